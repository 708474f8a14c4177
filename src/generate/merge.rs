//! Joins the shards of a data set to the whole: the same files, labels and manifest as one run of `gen` would have made.
//!
//! Nothing is made or changed; each file is checked against its hash, then linked (or copied, where the shard lies on another
//! disk). `dataset.json` comes last, so an interrupted merge is no data set, and the same command again goes on.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use fs_err as fs;
use rayon::prelude::*;
use serde::Serialize;
use thiserror::Error;

use super::aov::find_whole;
use super::folder::{CONFIG_FILE, OWN_MODELS};
use super::{CheckedConfig, GenerateConfig, GenerateError, plan};
use crate::config::{self, ConfigError};
use crate::episode::folder::{AOV, is_whole, remove_unfinished};
use crate::episode::manifest::{LabelCounts, label_sets};
use crate::episode::{EpisodeEntry, LabelManifest, Manifest, ManifestError, Shard, label_command, zone_in};
use crate::files::{self, FolderLock, bytes_to_copy, check_room, holds_anything, sha256_hex, write_atomic};
use crate::interrupt;
use crate::progress::Progress;
use crate::store::{link_or_copy, sha256_of};

/// Episodes that are named where many are missing.
const MOST_NAMED: usize = 5;

/// Why shards could not be joined.
#[derive(Debug, Error)]
pub enum MergeError {
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    #[error(transparent)]
    Config(#[from] ConfigError),
    #[error(transparent)]
    Generate(#[from] GenerateError),
    #[error(transparent)]
    Io(#[from] io::Error),
    #[error("a whole data set; shards are needed, which `harmzone gen --shard I/N` makes: {}", path.display())]
    NoShard { path: PathBuf },
    #[error("shards of two data sets: another {what} (found {found}, wanted {wanted} as in {}): {}", first.display(), path.display())]
    Other { what: &'static str, found: String, wanted: String, first: PathBuf, path: PathBuf },
    #[error("shard {shard} is given twice: {} and {}", first.display(), path.display())]
    Twice { shard: Shard, first: PathBuf, path: PathBuf },
    #[error("the manifest names an episode that is not of shard {shard}: `{episode}`: {}", path.display())]
    Stranger { episode: String, shard: Shard, path: PathBuf },
    #[error("{n} of {of} episodes are missing ({}); to make them:\n{}", names(named, *n), commands.join("\n"))]
    Missing { n: usize, of: usize, named: Vec<String>, commands: Vec<String> },
    #[error("{} is not as it was written, its hash is another; `harmzone gen` with the shard's own command makes it anew: {}", what, path.display())]
    Torn { what: String, path: PathBuf },
    #[error(
        "further pictures of episode `{episode}` are missing (render.aov); `harmzone gen` with the shard's own command makes it \
         anew: {}", path.display()
    )]
    NoPictures { episode: String, path: PathBuf },
    #[error("label set `{set}` is not in every shard; to make it, or take it away elsewhere:\n{}", commands.join("\n"))]
    Labels { set: String, commands: Vec<String> },
    #[error("the folder holds other things than this merge; give a new folder: {}", path.display())]
    ForeignFolder { path: PathBuf },
    #[error(
        "the folder holds a data set of {found} episodes, and this merge has {wanted}, without some of them; give a new folder: {}",
        path.display()
    )]
    Larger { found: usize, wanted: usize, path: PathBuf },
}

fn names(named: &[String], n: usize) -> String {
    let more = if n > named.len() { ", .." } else { "" };
    format!("{}{more}", named.join(", "))
}

/// The result of a merge.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct MergeSummary {
    pub folder: PathBuf,
    pub n_shards: usize,
    pub n_episodes: usize,
    pub n_samples: usize,
    pub label_sets: Vec<String>,
}

impl fmt::Display for MergeSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.folder.display())?;
        writeln!(f, "  shards    {}", self.n_shards)?;
        writeln!(f, "  episodes  {}", self.n_episodes)?;
        writeln!(f, "  samples   {}", self.n_samples)?;
        let sets = if self.label_sets.is_empty() { "none".to_owned() } else { self.label_sets.join(", ") };
        writeln!(f, "  labels    {sets}")
    }
}

/// A shard's folder and what it says of itself.
struct ShardFolder {
    path: PathBuf,
    shard: Shard,
    manifest: Manifest,
}

/// Joins shards in `out`.
///
/// # Errors
/// [`MergeError`]: not shards, not of one data set, a shard twice, missing episodes, a torn file, or labels of some only. Nothing is
/// written then but files of whole episodes.
pub fn merge(shards: &[PathBuf], out: &Path, progress: &dyn Progress) -> Result<MergeSummary, MergeError> {
    let (shards, n_episodes) = read(shards)?;
    let first = &shards[0];
    let config_path = first.path.join(CONFIG_FILE);
    let config_toml = fs::read_to_string(&config_path)?;
    let config: GenerateConfig = config::load(Some(&config_path), &[])?;
    let plans = plan(&CheckedConfig::try_from(&config)?, n_episodes);

    let mut of_name: BTreeMap<&str, (&ShardFolder, &EpisodeEntry)> = BTreeMap::new();
    let number_of: BTreeMap<&str, u32> = plans.iter().map(|plan| plan.name.as_str()).zip(0..).collect();
    for shard in &shards {
        for entry in &shard.manifest.episodes {
            if !number_of.get(entry.name.as_str()).is_some_and(|&i| shard.shard.holds(i)) {
                let (episode, path) = (entry.name.clone(), shard.path.clone());
                return Err(MergeError::Stranger { episode, shard: shard.shard, path });
            }
            of_name.insert(&entry.name, (shard, entry));
        }
    }
    let missing: Vec<&str> =
        plans.iter().map(|plan| plan.name.as_str()).filter(|name| !of_name.contains_key(name)).collect();
    if !missing.is_empty() {
        let of = missing.iter().map(|name| number_of[name]);
        return Err(missing_error(&shards, &missing, of, n_episodes, &config));
    }
    let ordered: Vec<(&ShardFolder, &EpisodeEntry)> =
        plans.iter().map(|plan| of_name[plan.name.as_str()]).collect();
    let sets = common_label_sets(&shards)?;
    let labels: Vec<(LabelManifest, Vec<PathBuf>)> =
        sets.iter().map(|set| join_labels(set, &shards, &ordered)).collect::<Result<_, _>>()?;
    let _lock = FolderLock::take(out)?;
    open(out, &config_toml, &number_of)?;
    remove_unfinished(out)?;

    let episodes = ordered.iter().map(|(shard, entry)| (shard.path.join(&entry.file), out.join(&entry.file)));
    let of_labels = labels.iter().flat_map(|(manifest, files)| {
        let folder = LabelManifest::folder(out, &manifest.set);
        files
            .iter()
            .zip(&manifest.episodes)
            .map(move |(from, entry)| (from.clone(), folder.join(&entry.file)))
    });
    let files: Vec<(PathBuf, PathBuf)> = episodes.chain(of_labels).collect();
    check_room(out, bytes_to_copy(out, files.iter().map(|(from, to)| (from.as_path(), to.as_path()))))?;

    let n_files = ordered.len() * (1 + sets.len());
    progress.start("merge", n_files as u64);
    ordered.par_iter().try_for_each(|(shard, entry)| {
        interrupt::check()?;
        if !is_whole(&shard.path, entry)? {
            let path = shard.path.join(&entry.file);
            return Err(MergeError::Torn { what: format!("episode `{}`", entry.name), path });
        }
        link_or_copy(&shard.path.join(&entry.file), &out.join(&entry.file))?;
        if config.render.aov {
            let Some(pictures) = find_whole(&shard.path, entry, config.rig.cameras.len())? else {
                let path = shard.path.join(AOV).join(&entry.name);
                return Err(MergeError::NoPictures { episode: entry.name.clone(), path });
            };
            for file in pictures {
                link_or_copy(&shard.path.join(&file), &out.join(&file))?;
            }
        }
        progress.advance(1);
        Ok(())
    })?;
    for (manifest, files) in &labels {
        let folder = LabelManifest::folder(out, &manifest.set);
        fs::create_dir_all(&folder)?;
        manifest.episodes.par_iter().zip(files).try_for_each(|(entry, from)| {
            if sha256_of(from)? != entry.sha256 {
                let what = format!("the labels of `{}`", entry.name);
                return Err(MergeError::Torn { what, path: from.clone() });
            }
            link_or_copy(from, &folder.join(&entry.file))?;
            progress.advance(1);
            Ok(())
        })?;
        manifest.write(out)?;
    }
    let own_models = first.path.join(OWN_MODELS);
    if files::is_dir(&own_models)? {
        copy_folder(&own_models, &out.join(OWN_MODELS))?;
    }
    let episodes: Vec<EpisodeEntry> = ordered.iter().map(|(_, entry)| (*entry).clone()).collect();
    let mut manifest = Manifest { part: None, episodes, ..first.manifest.clone() };
    for made_with in shards.iter().flat_map(|shard| &shard.manifest.made_with) {
        manifest.add_made_with(made_with.clone());
    }
    manifest.write(out)?;
    progress.finish();
    Ok(MergeSummary {
        folder: out.to_owned(),
        n_shards: shards.len(),
        n_episodes: manifest.episodes.len(),
        n_samples: manifest.episodes.iter().map(|entry| entry.n_samples).sum(),
        label_sets: sets,
    })
}

/// The shards in their order, and how many episodes the whole has; refuses what does not belong together.
fn read(paths: &[PathBuf]) -> Result<(Vec<ShardFolder>, u32), MergeError> {
    let mut shards: Vec<ShardFolder> = Vec::new();
    let mut n_episodes = 0;
    for path in paths {
        let manifest = Manifest::read(path)?;
        let Some(part) = manifest.part else { return Err(MergeError::NoShard { path: path.clone() }) };
        let hash = sha256_hex(&fs::read(path.join(CONFIG_FILE))?);
        if hash != manifest.config_sha256 {
            return Err(MergeError::Torn { what: CONFIG_FILE.to_owned(), path: path.join(CONFIG_FILE) });
        }
        if let Some(first) = shards.first() {
            let facts = |of: &Manifest, n: u32, parts: u32| {
                [
                    ("config (its hash)", of.config_sha256.clone()),
                    ("version of harmzone", of.generator_version.clone()),
                    ("version of the data", of.format_version.to_string()),
                    ("number of episodes", n.to_string()),
                    ("number of shards", parts.to_string()),
                ]
            };
            let wanted = facts(&first.manifest, n_episodes, first.shard.of);
            let found = facts(&manifest, part.n_episodes, part.shard.of);
            if let Some(((what, found), (_, wanted))) = found.into_iter().zip(wanted).find(|(a, b)| a != b) {
                let (first, path) = (first.path.clone(), path.clone());
                return Err(MergeError::Other { what, found, wanted, first, path });
            }
        }
        if let Some(same) = shards.iter().find(|other| other.shard == part.shard) {
            let (first, path) = (same.path.clone(), path.clone());
            return Err(MergeError::Twice { shard: part.shard, first, path });
        }
        n_episodes = part.n_episodes;
        shards.push(ShardFolder { path: path.clone(), shard: part.shard, manifest });
    }
    shards.sort_by_key(|shard| shard.shard);
    Ok((shards, n_episodes))
}

/// Tells what is missing, and the commands that make it: one for each shard that is not whole.
fn missing_error(
    shards: &[ShardFolder],
    missing: &[&str],
    numbers: impl Iterator<Item = u32>,
    n_episodes: u32,
    config: &GenerateConfig,
) -> MergeError {
    let (first, of) = (&shards[0], shards[0].shard.of);
    let wanting: BTreeSet<u32> = numbers.map(|number| number % of).collect();
    let models = if config.scene.own_models.is_empty() { "" } else { " --models DIR" };
    let commands = wanting.into_iter().map(|index| {
        let known = shards.iter().find(|shard| shard.shard.index == index);
        let folder = known.map_or_else(|| format!("SHARD_{index}"), |shard| shard.path.display().to_string());
        let config = first.path.join(CONFIG_FILE);
        format!(
            "harmzone gen --config {} --episodes {n_episodes} --shard {index}/{of}{models} --out {folder}",
            config.display()
        )
    });
    MergeError::Missing {
        n: missing.len(),
        of: n_episodes as usize,
        named: missing.iter().take(MOST_NAMED).map(|name| (*name).to_owned()).collect(),
        commands: commands.collect(),
    }
}

/// The label sets, which every shard must have.
fn common_label_sets(shards: &[ShardFolder]) -> Result<Vec<String>, MergeError> {
    // A shard without episodes has nothing to label.
    let with_episodes = shards.iter().filter(|shard| !shard.manifest.episodes.is_empty());
    let sets_of: Vec<(&ShardFolder, Vec<String>)> =
        with_episodes.map(|shard| Ok((shard, label_sets(&shard.path)?))).collect::<io::Result<_>>()?;
    let all: BTreeSet<String> = sets_of.iter().flat_map(|(_, sets)| sets).cloned().collect();
    for set in &all {
        let without = sets_of.iter().filter(|(_, sets)| !sets.contains(set)).map(|(shard, _)| *shard);
        let without: Vec<&ShardFolder> = without.collect();
        if !without.is_empty() {
            let with = sets_of.iter().find(|(_, sets)| sets.contains(set));
            let labels = with.and_then(|(shard, _)| LabelManifest::read(&shard.path, set).ok());
            let zone = labels.and_then(|labels| zone_in(&labels.zone_toml));
            let command = |shard: &&ShardFolder| label_command(&shard.path, set, zone.as_ref());
            let commands = without.iter().map(command).collect();
            return Err(MergeError::Labels { set: set.clone(), commands });
        }
    }
    Ok(all.into_iter().collect())
}

/// A set's manifest for the whole, and its files in the same order.
fn join_labels(
    set: &str,
    shards: &[ShardFolder],
    ordered: &[(&ShardFolder, &EpisodeEntry)],
) -> Result<(LabelManifest, Vec<PathBuf>), MergeError> {
    let mut joined: Option<LabelManifest> = None;
    let mut counts = LabelCounts::default();
    let mut of_name = BTreeMap::new();
    for shard in shards.iter().filter(|shard| !shard.manifest.episodes.is_empty()) {
        let labels = LabelManifest::read(&shard.path, set)?;
        if let Some(first) = joined.as_ref().filter(|first| first.zone_toml != labels.zone_toml) {
            let (found, wanted) =
                crate::episode::folder::first_difference(&labels.zone_toml, &first.zone_toml)
                    .expect("the texts differ");
            let path = LabelManifest::folder(&shard.path, set);
            let first = LabelManifest::folder(&shards[0].path, set);
            return Err(MergeError::Other { what: "zone", found, wanted, first, path });
        }
        counts.add_all(&labels.counts);
        let folder = LabelManifest::folder(&shard.path, set);
        for entry in &labels.episodes {
            of_name.insert(entry.name.clone(), (folder.join(&entry.file), entry.clone()));
        }
        joined.get_or_insert(LabelManifest { episodes: Vec::new(), ..labels });
    }
    let mut joined = joined.expect("a set is of some shard");
    let mut files = Vec::new();
    for (shard, entry) in ordered {
        let of_episode =
            of_name.remove(&entry.name).filter(|(_, label)| label.episode_sha256 == entry.sha256);
        let Some((path, label)) = of_episode else {
            let command = label_command(&shard.path, set, zone_in(&joined.zone_toml).as_ref());
            let commands = vec![format!("{command} --force")];
            return Err(MergeError::Labels { set: set.to_owned(), commands });
        };
        files.push(path);
        joined.episodes.push(label);
    }
    joined.counts = counts;
    Ok((joined, files))
}

/// Prepares the folder: a new one, or that of an earlier, equal merge. `number_of`: the episodes of this one by name.
fn open(out: &Path, config_toml: &str, number_of: &BTreeMap<&str, u32>) -> Result<(), MergeError> {
    let path = out.join(CONFIG_FILE);
    let is_ours = fs::read_to_string(&path).is_ok_and(|found| found == config_toml);
    let is_used = holds_anything(out)?;
    // A shard's own folder has its config, too, and is not to become the whole.
    let found = Manifest::read(out).ok();
    let is_shard = found.as_ref().is_some_and(|manifest| manifest.part.is_some());
    if is_used && (!is_ours || is_shard) {
        return Err(MergeError::ForeignFolder { path: out.to_owned() });
    }
    let is_lacking = |entry: &EpisodeEntry| !number_of.contains_key(entry.name.as_str());
    if let Some(found) = found.filter(|manifest| manifest.episodes.iter().any(is_lacking)) {
        let (found, wanted) = (found.episodes.len(), number_of.len());
        return Err(MergeError::Larger { found, wanted, path: out.to_owned() });
    }
    fs::create_dir_all(out)?;
    Ok(write_atomic(&path, config_toml.as_bytes())?)
}

fn copy_folder(from: &Path, to: &Path) -> io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let to = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            copy_folder(&entry.path(), &to)?;
        } else {
            link_or_copy(&entry.path(), &to)?;
        }
    }
    Ok(())
}
