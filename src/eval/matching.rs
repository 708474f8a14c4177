//! Which detection matches which true object, and on which object each false positive lies; done once for all
//! figures.
//!
//! Detections of a class go by descending score, the later first among equals. Each takes the nearest
//! unclaimed object of its class in its sample, if nearer than the threshold. If there is none but an
//! object of the other class is nearer than the threshold, it is misclassified on the nearest of those,
//! claimed or not. Otherwise it is unmatched, or neutral where nothing is annotated ([`super::neutral`]). Distances are between centres, on the ground; among
//! equally near objects the first in the sample counts.

use std::cmp::Reverse;
use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

use super::curve::N_ERRORS;
use super::filter::{Filters, KeptSample, filter};
pub use super::pairing::Outcome;
use super::pairing::{Pairing, order_of};
use super::protocol::{EvalConfig, Protocol};
use super::sample::{EvalSample, Mode, ScoreError, check};
use crate::dataset::SampleFacts;
use crate::geometry::{Box3, Ego};
use crate::object::{Detection, Distribution, Harm, LabelledObject};

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

    /// The class's value, to change it.
    pub fn get_mut(&mut self, class: Harm) -> &mut T {
        match class {
            Harm::Harmful => &mut self.harmful,
            Harm::Harmless => &mut self.harmless,
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

/// One detection in its rank.
#[derive(Debug, Clone, Copy)]
pub struct Ranked<'a> {
    pub detection: &'a Detection,
    pub score: f64,
    pub sample_idx: usize,
}

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
    pub outcomes: PerClass<Vec<Vec<Outcome>>>,
    pub filters: Filters,
    pub protocol: &'a Protocol,
    pub mode: Mode,
    /// The distributions of the objects, by number.
    distributions: Vec<Option<Distribution>>,
    /// Met by the detections of the operating score or more.
    met: OnceLock<PerClass<Met>>,
    zone_distances_m: OnceLock<Vec<Option<f64>>>,
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
        let (samples, filters) = filter(samples, protocol.config());
        let pairs = samples.iter().enumerate();
        let pairs = pairs.flat_map(|(i, sample)| sample.objects.iter().map(move |&object| (i, object)));
        let objects: Vec<PlacedObject<'a>> = pairs
            .enumerate()
            .map(|(number, (sample_idx, object))| PlacedObject { number, sample_idx, object })
            .collect();
        let (ranked, outcomes) = rank(&samples, &protocol.config().dist_thresholds_m);
        let distributions = objects.iter().map(|of| of.object.truth.distribution).collect();
        let (met, zone_distances_m) = (OnceLock::new(), OnceLock::new());
        Ok(Self {
            samples,
            objects,
            ranked,
            outcomes,
            filters,
            protocol,
            mode,
            distributions,
            met,
            zone_distances_m,
        })
    }

    pub fn config(&self) -> &'a EvalConfig {
        self.protocol.config()
    }

    /// The facts of an object's sample.
    pub fn facts_of(&self, of: &PlacedObject<'_>) -> &'a SampleFacts {
        self.samples[of.sample_idx].facts
    }

    /// The object of an outcome.
    pub fn object(&self, number: u32) -> &PlacedObject<'a> {
        &self.objects[number as usize]
    }

    /// The distribution of an outcome's object, as far as it is known.
    pub fn distribution(&self, number: u32) -> Option<Distribution> {
        self.distributions[number as usize]
    }

    /// Signed distance of each object, by number, to the zone's edge, metres; `None` where the zone is not known.
    pub fn zone_distances_m(&self) -> &[Option<f64>] {
        let of_object =
            |of: &PlacedObject<'_>| self.facts_of(of).zone_distance_m(&of.object.truth.solid_in_ego());
        self.zone_distances_m.get_or_init(|| self.objects.iter().map(of_object).collect())
    }

    /// A class's detections by rank, each with its outcome at one of the thresholds.
    pub fn at(&self, class: Harm, threshold_idx: usize) -> impl Iterator<Item = (&Ranked<'a>, Outcome)> {
        self.ranked.get(class).iter().zip(self.outcomes.get(class)[threshold_idx].iter().copied())
    }

    /// A class's detections of a score or more by rank, each with its outcome at the threshold of the errors.
    pub fn ranked_from(&self, class: Harm, score: f64) -> impl Iterator<Item = (&Ranked<'a>, Outcome)> {
        self.at(class, self.protocol.tp_threshold_idx()).take_while(move |(ranked, _)| ranked.score >= score)
    }

    /// As [`Self::ranked_from`], from the operating score on.
    pub fn operating(&self, class: Harm) -> impl Iterator<Item = (&Ranked<'a>, Outcome)> {
        self.ranked_from(class, self.config().operating_score)
    }

    /// The objects that a class's detections of a score or more meet, at the threshold of the errors.
    pub fn meet(&self, class: Harm, score: f64) -> Met {
        let nobody = vec![false; self.objects.len()];
        let mut met = Met { is_matched: nobody.clone(), is_mistaken: nobody };
        for (_, outcome) in self.ranked_from(class, score) {
            match outcome {
                Outcome::Matched(of) => met.is_matched[of as usize] = true,
                Outcome::Misclassified(of) => met.is_mistaken[of as usize] = true,
                Outcome::Unmatched | Outcome::Neutral(_) => {}
            }
        }
        met
    }

    /// As [`Self::meet`], by the operating score.
    pub fn met(&self, class: Harm) -> &Met {
        let operating_score = self.config().operating_score;
        self.met.get_or_init(|| PerClass::from_fn(|class| self.meet(class, operating_score))).get(class)
    }
}

/// The detections of each class by rank, with their outcomes, `[threshold][rank]`.
type Ranking<'a> = (PerClass<Vec<Ranked<'a>>>, PerClass<Vec<Vec<Outcome>>>);

/// Decides and ranks the detections of all samples. Scores must be finite.
fn rank<'a>(samples: &[KeptSample<'a>], thresholds_m: &[f64]) -> Ranking<'a> {
    let n_detections = samples.iter().map(|sample| sample.detections.len()).sum();
    let mut outcomes = vec![Outcome::Unmatched; n_detections * thresholds_m.len()];
    let mut pairing = Pairing::new(thresholds_m);
    let (mut rest, mut first_number) = (outcomes.as_mut_slice(), 0);
    let mut order: PerClass<Vec<(u64, u32)>> = PerClass::default();
    let mut found: Vec<Ranked<'a>> = Vec::with_capacity(n_detections);
    for (sample_idx, sample) in samples.iter().enumerate() {
        let (of_sample, later) = rest.split_at_mut(sample.detections.len() * thresholds_m.len());
        pairing.decide(sample, first_number, of_sample);
        (rest, first_number) = (later, first_number + sample.objects.len());
        for &detection in &sample.detections {
            let order = order.get_mut(detection.harm);
            order.push((order_of(detection.score), found.len() as u32));
            found.push(Ranked { detection, score: detection.score, sample_idx });
        }
    }
    // By falling score; among equal scores the later one comes first.
    Harm::ALL.into_iter().for_each(|class| order.get_mut(class).sort_unstable_by_key(|&of| Reverse(of)));
    let ranked =
        PerClass::from_fn(|class| order.get(class).iter().map(|&(_, i)| found[i as usize]).collect());
    let at_threshold = |class: Harm, threshold_idx: usize| {
        let of_rank = |&(_, i): &(u64, u32)| outcomes[i as usize * thresholds_m.len() + threshold_idx];
        order.get(class).iter().map(of_rank).collect()
    };
    let outcomes =
        PerClass::from_fn(|class| (0..thresholds_m.len()).map(|i| at_threshold(class, i)).collect());
    (ranked, outcomes)
}

/// Distance of two boxes' centres on the ground.
pub fn center_distance_m(one: &Box3<Ego>, other: &Box3<Ego>) -> f64 {
    let (dx, dy) = (one.center.x() - other.center.x(), one.center.y() - other.center.y());
    // Not `hypot`: its last digit may differ from the devkit's, which decides at a threshold.
    (dx * dx + dy * dy).sqrt()
}

/// Errors of a match: distance of centres (metres), 1 - IoU of the aligned boxes, yaw (radians, 0 to pi).
pub(super) fn match_errors(truth: &Box3<Ego>, found: &Box3<Ego>) -> [f64; N_ERRORS] {
    [
        center_distance_m(found, truth),
        1.0 - aligned_iou(truth, found),
        yaw_difference_rad(truth.yaw_rad, found.yaw_rad),
    ]
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
        Detection { box_in_ego: a_box(x_m, 0.0), velocity_in_ego_mps: [0.0; 2], harm, score, spread: None }
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
            Outcome::Matched(_) => 'm',
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
        assert!(matches!(outcome, Outcome::Matched(_)));
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
