//! Where what is known of a data set's episodes lies: its folder, its labels, the boxes of a detector.

use std::path::PathBuf;

use super::ServeError;
use super::folder::ServedFolder;
use crate::dataset::LabelledEpisodes;
use crate::episode::manifest::EpisodeEntry;
use crate::episode::{DetectionReader, LabelReader};
use crate::eval::Protocol;

/// Predictions for a data set.
#[derive(Debug, Clone)]
pub struct SetBoxes {
    pub folder: PathBuf,
    /// The detector, as `predict` was told it, or the driver's name.
    pub detector: String,
    /// By which they are compared with the truth.
    pub protocol: Protocol,
}

/// A data set's folder, with a label set and predictions if there are any.
#[derive(Debug)]
pub struct SetSource {
    pub path: PathBuf,
    pub labels: Option<LabelledEpisodes>,
    pub boxes: Option<SetBoxes>,
}

impl SetSource {
    /// The file of an episode, which may be a link that stays in the served folder.
    ///
    /// # Errors
    /// It is not there, or leads out.
    pub fn file_of(&self, folder: &ServedFolder, entry: &EpisodeEntry) -> Result<PathBuf, ServeError> {
        folder.inside(&self.path.join(&entry.file))
    }

    /// The labels of an episode, where the set has labels.
    ///
    /// # Errors
    /// They are not there, are damaged, lead out, or are of another episode.
    pub fn read_labels(
        &self,
        folder: &ServedFolder,
        entry: &EpisodeEntry,
    ) -> Result<Option<LabelReader>, ServeError> {
        let Some(labels) = &self.labels else { return Ok(None) };
        let reader = LabelReader::open(&folder.inside(&labels.file_of(entry)?)?)?;
        reader.check_episode(&entry.sha256)?;
        Ok(Some(reader))
    }

    /// A detector's boxes for an episode, where it has any.
    ///
    /// # Errors
    /// As [`Self::read_labels`].
    pub fn read_boxes(
        &self,
        folder: &ServedFolder,
        entry: &EpisodeEntry,
    ) -> Result<Option<DetectionReader>, ServeError> {
        let Some(boxes) = &self.boxes else { return Ok(None) };
        let file = boxes.folder.join(format!("{}.mcap", entry.name));
        // Often those of one split alone.
        if !file.exists() {
            return Ok(None);
        }
        let reader = DetectionReader::open(&folder.inside(&file)?)?;
        reader.check_episode(&entry.sha256)?;
        Ok(Some(reader))
    }
}
