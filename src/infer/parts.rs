//! Parts of the predictions for a data set, each made in a place of its own, and their join: the same files as one run writes.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use fs_err as fs;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::episode::{PartOf, Shard};
use crate::eval::json::{JsonError, RawSamples};
use crate::files::{FolderLock, holds_anything, is_file_name, read_sealed, sha256_of, write_sealed};
use crate::store;

/// The list of all boxes.
pub(super) const LIST_FILE: &str = "predictions.json";

/// `part.json`, beside the boxes of a part: what it is a part of.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PredictionPart {
    /// The part, and how many episodes all have.
    pub part: PartOf,
    pub generator_version: String,
    /// The data set and the split.
    pub data: PathBuf,
    pub data_sha256: String,
    pub split: String,
    /// The network, as the command names it, and the hash of its weights.
    pub network: String,
    pub network_sha256: String,
    /// In their order; filled in when the boxes are written.
    pub episodes: Vec<PredictedEpisode>,
}

/// One episode of a part.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PredictedEpisode {
    pub name: String,
    pub n_samples: usize,
    /// Content hash of its MCAP.
    pub sha256: String,
}

/// Why parts could not be joined.
#[derive(Debug, Error)]
pub enum JoinError {
    #[error(transparent)]
    Io(#[from] io::Error),
    #[error(transparent)]
    Json(#[from] JsonError),
    #[error("not a {}: {message}: {}", PredictionPart::FILE, path.display())]
    NotAPart { message: String, path: PathBuf },
    #[error("parts of other predictions: another {what} (found {found}, wanted {wanted} as in {}): {}", first.display(), path.display())]
    Other { what: &'static str, found: String, wanted: String, first: PathBuf, path: PathBuf },
    #[error("part {shard} is given twice: {} and {}", first.display(), path.display())]
    Twice { shard: Shard, first: PathBuf, path: PathBuf },
    #[error("{} of {of} parts are missing; to make them:\n{}", commands.len(), commands.join("\n"))]
    Missing { of: u32, commands: Vec<String> },
    #[error("{what} is not as it was written; `harmzone predict` with the part's own command and --force makes it anew: {}", path.display())]
    Torn { what: String, path: PathBuf },
    #[error("the folder holds other things already; give a new folder: {}", path.display())]
    Used { path: PathBuf },
}

/// The result of a join.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct JoinSummary {
    pub folder: PathBuf,
    pub n_parts: usize,
    pub n_episodes: usize,
    pub n_boxes: usize,
}

impl fmt::Display for JoinSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.folder.display())?;
        writeln!(f, "  parts     {}", self.n_parts)?;
        writeln!(f, "  episodes  {}", self.n_episodes)?;
        writeln!(f, "  boxes     {}", self.n_boxes)
    }
}

impl PredictionPart {
    /// Name of the file.
    pub const FILE: &str = "part.json";

    /// Whether a folder holds a part.
    #[must_use]
    pub fn is_in(folder: &Path) -> bool {
        folder.join(Self::FILE).is_file()
    }

    /// Writes it beside the boxes of these episodes, whose hashes it takes.
    ///
    /// # Errors
    /// A file cannot be read or written.
    pub fn write(mut self, folder: &Path, episodes: &[(&str, usize)]) -> io::Result<()> {
        for &(name, n_samples) in episodes {
            let sha256 = sha256_of(&folder.join(format!("{name}.mcap")))?;
            self.episodes.push(PredictedEpisode { name: name.to_owned(), n_samples, sha256 });
        }
        write_sealed(&folder.join(Self::FILE), &self)
    }

    fn read(folder: &Path) -> Result<Self, JoinError> {
        let path = folder.join(Self::FILE);
        let text = read_sealed(&path)?;
        let not_a_part = |message| JoinError::NotAPart { message, path: path.clone() };
        let part: Self = serde_json::from_str(&text).map_err(|error| not_a_part(error.to_string()))?;
        if let Some(entry) = part.episodes.iter().find(|entry| !is_file_name(&entry.name)) {
            return Err(not_a_part(format!("the episode's name `{}` is not that of a file", entry.name)));
        }
        Ok(part)
    }

    /// What all parts have in common, with its name.
    fn facts(&self) -> [(&'static str, String); 7] {
        [
            ("number of parts", self.part.shard.of.to_string()),
            ("number of episodes", self.part.n_episodes.to_string()),
            ("version of harmzone", self.generator_version.clone()),
            ("data set (its hash)", self.data_sha256.clone()),
            ("split", self.split.clone()),
            ("network", self.network.clone()),
            ("network (its hash)", self.network_sha256.clone()),
        ]
    }
}

/// Joins parts of predictions in `out`: the files that `harmzone predict` writes for all episodes.
///
/// # Errors
/// [`JoinError`]: not parts of one whole, one twice or missing, a torn file, a folder in use.
pub fn join(paths: &[PathBuf], out: &Path) -> Result<JoinSummary, JoinError> {
    let mut parts: BTreeMap<Shard, (PathBuf, PredictionPart)> = BTreeMap::new();
    for path in paths {
        let part = PredictionPart::read(path)?;
        if let Some((first, wanted)) = parts.values().next() {
            let pairs = part.facts().into_iter().zip(wanted.facts());
            if let Some(((what, found), (_, wanted))) = pairs.into_iter().find(|(a, b)| a != b) {
                return Err(JoinError::Other {
                    what,
                    found,
                    wanted,
                    first: first.clone(),
                    path: path.clone(),
                });
            }
        }
        let shard = part.part.shard;
        if let Some((first, _)) = parts.get(&shard) {
            return Err(JoinError::Twice { shard, first: first.clone(), path: path.clone() });
        }
        parts.insert(shard, (path.clone(), part));
    }
    let (_, first) = parts.values().next().expect("clap wants at least one part");
    let of = first.part.shard.of;
    let known: BTreeSet<u32> = parts.keys().map(|shard| shard.index).collect();
    let missing = (0..of).filter(|index| !known.contains(index)).map(|index| {
        let (network, data, split) = (&first.network, first.data.display(), &first.split);
        format!(
            "harmzone predict {network} --data {data} --split {split} --shard {index}/{of} --out PART_{index}"
        )
    });
    let commands: Vec<String> = missing.collect();
    if !commands.is_empty() {
        return Err(JoinError::Missing { of, commands });
    }
    let _lock = FolderLock::take(out)?;
    if holds_anything(out)? {
        return Err(JoinError::Used { path: out.to_owned() });
    }
    write_joined(&parts.into_values().collect::<Vec<_>>(), out)
}

/// Writes the joined files, with `parts` in their order; `predictions.json` comes last.
fn write_joined(parts: &[(PathBuf, PredictionPart)], out: &Path) -> Result<JoinSummary, JoinError> {
    let torn = |what: String, path: &Path| JoinError::Torn { what, path: path.to_owned() };
    let mut boxes = Vec::new();
    for (path, part) in parts {
        let file = path.join(LIST_FILE);
        let samples = RawSamples::read(&file)?;
        let n_samples = part.episodes.iter().map(|entry| entry.n_samples);
        if samples.n_samples() != n_samples.fold(0, usize::saturating_add) {
            return Err(torn(LIST_FILE.to_owned(), &file));
        }
        boxes.push(samples);
    }
    fs::create_dir_all(out)?;
    let n_episodes = parts[0].1.part.n_episodes as usize;
    let mut order = Vec::new();
    for number in 0..n_episodes {
        let at = number % parts.len();
        let (path, part) = &parts[at];
        let Some(entry) = part.episodes.get(number / parts.len()) else {
            return Err(torn(format!("part {}", part.part.shard), path));
        };
        let file = path.join(format!("{}.mcap", entry.name));
        if store::sha256_of(&file)? != entry.sha256 {
            return Err(torn(format!("the boxes of `{}`", entry.name), &file));
        }
        store::link_or_copy(&file, &out.join(format!("{}.mcap", entry.name)))?;
        order.push((at, entry.n_samples));
    }
    let n_boxes = RawSamples::write_joined(boxes, &order, &out.join(LIST_FILE))?;
    Ok(JoinSummary { folder: out.to_owned(), n_parts: parts.len(), n_episodes, n_boxes })
}
