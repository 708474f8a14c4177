//! Scores by group: what kind of object, where, how well seen, in what weather, how near the zone's edge.
//!
//! An axis sorts truths into groups. Where the group is a property of the sample (town, weather, rings of the LiDAR, speed, steering), the
//! scores are those of its samples alone. Where it is a property of the object, the truths of the group are the
//! positives; detections on truths of other groups are neither true nor false positives, a misclassified one counts
//! in the group of the truth that it lies on, and unmatched ones count nowhere, since nothing says which
//! group they belong to. Truths (and, on sample axes, samples) whose fact is not known are in no group.

use serde::{Deserialize, Serialize};

use super::axis::{Axis, Label};
use super::curve::GrowingCurve;
use super::matching::{Matching, Outcome, PerClass, PlacedObject};
use super::metrics::mean;
use crate::object::Harm;

/// The scores along one axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Breakdown {
    pub axis: Axis,
    /// Bands in their order, names in alphabetical order; a group without truth and sample is left out.
    pub groups: Vec<Group>,
}

/// Scores of one group.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Group {
    pub name: String,
    /// Samples in the group, or samples with a truth in it.
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
pub(super) fn measure(matching: &Matching<'_>) -> Vec<Breakdown> {
    let of_axis = |axis| Grouping::new(axis, matching).measure();
    Axis::ALL.into_iter().map(of_axis).filter(|breakdown| !breakdown.groups.is_empty()).collect()
}

/// Which sample or object is in which group.
struct Grouping<'a> {
    axis: Axis,
    matching: &'a Matching<'a>,
    names: Vec<String>,
    /// Group of each object, by number.
    of_object: Vec<Option<u32>>,
    /// Group of each sample; `None` on axes of objects.
    of_sample: Vec<Option<u32>>,
    n_samples: Vec<usize>,
}

impl<'a> Grouping<'a> {
    fn new(axis: Axis, matching: &'a Matching<'a>) -> Self {
        let config = &matching.config().breakdown;
        let mut groups = Groups::default();
        let samples = matching.samples.iter();
        let mut of_sample: Vec<Option<u32>> = samples
            .map(|sample| axis.label_sample(sample.facts, config).map(|label| groups.number(label)))
            .collect();
        let mut group_of = |of: &PlacedObject<'a>| {
            if axis.is_of_samples() {
                return of_sample[of.sample_idx];
            }
            let zone_distance_m = || matching.zone_distances_m()[of.number];
            let label = axis.label_object(&of.object.truth, zone_distance_m, config)?;
            Some(groups.number(label))
        };
        let mut of_object: Vec<Option<u32>> = matching.objects.iter().map(&mut group_of).collect();
        let labels = groups.sort([&mut of_sample, &mut of_object]);

        // Objects stand in the order of their samples.
        let mut n_samples = vec![0; labels.len()];
        let mut counted = vec![None; labels.len()];
        let objects = matching.objects.iter().zip(&of_object).map(|(of, &group)| (group, of.sample_idx));
        let samples = of_sample.iter().enumerate().map(|(i, &group)| (group, i));
        let of_axis: &mut dyn Iterator<Item = (Option<u32>, usize)> =
            if axis.is_of_samples() { &mut { samples } } else { &mut { objects } };
        for (group, sample_idx) in of_axis {
            let Some(group) = group else { continue };
            if counted[group as usize].replace(sample_idx) != Some(sample_idx) {
                n_samples[group as usize] += 1;
            }
        }
        let names = labels.into_iter().map(|label| axis.name_of(label, config)).collect();
        Self { axis, matching, names, of_object, of_sample, n_samples }
    }

    /// The group in which an outcome counts, and whether it is a true positive there.
    fn judge(&self, sample_idx: usize, outcome: Outcome) -> Option<(usize, bool)> {
        let (group, is_match) = match outcome {
            Outcome::Matched(of) => (self.of_object[of as usize], true),
            Outcome::Misclassified(of) => (self.of_object[of as usize], false),
            Outcome::Unmatched => (self.of_sample[sample_idx], false),
            Outcome::Neutral(_) => return None,
        };
        Some((group? as usize, is_match))
    }

    fn measure(&self) -> Breakdown {
        let scores =
            PerClass::from_fn(|class| if self.names.is_empty() { Vec::new() } else { self.score(class) });
        let groups = (0..self.names.len()).map(|group| Group {
            name: self.names[group].clone(),
            n_samples: self.n_samples[group],
            classes: PerClass::from_fn(|class| scores.get(class)[group].clone()),
        });
        Breakdown { axis: self.axis, groups: groups.collect() }
    }

    /// The scores of a class in each group.
    fn score(&self, class: Harm) -> Vec<GroupScores> {
        let (matching, config) = (self.matching, self.matching.config());
        let mut scores = vec![GroupScores::default(); self.names.len()];
        let is_found = &matching.met(class).is_matched;
        // Mistakes of the other class's detections on objects of this class.
        let is_mistaken = &matching.met(class.other()).is_mistaken;
        for of in matching.objects.iter().filter(|of| of.object.harm == class) {
            let Some(group) = self.of_object[of.number] else { continue };
            let of_group = &mut scores[group as usize];
            of_group.n_truths += 1;
            match (is_found[of.number], is_mistaken[of.number]) {
                (true, _) => of_group.n_found += 1,
                (false, true) => of_group.n_misclassified += 1,
                (false, false) => of_group.n_missed += 1,
            }
        }
        for threshold_idx in 0..config.dist_thresholds_m.len() {
            let counts_false = threshold_idx == matching.protocol.tp_threshold_idx();
            let mut curves: Vec<GrowingCurve> =
                scores.iter().map(|of_group| GrowingCurve::new(of_group.n_truths)).collect();
            for (ranked, outcome) in matching.at(class, threshold_idx) {
                let Some((group, is_match)) = self.judge(ranked.sample_idx, outcome) else { continue };
                curves[group].add(ranked.score, is_match);
                let is_false = counts_false && !is_match && ranked.score >= config.operating_score;
                scores[group].n_false += usize::from(is_false);
            }
            for (of_group, curve) in scores.iter_mut().zip(curves).filter(|(of, _)| of.n_truths > 0) {
                let first_step = matching.protocol.first_step();
                let ap = curve.finish().average_precision(first_step, config.min_precision);
                of_group.per_threshold.push(ap);
            }
        }
        for of_group in scores.iter_mut().filter(|of_group| of_group.n_truths > 0) {
            of_group.ap = Some(mean(&of_group.per_threshold));
            of_group.recall = Some(of_group.n_found as f64 / of_group.n_truths as f64);
        }
        scores
    }
}

/// The groups that occur, numbered as they come.
#[derive(Default)]
struct Groups<'a> {
    labels: Vec<Label<'a>>,
    latest: usize,
}

impl<'a> Groups<'a> {
    /// The number of a group.
    fn number(&mut self, label: Label<'a>) -> u32 {
        // There are few groups, and neighbours are often in the same.
        if self.labels.get(self.latest) != Some(&label) {
            let known = self.labels.iter().position(|&other| other == label);
            self.latest = known.unwrap_or(self.labels.len());
            if known.is_none() {
                self.labels.push(label);
            }
        }
        self.latest as u32
    }

    /// The groups in their order, by which the given numbers are replaced.
    fn sort(self, numbers: [&mut [Option<u32>]; 2]) -> Vec<Label<'a>> {
        let mut sorted = self.labels.clone();
        sorted.sort_unstable();
        let places: Vec<u32> = self
            .labels
            .iter()
            .map(|label| sorted.binary_search(label).expect("the same labels") as u32)
            .collect();
        for number in numbers.into_iter().flatten().flatten() {
            *number = places[*number as usize];
        }
        sorted
    }
}

#[cfg(test)]
mod tests {
    use super::super::matching::tests::{found, truth};
    use super::super::{EvalSample, Mode, Protocol, evaluate};
    use super::*;
    use crate::dataset::SampleFacts;
    use crate::object::{Detection, Distribution, LabelledObject};

    fn of_category(category: &str, x_m: f64, harm: Harm) -> LabelledObject {
        let mut car = truth(x_m, harm, Distribution::Id);
        car.truth.category = Some(category.into());
        car
    }

    fn in_town(town: &str, objects: Vec<LabelledObject>, detections: Vec<Detection>) -> EvalSample {
        let facts = SampleFacts { town: Some(town.into()), ..SampleFacts::default() };
        EvalSample::new(town, facts, objects, detections)
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
        // Two false ones rank before the true one: precision rises linearly from 0 to 1/3, and is above 0.1
        // from 0.31.
        let area: f64 = (31..=100).map(|step| f64::from(step) / 300.0 - 0.1).sum();
        assert!((town.ap.unwrap() - area / 90.0 / 0.9).abs() < 1e-12);
        assert_eq!((town.n_false, town.recall), (2, Some(1.0)));
        assert_eq!(group(&breakdowns, Axis::Town, "b").classes.harmful.recall, Some(0.0));
    }

    #[test]
    fn axes_without_facts_are_left_out() {
        let axes: Vec<Axis> = breakdowns().iter().map(|breakdown| breakdown.axis).collect();
        assert_eq!(
            axes,
            [Axis::Distribution, Axis::IdCategory, Axis::RangeM, Axis::NLidarPoints, Axis::Town]
        );
    }
}
