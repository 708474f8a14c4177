//! Parts of a label set, each labelled in a process of its own: `part-I-of-N.json` beside the labels, until the whole set is joined.

use std::collections::{HashMap, HashSet};
use std::io;
use std::path::{Path, PathBuf};

use fs_err as fs;

use super::LabelError;
use crate::episode::Shard;
use crate::episode::manifest::{LabelManifest, Manifest};
use crate::files::{read_sealed, write_manifest};
use crate::store;

const PREFIX: &str = "part-";

fn path_of(folder: &Path, shard: Shard) -> PathBuf {
    folder.join(format!("{PREFIX}{}-of-{}.json", shard.index, shard.of))
}

/// Notes that a part of the set in this folder is whole.
pub(super) fn write(folder: &Path, shard: Shard, part: &LabelManifest) -> Result<(), LabelError> {
    Ok(write_manifest(&path_of(folder, shard), part)?)
}

/// A part of the set, if it is as it was written, by this zone and for these episodes.
pub(super) fn find(
    folder: &Path,
    shard: Shard,
    zone_toml: &str,
    dataset: &Manifest,
) -> Option<LabelManifest> {
    read_whole(&path_of(folder, shard), folder, zone_toml, &dataset.hash_of_name())
}

/// All such parts, in the order of their names. No episode is in two of them.
pub(super) fn find_all(
    folder: &Path,
    zone_toml: &str,
    dataset: &Manifest,
) -> Result<Vec<LabelManifest>, LabelError> {
    let hashes = dataset.hash_of_name();
    let mut found: Vec<LabelManifest> = Vec::new();
    let mut known: HashSet<String> = HashSet::new();
    for path in paths(folder)? {
        let Some(part) = read_whole(&path, folder, zone_toml, &hashes) else { continue };
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
    for path in paths(folder)? {
        fs::remove_file(path)?;
    }
    Ok(())
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
            hashes.get(label.name.as_str()) == Some(&label.episode_sha256.as_str())
                && store::has(&folder.join(&label.file), &label.sha256).is_ok_and(|is_whole| is_whole)
        });
    is_whole.then_some(part)
}
