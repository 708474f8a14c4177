//! Scores a detector by the nuScenes detection protocol, in and out of distribution.
//!
//! Classes: harmful and harmless. A detection matches a truth by the distance of their centres on the
//! ground (0.5, 1, 2, 4 m); AP per class and distance, and ATE, ASE and AOE at 2 m, equal
//! nuscenes-devkit's. Out of distribution each false positive is attributed to the truth it was made
//! on, if any, which gives four columns ([`Column`]). All boxes are in the ego frame.

mod bootstrap;
mod breakdown;
mod curve;
mod evaluation;
pub mod facts;
mod faults;
pub mod json;
pub mod judge;
mod matching;
mod metrics;
mod of_dataset;
mod pretty_json;
mod protocol;
pub mod safety;
pub mod sweep;

use thiserror::Error;

use crate::geometry::{Box3, BoxError, Ego};
use crate::object::{Detection, Distribution, Harm, LabelledObject};

pub use bootstrap::{Confidence, Intervals};
pub use breakdown::{Axis, Breakdown, BreakdownConfig, Group, GroupScores};
pub use curve::Curve;
pub use evaluation::{Evaluation, evaluate};
pub use facts::{SampleFacts, TruthFacts};
pub use faults::{Fault, FaultDetection, FaultKind, FaultObject, Place, worst_faults};
pub use matching::{ClassMatching, NumberedTruth, Outcome, Ranked, Ranking, center_distance_m};
pub use metrics::{
    ClassScores, Column, Columns, Counts, Filters, Metrics, OutcomeCounts, PerClass, TpErrors, TruthCounts,
};
pub use of_dataset::{eval_samples, truth_of};
pub use protocol::{EvalConfig, Protocol};

/// A true box with its class.
#[derive(Debug, Clone, PartialEq)]
pub struct EvalTruth {
    pub box_in_ego: Box3<Ego>,
    /// Over ground, along the ego's x and y; NaN where unknown. No score looks at it.
    pub velocity_in_ego_mps: [f64; 2],
    pub harm: Harm,
    /// `None` where unknown; [`Mode::Ood`] needs it.
    pub distribution: Option<Distribution>,
    /// `None` where unknown; such a truth is kept by the filter on points.
    pub n_lidar_points: Option<u32>,
    pub facts: TruthFacts,
}

/// A detected box; the score has the precision of the file it came from, since ties decide ranks.
#[derive(Debug, Clone, PartialEq)]
pub struct EvalDetection {
    pub box_in_ego: Box3<Ego>,
    /// Over ground, along the ego's x and y; NaN where unknown. No score looks at it.
    pub velocity_in_ego_mps: [f64; 2],
    pub harm: Harm,
    /// Confidence; any finite number, only the order and the interpolation between scores count.
    pub score: f64,
}

/// One sample: what is there and what was detected.
///
/// The order of samples, and of detections in a sample, decides between equal scores: the later one
/// ranks higher, as in nuscenes-devkit.
#[derive(Debug, Clone, PartialEq)]
pub struct EvalSample {
    pub id: String,
    pub facts: SampleFacts,
    pub truths: Vec<EvalTruth>,
    pub detections: Vec<EvalDetection>,
}

impl From<&LabelledObject> for EvalTruth {
    fn from(object: &LabelledObject) -> Self {
        Self {
            box_in_ego: object.truth.box_in_ego,
            velocity_in_ego_mps: object.truth.velocity_in_ego_mps,
            harm: object.harm,
            distribution: Some(object.truth.distribution),
            n_lidar_points: Some(object.truth.n_lidar_points),
            facts: (&object.truth).into(),
        }
    }
}

impl From<&Detection> for EvalDetection {
    fn from(detection: &Detection) -> Self {
        Self {
            box_in_ego: detection.box_in_ego,
            velocity_in_ego_mps: detection.velocity_in_ego_mps,
            harm: detection.harm,
            score: f64::from(detection.score),
        }
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
    #[error("{found} detections, but at most {allowed} may be given (max_boxes): sample `{sample}`")]
    TooManyBoxes { found: usize, allowed: usize, sample: String },
    #[error("truth {index} has no `distribution` (id or ood), which --ood needs: sample `{sample}`")]
    MissingDistribution { index: usize, sample: String },
    #[error("{what} {index}: {source}: sample `{sample}`")]
    BadBox { what: &'static str, index: usize, source: BoxError, sample: String },
    #[error("detection {index}: the score is {found}; a finite number is needed: sample `{sample}`")]
    BadScore { index: usize, found: f64, sample: String },
    #[error("two samples have the same id: sample `{sample}`")]
    RepeatedSample { sample: String },
}

/// Scores detections against truths.
///
/// A class or column without a truth, or without a match, has AP 0 and errors of 1, and counts in the
/// means, as in nuscenes-devkit; [`Metrics::counts`] tells how many truths there were.
///
/// # Errors
/// [`ScoreError`]: no samples, a repeated sample, too many detections in one, a box or score that is
/// not finite, a size that is not above zero, a truth without its distribution in [`Mode::Ood`].
pub fn score(samples: &[EvalSample], protocol: &Protocol, mode: Mode) -> Result<Metrics, ScoreError> {
    check(samples, protocol, mode)?;
    let (kept, filters) = metrics::filtered(samples, protocol.config());
    let matching = metrics::matched(&kept, protocol.config());
    Ok(metrics::measure(&kept, &matching, filters, protocol, mode))
}

fn check(samples: &[EvalSample], protocol: &Protocol, mode: Mode) -> Result<(), ScoreError> {
    if samples.is_empty() {
        return Err(ScoreError::NoSamples);
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
        for (index, truth) in sample.truths.iter().enumerate() {
            let bad = |source| ScoreError::BadBox { what: "truth", index, source, sample: name() };
            truth.box_in_ego.check().map_err(bad)?;
            if mode == Mode::Ood && truth.distribution.is_none() {
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
