//! Labelled samples wherever they are: in memory, or on disk and read when they are needed.

use std::path::Path;

use super::{Dataset, DatasetError, Fingerprint, LabelledSample, LabelledSplit};
use crate::episode::manifest::EpisodeEntry;
use crate::zone::Zone;

/// A split's labelled samples.
#[derive(Debug, Clone, Copy)]
pub enum SampleSource<'a> {
    InMemory(&'a Dataset),
    OnDisk(&'a LabelledSplit),
}

impl<'a> From<&'a Dataset> for SampleSource<'a> {
    fn from(dataset: &'a Dataset) -> Self {
        Self::InMemory(dataset)
    }
}

impl<'a> From<&'a LabelledSplit> for SampleSource<'a> {
    fn from(split: &'a LabelledSplit) -> Self {
        Self::OnDisk(split)
    }
}

impl<'a> SampleSource<'a> {
    #[must_use]
    pub fn path(self) -> &'a Path {
        match self {
            Self::InMemory(dataset) => dataset.path(),
            Self::OnDisk(split) => split.path(),
        }
    }

    /// The rule the labels were made by.
    #[must_use]
    pub fn zone(self) -> &'a Zone {
        match self {
            Self::InMemory(dataset) => dataset.zone(),
            Self::OnDisk(split) => split.zone(),
        }
    }

    #[must_use]
    pub fn fingerprint(self) -> &'a Fingerprint {
        match self {
            Self::InMemory(dataset) => dataset.fingerprint(),
            Self::OnDisk(split) => split.fingerprint(),
        }
    }

    /// The split's episodes, in the order of the samples.
    #[must_use]
    pub fn episodes(self) -> &'a [EpisodeEntry] {
        match self {
            Self::InMemory(dataset) => dataset.episodes(),
            Self::OnDisk(split) => split.episodes(),
        }
    }

    #[must_use]
    pub fn n_samples(self) -> usize {
        match self {
            Self::InMemory(dataset) => dataset.samples().len(),
            Self::OnDisk(split) => split.n_samples(),
        }
    }

    /// Hands over all samples in order: at once if they are in memory, else as [`LabelledSplit::for_each_part`].
    ///
    /// # Errors
    /// An episode is broken; `take` fails.
    pub fn for_each_part<E: From<DatasetError>>(
        self,
        mut take: impl FnMut(&[LabelledSample]) -> Result<(), E>,
    ) -> Result<(), E> {
        match self {
            Self::InMemory(dataset) => take(dataset.samples()),
            Self::OnDisk(split) => split.for_each_part(|samples| take(&samples)),
        }
    }
}
