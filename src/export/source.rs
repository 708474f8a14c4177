//! What exports read: a data set's episodes, sample by sample, with the labels of a set.

use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::episode::manifest::{LabelManifest, ManifestError};
use crate::episode::{
    EpisodeEntry, EpisodeError, EpisodeReader, LabelReader, Manifest, label_command, zone_in,
};
use crate::files::FolderError;
use crate::object::Harm;
use crate::sample::Sample;

/// The file in an export's folder by which this program knows it for its own.
pub const MARKER: &str = "harmzone.json";

/// Why a data set could not be exported.
#[derive(Debug, Error)]
pub enum ExportError {
    #[error(transparent)]
    Folder(#[from] FolderError),
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    #[error(transparent)]
    Episode(#[from] EpisodeError),
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error("the data set holds no episode: {}", path.display())]
    NoEpisodes { path: PathBuf },
    /// `command`: `harmzone label` with the set's zone.
    #[error("episode `{episode}` has no labels in set `{set}`; `{command}` makes them")]
    NotLabelled { episode: String, set: String, command: String },
    #[error("episode `{episode}`, sample {sample_idx}: its labels are not of its objects; label the data set again: {}", path.display())]
    Mismatch { episode: String, sample_idx: usize, path: PathBuf },
    #[error("{message}: {}", path.display())]
    Unfit { message: String, path: PathBuf },
}

/// A data set to export, and one of its label sets where labels are asked for.
#[derive(Debug)]
pub struct DataSource {
    path: PathBuf,
    manifest: Manifest,
    labels: Option<LabelManifest>,
}

/// An episode with its labels.
pub struct LabelledEpisode {
    pub reader: EpisodeReader,
    labels: Option<LabelReader>,
    entry: EpisodeEntry,
    path: PathBuf,
}

impl DataSource {
    /// Reads the manifests.
    ///
    /// # Errors
    /// No data set, no episode in it, or no such label set.
    pub fn open(path: &Path, set: Option<&str>) -> Result<Self, ExportError> {
        let manifest = Manifest::read(path)?;
        if manifest.episodes.is_empty() {
            return Err(ExportError::NoEpisodes { path: path.to_owned() });
        }
        let labels = set.map(|set| LabelManifest::read(path, set)).transpose()?;
        Ok(Self { path: path.to_owned(), manifest, labels })
    }

    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    #[must_use]
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Opens an episode and its labels.
    ///
    /// # Errors
    /// A damaged file, or another one than the manifest names; no labels, or labels of another file.
    pub fn episode(&self, entry: &EpisodeEntry) -> Result<LabelledEpisode, ExportError> {
        let path = self.path.join(&entry.file);
        let reader = EpisodeReader::open_entry(&self.path, entry)?;
        let labels = self.labels.as_ref().map(|labels| self.labels_of(entry, labels)).transpose()?;
        Ok(LabelledEpisode { reader, labels, entry: entry.clone(), path })
    }

    fn labels_of(&self, entry: &EpisodeEntry, labels: &LabelManifest) -> Result<LabelReader, ExportError> {
        let Some(label) = labels.episodes.iter().find(|label| label.name == entry.name) else {
            let command = label_command(&self.path, &labels.set, zone_in(&labels.zone_toml).as_ref());
            let (episode, set) = (entry.name.clone(), labels.set.clone());
            return Err(ExportError::NotLabelled { episode, set, command });
        };
        let reader = LabelReader::open(&LabelManifest::folder(&self.path, &labels.set).join(&label.file))?;
        reader.check_episode(&entry.sha256)?;
        Ok(reader)
    }
}

impl LabelledEpisode {
    #[must_use]
    pub fn entry(&self) -> &EpisodeEntry {
        &self.entry
    }

    /// A sample with all points of the file, and the harm of each of its objects; empty without labels.
    ///
    /// # Errors
    /// Damage, or labels that are not of the sample's objects.
    pub fn sample(&self, sample_idx: usize) -> Result<(Sample, Vec<Harm>), ExportError> {
        let sample = self.reader.whole_sample(sample_idx)?;
        let Some(labels) = &self.labels else { return Ok((sample, Vec::new())) };
        let labels = labels.samples().get(sample_idx).map_or(&[][..], |labels| &labels.labels);
        let is_own = labels
            .iter()
            .map(|label| Some(&label.id))
            .eq(sample.objects().iter().map(|object| object.id.as_ref()));
        if !is_own {
            let (episode, path) = (self.entry.name.clone(), self.path.clone());
            return Err(ExportError::Mismatch { episode, sample_idx, path });
        }
        let harms = labels.iter().map(|label| label.harm).collect();
        Ok((sample, harms))
    }
}
