//! `dataset.json`: the content of a data set; `labels.json`: the content of a label set.

use std::collections::{BTreeMap, HashMap};
use std::io;
use std::path::{Path, PathBuf};

use fs_err as fs;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use thiserror::Error;

pub use super::counts::{HarmCounts, LabelCounts, ObjectCounts, PerDistribution, PerKind};
use super::made_with::{self, MadeWith};
use super::shard::PartOf;
use crate::files::{is_file, is_file_name, is_inside, is_sealed, unseal, write_atomic, write_manifest};

/// Why a manifest cannot be read or written.
#[derive(Debug, Error)]
pub enum ManifestError {
    #[error(transparent)]
    Io(#[from] io::Error),
    #[error("no data set here: there is no `{}`; `harmzone gen --out` makes one: {}", Manifest::FILE, path.display())]
    NotADataset { path: PathBuf },
    #[error("no label set `{set}` here, found {found:?}; `harmzone label` makes one: {}", path.display())]
    NoLabels { set: String, found: Vec<String>, path: PathBuf },
    #[error("not a valid manifest ({message}); make the data set or the labels again, or let `harmzone doctor --fix` rebuild it: {}", path.display())]
    Parse { message: String, path: PathBuf },
    #[error("format version {found}; this program reads {valid:?}: {}", path.display())]
    Version { found: u32, valid: &'static [u32], path: PathBuf },
    #[error("{message}: {}", path.display())]
    Inconsistent { message: String, path: PathBuf },
}

/// The part of the experiment that an episode belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// To learn from.
    Train,
    /// To watch a training.
    Val,
    /// With unfamiliar objects, for every choice: architecture, augmentation, thresholds.
    Dev,
    /// For reporting alone: with towns and unfamiliar objects that no other split has.
    Test,
}

impl Split {
    pub const ALL: [Self; 4] = [Self::Train, Self::Val, Self::Dev, Self::Test];

    /// The split that is scored where none is named: the first of `val`, `dev` and `test` that the data set has.
    #[must_use]
    pub fn to_score(manifest: &Manifest) -> Self {
        let has = |split: &Self| manifest.of_split(*split).next().is_some();
        [Self::Val, Self::Dev].into_iter().find(has).unwrap_or(Self::Test)
    }

    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Val => "val",
            Self::Dev => "dev",
            Self::Test => "test",
        }
    }
}

/// Most samples of an episode: ten days at ten a second. Sums over a data set stay within their types.
const MAX_SAMPLES: usize = 10_000_000;
/// Most objects of a kind in an episode, counted in each sample.
const MAX_OBJECTS: u64 = 1_000_000_000_000;

/// What is wrong with a number of samples.
fn too_many(episode: &str, n_samples: usize) -> Option<String> {
    let wanted = format!("{MAX_SAMPLES} at most are believed");
    (n_samples > MAX_SAMPLES)
        .then(|| format!("episode `{episode}` is said to have {n_samples} samples; {wanted}"))
}

/// One episode of a data set.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EpisodeEntry {
    pub name: String,
    /// Path of the file from the data set's folder, with `/`.
    pub file: String,
    pub split: Split,
    pub seed: u64,
    pub town: String,
    pub weather: String,
    pub ood: bool,
    pub n_samples: usize,
    pub n_objects: ObjectCounts,
    /// Content hash of the file.
    pub sha256: String,
}

/// `dataset.json`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// [`Self::VERSION`], or that of an older data set that was read.
    pub format_version: u32,
    pub generator_version: String,
    /// SHA-256 of the resolved config's TOML.
    pub config_sha256: String,
    pub seed: u64,
    pub ood: bool,
    /// Which part of a larger data set this is; `None`: a whole one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<PartOf>,
    /// What the episodes were made with, sorted, each once; not known of logs and of older versions.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub made_with: Vec<MadeWith>,
    pub episodes: Vec<EpisodeEntry>,
}

impl Manifest {
    pub const FILE: &'static str = "dataset.json";
    /// The data version that this program makes. Version 3 is version 2 with a hash of the file in itself.
    pub const VERSION: u32 = 3;
    /// Those that it reads.
    pub const READS: &'static [u32] = &[1, 2, Self::VERSION];

    /// A manifest of this program's version without episodes.
    #[must_use]
    pub fn new(config_sha256: String, seed: u64, ood: bool) -> Self {
        Self {
            format_version: Self::VERSION,
            generator_version: env!("CARGO_PKG_VERSION").to_owned(),
            config_sha256,
            seed,
            ood,
            part: None,
            made_with: Vec::new(),
            episodes: Vec::new(),
        }
    }

    /// Reads the manifest of a data set's folder.
    ///
    /// Version 1 had no `dev`: it called generated episodes with unfamiliar objects `test`. They are of the towns and
    /// kinds of `dev`, and are read as that.
    ///
    /// # Errors
    /// Not a data set, malformed, of another format version, or with two episodes of one name.
    pub fn read(folder: &Path) -> Result<Self, ManifestError> {
        let path = folder.join(Self::FILE);
        if !is_file(&path)? {
            return Err(ManifestError::NotADataset { path: folder.to_owned() });
        }
        let mut manifest: Self = read_json(&path, Self::READS, Self::VERSION)?;
        if manifest.format_version == 1 {
            // A log of a real car has no seed.
            let is_dev =
                |entry: &&mut EpisodeEntry| entry.ood && entry.seed != 0 && entry.split == Split::Test;
            manifest.episodes.iter_mut().filter(is_dev).for_each(|entry| entry.split = Split::Dev);
        }
        manifest.check(&path)?;
        Ok(manifest)
    }

    /// Writes the manifest into the data set's folder, completely or not at all.
    ///
    /// # Errors
    /// Two episodes of one name, a file outside the folder, or the disk fails.
    pub fn write(&self, folder: &Path) -> Result<(), ManifestError> {
        let path = folder.join(Self::FILE);
        self.check(&path)?;
        Ok(write_json(&path, self, self.format_version >= Self::VERSION)?)
    }

    /// Notes what an episode was made with.
    pub fn add_made_with(&mut self, made_with: MadeWith) {
        made_with::add(&mut self.made_with, made_with);
    }

    /// The episodes of a split.
    pub fn of_split(&self, split: Split) -> impl Iterator<Item = &EpisodeEntry> {
        self.episodes.iter().filter(move |entry| entry.split == split)
    }

    /// How many episodes each split has, without those that have none.
    #[must_use]
    pub fn n_by_split(&self) -> BTreeMap<Split, usize> {
        self.episodes.iter().fold(BTreeMap::new(), |mut counts, entry| {
            *counts.entry(entry.split).or_default() += 1;
            counts
        })
    }

    /// The content hash of each episode by its name.
    #[must_use]
    pub fn hash_of_name(&self) -> HashMap<&str, &str> {
        self.episodes.iter().map(|entry| (entry.name.as_str(), entry.sha256.as_str())).collect()
    }

    fn check(&self, path: &Path) -> Result<(), ManifestError> {
        let fail = |message| Err(ManifestError::Inconsistent { message, path: path.to_owned() });
        let mut names: Vec<&str> = self.episodes.iter().map(|entry| entry.name.as_str()).collect();
        names.sort_unstable();
        let twice = names.iter().zip(names.iter().skip(1)).find(|(name, next)| name == next);
        if let Some((name, _)) = twice {
            return fail(format!("episode `{name}` is there twice"));
        }
        let mut files: Vec<&Path> = self.episodes.iter().map(|entry| Path::new(&entry.file)).collect();
        files.sort_unstable();
        if let Some((file, _)) = files.iter().zip(files.iter().skip(1)).find(|(file, next)| file == next) {
            return fail(format!("the file `{}` is that of two episodes", file.display()));
        }
        for entry in &self.episodes {
            if !is_inside(&entry.file) {
                return fail(format!("the file `{}` is not inside the data set", entry.file));
            }
            if Path::new(&entry.file).extension().is_none_or(|suffix| suffix != "mcap") {
                return fail(format!("the file `{}` is no episode's, whose name ends in .mcap", entry.file));
            }
            if !is_file_name(&entry.name) {
                return fail(format!("the episode's name `{}` is not that of a file", entry.name));
            }
            if let Some(message) = too_many(&entry.name, entry.n_samples) {
                return fail(message);
            }
            let counts = entry.n_objects.id.values().into_iter().chain(entry.n_objects.ood.values());
            if let Some(n) = counts.max().filter(|&&n| n > MAX_OBJECTS) {
                let name = &entry.name;
                return fail(format!(
                    "episode `{name}` is said to show {n} objects; {MAX_OBJECTS} at most are believed"
                ));
            }
        }
        Ok(())
    }
}

/// The labels of one episode.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelEntry {
    /// The episode's name.
    pub name: String,
    /// The label file, beside `labels.json`.
    pub file: String,
    /// Content hash of the episode that was labelled.
    pub episode_sha256: String,
    /// Content hash of the label file.
    pub sha256: String,
    pub n_samples: usize,
}

/// `labels/<set>/labels.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelManifest {
    pub format_version: u32,
    pub generator_version: String,
    pub set: String,
    /// The resolved config of the zone, as TOML.
    pub zone_toml: String,
    /// The config hash of the data set that was labelled.
    pub dataset_config_sha256: String,
    pub counts: LabelCounts,
    pub episodes: Vec<LabelEntry>,
}

impl LabelManifest {
    pub const FILE: &'static str = "labels.json";
    /// The version that this program makes. Version 2 is version 1 with a hash of the file in itself.
    pub const VERSION: u32 = 2;
    /// Those that it reads.
    pub const READS: &'static [u32] = &[1, Self::VERSION];

    /// A manifest of this program's version without episodes.
    #[must_use]
    pub fn new(set: &str, zone_toml: String, dataset: &Manifest) -> Self {
        Self {
            format_version: Self::VERSION,
            generator_version: env!("CARGO_PKG_VERSION").to_owned(),
            set: set.to_owned(),
            zone_toml,
            dataset_config_sha256: dataset.config_sha256.clone(),
            counts: LabelCounts::default(),
            episodes: Vec::new(),
        }
    }

    /// The folder of a label set.
    #[must_use]
    pub fn folder(dataset: &Path, set: &str) -> PathBuf {
        dataset.join("labels").join(set)
    }

    /// Reads a label set of a data set's folder.
    ///
    /// # Errors
    /// No such set (the error lists those that exist), malformed, of another name than its folder, with labels outside of it, or
    /// of another format version.
    pub fn read(dataset: &Path, set: &str) -> Result<Self, ManifestError> {
        let path = Self::folder(dataset, set).join(Self::FILE);
        if !is_file(&path)? {
            let (set, found, path) = (set.to_owned(), label_sets(dataset)?, dataset.to_owned());
            return Err(ManifestError::NoLabels { set, found, path });
        }
        let labels: Self = read_json(&path, Self::READS, Self::VERSION)?;
        let fail = |message| Err(ManifestError::Inconsistent { message, path: path.clone() });
        if labels.set != set {
            return fail(format!("the label set calls itself `{}`, and its folder is `{set}`", labels.set));
        }
        if let Some(entry) = labels.episodes.iter().find(|entry| !is_file_name(&entry.file)) {
            return fail(format!("the label file `{}` is not beside {}", entry.file, Self::FILE));
        }
        if let Some(message) = labels.episodes.iter().find_map(|entry| too_many(&entry.name, entry.n_samples))
        {
            return fail(message);
        }
        Ok(labels)
    }

    /// Writes the set's manifest, whole or not at all; the set's folder must exist.
    ///
    /// # Errors
    /// The disk fails.
    pub fn write(&self, dataset: &Path) -> Result<(), ManifestError> {
        let path = Self::folder(dataset, &self.set).join(Self::FILE);
        Ok(write_json(&path, self, self.format_version >= Self::VERSION)?)
    }
}

/// Names of the label sets of a data set, sorted; empty if there is none.
///
/// # Errors
/// The disk does not tell: nothing is known of the labels then, and not that there are none.
pub fn label_sets(dataset: &Path) -> io::Result<Vec<String>> {
    let mut names = Vec::new();
    let entries = match fs::read_dir(dataset.join("labels")) {
        Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => {
            return Ok(names);
        }
        entries => entries?,
    };
    for entry in entries {
        let entry = entry?;
        if is_file(&entry.path().join(LabelManifest::FILE))? {
            names.push(entry.file_name().to_string_lossy().into_owned());
        }
    }
    names.sort();
    Ok(names)
}

/// `sealed_from`: the first version whose files hold a hash of themselves.
fn read_json<T: DeserializeOwned>(
    path: &Path,
    valid: &'static [u32],
    sealed_from: u32,
) -> Result<T, ManifestError> {
    #[derive(Deserialize)]
    struct Version {
        format_version: u32,
    }
    let invalid = |message| ManifestError::Parse { message, path: path.to_owned() };
    let parse = |error: serde_json::Error| invalid(error.to_string());
    let text = fs::read_to_string(path)?;
    let json = unseal(&text).map_err(invalid)?;
    // The version first: another version's fields would only confuse.
    let found = serde_json::from_str::<Version>(&json).map_err(parse)?.format_version;
    if !valid.contains(&found) {
        return Err(ManifestError::Version { found, valid, path: path.to_owned() });
    }
    if found >= sealed_from && !is_sealed(&text) {
        return Err(invalid(format!(
            "the hash of its content, which ends a file of version {found}, is missing"
        )));
    }
    serde_json::from_str(&json).map_err(parse)
}

/// Writes a manifest; the versions that have no hash are not sealed.
fn write_json<T: Serialize>(path: &Path, value: &T, is_sealed: bool) -> io::Result<()> {
    if is_sealed {
        return write_manifest(path, value);
    }
    write_atomic(path, (serde_json::to_string_pretty(value)? + "\n").as_bytes())
}
