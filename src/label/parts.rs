//! Parts of a label set: `part-I-of-N.json` beside the labels for each one that a process of its own has labelled, and
//! `part-so-far..json` for what a run has labelled while it goes on, until the whole set is joined.

use std::cmp::Reverse;
use std::collections::{HashMap, HashSet};
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use fs_err as fs;

use super::LabelError;
use super::episode::LabelledEpisode;
use crate::episode::Shard;
use crate::episode::manifest::{LabelManifest, Manifest};
use crate::files::{is_file_name, read_sealed, remove_if_there, write_manifest};
use crate::store;

const PREFIX: &str = "part-";

/// Share of the time that noting what is labelled so far may take.
const NOTING_SHARE: u32 = 20;

fn path_of(folder: &Path, shard: Shard) -> PathBuf {
    folder.join(format!("{PREFIX}{}-of-{}.json", shard.index, shard.of))
}

fn path_so_far(folder: &Path, shard: Option<Shard>) -> PathBuf {
    // After the names of whole parts, which are taken first.
    folder.join(match shard {
        None => format!("{PREFIX}so-far.json"),
        Some(Shard { index, of }) => format!("{PREFIX}so-far-{index}-of-{of}.json"),
    })
}

/// Notes that a part of the set in this folder is whole.
pub(super) fn write(folder: &Path, shard: Shard, part: &LabelManifest) -> Result<(), LabelError> {
    write_manifest(&path_of(folder, shard), part)?;
    Ok(remove_if_there(&path_so_far(folder, Some(shard)))?)
}

/// What a run has labelled so far, in no order, noted beside the labels with the hash of each: the same command goes on with it
/// after a kill.
pub(super) struct LabelledSoFar<'a> {
    pub labels: LabelManifest,
    folder: &'a Path,
    shard: Option<Shard>,
    /// When it is noted again, if an episode comes.
    rest_until: Option<Instant>,
}

impl<'a> LabelledSoFar<'a> {
    /// `labels`: the set without episodes; `parts`: what is there of it.
    pub(super) fn new(
        labels: LabelManifest,
        parts: Vec<LabelManifest>,
        folder: &'a Path,
        shard: Option<Shard>,
    ) -> Self {
        let mut so_far = Self { labels, folder, shard, rest_until: None };
        for part in parts {
            so_far.labels.counts.add_all(&part.counts);
            so_far.labels.episodes.extend(part.episodes);
        }
        so_far
    }

    /// Adds an episode whose file is whole. A killed run loses at most what came since the last note, twenty times as long ago
    /// as that took.
    pub(super) fn add(&mut self, (entry, counts): LabelledEpisode) -> Result<(), LabelError> {
        self.labels.counts.add_all(&counts);
        self.labels.episodes.push(entry);
        let begin = Instant::now();
        if self.rest_until.is_none_or(|until| begin >= until) {
            self.note()?;
            let pause = begin.elapsed().max(Duration::from_millis(50)) * NOTING_SHARE;
            self.rest_until = Some(Instant::now() + pause);
        }
        Ok(())
    }

    /// Notes it, if there is anything.
    pub(super) fn note(&self) -> Result<(), LabelError> {
        if self.labels.episodes.is_empty() {
            return Ok(());
        }
        Ok(write_manifest(&path_so_far(self.folder, self.shard), &self.labels)?)
    }
}

/// The names of a part's episodes.
fn names_of(shard: Shard, dataset: &Manifest) -> HashSet<&str> {
    let of_shard = (0..).zip(&dataset.episodes).filter(|(number, _)| shard.holds(*number));
    of_shard.map(|(_, entry)| entry.name.as_str()).collect()
}

fn is_of(part: &LabelManifest, names: &HashSet<&str>) -> bool {
    part.episodes.iter().all(|entry| names.contains(entry.name.as_str()))
}

/// What runs that were to label this part have left of it, if all that is of the part still: where episodes were added since, it may be
/// of others. A part that was whole before is such a beginning, too. Else as [`find`].
pub(super) fn find_so_far(
    folder: &Path,
    shard: Shard,
    zone_toml: &str,
    dataset: &Manifest,
) -> Option<LabelManifest> {
    let (names, hashes) = (names_of(shard, dataset), dataset.hash_of_name());
    let paths = [path_of(folder, shard), path_so_far(folder, Some(shard))];
    let found = paths.iter().filter_map(|path| read_whole(path, folder, zone_toml, &hashes));
    found.filter(|part| is_of(part, &names)).max_by_key(|part| part.episodes.len())
}

/// A part of the set, if it is as it was written, by this zone, and has all episodes of the part and no others.
pub(super) fn find(
    folder: &Path,
    shard: Shard,
    zone_toml: &str,
    dataset: &Manifest,
) -> Option<LabelManifest> {
    let names = names_of(shard, dataset);
    let part = read_whole(&path_of(folder, shard), folder, zone_toml, &dataset.hash_of_name())?;
    (part.episodes.len() == names.len() && is_of(&part, &names)).then_some(part)
}

/// All such parts, the largest first: what a whole run has noted holds the parts that it began with. No episode is in two of them.
pub(super) fn find_all(
    folder: &Path,
    zone_toml: &str,
    dataset: &Manifest,
) -> Result<Vec<LabelManifest>, LabelError> {
    let hashes = dataset.hash_of_name();
    let mut found: Vec<LabelManifest> = Vec::new();
    let mut known: HashSet<String> = HashSet::new();
    let read = |path: PathBuf| read_whole(&path, folder, zone_toml, &hashes);
    let mut parts: Vec<LabelManifest> = paths(folder)?.into_iter().filter_map(read).collect();
    // Those of one size stay in the order of their names.
    parts.sort_by_key(|part| Reverse(part.episodes.len()));
    for part in parts {
        // Parts of another count overlap with these.
        if !part.episodes.iter().any(|entry| known.contains(&entry.name)) {
            known.extend(part.episodes.iter().map(|entry| entry.name.clone()));
            found.push(part);
        }
    }
    Ok(found)
}

/// Forgets the parts: the set is whole.
pub(super) fn remove_all(folder: &Path) -> Result<(), LabelError> {
    // A run beside this one may have removed some.
    Ok(paths(folder)?.iter().try_for_each(|path| remove_if_there(path))?)
}

fn paths(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if name.starts_with(PREFIX) && path.extension().is_some_and(|suffix| suffix == "json") {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// `hashes`: the content hash of each of the data set's episodes by its name.
fn read_whole(
    path: &Path,
    folder: &Path,
    zone_toml: &str,
    hashes: &HashMap<&str, &str>,
) -> Option<LabelManifest> {
    let part: LabelManifest = serde_json::from_str(&read_sealed(path).ok()?).ok()?;
    let is_whole = part.zone_toml == zone_toml
        && part.generator_version == env!("CARGO_PKG_VERSION")
        && part.episodes.iter().all(|label| {
            is_file_name(&label.file)
                && hashes.get(label.name.as_str()) == Some(&label.episode_sha256.as_str())
                && store::has(&folder.join(&label.file), &label.sha256).is_ok_and(|is_whole| is_whole)
        });
    is_whole.then_some(part)
}
