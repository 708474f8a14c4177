//! What is known of an episode beyond the manifest: harm by the labels, and what a detector got wrong by the scores' own
//! matching.

use serde::Serialize;

use super::ServeError;
use super::folder::ServedFolder;
use super::source::SetSource;
use crate::episode::manifest::EpisodeEntry;
use crate::episode::{EpisodeReader, LabelReader};
use crate::eval::{EvalSample, FaultPlace, ScoreError, list_faults};
use crate::object::Harm;

/// Counts of an episode, sample by sample, and its faults.
#[derive(Debug, Default)]
pub struct EpisodeFacts {
    /// Why the episode cannot be shown.
    pub trouble: Option<String>,
    /// Harmful boxes of each sample; `None` without labels.
    pub harmful: Option<Vec<u32>>,
    /// `None` without labels or without boxes of a detector.
    pub faults: Option<Vec<FaultPlace>>,
}

/// Sums of an episode, for the list.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct EpisodeSums {
    pub harmful: Option<u32>,
    /// Harmful boxes that were not found as harmful.
    pub missed: Option<usize>,
    pub false_alarms: Option<usize>,
}

/// The same by sample, for the player's bar.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct SampleCounts {
    pub harmful: Option<Vec<u32>>,
    pub missed: Option<Vec<u32>>,
    pub false_alarms: Option<Vec<u32>>,
}

impl EpisodeFacts {
    /// Reads an episode; what is wrong with it becomes its trouble.
    pub fn read(source: &SetSource, folder: &ServedFolder, entry: &EpisodeEntry) -> Self {
        try_read(source, folder, entry)
            .unwrap_or_else(|error| Self { trouble: Some(error.to_string()), ..Self::default() })
    }

    #[must_use]
    pub fn sums(&self) -> EpisodeSums {
        let count = |is_miss: bool| {
            self.faults.as_ref().map(|all| all.iter().filter(|fault| fault.kind.is_miss() == is_miss).count())
        };
        EpisodeSums {
            harmful: self.harmful.as_ref().map(|of| of.iter().sum()),
            missed: count(true),
            false_alarms: count(false),
        }
    }

    /// The counts of an episode of so many samples.
    #[must_use]
    pub fn by_sample(&self, n_samples: usize) -> SampleCounts {
        let count = |is_miss: bool| {
            self.faults.as_ref().map(|all| {
                let mut counts = vec![0; n_samples];
                let of_kind = all.iter().filter(|fault| fault.kind.is_miss() == is_miss);
                of_kind.for_each(|fault| counts[fault.sample_idx] += 1);
                counts
            })
        };
        SampleCounts { harmful: self.harmful.clone(), missed: count(true), false_alarms: count(false) }
    }
}

fn try_read(
    source: &SetSource,
    folder: &ServedFolder,
    entry: &EpisodeEntry,
) -> Result<EpisodeFacts, ServeError> {
    let file = source.file_of(folder, entry)?;
    let (labels, found) = (source.read_labels(folder, entry)?, source.read_boxes(folder, entry)?);
    let harmful = labels.as_ref().map(count_harmful);
    let (Some(labels), Some(boxes), Some(found)) = (&source.labels, &source.boxes, found) else {
        // The index alone, so that a torn file is told.
        let n_samples = EpisodeReader::open(&file)?.len();
        if n_samples != entry.n_samples {
            let message = format!(
                "{n_samples} samples, but the manifest says {}; make the data set anew: {}",
                entry.n_samples,
                file.display()
            );
            return Err(ServeError::Trouble { message });
        }
        return Ok(EpisodeFacts { trouble: None, harmful, faults: None });
    };
    let samples = labels.map(entry, |sample_idx, sample| {
        let found = found.samples().get(sample_idx).map(|found| found.detections.clone());
        EvalSample::of(&sample, found.unwrap_or_default())
    })?;
    if found.samples().len() != samples.len() {
        let (n_found, n) = (found.samples().len(), samples.len());
        let message = format!(
            "predictions for {n_found} samples, but the episode `{}` has {n}; `harmzone predict` makes them anew: {}",
            entry.name,
            boxes.folder.display()
        );
        return Err(ServeError::Trouble { message });
    }
    let faults = match list_faults(&samples, &boxes.protocol) {
        Err(ScoreError::NothingLabelled { .. } | ScoreError::NoSamples) => None,
        faults => Some(faults?),
    };
    Ok(EpisodeFacts { trouble: None, harmful, faults })
}

fn count_harmful(labels: &LabelReader) -> Vec<u32> {
    let of_sample = |labels: &[crate::episode::ObjectLabel]| {
        labels.iter().filter(|label| label.harm == Harm::Harmful).count() as u32
    };
    labels.samples().iter().map(|sample| of_sample(&sample.labels)).collect()
}
