//! A labelled data set of which one episode is loaded at a time: what looks through many and keeps none.

use std::path::{Path, PathBuf};

use super::{DatasetError, LabelledSample, label_entry, labels_of, load_episode, zone_of};
use crate::episode::manifest::{EpisodeEntry, LabelManifest, Manifest};
use crate::zone::Zone;

/// A data set's folder and one of its label sets.
#[derive(Debug)]
pub struct LabelledEpisodes {
    path: PathBuf,
    labels: LabelManifest,
    zone: Zone,
}

impl LabelledEpisodes {
    /// Reads the label set's manifest.
    ///
    /// # Errors
    /// [`DatasetError`]: no such labels, labels of another data set, a zone that is not valid.
    pub fn open(path: &Path, set: &str, manifest: &Manifest) -> Result<Self, DatasetError> {
        let labels = labels_of(path, set, manifest)?;
        let zone = zone_of(&labels).map_err(|message| DatasetError::Zone {
            set: set.to_owned(),
            message,
            path: path.to_owned(),
        })?;
        Ok(Self { path: path.to_owned(), labels, zone })
    }

    /// The label set's name.
    #[must_use]
    pub fn set(&self) -> &str {
        &self.labels.set
    }

    /// The file of an episode's labels.
    ///
    /// # Errors
    /// [`DatasetError::NotLabelled`].
    pub fn file_of(&self, entry: &EpisodeEntry) -> Result<PathBuf, DatasetError> {
        let label = label_entry(&self.labels, entry, &self.path)?;
        Ok(LabelManifest::folder(&self.path, self.set()).join(&label.file))
    }

    /// Loads one episode.
    ///
    /// # Errors
    /// As [`super::Dataset::open`].
    pub fn load(&self, entry: &EpisodeEntry) -> Result<Vec<LabelledSample>, DatasetError> {
        let labels = label_entry(&self.labels, entry, &self.path)?;
        load_episode(&self.path, self.set(), entry, labels, &self.zone)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::{Dataset, test_data};
    use crate::episode::Split;

    #[test]
    fn the_episodes_one_by_one_are_those_of_the_whole() {
        let folder = tempfile::tempdir().unwrap();
        test_data::write(folder.path(), &[3, 2]);
        let manifest = Manifest::read(folder.path()).unwrap();
        let episodes = LabelledEpisodes::open(folder.path(), "rect", &manifest).unwrap();
        let whole = Dataset::open(folder.path(), "rect", Split::Train).unwrap();
        let one_by_one: Vec<LabelledSample> =
            manifest.episodes.iter().flat_map(|entry| episodes.load(entry).unwrap()).collect();
        assert_eq!(one_by_one, whole.samples());
        assert!(manifest.episodes.iter().all(|entry| episodes.file_of(entry).unwrap().is_file()));
        let told = LabelledEpisodes::open(folder.path(), "absent", &manifest).unwrap_err().to_string();
        assert!(told.contains("rect"), "{told}");
    }
}
