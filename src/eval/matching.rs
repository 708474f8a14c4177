//! Which detection matches which true object, and on which object each false positive lies; done once for all
//! figures.
//!
//! Detections of a class go by descending score, the later first among equals. Each takes the nearest
//! unclaimed object of its class in its sample, if nearer than the threshold. If there is none but an
//! object of the other class is nearer than the threshold, it is misclassified on the nearest of those,
//! claimed or not. Otherwise it is unmatched, or neutral where nothing is annotated ([`super::neutral`]). Distances are between centres, on the ground; among
//! equally near objects the first in the sample counts.

use serde::{Deserialize, Serialize};

use super::curve::N_ERRORS;
use super::filter::{Filters, KeptSample, filter};
use super::neutral::NeutralReason;
use super::protocol::{EvalConfig, Protocol};
use super::sample::{EvalSample, Mode, ScoreError, check};
use crate::dataset::SampleFacts;
use crate::geometry::{Box3, Ego};
use crate::object::{Detection, Harm, LabelledObject};

/// A value for each class.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct PerClass<T> {
    pub harmful: T,
    pub harmless: T,
}

impl<T> PerClass<T> {
    /// Makes both values.
    pub fn from_fn(mut value: impl FnMut(Harm) -> T) -> Self {
        Self { harmful: value(Harm::Harmful), harmless: value(Harm::Harmless) }
    }

    /// The class's value.
    pub fn get(&self, class: Harm) -> &T {
        match class {
            Harm::Harmful => &self.harmful,
            Harm::Harmless => &self.harmless,
        }
    }
}

/// A true object with its place in the samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedObject<'a> {
    /// Its number among the objects of all samples.
    pub number: usize,
    pub sample_idx: usize,
    pub object: &'a LabelledObject,
}

/// What became of a detection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outcome<'a> {
    /// A true positive on this object, at this distance in metres.
    Matched(PlacedObject<'a>, f64),
    /// A false positive; this object of the other class is the nearest within the threshold.
    Misclassified(PlacedObject<'a>),
    /// A false positive with no object within the threshold that it could be attributed to.
    Unmatched,
    /// As unmatched, but nobody annotated what may be there: neither a true nor a false positive.
    Neutral(NeutralReason),
}

impl Outcome<'_> {
    /// The outcome where all that is not a true positive is a false one.
    #[must_use]
    pub fn strictly(self) -> Self {
        if let Self::Neutral(_) = self { Self::Unmatched } else { self }
    }
}

/// One detection in its rank.
#[derive(Debug, Clone)]
pub struct Ranked<'a> {
    pub detection: &'a Detection,
    pub sample_idx: usize,
    neutral: Option<NeutralReason>,
    /// Objects of its class within reach, nearest first.
    same_class: Vec<Reached<'a>>,
    /// The nearest object of the other class within reach.
    other_class: Option<Reached<'a>>,
}

/// An object within reach and its distance, metres.
type Reached<'a> = (PlacedObject<'a>, f64);

/// Which objects the detections of a class meet, by number.
#[derive(Debug)]
pub struct Met {
    /// Whether a detection is matched to the object.
    pub is_matched: Vec<bool>,
    /// Whether a detection is misclassified on the object, which is of the other class.
    pub is_mistaken: Vec<bool>,
}

/// Samples after the filters with their detections matched; every figure is read off one of these.
#[derive(Debug)]
pub struct Matching<'a> {
    pub samples: Vec<KeptSample<'a>>,
    /// The objects of all samples, by number.
    pub objects: Vec<PlacedObject<'a>>,
    /// The detections by rank.
    pub ranked: PerClass<Vec<Ranked<'a>>>,
    /// `[threshold][rank]`.
    pub outcomes: PerClass<Vec<Vec<Outcome<'a>>>>,
    pub filters: Filters,
    pub protocol: &'a Protocol,
    pub mode: Mode,
}

impl<'a> Matching<'a> {
    /// Checks, filters and matches samples.
    ///
    /// # Errors
    /// As [`super::score`].
    pub fn new(samples: &'a [EvalSample], protocol: &'a Protocol, mode: Mode) -> Result<Self, ScoreError> {
        check(samples, protocol, mode)?;
        #[cfg(test)]
        tests::N_MATCHINGS.set(tests::N_MATCHINGS.get() + 1);
        let thresholds_m = &protocol.config().dist_thresholds_m;
        let reach_m = thresholds_m.iter().copied().fold(0.0, f64::max);
        let (samples, filters) = filter(samples, protocol.config());
        let pairs = samples.iter().enumerate();
        let pairs = pairs.flat_map(|(i, sample)| sample.objects.iter().map(move |&object| (i, object)));
        let objects: Vec<PlacedObject<'a>> = pairs
            .enumerate()
            .map(|(number, (sample_idx, object))| PlacedObject { number, sample_idx, object })
            .collect();
        let ranked = PerClass::from_fn(|class| rank(&samples, &objects, class, reach_m));
        let outcomes = PerClass::from_fn(|class| {
            let ranked = ranked.get(class);
            thresholds_m.iter().map(|&threshold_m| decide(ranked, objects.len(), threshold_m)).collect()
        });
        Ok(Self { samples, objects, ranked, outcomes, filters, protocol, mode })
    }

    pub fn config(&self) -> &'a EvalConfig {
        self.protocol.config()
    }

    /// The facts of an object's sample.
    pub fn facts_of(&self, of: &PlacedObject<'_>) -> &'a SampleFacts {
        self.samples[of.sample_idx].facts
    }

    /// A class's detections by rank, each with its outcome at one of the thresholds.
    pub fn at(&self, class: Harm, threshold_idx: usize) -> impl Iterator<Item = (&Ranked<'a>, Outcome<'a>)> {
        self.ranked.get(class).iter().zip(self.outcomes.get(class)[threshold_idx].iter().copied())
    }

    /// A class's detections of a score or more by rank, each with its outcome at the threshold of the errors.
    pub fn ranked_from(&self, class: Harm, score: f64) -> impl Iterator<Item = (&Ranked<'a>, Outcome<'a>)> {
        self.at(class, self.protocol.tp_threshold_idx())
            .take_while(move |(ranked, _)| ranked.detection.score >= score)
    }

    /// As [`Self::ranked_from`], from the operating score on.
    pub fn operating(&self, class: Harm) -> impl Iterator<Item = (&Ranked<'a>, Outcome<'a>)> {
        self.ranked_from(class, self.config().operating_score)
    }

    /// The objects that a class's detections of a score or more meet, at the threshold of the errors.
    pub fn meet(&self, class: Harm, score: f64) -> Met {
        let nobody = vec![false; self.objects.len()];
        let mut met = Met { is_matched: nobody.clone(), is_mistaken: nobody };
        for (_, outcome) in self.ranked_from(class, score) {
            match outcome {
                Outcome::Matched(of, _) => met.is_matched[of.number] = true,
                Outcome::Misclassified(of) => met.is_mistaken[of.number] = true,
                Outcome::Unmatched | Outcome::Neutral(_) => {}
            }
        }
        met
    }
}

/// The detections of a class by rank, each with the objects within reach. Scores must not be NaN.
fn rank<'a>(
    samples: &[KeptSample<'a>],
    objects: &[PlacedObject<'a>],
    class: Harm,
    reach_m: f64,
) -> Vec<Ranked<'a>> {
    let mut ranked = Vec::new();
    let mut rest = objects;
    for (sample_idx, sample) in samples.iter().enumerate() {
        let (of_sample, later) = rest.split_at(sample.objects.len());
        rest = later;
        let detections = sample.detections.iter().copied().zip(sample.neutral.iter().copied());
        for (detection, neutral) in detections.filter(|(detection, _)| detection.harm == class) {
            let (same_class, other_class) = find_neighbours(detection, of_sample, reach_m);
            ranked.push(Ranked { detection, sample_idx, neutral, same_class, other_class });
        }
    }
    // Stable and ascending, then reversed: among equal scores the later one comes first.
    ranked.sort_by(|a, b| {
        a.detection.score.partial_cmp(&b.detection.score).expect("scores are checked to be finite")
    });
    ranked.reverse();
    ranked
}

/// The outcome of each detection at one distance threshold, by rank.
fn decide<'a>(ranked: &[Ranked<'a>], n_objects: usize, threshold_m: f64) -> Vec<Outcome<'a>> {
    let mut is_claimed = vec![false; n_objects];
    let decide_one = |ranked: &Ranked<'a>| {
        let free = ranked.same_class.iter().find(|(of, _)| !is_claimed[of.number]);
        match (free, ranked.other_class) {
            (Some(&(of, distance_m)), _) if distance_m < threshold_m => {
                is_claimed[of.number] = true;
                Outcome::Matched(of, distance_m)
            }
            (_, Some((of, distance_m))) if distance_m < threshold_m => Outcome::Misclassified(of),
            _ => ranked.neutral.map_or(Outcome::Unmatched, Outcome::Neutral),
        }
    };
    ranked.iter().map(decide_one).collect()
}

/// The objects of its sample that a detection can reach: those of its class, nearest first, and the nearest of the
/// other class.
fn find_neighbours<'a>(
    detection: &Detection,
    objects: &[PlacedObject<'a>],
    reach_m: f64,
) -> (Vec<Reached<'a>>, Option<Reached<'a>>) {
    let mut same_class = Vec::new();
    let mut other_class: Option<Reached<'_>> = None;
    for &of in objects {
        let distance_m = center_distance_m(&detection.box_in_ego, &of.object.truth.box_in_ego);
        if distance_m >= reach_m {
            continue;
        }
        if of.object.harm == detection.harm {
            same_class.push((of, distance_m));
        } else if other_class.is_none_or(|(_, nearest_m)| distance_m < nearest_m) {
            other_class = Some((of, distance_m));
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
    use crate::geometry::Point;
    use crate::object::{Distribution, Object};

    thread_local! {
        /// How often this test's thread has matched samples.
        pub(crate) static N_MATCHINGS: std::cell::Cell<usize> = const { std::cell::Cell::new(0) };
    }

    pub(crate) fn a_box(x_m: f64, y_m: f64) -> Box3<Ego> {
        Box3 { center: Point::new(x_m, y_m, 1.0), length_m: 4.0, width_m: 2.0, height_m: 1.5, yaw_rad: 0.0 }
    }

    pub(crate) fn truth(x_m: f64, harm: Harm, distribution: Distribution) -> LabelledObject {
        let box_in_ego = a_box(x_m, 0.0);
        let (distribution, n_lidar_points) = (Some(distribution), Some(5));
        LabelledObject { truth: Object { distribution, n_lidar_points, ..Object::new(box_in_ego) }, harm }
    }

    pub(crate) fn found(x_m: f64, harm: Harm, score: f64) -> Detection {
        Detection { box_in_ego: a_box(x_m, 0.0), velocity_in_ego_mps: [0.0; 2], harm, score }
    }

    fn sample(objects: Vec<LabelledObject>, detections: Vec<Detection>) -> EvalSample {
        EvalSample::new("s", SampleFacts::default(), objects, detections)
    }

    fn kinds(sample: EvalSample, threshold_m: f64) -> String {
        let config = EvalConfig {
            dist_thresholds_m: vec![threshold_m],
            tp_threshold_m: threshold_m,
            ..EvalConfig::default()
        };
        let (samples, protocol) = ([sample], Protocol::try_from(config).unwrap());
        let matching = Matching::new(&samples, &protocol, Mode::Id).unwrap();
        let letter = |(_, outcome)| match outcome {
            Outcome::Matched(..) => 'm',
            Outcome::Misclassified(_) => 'c',
            Outcome::Unmatched => 'u',
            Outcome::Neutral(_) => 'n',
        };
        matching.at(Harm::Harmful, 0).map(letter).collect()
    }

    #[test]
    fn a_detection_exactly_at_the_threshold_does_not_match() {
        let sample =
            sample(vec![truth(10.0, Harm::Harmful, Distribution::Id)], vec![found(12.0, Harm::Harmful, 0.5)]);
        assert_eq!(kinds(sample.clone(), 2.0), "u");
        assert_eq!(kinds(sample, 4.0), "m");
    }

    #[test]
    fn of_equal_scores_the_later_detection_claims_the_truth() {
        let samples = [sample(
            vec![truth(10.0, Harm::Harmful, Distribution::Id)],
            vec![found(10.0, Harm::Harmful, 0.5), found(10.5, Harm::Harmful, 0.5)],
        )];
        let protocol = Protocol::default();
        let matching = Matching::new(&samples, &protocol, Mode::Id).unwrap();
        let (first, outcome) = matching.operating(Harm::Harmful).next().unwrap();
        assert_eq!(first.detection.box_in_ego.center.x(), 10.5);
        assert!(matches!(outcome, Outcome::Matched(..)));
    }

    #[test]
    fn a_second_detection_takes_the_next_nearest_truth_then_falls_on_the_other_class_then_on_nothing() {
        let sample = sample(
            vec![
                truth(10.0, Harm::Harmful, Distribution::Id),
                truth(11.0, Harm::Harmful, Distribution::Id),
                truth(11.5, Harm::Harmless, Distribution::Ood),
            ],
            (0..4).map(|i| found(10.0, Harm::Harmful, 0.9 - 0.1 * f64::from(i))).collect(),
        );
        assert_eq!(kinds(sample.clone(), 2.0), "mmcc");
        assert_eq!(kinds(sample, 1.25), "mmuu");
    }

    #[test]
    fn yaw_errors_wrap_around() {
        assert!((yaw_difference_rad(3.1, -3.1) - (std::f64::consts::TAU - 6.2)).abs() < 1e-12);
    }
}
