//! How harmful the detections on an object make it, whatever class either has.
//!
//! In a sample the detections of each class go by descending score, the later first among equals; each takes the
//! nearest object, of any class, that no other detection of its class has taken, if nearer than the threshold. The
//! probability of harm is the harmful score over the sum of both.

use crate::eval::filter::KeptSample;
use crate::eval::matching::Matching;
use crate::geometry::{Box3, Ego};
use crate::object::Harm;

/// Probability of harm of each object, by number; `None` if nothing lies on it, or no score is above zero.
pub fn measure(matching: &Matching<'_>) -> Vec<Option<f64>> {
    let mut locator = Locator { threshold_m: matching.config().tp_threshold_m, ..Locator::default() };
    let mut probabilities = Vec::with_capacity(matching.objects.len());
    for sample in &matching.samples {
        locator.find_scores(sample);
        probabilities.extend(locator.scores.iter().map(|&[harmful, harmless]| share(harmful, harmless)));
    }
    probabilities
}

fn share(harmful: Option<f64>, harmless: Option<f64>) -> Option<f64> {
    let [harmful, harmless] = [harmful, harmless].map(|score| score.unwrap_or(0.0).max(0.0));
    let sum = harmful + harmless;
    (sum > 0.0).then(|| harmful / sum)
}

/// Finds which detections lie on the objects of sample after sample, in memory that is asked for once.
#[derive(Default)]
struct Locator {
    threshold_m: f64,
    /// Each class's score on each object.
    scores: Vec<[Option<f64>; Harm::ALL.len()]>,
    centers_m: Vec<[f64; 2]>,
    /// Scores and places of the detections, best first.
    order: Vec<(f64, usize)>,
}

impl Locator {
    fn find_scores(&mut self, sample: &KeptSample<'_>) {
        let center = |of: &Box3<Ego>| [of.center.x(), of.center.y()];
        self.centers_m.clear();
        self.centers_m.extend(sample.objects.iter().map(|object| center(&object.truth.box_in_ego)));
        self.scores.clear();
        self.scores.resize(sample.objects.len(), [None; Harm::ALL.len()]);
        self.order.clear();
        self.order.extend(sample.detections.iter().enumerate().map(|(i, found)| (found.score, i)));
        self.order.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)));
        // More than what rounding can add to a distance below the threshold.
        let reach_m2 = self.threshold_m * self.threshold_m * (1.0 + 1e-9);
        for &(score, at) in &self.order {
            let found = sample.detections[at];
            let ([x_m, y_m], class) = (center(&found.box_in_ego), found.harm.index());
            let mut nearest: Option<(usize, f64)> = None;
            for (i, &[object_x_m, object_y_m]) in self.centers_m.iter().enumerate() {
                let (dx, dy) = (x_m - object_x_m, y_m - object_y_m);
                let squared = dx * dx + dy * dy;
                if squared > reach_m2 || self.scores[i][class].is_some() {
                    continue;
                }
                // As `center_distance_m` has it, to the last bit.
                let distance_m = squared.sqrt();
                if distance_m < self.threshold_m && nearest.is_none_or(|(_, least_m)| distance_m < least_m) {
                    nearest = Some((i, distance_m));
                }
            }
            if let Some((i, _)) = nearest {
                self.scores[i][class] = Some(score);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::SampleFacts;
    use crate::eval::matching::tests::{found, truth};
    use crate::eval::{EvalSample, Mode, Protocol};
    use crate::object::Distribution;

    #[test]
    fn both_classes_detections_share_an_object_and_a_second_one_goes_to_the_next() {
        let samples = [EvalSample {
            id: "s".into(),
            facts: SampleFacts::default(),
            n_points: vec![],
            objects: vec![
                truth(10.0, Harm::Harmless, Distribution::Id),
                truth(11.5, Harm::Harmful, Distribution::Id),
                truth(30.0, Harm::Harmful, Distribution::Id),
            ],
            detections: vec![
                found(10.0, Harm::Harmful, 0.2),
                found(10.0, Harm::Harmless, 0.6),
                found(10.1, Harm::Harmful, 0.1),
            ],
        }];
        let protocol = Protocol::default();
        let found = measure(&Matching::new(&samples, &protocol, Mode::Id).unwrap());
        assert!((found[0].unwrap() - 0.25).abs() < 1e-12);
        assert_eq!(found[1..], [Some(1.0), None]);
    }
}
