//! Scores by group: what kind of object, where, how well seen, in what weather, how near the zone's edge.
//!
//! An axis sorts truths into groups. Where the group is a property of the sample (town, weather, speed, steering), the
//! scores are those of its samples alone. Where it is a property of the object, the truths of the group are the
//! positives; detections on truths of other groups are neither true nor false positives, a misclassified one counts
//! in the group of the truth that it was made on, and unmatched ones count nowhere, since nothing says which group
//! they are of. Truths (and, on sample axes, samples) whose fact is not known are in no group.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::curve::Curve;
use super::matching::Outcome;
use super::metrics::{Matching, mean};
use super::protocol::Protocol;
use super::{EvalSample, EvalTruth, PerClass};
use crate::config::{Rule, define_config, from_to};
use crate::object::{Distribution, Event, Harm, Kind};

define_config! {
    /// Edges of the bands; a band begins at its edge and ends before the next.
    pub struct BreakdownConfig {
        /// From the ego's origin to the box's centre on the ground, metres. Default 10, 20, 30, 40.
        range_m: Vec<f64> = vec![10.0, 20.0, 30.0, 40.0], in EDGES;
        /// Visible pixels over those of the whole silhouette, 0 to 1. Default 0.1, 0.25, 0.5, 0.75, 0.9.
        visible_fraction: Vec<f64> = vec![0.1, 0.25, 0.5, 0.75, 0.9], in EDGES;
        /// LiDAR points on the object. Default 3, 6, 11, 21, 51, 101.
        n_lidar_points: Vec<f64> = vec![3.0, 6.0, 11.0, 21.0, 51.0, 101.0], in EDGES;
        /// The ego's speed, m/s. Default 0.5, 3, 6, 9, 12.
        speed_mps: Vec<f64> = vec![0.5, 3.0, 6.0, 9.0, 12.0], in EDGES;
        /// Size of the steering angle, degrees. Default 1, 3, 6, 10, 20.
        steering_deg: Vec<f64> = vec![1.0, 3.0, 6.0, 10.0, 20.0], in EDGES;
        /// Signed distance of the footprint to the zone's edge, metres, negative inside.
        /// Default -1, -0.5, -0.25, 0, 0.25, 0.5, 1, 2, 4.
        zone_distance_m: Vec<f64> = vec![-1.0, -0.5, -0.25, 0.0, 0.25, 0.5, 1.0, 2.0, 4.0], in EDGES;
    }
}

/// Of bands.
const EDGES: Rule = from_to(-1e6, 1e6).rising(0, 1000);

/// By what truths are sorted into groups.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Axis {
    Distribution,
    Kind,
    /// Families of objects in distribution.
    IdCategory,
    /// Families of objects out of distribution.
    OodCategory,
    RangeM,
    VisibleFraction,
    NLidarPoints,
    Event,
    ZoneDistanceM,
    Town,
    Weather,
    SpeedMps,
    SteeringDeg,
}

impl Axis {
    pub const ALL: [Self; 13] = [
        Self::Distribution,
        Self::Kind,
        Self::IdCategory,
        Self::OodCategory,
        Self::RangeM,
        Self::VisibleFraction,
        Self::NLidarPoints,
        Self::Event,
        Self::ZoneDistanceM,
        Self::Town,
        Self::Weather,
        Self::SpeedMps,
        Self::SteeringDeg,
    ];

    /// Whether a group is a set of samples, not of objects.
    #[must_use]
    pub fn is_of_samples(self) -> bool {
        matches!(self, Self::Town | Self::Weather | Self::SpeedMps | Self::SteeringDeg)
    }

    /// The name in files and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Distribution => "distribution",
            Self::Kind => "kind",
            Self::IdCategory => "id_category",
            Self::OodCategory => "ood_category",
            Self::RangeM => "range_m",
            Self::VisibleFraction => "visible_fraction",
            Self::NLidarPoints => "n_lidar_points",
            Self::Event => "event",
            Self::ZoneDistanceM => "zone_distance_m",
            Self::Town => "town",
            Self::Weather => "weather",
            Self::SpeedMps => "speed_mps",
            Self::SteeringDeg => "steering_deg",
        }
    }

    /// The group of a sample on an axis of samples.
    fn of_sample(self, sample: &EvalSample, config: &BreakdownConfig) -> Option<Label> {
        let facts = &sample.facts;
        match self {
            Self::Town => facts.town.as_deref().map(word),
            Self::Weather => facts.weather.as_deref().map(word),
            Self::SpeedMps => Some(band(facts.speed_mps?, &config.speed_mps)),
            Self::SteeringDeg => {
                Some(band(facts.steering_angle_rad?.abs().to_degrees(), &config.steering_deg))
            }
            _ => None,
        }
    }

    /// The group of a truth on an axis of objects.
    fn of_truth(self, sample: &EvalSample, truth: &EvalTruth, config: &BreakdownConfig) -> Option<Label> {
        let facts = &truth.facts;
        let category_if = |distribution| {
            let fits = truth.distribution == Some(distribution);
            facts.category.as_deref().filter(|_| fits).map(word)
        };
        match self {
            Self::Distribution => truth.distribution.map(|distribution| match distribution {
                Distribution::Id => word("id"),
                Distribution::Ood => word("ood"),
            }),
            Self::Kind => facts.kind.map(|kind| match kind {
                Kind::Vehicle => word("vehicle"),
                Kind::Pedestrian => word("pedestrian"),
                Kind::Static => word("static"),
            }),
            Self::IdCategory => category_if(Distribution::Id),
            Self::OodCategory => category_if(Distribution::Ood),
            Self::RangeM => {
                let center = truth.box_in_ego.center;
                Some(band(center.x().hypot(center.y()), &config.range_m))
            }
            Self::VisibleFraction => Some(band(facts.visible_fraction?, &config.visible_fraction)),
            Self::NLidarPoints => Some(band(f64::from(truth.n_lidar_points?), &config.n_lidar_points)),
            Self::Event => facts.event.map(|event| match event {
                Event::None => word("none"),
                Event::Lies => word("lies"),
                Event::Falls => word("falls"),
                Event::Rolls => word("rolls"),
                Event::Thrown => word("thrown"),
            }),
            Self::ZoneDistanceM => {
                Some(band(sample.facts.zone_distance_m(&truth.box_in_ego)?, &config.zone_distance_m))
            }
            _ => None,
        }
    }
}

/// A group's place in the order, and its name.
type Label = (usize, String);

fn word(name: &str) -> Label {
    (0, name.to_owned())
}

fn band(value: f64, edges: &[f64]) -> Label {
    let at = edges.partition_point(|&edge| edge <= value);
    let name = match (at.checked_sub(1).map(|below| edges[below]), edges.get(at)) {
        (None, Some(above)) => format!("below {above}"),
        (Some(below), Some(above)) => format!("{below} to {above}"),
        (Some(below), None) => format!("{below} and more"),
        (None, None) => "all".to_owned(),
    };
    (at, name)
}

/// What an axis shows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Breakdown {
    pub axis: Axis,
    /// Bands in their order, names by the alphabet; a group without truth and sample is left out.
    pub groups: Vec<Group>,
}

/// Scores of one group.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Group {
    pub name: String,
    /// Samples of the group, or with a truth of it.
    pub n_samples: usize,
    #[serde(flatten)]
    pub classes: PerClass<GroupScores>,
}

/// Scores of one class in a group. Found, misclassified and missed are counted at the threshold of the errors with
/// detections of the operating score or more, and make up the truths.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct GroupScores {
    pub n_truths: usize,
    /// Mean of `per_threshold`.
    pub ap: Option<f64>,
    /// AP at each threshold; empty where the group has no truth of the class.
    pub per_threshold: Vec<f64>,
    pub n_found: usize,
    /// Not found, but a detection of the other class was made on it.
    pub n_misclassified: usize,
    pub n_missed: usize,
    /// Found over truths.
    pub recall: Option<f64>,
    /// False positives that count in the group, with the operating score or more.
    pub n_false: usize,
}

/// Breaks scores down along every axis that some truth or sample has a fact for.
pub(super) fn break_down(
    kept: &[EvalSample],
    matching: &Matching<'_>,
    protocol: &Protocol,
) -> Vec<Breakdown> {
    let of_axis = |axis| Grouping::new(axis, kept, &protocol.config().breakdown).scores(matching, protocol);
    Axis::ALL.into_iter().map(of_axis).filter(|breakdown| !breakdown.groups.is_empty()).collect()
}

/// Who is in which group.
struct Grouping<'a> {
    axis: Axis,
    names: Vec<String>,
    truths: Vec<&'a EvalTruth>,
    /// Group of each truth, numbered over all samples.
    of_truth: Vec<Option<usize>>,
    /// Group of each sample; `None` on axes of objects.
    of_sample: Vec<Option<usize>>,
    n_samples: Vec<usize>,
}

impl<'a> Grouping<'a> {
    fn new(axis: Axis, samples: &'a [EvalSample], config: &BreakdownConfig) -> Self {
        let labels_of_samples: Vec<Option<Label>> =
            samples.iter().map(|sample| axis.of_sample(sample, config)).collect();
        let label_of = |sample: &EvalSample, of_sample: &Option<Label>, truth: &EvalTruth| {
            if axis.is_of_samples() { of_sample.clone() } else { axis.of_truth(sample, truth, config) }
        };
        let labels_of_truths: Vec<Vec<Option<Label>>> = samples
            .iter()
            .zip(&labels_of_samples)
            .map(|(sample, of_sample)| {
                sample.truths.iter().map(|truth| label_of(sample, of_sample, truth)).collect()
            })
            .collect();
        let all = labels_of_samples.iter().chain(labels_of_truths.iter().flatten()).flatten();
        let mut numbers: BTreeMap<&Label, usize> = all.map(|label| (label, 0)).collect();
        numbers.values_mut().enumerate().for_each(|(i, number)| *number = i);
        let number = |label: &Option<Label>| label.as_ref().map(|label| numbers[label]);
        let mut n_samples = vec![0; numbers.len()];
        for (of_sample, of_truths) in labels_of_samples.iter().zip(&labels_of_truths) {
            let mut present: Vec<usize> =
                of_truths.iter().chain(std::iter::once(of_sample)).filter_map(number).collect();
            present.sort_unstable();
            present.dedup();
            present.into_iter().for_each(|group| n_samples[group] += 1);
        }
        Self {
            axis,
            names: numbers.keys().map(|label| label.1.clone()).collect(),
            truths: samples.iter().flat_map(|sample| &sample.truths).collect(),
            of_truth: labels_of_truths.iter().flatten().map(number).collect(),
            of_sample: labels_of_samples.iter().map(number).collect(),
            n_samples,
        }
    }

    /// The group in which an outcome counts, and whether it is a true positive there.
    fn judge(&self, sample_idx: usize, outcome: Outcome<'_>) -> Option<(usize, bool)> {
        match outcome {
            Outcome::Matched(truth, _) => Some((self.of_truth[truth.number]?, true)),
            Outcome::Misclassified(truth) => Some((self.of_truth[truth.number]?, false)),
            Outcome::Unmatched => Some((self.of_sample[sample_idx]?, false)),
        }
    }

    fn scores(&self, matching: &Matching<'_>, protocol: &Protocol) -> Breakdown {
        let is_found = PerClass::from_fn(|class| self.are_met(matching, class, protocol).0);
        let scores = PerClass::from_fn(|class| {
            let mut scores = self.curves(matching, class, protocol);
            // Made by the other class's detections on truths of this one.
            let other = Harm::ALL[1 - class.index()];
            let is_misclassified = self.are_met(matching, other, protocol).1;
            for (number, group) in self.of_truth.iter().enumerate() {
                let Some(group) = group.filter(|_| self.truths[number].harm == class) else { continue };
                let of_group = &mut scores[group];
                match (is_found.get(class)[number], is_misclassified[number]) {
                    (true, _) => of_group.n_found += 1,
                    (false, true) => of_group.n_misclassified += 1,
                    (false, false) => of_group.n_missed += 1,
                }
            }
            for of_group in scores.iter_mut().filter(|of_group| of_group.n_truths > 0) {
                of_group.recall = Some(of_group.n_found as f64 / of_group.n_truths as f64);
            }
            scores
        });
        let groups = (0..self.names.len()).map(|group| Group {
            name: self.names[group].clone(),
            n_samples: self.n_samples[group],
            classes: PerClass::from_fn(|class| scores.get(class)[group].clone()),
        });
        Breakdown { axis: self.axis, groups: groups.collect() }
    }

    /// AP of each group, its truths and false positives.
    fn curves(&self, matching: &Matching<'_>, class: Harm, protocol: &Protocol) -> Vec<GroupScores> {
        let (config, matching) = (protocol.config(), matching.get(class));
        let mut scores = vec![GroupScores::default(); self.names.len()];
        for (truth, group) in self.truths.iter().zip(&self.of_truth) {
            if let Some(group) = group.filter(|_| truth.harm == class) {
                scores[group].n_truths += 1;
            }
        }
        for threshold_idx in 0..config.dist_thresholds_m.len() {
            let mut judged = vec![Vec::new(); self.names.len()];
            for (ranked, outcome) in matching.at(threshold_idx) {
                let score = ranked.detection.score;
                let Some((group, is_match)) = self.judge(ranked.sample_idx, outcome) else { continue };
                judged[group].push((score, is_match));
                if threshold_idx == protocol.tp_threshold_idx()
                    && !is_match
                    && score >= config.operating_score
                {
                    scores[group].n_false += 1;
                }
            }
            for (of_group, judged) in scores.iter_mut().zip(judged) {
                if of_group.n_truths > 0 {
                    let curve = Curve::new(judged, of_group.n_truths);
                    let ap = curve.average_precision(protocol.first_step(), config.min_precision);
                    of_group.per_threshold.push(ap);
                }
            }
        }
        for of_group in scores.iter_mut().filter(|of_group| of_group.n_truths > 0) {
            of_group.ap = Some(mean(&of_group.per_threshold));
        }
        scores
    }

    /// Which truths the detections of a class are matched to, and which they are misclassified on, at the threshold of
    /// the errors and the operating score.
    fn are_met(&self, matching: &Matching<'_>, class: Harm, protocol: &Protocol) -> (Vec<bool>, Vec<bool>) {
        let (mut matched, mut misclassified) =
            (vec![false; self.truths.len()], vec![false; self.truths.len()]);
        let ranked = matching.get(class).at(protocol.tp_threshold_idx());
        for (_, outcome) in
            ranked.take_while(|(ranked, _)| ranked.detection.score >= protocol.config().operating_score)
        {
            match outcome {
                Outcome::Matched(truth, _) => matched[truth.number] = true,
                Outcome::Misclassified(truth) => misclassified[truth.number] = true,
                Outcome::Unmatched => {}
            }
        }
        (matched, misclassified)
    }
}

#[cfg(test)]
mod tests {
    use super::super::matching::tests::{found, truth};
    use super::super::{EvalDetection, Mode, SampleFacts, TruthFacts, evaluate};
    use super::*;

    fn of_category(category: &str, x_m: f64, harm: Harm) -> EvalTruth {
        let facts = TruthFacts { category: Some(category.into()), ..TruthFacts::default() };
        EvalTruth { facts, ..truth(x_m, harm, Distribution::Id) }
    }

    fn in_town(town: &str, truths: Vec<EvalTruth>, detections: Vec<EvalDetection>) -> EvalSample {
        let facts = SampleFacts { town: Some(town.into()), ..SampleFacts::default() };
        EvalSample { id: town.into(), facts, truths, detections }
    }

    fn group<'a>(breakdowns: &'a [Breakdown], axis: Axis, name: &str) -> &'a Group {
        let breakdown = breakdowns.iter().find(|breakdown| breakdown.axis == axis).unwrap();
        breakdown.groups.iter().find(|group| group.name == name).unwrap()
    }

    /// A car that is found, a pole that is called harmful, and a false alarm, in one town; a missed car in another.
    fn breakdowns() -> Vec<Breakdown> {
        let samples = [
            in_town(
                "a",
                vec![of_category("car", 8.0, Harm::Harmful), of_category("pole", 20.0, Harm::Harmless)],
                vec![
                    found(40.0, Harm::Harmful, 0.9),
                    found(20.0, Harm::Harmful, 0.8),
                    found(8.0, Harm::Harmful, 0.7),
                ],
            ),
            in_town("b", vec![of_category("car", 8.0, Harm::Harmful)], vec![]),
        ];
        evaluate(&samples, &Protocol::default(), Mode::Id).unwrap().breakdowns
    }

    #[test]
    fn in_a_group_of_objects_only_what_was_made_on_its_truths_counts() {
        let breakdowns = breakdowns();
        let cars = group(&breakdowns, Axis::IdCategory, "car");
        assert_eq!((cars.n_samples, cars.classes.harmful.n_truths, cars.classes.harmful.n_false), (2, 2, 0));
        assert_eq!((cars.classes.harmful.n_found, cars.classes.harmful.n_missed), (1, 1));
        // One of two found with nothing false: precision 1 up to recall one half.
        assert!((cars.classes.harmful.ap.unwrap() - 40.0 / 90.0).abs() < 1e-12);
        let poles = &group(&breakdowns, Axis::IdCategory, "pole").classes;
        assert_eq!((poles.harmless.n_misclassified, poles.harmful.n_false), (1, 1));
        assert_eq!((poles.harmful.ap, poles.harmless.ap), (None, Some(0.0)));
    }

    #[test]
    fn in_a_group_of_samples_the_scores_are_those_of_its_samples_alone() {
        let breakdowns = breakdowns();
        let town = &group(&breakdowns, Axis::Town, "a").classes.harmful;
        // Two false before the one true: precision rises from 0 to 1/3, a line over recall, and is above 0.1 from 0.31.
        let area: f64 = (31..=100).map(|step| f64::from(step) / 300.0 - 0.1).sum();
        assert!((town.ap.unwrap() - area / 90.0 / 0.9).abs() < 1e-12);
        assert_eq!((town.n_false, town.recall), (2, Some(1.0)));
        assert_eq!(group(&breakdowns, Axis::Town, "b").classes.harmful.recall, Some(0.0));
    }

    #[test]
    fn axes_without_facts_are_left_out_and_bands_are_named_by_their_edges() {
        let axes: Vec<Axis> = breakdowns().iter().map(|breakdown| breakdown.axis).collect();
        assert_eq!(
            axes,
            [Axis::Distribution, Axis::IdCategory, Axis::RangeM, Axis::NLidarPoints, Axis::Town]
        );
        let names = [-3.0, -1.0, 0.0, 7.0].map(|value| band(value, &[-1.0, 0.5]));
        let wanted = [(0, "below -1"), (1, "-1 to 0.5"), (1, "-1 to 0.5"), (2, "0.5 and more")];
        assert_eq!(names, wanted.map(|(at, name)| (at, name.to_owned())));
    }
}
