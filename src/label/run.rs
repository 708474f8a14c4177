//! Labels a whole data set: one file per episode under `labels/<set>/`, and `labels.json` last.
//!
//! `labels.json` is written when every episode is done, so a set without it is unfinished and is made anew.

use std::collections::BTreeMap;
use std::path::Path;

use fs_err as fs;
use rayon::prelude::*;

use super::LabelError;
use super::counts::LabelSummary;
use super::episode::{LabelledEpisode, label_episode};
use super::parts;
use super::worker::{self, LabelJob};
use crate::config;
use crate::episode::manifest::{EpisodeEntry, LabelEntry, LabelManifest, Manifest};
use crate::episode::{Shard, is_any_annotated};
use crate::files::{FolderLock, PARTIAL_SUFFIX, is_file, remove_unfinished};
use crate::interrupt;
use crate::progress::Progress;
use crate::store;
use crate::worker::{Engine, Program};
use crate::zone::{Zone, ZoneConfig};

/// How a data set is labelled; this does not change the labels.
#[derive(Debug, Clone, Copy, Default)]
pub struct LabelOptions<'a> {
    /// Whether a set of another zone or of other episodes may be replaced.
    pub force: bool,
    /// Only this part of the episodes: the set is whole when a run without it has joined all parts.
    pub shard: Option<Shard>,
    /// Who labels; `None`: this process.
    pub workers: Option<(&'a Engine, &'a Program)>,
}

/// Labels every annotated object of a data set, in this process.
///
/// # Errors
/// As [`run_with`].
pub fn run(
    dataset: &Path,
    zone_config: &ZoneConfig,
    set: &str,
    force: bool,
    progress: &dyn Progress,
) -> Result<LabelSummary, LabelError> {
    run_with(dataset, zone_config, set, &LabelOptions { force, ..LabelOptions::default() }, progress)
}

/// Labels every annotated object of a data set, or of a part of its episodes.
///
/// A set that is complete and of the same zone is left as it is and its counts are returned. Parts that are there are
/// joined: only what they lack is labelled.
///
/// # Errors
/// [`LabelError`]; a set of another zone or of other episodes is kept unless `options.force`.
pub fn run_with(
    dataset: &Path,
    zone_config: &ZoneConfig,
    set: &str,
    options: &LabelOptions<'_>,
    progress: &dyn Progress,
) -> Result<LabelSummary, LabelError> {
    let is_word = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    if set.is_empty() || !set.chars().all(is_word) {
        return Err(LabelError::SetName { found: set.to_owned() });
    }
    let zone = Zone::try_from(zone_config.clone())?;
    let zone_toml = config::to_toml(zone_config);
    let manifest = Manifest::read(dataset)?;
    if manifest.episodes.is_empty() {
        return Err(LabelError::NoEpisodes { path: dataset.to_owned() });
    }
    let folder = LabelManifest::folder(dataset, set);
    if !options.force
        && is_file(&folder.join(LabelManifest::FILE))?
        && let Some(done) = finished(LabelManifest::read(dataset, set)?, &manifest, zone_config, &folder)?
    {
        FolderLock::tidy(&folder);
        return Ok(summary(&done, true));
    }
    // Episodes without truth beside others get the zone and no labels.
    if !is_any_annotated(dataset, &manifest)? {
        return Err(LabelError::NoTruth { path: dataset.to_owned() });
    }
    let lock = match options.shard {
        None => FolderLock::take(&folder)?,
        Some(Shard { index, of }) => {
            FolderLock::take_named(&folder, &format!("writer-{index}-of-{of}.{PARTIAL_SUFFIX}"))?
        }
    };
    if options.shard.is_none() {
        remove_unfinished(&folder)?;
    }
    // Until the new files are complete, the set must not look finished.
    match fs::remove_file(folder.join(LabelManifest::FILE)) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error.into()),
        _ => {}
    }
    let parts = match options.shard {
        _ if options.force => Vec::new(),
        Some(shard) => match parts::find(&folder, shard, &zone_toml, &manifest) {
            Some(done) => return Ok(summary(&done, true)),
            None => Vec::new(),
        },
        None => parts::find_all(&folder, &zone_toml, &manifest)?,
    };
    let mut labels = LabelManifest::new(set, zone_toml, &manifest);
    let mut of_name: BTreeMap<String, LabelEntry> = BTreeMap::new();
    for part in parts {
        labels.counts.add_all(&part.counts);
        of_name.extend(part.episodes.into_iter().map(|entry| (entry.name.clone(), entry)));
    }
    let is_wanted = |i: usize| options.shard.is_none_or(|shard| shard.holds(i as u32));
    let todo: Vec<&EpisodeEntry> = manifest
        .episodes
        .iter()
        .enumerate()
        .filter(|(i, entry)| is_wanted(*i) && !of_name.contains_key(&entry.name))
        .map(|(_, entry)| entry)
        .collect();
    progress.start("label", todo.iter().map(|entry| entry.n_samples as u64).sum());
    let labelled: Vec<Result<LabelledEpisode, LabelError>> = match options.workers {
        None => {
            let label_one = |entry: &&EpisodeEntry| {
                interrupt::check()?;
                progress.note(&entry.name);
                label_episode(dataset, entry, &zone, set, &labels.zone_toml, &|| progress.advance(1))
            };
            // All are tried, so that of several broken episodes the first one is told.
            todo.par_iter().map(label_one).collect()
        }
        Some((engine, program)) => {
            let folder = fs::canonicalize(dataset)?;
            let job = LabelJob { folder, set: set.to_owned(), zone_toml: labels.zone_toml.clone() };
            worker::label_by(engine, program, &job, &todo, progress)?
        }
    };
    lock.check()?;
    for of_episode in labelled {
        let (entry, counts) = of_episode?;
        of_name.insert(entry.name.clone(), entry);
        labels.counts.add_all(&counts);
    }
    labels.episodes = manifest.episodes.iter().filter_map(|entry| of_name.remove(&entry.name)).collect();
    if let Some(shard) = options.shard {
        parts::write(&folder, shard, &labels)?;
    } else {
        labels.write(dataset)?;
        parts::remove_all(&folder)?;
    }
    progress.finish();
    Ok(summary(&labels, false))
}

/// The set as it is if there is nothing to do; `None` if episodes are missing from it.
fn finished(
    labels: LabelManifest,
    manifest: &Manifest,
    zone_config: &ZoneConfig,
    folder: &Path,
) -> Result<Option<LabelManifest>, LabelError> {
    let other = |what| LabelError::Other { set: labels.set.clone(), what, path: folder.to_owned() };
    // Parsed, not compared as text: a set made before a key existed was made with its default.
    if toml::from_str::<ZoneConfig>(&labels.zone_toml).ok().as_ref() != Some(zone_config) {
        return Err(other("another zone"));
    }
    let hashes = manifest.hash_of_name();
    let is_known =
        |entry: &LabelEntry| hashes.get(entry.name.as_str()) == Some(&entry.episode_sha256.as_str());
    if !labels.episodes.iter().all(is_known) {
        return Err(other("other episodes"));
    }
    let are_files_there = labels.episodes.iter().all(|entry| store::is_there(&folder.join(&entry.file)));
    let is_complete = are_files_there && labels.episodes.len() == manifest.episodes.len();
    Ok(is_complete.then_some(labels))
}

fn summary(labels: &LabelManifest, was_complete: bool) -> LabelSummary {
    LabelSummary {
        set: labels.set.clone(),
        was_complete,
        n_episodes: labels.episodes.len(),
        n_samples: labels.episodes.iter().map(|entry| entry.n_samples).sum(),
        counts: labels.counts,
    }
}
