//! Scores by group: what kind of object, where, how well seen, in what weather, how near the zone's edge.
//!
//! An axis sorts truths into groups. Where the group is a property of the sample (town, weather, speed, steering), the
//! scores are those of its samples alone. Where it is a property of the object, the truths of the group are the
//! positives; detections on truths of other groups are neither true nor false positives, a misclassified one counts
//! in the group of the truth that it lies on, and unmatched ones count nowhere, since nothing says which
//! group they belong to. Truths (and, on sample axes, samples) whose fact is not known are in no group.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::axis::{Axis, Label};
use super::curve::Curve;
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
    of_object: Vec<Option<usize>>,
    /// Group of each sample; `None` on axes of objects.
    of_sample: Vec<Option<usize>>,
    n_samples: Vec<usize>,
}

impl<'a> Grouping<'a> {
    fn new(axis: Axis, matching: &'a Matching<'a>) -> Self {
        let config = &matching.config().breakdown;
        let labels_of_samples: Vec<Option<Label>> =
            matching.samples.iter().map(|sample| axis.label_sample(sample.facts, config)).collect();
        let label = |of: &PlacedObject<'_>| {
            if axis.is_of_samples() {
                labels_of_samples[of.sample_idx].clone()
            } else {
                axis.label_object(matching.facts_of(of), &of.object.truth, config)
            }
        };
        let labels_of_objects: Vec<Option<Label>> = matching.objects.iter().map(label).collect();
        let all = labels_of_samples.iter().chain(&labels_of_objects).flatten();
        let mut numbers: BTreeMap<&Label, usize> = all.map(|label| (label, 0)).collect();
        numbers.values_mut().enumerate().for_each(|(i, number)| *number = i);
        let number = |label: &Option<Label>| label.as_ref().map(|label| numbers[label]);
        let of_sample: Vec<Option<usize>> = labels_of_samples.iter().map(number).collect();
        let of_object: Vec<Option<usize>> = labels_of_objects.iter().map(number).collect();
        let objects = matching.objects.iter().zip(&of_object).map(|(of, &group)| (group, of.sample_idx));
        let samples = of_sample.iter().enumerate().map(|(i, &group)| (group, i));
        let present: BTreeSet<(usize, usize)> =
            objects.chain(samples).filter_map(|(group, sample_idx)| Some((group?, sample_idx))).collect();
        let mut n_samples = vec![0; numbers.len()];
        present.into_iter().for_each(|(group, _)| n_samples[group] += 1);
        let names = numbers.keys().map(|label| label.1.clone()).collect();
        Self { axis, matching, names, of_object, of_sample, n_samples }
    }

    /// The group in which an outcome counts, and whether it is a true positive there.
    fn judge(&self, sample_idx: usize, outcome: Outcome<'_>) -> Option<(usize, bool)> {
        match outcome {
            Outcome::Matched(of, _) => Some((self.of_object[of.number]?, true)),
            Outcome::Misclassified(of) => Some((self.of_object[of.number]?, false)),
            Outcome::Unmatched => Some((self.of_sample[sample_idx]?, false)),
            Outcome::Neutral(_) => None,
        }
    }

    fn measure(&self) -> Breakdown {
        let scores = PerClass::from_fn(|class| self.score(class));
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
        let is_found = matching.meet(class, config.operating_score).is_matched;
        // Mistakes of the other class's detections on objects of this class.
        let is_mistaken = matching.meet(class.other(), config.operating_score).is_mistaken;
        for of in matching.objects.iter().filter(|of| of.object.harm == class) {
            let Some(group) = self.of_object[of.number] else { continue };
            let of_group = &mut scores[group];
            of_group.n_truths += 1;
            match (is_found[of.number], is_mistaken[of.number]) {
                (true, _) => of_group.n_found += 1,
                (false, true) => of_group.n_misclassified += 1,
                (false, false) => of_group.n_missed += 1,
            }
        }
        for (ranked, outcome) in matching.operating(class) {
            if let Some((group, false)) = self.judge(ranked.sample_idx, outcome) {
                scores[group].n_false += 1;
            }
        }
        for threshold_idx in 0..config.dist_thresholds_m.len() {
            let mut positives = vec![Vec::new(); self.names.len()];
            for (ranked, outcome) in matching.at(class, threshold_idx) {
                if let Some((group, is_match)) = self.judge(ranked.sample_idx, outcome) {
                    positives[group].push((ranked.detection.score, is_match));
                }
            }
            for (of_group, positives) in scores.iter_mut().zip(positives).filter(|(of, _)| of.n_truths > 0) {
                let curve = Curve::new(positives, of_group.n_truths);
                let ap = curve.average_precision(matching.protocol.first_step(), config.min_precision);
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
