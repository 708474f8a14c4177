//! All that `harmzone eval` finds out: the headline metrics, their confidence, breakdowns, and safety.

use serde::{Deserialize, Serialize};

use super::bootstrap::{self, Confidence};
use super::breakdown::{self, Breakdown};
use super::faults::{self, Fault};
use super::matching::Matching;
use super::metrics::{self, Metrics};
use super::pretty_json;
use super::protocol::Protocol;
use super::safety::{self, Safety};
use super::sample::{EvalSample, Mode, ScoreError};

/// The content of `metrics.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    #[serde(flatten)]
    pub metrics: Metrics,
    /// `None` if no resample was asked for, or there is only one episode.
    pub confidence: Option<Confidence>,
    /// One for each axis about which something is known.
    pub breakdowns: Vec<Breakdown>,
    pub safety: Safety,
    /// The worst of what went wrong; `faults.json` holds it.
    #[serde(skip)]
    pub faults: Vec<Fault>,
}

impl Evaluation {
    /// The file's text; the same figures give the same bytes.
    #[must_use]
    pub fn to_json(&self) -> String {
        pretty_json::to_string(self)
    }
}

/// Scores detections against truths.
///
/// A class without a match has AP 0 and errors of 1. One without a truth, in the whole or in a column, has
/// none and counts in no mean, unless the config asks for nuscenes-devkit's zero; [`Metrics::counts`] says how many
/// truths there were.
///
/// # Errors
/// [`ScoreError`]: no samples, a repeated sample, too many detections in one, a box or score that is
/// not finite, a size that is not above zero, a truth without its distribution in [`Mode::Ood`].
pub fn score(samples: &[EvalSample], protocol: &Protocol, mode: Mode) -> Result<Metrics, ScoreError> {
    Ok(metrics::measure(&Matching::new(samples, protocol, mode)?))
}

/// Scores detections against truths, with everything that the facts of samples and truths allow.
///
/// ```
/// use harmzone::dataset::SampleFacts;
/// use harmzone::eval::{EvalSample, Mode, Protocol, evaluate};
/// use harmzone::geometry::{Box3, Point};
/// use harmzone::object::{Detection, Harm, LabelledObject, Object};
///
/// let center = Point::new(12.0, 0.5, 0.75);
/// let box_in_ego = Box3 { center, length_m: 4.0, width_m: 1.8, height_m: 1.5, yaw_rad: 0.0 };
/// let harm = Harm::Harmful;
/// let objects = vec![LabelledObject { truth: Object::new(box_in_ego), harm }];
/// let detections = vec![Detection { box_in_ego, velocity_in_ego_mps: [0.0; 2], harm, score: 0.9, spread: None }];
/// let sample = EvalSample::new("one", SampleFacts::default(), objects, detections);
/// let evaluation = evaluate(&[sample], &Protocol::default(), Mode::Id)?;
/// let ap = evaluation.metrics.columns.total;
/// assert!(ap.harmful > Some(0.999) && ap.harmless.is_none()); // there is nothing harmless to find
/// assert_eq!(ap.mean, ap.harmful);
/// assert!(evaluation.faults.is_empty());
/// # Ok::<(), harmzone::eval::ScoreError>(())
/// ```
///
/// # Errors
/// As [`score`].
pub fn evaluate(samples: &[EvalSample], protocol: &Protocol, mode: Mode) -> Result<Evaluation, ScoreError> {
    let matching = Matching::new(samples, protocol, mode)?;
    Ok(Evaluation {
        metrics: metrics::measure(&matching),
        confidence: bootstrap::measure(&matching),
        breakdowns: breakdown::measure(&matching),
        safety: safety::measure(&matching),
        faults: faults::find_worst(&matching),
    })
}

#[cfg(test)]
mod tests {
    use super::super::matching::tests::{N_MATCHINGS, truth};
    use super::*;
    use crate::dataset::SampleFacts;
    use crate::object::{Distribution, Harm};

    #[test]
    fn one_matching_serves_scores_intervals_groups_safety_and_faults() {
        let objects = vec![truth(10.0, Harm::Harmful, Distribution::Id)];
        let samples = [EvalSample::new("s", SampleFacts::default(), objects, vec![])];
        N_MATCHINGS.set(0);
        let evaluation = evaluate(&samples, &Protocol::default(), Mode::Ood).unwrap();
        assert_eq!((N_MATCHINGS.get(), evaluation.faults.len()), (1, 1));
    }
}
