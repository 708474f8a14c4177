//! How harmful the detections on an object make it, whatever class either has.
//!
//! In a sample the detections of each class go by descending score, the later first among equals; each takes the
//! nearest object, of any class, that no other detection of its class has taken, if nearer than the threshold. The
//! probability of harm is the harmful score over the sum of both.

use crate::eval::filter::KeptSample;
use crate::eval::matching::{Matching, center_distance_m};
use crate::object::{Detection, Harm};

/// Probability of harm of each object, by number; `None` if nothing lies on it, or no score is above zero.
pub fn measure(matching: &Matching<'_>) -> Vec<Option<f64>> {
    let threshold_m = matching.config().tp_threshold_m;
    let of_sample = |sample| {
        let [harmful, harmless] = Harm::ALL.map(|class| find_scores(sample, class, threshold_m));
        harmful.into_iter().zip(harmless).map(|(harmful, harmless)| share(harmful, harmless))
    };
    matching.samples.iter().flat_map(of_sample).collect()
}

fn share(harmful: Option<f64>, harmless: Option<f64>) -> Option<f64> {
    let [harmful, harmless] = [harmful, harmless].map(|score| score.unwrap_or(0.0).max(0.0));
    let sum = harmful + harmless;
    (sum > 0.0).then(|| harmful / sum)
}

/// The score of the class's detection on each object of a sample.
fn find_scores(sample: &KeptSample<'_>, class: Harm, threshold_m: f64) -> Vec<Option<f64>> {
    let mut ranked: Vec<&Detection> =
        sample.detections.iter().copied().filter(|detection| detection.harm == class).collect();
    ranked.sort_by(|a, b| a.score.total_cmp(&b.score));
    let mut scores = vec![None; sample.objects.len()];
    for detection in ranked.into_iter().rev() {
        let mut nearest: Option<(usize, f64)> = None;
        for (i, object) in sample.objects.iter().enumerate() {
            let distance_m = center_distance_m(&detection.box_in_ego, &object.truth.box_in_ego);
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
