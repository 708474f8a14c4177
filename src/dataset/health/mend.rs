//! Mends what can be mended without loss: leftovers are deleted, lost manifests and configs made again, and files that are not
//! what they should be set aside, so that the stage that made them makes them again. Nothing else is deleted.

use std::io;
use std::path::{Path, PathBuf};

use fs_err as fs;
use rayon::prelude::*;

use super::entries::difference;
use super::folder::{listed, unfinished, unknown_episodes, written};
use super::maker::{ConfigFile, Maker, Plans};
use super::rebuild::{count, entry_of, is_of_a_set, names_of, plans_for, rebuild};
use crate::dataset::DatasetError;
use crate::episode::manifest::{EpisodeEntry, Manifest};
use crate::episode::{EpisodeMeta, EpisodeReader, check_archive};
use crate::files::{self, FolderLock, give_final_name, is_lock, write_atomic};
use crate::progress::Progress;
use crate::store;

/// Where files go that are not what they should be, in the data set's folder.
const SET_ASIDE: &str = "set_aside";

/// Mends a data set's folder; returns what was done, a sentence each.
///
/// # Errors
/// No data set; another process writes there; the disk fails.
pub fn mend(path: &Path, progress: &dyn Progress) -> Result<Vec<String>, DatasetError> {
    // Taking a lock makes a folder, which is only right in a data set's.
    if let Err(error) = Manifest::read(path)
        && !is_of_a_set(path, &error)
    {
        return Err(error.into());
    }
    let locks = lock_all(path)?;
    let mut done = Vec::new();
    for leftover in unfinished(path)? {
        if leftover.is_dir() {
            fs::remove_dir_all(&leftover)?;
        } else {
            fs::remove_file(&leftover)?;
        }
        done.push(format!("deleted what a run left unfinished: {}", leftover.display()));
    }
    if let Some(manifest) = mend_manifest(path, &mut done)? {
        mend_config(path, &manifest, &mut done)?;
        mend_episodes(path, manifest, &mut done, progress)?;
    }
    drop(locks);
    Ok(done)
}

/// The right to write in all folders of the set. A lock that nobody holds is taken over, and is gone afterwards.
fn lock_all(path: &Path) -> io::Result<Vec<FolderLock>> {
    let mut locks = vec![FolderLock::take(path)?];
    for folder in written(path)?.into_iter().skip(1) {
        for lock in listed(&folder)?.into_iter().filter(|file| is_lock(file)) {
            let name = lock.file_name().unwrap_or_default().to_string_lossy().into_owned();
            locks.push(FolderLock::take_named(&folder, &name)?);
        }
    }
    Ok(locks)
}

/// The manifest, made anew where it was lost; `None` where it cannot be.
fn mend_manifest(path: &Path, done: &mut Vec<String>) -> Result<Option<Manifest>, DatasetError> {
    match Manifest::read(path) {
        Ok(manifest) => return Ok(Some(manifest)),
        Err(error) if !is_of_a_set(path, &error) => return Err(error.into()),
        Err(_) => {}
    }
    let rebuilt = rebuild(path)?;
    if rebuilt.doubt.is_some() {
        return Ok(None);
    }
    let file = path.join(Manifest::FILE);
    if files::is_file(&file)? {
        let aside = set_aside(path, &file)?;
        done.push(format!("set the broken {} aside: {}", Manifest::FILE, aside.display()));
    }
    rebuilt.manifest.write(path)?;
    done.push(format!(
        "made {} anew of the config and {} whole episodes, as that of a whole data set; a shard is made again by `harmzone gen \
         --shard` with --force",
        Manifest::FILE,
        rebuilt.manifest.episodes.len()
    ));
    Ok(Some(rebuilt.manifest))
}

/// Writes the config again that the manifest names, if an episode has it word by word, but for the hashes of a user's maps.
fn mend_config(path: &Path, manifest: &Manifest, done: &mut Vec<String>) -> io::Result<()> {
    let config = ConfigFile::find(path)?;
    if config.as_ref().is_some_and(|config| config.sha256 == manifest.config_sha256) {
        return Ok(());
    }
    // One that cannot be read has no config to give; that the disk fails is told where the episodes are mended.
    let meta_of =
        |entry: &EpisodeEntry| Some(EpisodeReader::open(&path.join(&entry.file)).ok()?.meta().clone());
    let with_text = |meta: EpisodeMeta| {
        let text = ConfigFile::text_for(&meta, &manifest.config_sha256)?;
        Some((meta, text))
    };
    let Some((meta, text)) = manifest.episodes.iter().filter_map(meta_of).find_map(with_text) else {
        return Ok(());
    };
    if let Some(config) = config {
        let aside = set_aside(path, &path.join(config.name))?;
        done.push(format!("set a {} aside that is not the data set's: {}", config.name, aside.display()));
    }
    let name = ConfigFile::name_for(&meta);
    write_atomic(&path.join(name), text.as_bytes())?;
    done.push(format!("wrote {name} again as episode `{}` has it", meta.name));
    Ok(())
}

/// What becomes of an episode that the manifest names.
enum State {
    /// It is as the manifest says.
    Whole,
    /// It is whole, and says this of itself.
    Corrected(Box<EpisodeEntry>, String),
    Missing,
    /// It is not what the manifest says, or nobody can read it: why.
    Torn(String),
}

fn mend_episodes(
    path: &Path,
    mut manifest: Manifest,
    done: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<(), DatasetError> {
    let config = ConfigFile::find(path)?;
    let maker = Maker::of(config.as_ref(), &manifest.config_sha256);
    let unknown = unknown_episodes(path, &manifest)?;
    let part = manifest.part;
    let plans = if let Some(part) = part {
        maker.plans(part.n_episodes)
    } else {
        let known = manifest.episodes.iter().map(|entry| entry.name.clone());
        plans_for(&maker, &known.chain(names_of(&unknown)).collect::<Vec<_>>())
    };
    progress.start("mend", manifest.episodes.len() as u64);
    let states: Vec<State> = manifest
        .episodes
        .par_iter()
        .map(|entry| {
            let state = state_of(path, entry, &maker, &plans);
            progress.advance(1);
            state
        })
        .collect::<io::Result<_>>()?;
    progress.finish();
    let are_away = !states.is_empty() && states.iter().all(|state| matches!(state, State::Missing));
    if are_away && unknown.is_empty() {
        // What it says of splits and order stands nowhere else.
        tracing::warn!(
            "{} stays as it is: not one of its {} episodes is there; if they lie on another disk, attach it, else `harmzone gen` or \
             `import` makes them again",
            Manifest::FILE,
            states.len()
        );
        return Ok(());
    }
    let n_before = done.len();
    let before: Vec<String> = manifest.episodes.iter().map(|entry| entry.name.clone()).collect();
    let mut kept = Vec::new();
    for (entry, state) in std::mem::take(&mut manifest.episodes).into_iter().zip(states) {
        match state {
            State::Whole => kept.push(entry),
            State::Corrected(corrected, what) => {
                done.push(format!("corrected what {} says of `{}`: {what}", Manifest::FILE, entry.name));
                kept.push(*corrected);
            }
            State::Missing => {
                done.push(format!("took `{}` out of {}: its file is not there", entry.name, Manifest::FILE));
            }
            State::Torn(why) => {
                let aside = set_aside(path, &path.join(&entry.file))?;
                done.push(format!("set `{}` aside ({why}): {}", entry.name, aside.display()));
            }
        }
    }
    // Of a shard's plan most episodes are others'.
    let is_ours = |place: usize| part.is_none_or(|part| part.shard.holds(place as u32));
    let is_planned = |entry: &EpisodeEntry| plans.get(&entry.name).is_some_and(|(place, _)| is_ours(*place));
    for file in unknown {
        match entry_of(path, &file, &maker, &plans)? {
            Some((entry, _)) if is_planned(&entry) && kept.iter().all(|other| other.name != entry.name) => {
                done.push(format!(
                    "entered `{}`, which is whole and planned, into {}",
                    entry.name,
                    Manifest::FILE
                ));
                kept.push(entry);
            }
            _ => {
                let aside = set_aside(path, &path.join(&file))?;
                done.push(format!(
                    "set {file} aside, which {} does not name: {}",
                    Manifest::FILE,
                    aside.display()
                ));
            }
        }
    }
    if done.len() == n_before {
        return Ok(());
    }
    // Others than `gen` have an order of their own.
    if kept.iter().all(is_planned) {
        kept.sort_by_key(|entry| plans[&entry.name].0);
    }
    if !before.iter().all(|name| kept.iter().any(|entry| entry.name == *name)) {
        let aside = free_name(path, &path.join(Manifest::FILE))?;
        write_atomic(&aside, &fs::read(path.join(Manifest::FILE))?)?;
        done.push(format!("kept {} as it was: {}", Manifest::FILE, aside.display()));
    }
    manifest.episodes = kept;
    Ok(manifest.write(path)?)
}

/// # Errors
/// The disk does not answer.
fn state_of(path: &Path, entry: &EpisodeEntry, maker: &Maker, plans: &Plans) -> io::Result<State> {
    let file = path.join(&entry.file);
    if !store::is_there(&file)? {
        return Ok(State::Missing);
    }
    if store::sha256_of(&file)? != entry.sha256 {
        return Ok(State::Torn(format!("its hash is another than {} says", Manifest::FILE)));
    }
    let read = check_archive(&file).and_then(|_| EpisodeReader::open(&file)).and_then(|reader| {
        let counts = count(&reader)?;
        Ok((reader, counts))
    });
    let (reader, n_objects) = match read {
        Ok(read) => read,
        Err(error) if error.is_of_system() => return Err(io::Error::other(error)),
        Err(error) => return Ok(State::Torn(error.to_string())),
    };
    let meta = reader.meta();
    if meta.name != entry.name {
        return Ok(State::Torn(format!("it is episode `{}`", meta.name)));
    }
    if !maker.has_made(meta) {
        return Ok(State::Torn("it was made by another config".to_owned()));
    }
    let corrected = EpisodeEntry {
        split: plans.get(&entry.name).map_or(entry.split, |(_, split)| *split),
        seed: meta.seed,
        town: meta.town.clone(),
        weather: meta.weather.clone(),
        ood: meta.ood,
        n_samples: reader.len(),
        n_objects,
        ..entry.clone()
    };
    if corrected == *entry {
        return Ok(State::Whole);
    }
    let what = difference(entry, &reader, &n_objects).map_or_else(
        || format!("split {}, and not {}", corrected.split.name(), entry.split.name()),
        |(key, told, found)| format!("{key} {found}, and not {told}"),
    );
    Ok(State::Corrected(Box::new(corrected), what))
}

/// Moves a file out of the way, under a name that is free; returns where it is.
fn set_aside(path: &Path, file: &Path) -> io::Result<PathBuf> {
    let free = free_name(path, file)?;
    give_final_name(file, &free)?;
    Ok(free)
}

/// Where a file may lie that is set aside.
fn free_name(path: &Path, file: &Path) -> io::Result<PathBuf> {
    let folder = path.join(SET_ASIDE);
    fs::create_dir_all(&folder)?;
    let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let names = std::iter::once(name.clone()).chain((2..).map(|n| format!("{name}.{n}")));
    for free in names.map(|name| folder.join(name)) {
        match fs::symlink_metadata(&free) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(free),
            found => found.map(drop)?,
        }
    }
    unreachable!("there are names without end")
}

#[cfg(test)]
mod tests;
