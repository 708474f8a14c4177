//! A labelled data set of which one episode is loaded at a time: what looks through many and keeps none.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::{DatasetError, LabelledSample, labels_of, map_episode, zone_of};
use crate::episode::label_command;
use crate::episode::manifest::{EpisodeEntry, LabelEntry, LabelManifest, Manifest};
use crate::zone::Zone;

/// A data set's folder and one of its label sets.
#[derive(Debug)]
pub struct LabelledEpisodes {
    path: PathBuf,
    set: String,
    /// By the episode's name.
    labels: HashMap<String, LabelEntry>,
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
        let by_name = labels.episodes.into_iter().map(|label| (label.name.clone(), label)).collect();
        Ok(Self { path: path.to_owned(), set: labels.set, labels: by_name, zone })
    }

    /// The label set's name.
    #[must_use]
    pub fn set(&self) -> &str {
        &self.set
    }

    /// The file of an episode's labels.
    ///
    /// # Errors
    /// [`DatasetError::NotLabelled`].
    pub fn file_of(&self, entry: &EpisodeEntry) -> Result<PathBuf, DatasetError> {
        let label = self.label_of(entry)?;
        Ok(LabelManifest::folder(&self.path, self.set()).join(&label.file))
    }

    /// Makes something of each sample of an episode and its number, of which one at a time is in memory.
    ///
    /// # Errors
    /// As [`super::Dataset::open`].
    pub fn map<T>(
        &self,
        entry: &EpisodeEntry,
        make: impl Fn(usize, LabelledSample) -> T,
    ) -> Result<Vec<T>, DatasetError> {
        map_episode(&self.path, (self.set(), entry, self.label_of(entry)?), &self.zone, make)
    }

    fn label_of(&self, entry: &EpisodeEntry) -> Result<&LabelEntry, DatasetError> {
        self.labels.get(&entry.name).ok_or_else(|| DatasetError::NotLabelled {
            episode: entry.name.clone(),
            set: self.set.clone(),
            command: label_command(&self.path, &self.set, Some(self.zone.config())),
        })
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
        let one_by_one: Vec<LabelledSample> = manifest
            .episodes
            .iter()
            .flat_map(|entry| episodes.map(entry, |_, sample| sample).unwrap())
            .collect();
        assert_eq!(one_by_one, whole.samples());
        assert!(manifest.episodes.iter().all(|entry| episodes.file_of(entry).unwrap().is_file()));
        let told = LabelledEpisodes::open(folder.path(), "absent", &manifest).unwrap_err().to_string();
        assert!(told.contains("rect"), "{told}");
    }
}
