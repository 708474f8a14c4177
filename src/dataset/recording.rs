//! What the sensors of a split saw, without labels or truth: all that a detector needs. Read a part at a time.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::{DatasetError, episodes_of};
use crate::episode::manifest::{EpisodeEntry, Manifest, Split};
use crate::episode::{EpisodeError, EpisodeReader, Shard};
use crate::interrupt;
use crate::sample::Measured;

/// Samples that are read together, on all cores.
pub(super) const N_TOGETHER: usize = 32;

/// One split of a data set, which need be neither annotated nor labelled.
#[derive(Debug, Clone)]
pub struct MeasuredSplit {
    path: PathBuf,
    episodes: Vec<EpisodeEntry>,
}

impl MeasuredSplit {
    /// Finds the episodes of a split; if none is named, of `val`, or of `test` in a data set without `val`.
    ///
    /// # Errors
    /// [`DatasetError`]: no dataset, or no episode of the split.
    pub fn open(path: &Path, split: Option<Split>) -> Result<Self, DatasetError> {
        let manifest = Manifest::read(path)?;
        let split = split.unwrap_or_else(|| Split::to_score(&manifest));
        Ok(Self { path: path.to_owned(), episodes: episodes_of(&manifest, split, path)? })
    }

    /// These episodes of a data set.
    #[must_use]
    pub fn of(path: &Path, episodes: Vec<EpisodeEntry>) -> Self {
        Self { path: path.to_owned(), episodes }
    }

    /// The episodes of a part.
    #[must_use]
    pub fn part(&self, shard: Shard) -> Self {
        let of_part = (0..).zip(&self.episodes).filter(|(number, _)| shard.holds(*number));
        Self::of(&self.path, of_part.map(|(_, entry)| entry.clone()).collect())
    }

    /// The split's episodes, in the order of the samples.
    #[must_use]
    pub fn episodes(&self) -> &[EpisodeEntry] {
        &self.episodes
    }

    #[must_use]
    pub fn n_samples(&self) -> usize {
        self.episodes.iter().map(|entry| entry.n_samples).sum()
    }

    /// Hands over all samples in order, 32 at a time and the rest, each with its id, `<episode>/<sample index>`: a log of
    /// hours need not fit in memory.
    ///
    /// # Errors
    /// An episode is broken or not the manifest's; `take` fails.
    pub fn for_each_part<E: From<EpisodeError>>(
        &self,
        mut take: impl FnMut(&[(String, Measured)]) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut waiting: Vec<(String, Measured)> = Vec::new();
        for entry in &self.episodes {
            let reader = EpisodeReader::open_entry(&self.path, entry)?;
            let mut begin = 0;
            while begin < reader.len() {
                interrupt::check().map_err(EpisodeError::from)?;
                let end = reader.len().min(begin + N_TOGETHER - waiting.len());
                let read = |i: usize| {
                    reader.sample(i).map(|sample| (format!("{}/{i}", entry.name), sample.measured))
                };
                waiting.extend((begin..end).into_par_iter().map(read).collect::<Result<Vec<_>, _>>()?);
                begin = end;
                if waiting.len() == N_TOGETHER {
                    take(&waiting)?;
                    waiting.clear();
                }
            }
        }
        if waiting.is_empty() { Ok(()) } else { take(&waiting) }
    }
}
