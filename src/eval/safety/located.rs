//! Which detections lie on which object, whatever class either has, and how harmful that makes it.
//!
//! In a sample the detections of each class go by descending score, the later first among equals; each takes the
//! nearest truth, of any class, that no other detection of its class has taken, if nearer than the threshold.

use crate::eval::matching::center_distance_m;
use crate::eval::{EvalDetection, EvalSample, EvalTruth};
use crate::object::Harm;

/// A truth with the scores of the detections on it.
#[derive(Debug, Clone)]
pub struct Located<'a> {
    pub truth: &'a EvalTruth,
    pub sample_idx: usize,
    harmful_score: Option<f64>,
    harmless_score: Option<f64>,
}

impl<'a> Located<'a> {
    /// Every truth of all samples, in order; most have detections.
    pub fn of_samples(samples: &'a [EvalSample], threshold_m: f64) -> Vec<Self> {
        samples
            .iter()
            .enumerate()
            .flat_map(|(sample_idx, sample)| {
                let [harmful, harmless] = Harm::ALL.map(|class| best_scores(sample, class, threshold_m));
                let both = harmful.into_iter().zip(harmless);
                sample.truths.iter().zip(both).map(move |(truth, (harmful_score, harmless_score))| Self {
                    truth,
                    sample_idx,
                    harmful_score,
                    harmless_score,
                })
            })
            .collect()
    }

    /// Harmful score over the sum of both, 0 to 1; `None` if nothing lies on the object, or no score is above zero.
    pub fn harm_probability(&self) -> Option<f64> {
        if self.harmful_score.is_none() && self.harmless_score.is_none() {
            return None;
        }
        let score = |found: Option<f64>| found.unwrap_or(0.0).max(0.0);
        let sum = score(self.harmful_score) + score(self.harmless_score);
        (sum > 0.0).then(|| score(self.harmful_score) / sum)
    }
}

/// The score of the class's detection on each truth of a sample.
fn best_scores(sample: &EvalSample, class: Harm, threshold_m: f64) -> Vec<Option<f64>> {
    let mut ranked: Vec<&EvalDetection> =
        sample.detections.iter().filter(|detection| detection.harm == class).collect();
    ranked.sort_by(|a, b| a.score.total_cmp(&b.score));
    let mut scores = vec![None; sample.truths.len()];
    for detection in ranked.into_iter().rev() {
        let mut nearest: Option<(usize, f64)> = None;
        for (i, truth) in sample.truths.iter().enumerate() {
            let distance_m = center_distance_m(&detection.box_in_ego, &truth.box_in_ego);
            let is_free = scores[i].is_none() && distance_m < threshold_m;
            if is_free && nearest.is_none_or(|(_, least_m)| distance_m < least_m) {
                nearest = Some((i, distance_m));
            }
        }
        if let Some((i, _)) = nearest {
            scores[i] = Some(detection.score);
        }
    }
    scores
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::SampleFacts;
    use crate::eval::matching::tests::{found, truth};
    use crate::object::Distribution;

    #[test]
    fn both_classes_detections_share_an_object_and_a_second_one_goes_to_the_next() {
        let sample = EvalSample {
            id: "s".into(),
            facts: SampleFacts::default(),
            truths: vec![
                truth(10.0, Harm::Harmless, Distribution::Id),
                truth(11.5, Harm::Harmful, Distribution::Id),
                truth(30.0, Harm::Harmful, Distribution::Id),
            ],
            detections: vec![
                found(10.0, Harm::Harmful, 0.2),
                found(10.0, Harm::Harmless, 0.6),
                found(10.1, Harm::Harmful, 0.1),
            ],
        };
        let samples = [sample];
        let located = Located::of_samples(&samples, 2.0);
        let probabilities: Vec<_> = located.iter().map(Located::harm_probability).collect();
        assert!((probabilities[0].unwrap() - 0.25).abs() < 1e-12);
        assert_eq!(probabilities[1..], [Some(1.0), None]);
    }
}
