//! An episode with its labels, checked against the manifests.

use std::fmt;
use std::path::{Path, PathBuf};

use super::DatasetError;
use crate::episode::manifest::{EpisodeEntry, LabelEntry, LabelManifest};
use crate::episode::{EpisodeReader, LabelReader};

/// Its index and its labels; samples are read when they are asked for.
pub(super) struct OpenedEpisode {
    pub reader: EpisodeReader,
    pub labels: Option<LabelReader>,
    name: String,
    /// The label file, or the episode's own.
    path: PathBuf,
}

impl OpenedEpisode {
    /// `labels`: the label set's name and its entry. Where `is_checked` says that an earlier opening found the manifest's
    /// content, it is not hashed again.
    ///
    /// # Errors
    /// A file is damaged or not the manifest's; the labels are of another episode or of another number of samples.
    pub fn open(
        dataset: &Path,
        entry: &EpisodeEntry,
        labels: Option<(&str, &LabelEntry)>,
        is_checked: bool,
    ) -> Result<Self, DatasetError> {
        let reader = if is_checked {
            EpisodeReader::open_known(dataset, entry)?
        } else {
            EpisodeReader::open_entry(dataset, entry)?
        };
        let (name, path) = (entry.name.clone(), reader.path().to_owned());
        let mut opened = Self { reader, labels: None, name, path };
        if let Some((set, label_entry)) = labels {
            opened.path = LabelManifest::folder(dataset, set).join(&label_entry.file);
            let labels = LabelReader::open(&opened.path)?;
            if !is_checked {
                labels.check_content(&label_entry.sha256)?;
            }
            labels.check_episode(&entry.sha256)?;
            let n = labels.samples().len();
            if n != opened.reader.len() {
                return Err(opened.mismatch(n.min(opened.reader.len())));
            }
            opened.labels = Some(labels);
        }
        Ok(opened)
    }

    /// The error where labels are not of a sample's objects.
    pub fn mismatch(&self, sample_idx: usize) -> DatasetError {
        DatasetError::Mismatch { episode: self.name.clone(), sample_idx, path: self.path.clone() }
    }
}

impl fmt::Debug for OpenedEpisode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("OpenedEpisode").field(&self.name).finish()
    }
}
