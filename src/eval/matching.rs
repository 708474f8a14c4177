//! Which detection matches which truth, and on what each false positive was made.
//!
//! Detections of a class go by descending score, the later first among equals. Each takes the nearest
//! unclaimed truth of its class in its sample, if nearer than the threshold. If there is none but a
//! truth of the other class is nearer than the threshold, it is misclassified on the nearest of those,
//! claimed or not. Otherwise it is unmatched. Distances are between centres, on the ground; among
//! equally near truths the first in the sample counts.

use crate::object::Harm;

use super::curve::N_ERRORS;
use super::{EvalDetection, EvalSample, EvalTruth};
use crate::geometry::{Box3, Ego};

/// A true object with its number among the truths of all samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NumberedTruth<'a> {
    pub number: usize,
    pub truth: &'a EvalTruth,
}

/// What became of a detection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outcome<'a> {
    /// A true positive on this truth, at this distance in metres.
    Matched(NumberedTruth<'a>, f64),
    /// A false positive; this truth of the other class is the nearest within the threshold.
    Misclassified(NumberedTruth<'a>),
    /// A false positive with no truth within the threshold that it could be attributed to.
    Unmatched,
}

/// One detection in its rank.
#[derive(Debug, Clone)]
pub struct Ranked<'a> {
    pub detection: &'a EvalDetection,
    /// Index of its sample.
    pub sample_idx: usize,
    /// Truths of its class within reach, nearest first, each with its distance.
    same_class: Vec<(NumberedTruth<'a>, f64)>,
    /// The nearest truth of the other class within reach.
    other_class: Option<(NumberedTruth<'a>, f64)>,
}

/// All detections of one class by rank, each with the truths within reach.
#[derive(Debug)]
pub struct Ranking<'a> {
    ranked: Vec<Ranked<'a>>,
    n_truths: usize,
}

impl<'a> Ranking<'a> {
    /// Ranks the detections of a class; thresholds up to `reach_m` can be asked for afterwards.
    ///
    /// Scores must not be NaN.
    #[must_use]
    pub fn new(samples: &'a [EvalSample], class: Harm, reach_m: f64) -> Self {
        let mut ranked = Vec::new();
        let mut n_truths = 0;
        for (sample_idx, sample) in samples.iter().enumerate() {
            for detection in sample.detections.iter().filter(|detection| detection.harm == class) {
                let (same_class, other_class) = neighbours(detection, &sample.truths, n_truths, reach_m);
                ranked.push(Ranked { detection, sample_idx, same_class, other_class });
            }
            n_truths += sample.truths.len();
        }
        // Stable and ascending, then reversed: among equal scores the later one comes first.
        ranked.sort_by(|a, b| {
            a.detection.score.partial_cmp(&b.detection.score).expect("scores are checked to be finite")
        });
        ranked.reverse();
        Self { ranked, n_truths }
    }

    /// The detections by rank.
    #[must_use]
    pub fn ranked(&self) -> &[Ranked<'a>] {
        &self.ranked
    }

    /// The outcome of each detection at one distance threshold, by rank.
    pub fn outcomes(&self, threshold_m: f64) -> impl Iterator<Item = Outcome<'a>> {
        let mut is_claimed = vec![false; self.n_truths];
        self.ranked.iter().map(move |ranked| {
            let free = ranked.same_class.iter().find(|(truth, _)| !is_claimed[truth.number]);
            match (free, ranked.other_class) {
                (Some(&(truth, distance_m)), _) if distance_m < threshold_m => {
                    is_claimed[truth.number] = true;
                    Outcome::Matched(truth, distance_m)
                }
                (_, Some((truth, distance_m))) if distance_m < threshold_m => Outcome::Misclassified(truth),
                _ => Outcome::Unmatched,
            }
        })
    }
}

/// The detections of one class with their outcomes at each threshold.
#[derive(Debug)]
pub struct ClassMatching<'a> {
    pub ranking: Ranking<'a>,
    /// `[threshold][rank]`.
    pub outcomes: Vec<Vec<Outcome<'a>>>,
}

impl<'a> ClassMatching<'a> {
    /// Matches the detections of a class at each threshold.
    #[must_use]
    pub fn new(samples: &'a [EvalSample], class: Harm, thresholds_m: &[f64]) -> Self {
        let reach_m = thresholds_m.iter().copied().fold(0.0, f64::max);
        let ranking = Ranking::new(samples, class, reach_m);
        let outcomes = thresholds_m.iter().map(|&threshold_m| ranking.outcomes(threshold_m).collect());
        Self { outcomes: outcomes.collect(), ranking }
    }

    /// The detections by rank, each with its outcome at one of the thresholds.
    pub fn at(&self, threshold_idx: usize) -> impl Iterator<Item = (&Ranked<'a>, Outcome<'a>)> {
        self.ranking.ranked.iter().zip(self.outcomes[threshold_idx].iter().copied())
    }
}

/// A truth within reach and its distance, metres.
type Reached<'a> = (NumberedTruth<'a>, f64);

/// The truths of its sample that a detection can reach: those of its class, nearest first, and the nearest of the
/// other class. `first_number` counts earlier samples' truths.
fn neighbours<'a>(
    detection: &EvalDetection,
    truths: &'a [EvalTruth],
    first_number: usize,
    reach_m: f64,
) -> (Vec<Reached<'a>>, Option<Reached<'a>>) {
    let mut same_class = Vec::new();
    let mut other_class: Option<Reached<'_>> = None;
    for (idx, truth) in truths.iter().enumerate() {
        let distance_m = center_distance_m(&detection.box_in_ego, &truth.box_in_ego);
        if distance_m >= reach_m {
            continue;
        }
        let numbered = NumberedTruth { number: first_number + idx, truth };
        if truth.harm == detection.harm {
            same_class.push((numbered, distance_m));
        } else if other_class.is_none_or(|(_, nearest_m)| distance_m < nearest_m) {
            other_class = Some((numbered, distance_m));
        }
    }
    same_class.sort_by(|a, b| a.1.total_cmp(&b.1));
    (same_class, other_class)
}

/// Distance of two boxes' centres on the ground.
pub fn center_distance_m(one: &Box3<Ego>, other: &Box3<Ego>) -> f64 {
    let (dx, dy) = (one.center.x() - other.center.x(), one.center.y() - other.center.y());
    // Not `hypot`: its last digit may differ from the devkit's, which decides at a threshold.
    (dx * dx + dy * dy).sqrt()
}

/// Errors of a match: distance of centres (metres), 1 - IoU of the aligned boxes, yaw (radians, 0 to pi).
pub(super) fn match_errors(truth: &Box3<Ego>, found: &Box3<Ego>, distance_m: f64) -> [f64; N_ERRORS] {
    [distance_m, 1.0 - aligned_iou(truth, found), yaw_difference_rad(truth.yaw_rad, found.yaw_rad)]
}

/// Intersection over union of two boxes laid over each other, centre on centre, axis on axis.
fn aligned_iou(one: &Box3<Ego>, other: &Box3<Ego>) -> f64 {
    let sizes = |of: &Box3<Ego>| [of.width_m, of.length_m, of.height_m];
    let (one, other) = (sizes(one), sizes(other));
    let volume = |size: [f64; 3]| size[0] * size[1] * size[2];
    let shared = volume(std::array::from_fn(|axis| one[axis].min(other[axis])));
    shared / (volume(one) + volume(other) - shared)
}

/// Smallest turn between two yaws, 0 to pi.
fn yaw_difference_rad(one: f64, other: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    ((one - other + PI).rem_euclid(TAU) - PI).abs()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::eval::{SampleFacts, TruthFacts};
    use crate::geometry::Point;
    use crate::object::Distribution;

    pub(crate) fn a_box(x_m: f64, y_m: f64) -> Box3<Ego> {
        Box3 { center: Point::new(x_m, y_m, 1.0), length_m: 4.0, width_m: 2.0, height_m: 1.5, yaw_rad: 0.0 }
    }

    pub(crate) fn truth(x_m: f64, harm: Harm, distribution: Distribution) -> EvalTruth {
        EvalTruth {
            box_in_ego: a_box(x_m, 0.0),
            velocity_in_ego_mps: [0.0; 2],
            harm,
            distribution: Some(distribution),
            n_lidar_points: Some(5),
            facts: TruthFacts::default(),
        }
    }

    pub(crate) fn found(x_m: f64, harm: Harm, score: f64) -> EvalDetection {
        EvalDetection { box_in_ego: a_box(x_m, 0.0), velocity_in_ego_mps: [0.0; 2], harm, score }
    }

    fn kinds(sample: EvalSample, threshold_m: f64) -> String {
        let samples = [sample];
        Ranking::new(&samples, Harm::Harmful, 4.0)
            .outcomes(threshold_m)
            .map(|outcome| match outcome {
                Outcome::Matched(..) => 'm',
                Outcome::Misclassified(_) => 'c',
                Outcome::Unmatched => 'u',
            })
            .collect()
    }

    #[test]
    fn a_detection_exactly_at_the_threshold_does_not_match() {
        let sample = EvalSample {
            id: "s".into(),
            facts: SampleFacts::default(),
            truths: vec![truth(10.0, Harm::Harmful, Distribution::Id)],
            detections: vec![found(12.0, Harm::Harmful, 0.5)],
        };
        assert_eq!(kinds(sample.clone(), 2.0), "u");
        assert_eq!(kinds(sample, 4.0), "m");
    }

    #[test]
    fn of_equal_scores_the_later_detection_claims_the_truth() {
        let sample = EvalSample {
            id: "s".into(),
            facts: SampleFacts::default(),
            truths: vec![truth(10.0, Harm::Harmful, Distribution::Id)],
            detections: vec![found(10.0, Harm::Harmful, 0.5), found(10.5, Harm::Harmful, 0.5)],
        };
        let samples = [sample];
        let ranking = Ranking::new(&samples, Harm::Harmful, 4.0);
        assert_eq!(ranking.ranked()[0].detection.box_in_ego.center.x(), 10.5);
        assert!(matches!(ranking.outcomes(2.0).next().unwrap(), Outcome::Matched(..)));
    }

    #[test]
    fn a_second_detection_takes_the_next_nearest_truth_then_falls_on_the_other_class_then_on_nothing() {
        let sample = EvalSample {
            id: "s".into(),
            facts: SampleFacts::default(),
            truths: vec![
                truth(10.0, Harm::Harmful, Distribution::Id),
                truth(11.0, Harm::Harmful, Distribution::Id),
                truth(11.5, Harm::Harmless, Distribution::Ood),
            ],
            detections: (0..4).map(|i| found(10.0, Harm::Harmful, 0.9 - 0.1 * f64::from(i))).collect(),
        };
        assert_eq!(kinds(sample.clone(), 2.0), "mmcc");
        assert_eq!(kinds(sample, 1.25), "mmuu");
    }

    #[test]
    fn yaw_errors_wrap_around() {
        assert!((yaw_difference_rad(3.1, -3.1) - (std::f64::consts::TAU - 6.2)).abs() < 1e-12);
    }
}
