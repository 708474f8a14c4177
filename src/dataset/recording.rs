//! What the sensors of a split saw, without labels or truth: all that a detector needs.

use std::path::Path;

use rayon::prelude::*;

use super::{DatasetError, episodes_of};
use crate::episode::EpisodeReader;
use crate::episode::manifest::{EpisodeEntry, Manifest, Split};
use crate::sample::Measured;

/// The measurements of one split of a data set, which need be neither annotated nor labelled.
#[derive(Debug, Clone)]
pub struct Recording {
    episodes: Vec<EpisodeEntry>,
    /// Each sample's id, `<episode>/<sample index>`, and measurements.
    samples: Vec<(String, Measured)>,
}

impl Recording {
    /// Reads a split; if none is named, `val`, or `test` in a data set without `val`.
    ///
    /// # Errors
    /// [`DatasetError`]: no dataset, a broken file, or no episode of the split.
    pub fn open(path: &Path, split: Option<Split>) -> Result<Self, DatasetError> {
        let manifest = Manifest::read(path)?;
        let split = split.unwrap_or_else(|| Split::to_score(&manifest));
        let episodes = episodes_of(&manifest, split, path)?;
        let read = |entry: &EpisodeEntry| -> Result<Vec<(String, Measured)>, DatasetError> {
            let reader = EpisodeReader::open_entry(path, entry)?;
            let name = |(i, sample): (usize, _)| -> Result<_, DatasetError> {
                let sample: Result<crate::sample::Sample, _> = sample;
                Ok((format!("{}/{i}", entry.name), sample?.measured))
            };
            reader.samples().enumerate().map(name).collect()
        };
        let samples = episodes.par_iter().map(read).collect::<Result<Vec<_>, _>>()?;
        Ok(Self { samples: samples.into_iter().flatten().collect(), episodes })
    }

    /// The split's episodes, in the order of the samples.
    #[must_use]
    pub fn episodes(&self) -> &[EpisodeEntry] {
        &self.episodes
    }

    /// Each sample's id and measurements.
    #[must_use]
    pub fn named(&self) -> Vec<(&str, &Measured)> {
        self.samples.iter().map(|(id, measured)| (id.as_str(), measured)).collect()
    }
}
