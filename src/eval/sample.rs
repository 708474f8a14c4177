//! One sample to be scored: what is there, and what was detected.

use std::collections::BTreeMap;

use thiserror::Error;

use super::protocol::Protocol;
use crate::dataset::{LabelledSample, SampleFacts, count_points};
use crate::geometry::BoxError;
use crate::object::{Detection, LabelledObject};
use crate::sample::Measured;

/// One sample: what is there and what was detected.
///
/// The order of samples, and of detections in a sample, decides between equal scores: the later one
/// ranks higher, as in nuscenes-devkit.
#[derive(Debug, Clone, PartialEq)]
pub struct EvalSample {
    pub id: String,
    pub facts: SampleFacts,
    pub objects: Vec<LabelledObject>,
    pub detections: Vec<Detection>,
    /// LiDAR points in each detection's box, as far as they are known; what is missing at the end is not. They tell an
    /// object that nobody annotated from nothing.
    pub n_points: Vec<Option<u32>>,
}

impl EvalSample {
    /// A sample of whose detections the points are not known.
    pub fn new(
        id: impl Into<String>,
        facts: SampleFacts,
        objects: Vec<LabelledObject>,
        detections: Vec<Detection>,
    ) -> Self {
        Self { id: id.into(), facts, objects, detections, n_points: Vec::new() }
    }

    /// A data set's sample with a detector's boxes.
    #[must_use]
    pub fn of(sample: &LabelledSample, found: Vec<Detection>) -> Self {
        let (facts, objects) = (sample.facts.clone(), sample.objects.clone());
        Self::new(&sample.id, facts, objects, found).with_points_of(&sample.measured)
    }

    /// The same with the points in its detections counted in its own cloud, if its truth tells what it leaves out by size.
    #[must_use]
    pub fn with_points_of(self, measured: &Measured) -> Self {
        if !self.facts.needs_points() {
            return self;
        }
        let counts = count_points(measured, self.detections.iter().map(|found| &found.box_in_ego));
        Self { n_points: counts.into_iter().map(Some).collect(), ..self }
    }
}

/// Which columns are scored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// The nuScenes protocol alone.
    Id,
    /// The four columns of Table III; each truth needs its distribution.
    Ood,
}

/// Why samples cannot be scored.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ScoreError {
    #[error("there is no sample to score")]
    NoSamples,
    #[error(
        "nobody annotated any of the {n_samples} samples, so there is nothing to score; `harmzone predict` and \
         `harmzone view` need no truth"
    )]
    NothingLabelled { n_samples: usize },
    #[error("{found} detections, but at most {allowed} may be given (max_boxes): sample `{sample}`")]
    TooManyBoxes { found: usize, allowed: usize, sample: String },
    #[error("truth {index} has no `distribution` (id or ood), which --ood needs: sample `{sample}`")]
    MissingDistribution { index: usize, sample: String },
    #[error("{what} {index}: {source}: sample `{sample}`")]
    BadBox { what: &'static str, index: usize, source: BoxError, sample: String },
    #[error("detection {index}: the score is {found}; a finite number is needed: sample `{sample}`")]
    BadScore { index: usize, found: f64, sample: String },
    #[error("these are other samples than the first detector's, with which they are compared")]
    OtherSamples,
    #[error("two samples have the same id: sample `{sample}`")]
    RepeatedSample { sample: String },
}

pub(super) fn check(samples: &[EvalSample], protocol: &Protocol, mode: Mode) -> Result<(), ScoreError> {
    if samples.is_empty() {
        return Err(ScoreError::NoSamples);
    }
    if samples.iter().all(|sample| sample.facts.is_unlabelled) {
        return Err(ScoreError::NothingLabelled { n_samples: samples.len() });
    }
    let mut ids = std::collections::HashSet::with_capacity(samples.len());
    for sample in samples {
        let name = || sample.id.clone();
        if !ids.insert(sample.id.as_str()) {
            return Err(ScoreError::RepeatedSample { sample: name() });
        }
        let (found, allowed) = (sample.detections.len(), protocol.config().max_boxes);
        if found > allowed {
            return Err(ScoreError::TooManyBoxes { found, allowed, sample: name() });
        }
        for (index, object) in sample.objects.iter().enumerate() {
            let bad = |source| ScoreError::BadBox { what: "truth", index, source, sample: name() };
            object.truth.box_in_ego.check().map_err(bad)?;
            if mode == Mode::Ood && object.truth.distribution.is_none() {
                return Err(ScoreError::MissingDistribution { index, sample: name() });
            }
        }
        for (index, detection) in sample.detections.iter().enumerate() {
            let bad = |source| ScoreError::BadBox { what: "detection", index, source, sample: name() };
            detection.box_in_ego.check().map_err(bad)?;
            if !detection.score.is_finite() {
                return Err(ScoreError::BadScore { index, found: detection.score, sample: name() });
            }
        }
    }
    Ok(())
}

/// A data set's samples with a detector's boxes, to be scored.
#[must_use]
pub fn eval_samples(samples: &[LabelledSample], found: &[Vec<Detection>]) -> Vec<EvalSample> {
    samples.iter().zip(found).map(|(sample, found)| EvalSample::of(sample, found.clone())).collect()
}
/// Mean time between two samples of an episode, seconds; `None` where no episode with known times has two.
#[must_use]
pub fn mean_period_s(samples: &[EvalSample]) -> Option<f64> {
    let mut spans_s: BTreeMap<&str, (usize, f64, f64)> = BTreeMap::new();
    for facts in samples.iter().map(|sample| &sample.facts) {
        let (episode, time_s) = (facts.episode.as_deref()?, facts.time_s?);
        let (n, first_s, last_s) = spans_s.entry(episode).or_insert((0, time_s, time_s));
        (*n, *first_s, *last_s) = (*n + 1, first_s.min(time_s), last_s.max(time_s));
    }
    let n_gaps: usize = spans_s.values().map(|(n, ..)| n - 1).sum();
    let all_s: f64 = spans_s.values().map(|(_, first_s, last_s)| last_s - first_s).sum();
    (all_s > 0.0).then(|| all_s / n_gaps as f64)
}
