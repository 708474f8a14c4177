//! The metadata records: where an episode comes from, and what labels or predictions belong to.

use std::collections::BTreeMap;
use std::path::Path;
use std::str::FromStr;

use super::error::EpisodeError;

/// Where an episode comes from: the metadata record `episode`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EpisodeMeta {
    /// `<town>-<weather>-<seed>`, the file's stem.
    pub name: String,
    pub seed: u64,
    pub town: String,
    pub weather: String,
    /// Whether objects that no training set holds were placed.
    pub ood: bool,
    pub generator_version: String,
    /// The resolved config of the run.
    pub config_toml: String,
    /// The sensor rig.
    pub rig_toml: String,
    /// Planned when a writer is made; counted in what a reader gives.
    pub n_samples: usize,
}

/// The version of the format that this code writes and reads.
pub const FORMAT_VERSION: u32 = 1;

type Record = BTreeMap<String, String>;

fn value<T: FromStr>(
    record: &Record,
    name: &'static str,
    key: &'static str,
    path: &Path,
) -> Result<T, EpisodeError> {
    record.get(key).and_then(|text| text.parse().ok()).ok_or_else(|| EpisodeError::Metadata {
        record: name,
        key,
        path: path.to_owned(),
    })
}

fn check_version(record: &Record, name: &'static str, path: &Path) -> Result<(), EpisodeError> {
    let version: u32 = value(record, name, "format_version", path)?;
    if version == FORMAT_VERSION {
        return Ok(());
    }
    Err(EpisodeError::Metadata { record: name, key: "format_version", path: path.to_owned() })
}

impl EpisodeMeta {
    pub(super) const RECORD: &'static str = "episode";

    pub(super) fn to_record(&self) -> Record {
        [
            ("format_version", FORMAT_VERSION.to_string()),
            ("name", self.name.clone()),
            ("seed", self.seed.to_string()),
            ("town", self.town.clone()),
            ("weather", self.weather.clone()),
            ("ood", self.ood.to_string()),
            ("generator_version", self.generator_version.clone()),
            ("config_toml", self.config_toml.clone()),
            ("rig_toml", self.rig_toml.clone()),
            ("n_samples", self.n_samples.to_string()),
        ]
        .map(|(key, value)| (key.to_owned(), value))
        .into()
    }

    pub(super) fn from_record(record: &Record, path: &Path) -> Result<Self, EpisodeError> {
        let name = Self::RECORD;
        check_version(record, name, path)?;
        Ok(Self {
            name: value(record, name, "name", path)?,
            seed: value(record, name, "seed", path)?,
            town: value(record, name, "town", path)?,
            weather: value(record, name, "weather", path)?,
            ood: value(record, name, "ood", path)?,
            generator_version: value(record, name, "generator_version", path)?,
            config_toml: value(record, name, "config_toml", path)?,
            rig_toml: value(record, name, "rig_toml", path)?,
            n_samples: value(record, name, "n_samples", path)?,
        })
    }
}

/// What labels or predictions were made from, and how: the metadata record `labels` or `detections`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SourceMeta {
    /// The episode's name.
    pub episode: String,
    /// Content hash of the episode's file.
    pub episode_sha256: String,
    /// Name of the label set or of the run.
    pub set: String,
    /// Resolved config of what made the file.
    pub config_toml: String,
    pub generator_version: String,
}

impl SourceMeta {
    pub(super) fn to_record(&self) -> Record {
        [
            ("format_version", FORMAT_VERSION.to_string()),
            ("episode", self.episode.clone()),
            ("episode_sha256", self.episode_sha256.clone()),
            ("set", self.set.clone()),
            ("config_toml", self.config_toml.clone()),
            ("generator_version", self.generator_version.clone()),
        ]
        .map(|(key, value)| (key.to_owned(), value))
        .into()
    }

    pub(super) fn from_record(
        record: &Record,
        name: &'static str,
        path: &Path,
    ) -> Result<Self, EpisodeError> {
        check_version(record, name, path)?;
        Ok(Self {
            episode: value(record, name, "episode", path)?,
            episode_sha256: value(record, name, "episode_sha256", path)?,
            set: value(record, name, "set", path)?,
            config_toml: value(record, name, "config_toml", path)?,
            generator_version: value(record, name, "generator_version", path)?,
        })
    }

    /// Refuses a file that was made from another episode.
    pub(super) fn check_episode(&self, wanted: &str, path: &Path) -> Result<(), EpisodeError> {
        if self.episode_sha256 == wanted {
            return Ok(());
        }
        let (found, wanted) = (self.episode_sha256.clone(), wanted.to_owned());
        Err(EpisodeError::OtherEpisode { found, wanted, path: path.to_owned() })
    }
}
