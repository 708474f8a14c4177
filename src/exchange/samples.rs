//! The samples of a split under the names that other tools know them by.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::error::ExchangeError;
use crate::dataset::MeasuredSplit;
use crate::episode::{EpisodeEntry, EpisodeReader, LogFacts, Split};
use crate::progress::Progress;
use crate::sample::Measured;

/// A sample with its names.
#[derive(Debug, Clone, Copy)]
pub struct NamedSample<'a> {
    /// `<episode>/<sample index>`.
    pub id: &'a str,
    pub episode: &'a EpisodeEntry,
    pub sample_idx: usize,
    /// What an imported episode says of its log, the log's own names of samples among it.
    pub log: Option<&'a LogFacts>,
    pub measured: &'a Measured,
}

/// The samples of a split, read a part at a time.
#[derive(Debug)]
pub struct NamedSamples {
    path: PathBuf,
    recording: MeasuredSplit,
    /// Each episode's index in the recording and log, by its name.
    episodes: HashMap<String, (usize, Option<LogFacts>)>,
}

impl NamedSamples {
    /// Finds the samples of a split; without one, of the first of `val`, `dev` and `test` that there is.
    ///
    /// # Errors
    /// No data set, no episode of the split, or a damaged file.
    pub fn open(path: &Path, split: Option<Split>) -> Result<Self, ExchangeError> {
        let recording = MeasuredSplit::open(path, split)?;
        let mut episodes = HashMap::new();
        for (idx, entry) in recording.episodes().iter().enumerate() {
            let reader = EpisodeReader::open(&path.join(&entry.file))?;
            episodes.insert(entry.name.clone(), (idx, reader.log().cloned()));
        }
        Ok(Self { path: path.to_owned(), recording, episodes })
    }

    /// The data set's folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The split's episodes, in the order of the samples.
    #[must_use]
    pub fn episodes(&self) -> &[EpisodeEntry] {
        self.recording.episodes()
    }

    /// Hands over each sample in order.
    ///
    /// # Errors
    /// A damaged file, or `take` fails.
    pub fn for_each(
        &self,
        stage: &str,
        progress: &dyn Progress,
        mut take: impl FnMut(NamedSample<'_>) -> Result<(), ExchangeError>,
    ) -> Result<(), ExchangeError> {
        progress.start(stage, self.recording.n_samples() as u64);
        self.recording.for_each_part(|part| {
            for (id, measured) in part {
                let (name, sample_idx) = id.rsplit_once('/').expect("ids are made of a name and an index");
                let (idx, log) = self.episodes.get(name).expect("each sample is of an episode of the split");
                take(NamedSample {
                    id,
                    episode: &self.recording.episodes()[*idx],
                    sample_idx: sample_idx.parse().expect("ids are made of a name and an index"),
                    log: log.as_ref(),
                    measured,
                })?;
            }
            progress.advance(part.len() as u64);
            Ok::<_, ExchangeError>(())
        })?;
        progress.finish();
        Ok(())
    }
}
