//! A closed-set detector's harm: decided by the kind of object, and harmful where the kind is in doubt.
//!
//! A network that detects vehicles, pedestrians and static objects has no name for anything else. As in Huang
//! et al. (ITSC 2022) and Koesel et al. (IV 2024), a score of strangeness says which boxes it has no name
//! for:
//!
//! - MSP: 1 - the largest softmax of the logits (Hendrycks and Gimpel 2017);
//! - energy: - log of the sum of exponentials of the logits (Liu et al. 2020);
//! - Mahalanobis: squared distance of the features to the nearest kind's mean under one covariance (Lee et al. 2018).
//!
//! Fitted on the training split: the share of harmful objects of each kind, means and covariance of features, and the
//! strangeness below which 95 % of the boxes on training objects lie. A box above it is unknown, and harmful with its
//! whole score; for other boxes the kind's share splits the score into harmful and harmless.

use burn::tensor::Device;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use thiserror::Error;

use super::predict::{PredictError, detect_kinds};
use crate::dataset::Dataset;
use crate::eval::center_distance_m;
use crate::model::{Detector, KindBox};
use crate::object::{Detection, Harm, Kind, LabelledObject, MIN_SCORE};
use crate::progress::Progress;

/// Share of the boxes on training objects that count as known.
const KEPT: f64 = 0.95;
/// A box within this distance of an object lies on it, metres.
const ON_OBJECT_M: f64 = 2.0;
/// Added to the covariance's diagonal, as a share of its mean: features that never vary leave it singular.
const RIDGE: f64 = 1e-3;

/// A score of strangeness.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Strangeness {
    Msp,
    Energy,
    Mahalanobis,
}

impl Strangeness {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Msp, Self::Energy, Self::Mahalanobis];

    /// The rival's name in files and flags.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Msp => "closed-msp",
            Self::Energy => "closed-energy",
            Self::Mahalanobis => "closed-mahalanobis",
        }
    }
}

/// Why a closed set could not be fitted.
#[derive(Debug, Error)]
pub enum ClosedSetError {
    #[error(transparent)]
    Predict(#[from] PredictError),
    #[error(
        "no box of the network lies on a {kind:?} of the training split; a closed set needs all of {:?}",
        Kind::ALL
    )]
    NotFound { kind: Kind },
    #[error("the network's features have no covariance: they are not finite")]
    Features,
}

/// What was learnt from the training split.
#[derive(Debug, Clone)]
pub struct ClosedSet {
    /// Share of harmful objects, by kind.
    harmful_share: [f64; 3],
    means: [DVector<f64>; 3],
    covariance: Cholesky<f64, Dyn>,
    /// Threshold of strangeness, by score.
    thresholds: [f64; 3],
}

impl ClosedSet {
    /// Fits to a training split, with the boxes of a network that detects kinds.
    ///
    /// # Errors
    /// The network detects harm, not kinds; a sample is broken; or as [`Self::fit`].
    pub fn fit_to(
        detector: &Detector,
        training: &Dataset,
        device: &Device,
        progress: &dyn Progress,
    ) -> Result<Self, ClosedSetError> {
        let found = detect_kinds(detector, training, "fit", device, progress)?;
        let objects = training.samples().iter().map(|sample| sample.objects.as_slice());
        Self::fit(&objects.zip(found.iter().map(Vec::as_slice)).collect::<Vec<_>>())
    }

    /// Fits to frames of the training split, each with its objects and the network's boxes, best first.
    ///
    /// # Errors
    /// No box lies on any object of a kind, or features are not finite.
    pub fn fit(frames: &[(&[LabelledObject], &[KindBox])]) -> Result<Self, ClosedSetError> {
        let located: Vec<(&LabelledObject, &KindBox)> =
            frames.iter().flat_map(|(objects, boxes)| pair(objects, boxes)).collect();
        let of_kind = |kind: Kind| located.iter().filter(move |(object, _)| object.truth.kind == Some(kind));
        if let Some(kind) = Kind::ALL.into_iter().find(|&kind| of_kind(kind).next().is_none()) {
            return Err(ClosedSetError::NotFound { kind });
        }
        let harmful_share = Kind::ALL.map(|kind| {
            let n_harmful = of_kind(kind).filter(|(object, _)| object.harm == Harm::Harmful).count();
            n_harmful as f64 / of_kind(kind).count() as f64
        });
        let means = Kind::ALL.map(|kind| {
            let sum = of_kind(kind).map(|(_, found)| vector(found)).reduce(|a, b| a + b);
            sum.expect("a box lies on some object of each kind") / of_kind(kind).count() as f64
        });
        let n_channels = means[0].len();
        let mut covariance = DMatrix::zeros(n_channels, n_channels);
        for (kind, found) in located.iter().filter_map(|(object, found)| Some((object.truth.kind?, found))) {
            let off = vector(found) - &means[kind.index()];
            covariance.ger(1.0 / located.len() as f64, &off, &off, 1.0);
        }
        let ridge = RIDGE * covariance.trace() / n_channels as f64 + f64::MIN_POSITIVE.sqrt();
        covariance += DMatrix::identity(n_channels, n_channels) * ridge;
        let covariance = Cholesky::new(covariance).ok_or(ClosedSetError::Features)?;
        let mut fitted = Self { harmful_share, means, covariance, thresholds: [f64::INFINITY; 3] };
        fitted.thresholds = Strangeness::ALL.map(|score| {
            let mut values: Vec<f64> =
                located.iter().map(|(_, found)| fitted.strangeness(score, found)).collect();
            values.sort_by(f64::total_cmp);
            values[((KEPT * values.len() as f64).ceil() as usize).clamp(1, values.len()) - 1]
        });
        Ok(fitted)
    }

    /// How strange a box is to the closed set; larger is stranger.
    #[must_use]
    pub fn strangeness(&self, score: Strangeness, found: &KindBox) -> f64 {
        let logits = found.logits.map(f64::from);
        let largest = logits.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = logits.iter().map(|logit| (logit - largest).exp()).sum();
        match score {
            Strangeness::Msp => 1.0 - 1.0 / sum,
            Strangeness::Energy => -(largest + sum.ln()),
            Strangeness::Mahalanobis => {
                let features = vector(found);
                let distance = |mean: &DVector<f64>| {
                    let off = &features - mean;
                    off.dot(&self.covariance.solve(&off))
                };
                self.means.iter().map(distance).fold(f64::INFINITY, f64::min)
            }
        }
    }

    /// The detections of a sample, best first; those below [`MIN_SCORE`] are left out.
    #[must_use]
    pub fn judge(&self, score: Strangeness, found: &[KindBox]) -> Vec<Detection> {
        let threshold = self.thresholds[score as usize];
        let mut judged = Vec::with_capacity(found.len());
        for one in found {
            let is_known = self.strangeness(score, one) <= threshold;
            let p = if is_known { self.harmful_share[one.kind_idx()] as f32 } else { 1.0 };
            for (harm, share) in [(Harm::Harmful, p), (Harm::Harmless, 1.0 - p)] {
                let score = share * one.objectness;
                if score >= MIN_SCORE {
                    let (box_in_ego, velocity_in_ego_mps) = (one.box_in_ego, one.velocity_in_ego_mps);
                    judged.push(Detection {
                        box_in_ego,
                        velocity_in_ego_mps,
                        harm,
                        score: score.into(),
                        spread: None,
                    });
                }
            }
        }
        judged.sort_by(|a, b| b.score.total_cmp(&a.score));
        judged
    }
}

fn vector(found: &KindBox) -> DVector<f64> {
    DVector::from_iterator(found.features.len(), found.features.iter().map(|&x| f64::from(x)))
}

/// Objects with the boxes on them: each box, best first, takes the nearest object that none has taken.
fn pair<'a>(objects: &'a [LabelledObject], boxes: &'a [KindBox]) -> Vec<(&'a LabelledObject, &'a KindBox)> {
    let mut is_taken = vec![false; objects.len()];
    let mut pairs = Vec::new();
    for found in boxes {
        let nearest = objects
            .iter()
            .enumerate()
            .filter(|(i, _)| !is_taken[*i])
            .map(|(i, object)| (i, center_distance_m(&found.box_in_ego, &object.truth.box_in_ego)))
            .filter(|&(_, distance_m)| distance_m < ON_OBJECT_M)
            .min_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((i, _)) = nearest {
            is_taken[i] = true;
            pairs.push((&objects[i], found));
        }
    }
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;

    /// Objects of the three kinds in turn, harmful as given, with boxes on them.
    fn frame(harms: &[Harm], features: impl Fn(usize) -> Vec<f32>) -> (Vec<LabelledObject>, Vec<KindBox>) {
        let template = test_data::dataset(1).samples()[0].objects[0].clone();
        let object = |(i, &harm): (usize, &Harm)| {
            let mut object = LabelledObject { harm, ..template.clone() };
            object.truth.kind = Some(Kind::ALL[i % 3]);
            object.truth.box_in_ego.center.coords.x = 10.0 * i as f64;
            object
        };
        let objects: Vec<LabelledObject> = harms.iter().enumerate().map(object).collect();
        let found = |(i, object): (usize, &LabelledObject)| {
            let mut logits = [0.0; 3];
            logits[i % 3] = 4.0;
            KindBox {
                box_in_ego: object.truth.box_in_ego,
                velocity_in_ego_mps: [0.0; 2],
                spread: None,
                score: 0.5,
                objectness: 0.8,
                logits,
                features: features(i),
            }
        };
        let boxes = objects.iter().enumerate().map(found).collect();
        (objects, boxes)
    }

    fn harms(n: usize) -> Vec<Harm> {
        // The first of each kind is harmful, the rest not.
        (0..n).map(|i| if i < 3 { Harm::Harmful } else { Harm::Harmless }).collect()
    }

    /// Two features: a kind's mean at (10 kind, 0), spread by a tenth.
    fn features(i: usize) -> Vec<f32> {
        let side = if (i / 3).is_multiple_of(2) { 0.1 } else { -0.1 };
        vec![10.0 * (i % 3) as f32 + side, if (i / 6).is_multiple_of(2) { 0.1 } else { -0.1 }]
    }

    #[test]
    fn known_boxes_have_their_kinds_share_and_unknown_ones_are_harmful() {
        let (objects, boxes) = frame(&harms(12), features);
        let set = ClosedSet::fit(&[(objects.as_slice(), boxes.as_slice())]).unwrap();
        assert_eq!(set.harmful_share, [0.25; 3]);
        let told = |score, found: &KindBox| -> Vec<(Harm, i32)> {
            let judged = set.judge(score, std::slice::from_ref(found));
            judged.iter().map(|d| (d.harm, (100.0 * d.score).round() as i32)).collect()
        };
        let strange =
            |logits, features: [f32; 2]| KindBox { logits, features: features.to_vec(), ..boxes[0].clone() };
        for score in Strangeness::ALL {
            assert_eq!(told(score, &boxes[0]), [(Harm::Harmless, 60), (Harm::Harmful, 20)], "{score:?}");
        }
        let undecided = strange([1.0, 1.0, 0.9], [0.1, 0.1]);
        assert_eq!(told(Strangeness::Msp, &undecided), [(Harm::Harmful, 80)]);
        // All logits are low, though their ratios are as sure as before.
        let faint = strange([0.0, -4.0, -4.0], [0.1, 0.1]);
        assert_eq!(told(Strangeness::Msp, &faint).len(), 2);
        assert_eq!(told(Strangeness::Energy, &faint), [(Harm::Harmful, 80)]);
        let far = strange(boxes[0].logits, [0.1, 3.0]);
        assert_eq!(told(Strangeness::Msp, &far).len(), 2);
        assert_eq!(told(Strangeness::Mahalanobis, &far), [(Harm::Harmful, 80)]);
    }

    #[test]
    fn scores_are_those_worked_out_by_hand() {
        let (objects, boxes) = frame(&harms(12), features);
        let set = ClosedSet::fit(&[(objects.as_slice(), boxes.as_slice())]).unwrap();
        let found = KindBox { logits: [1.0, 1.0, 0.0], features: vec![1.0, 0.0], ..boxes[0].clone() };
        let e = std::f64::consts::E;
        assert!((set.strangeness(Strangeness::Msp, &found) - (1.0 - e / (2.0 * e + 1.0))).abs() < 1e-12);
        assert!((set.strangeness(Strangeness::Energy, &found) + (2.0 * e + 1.0).ln()).abs() < 1e-12);
        // Variance 0.01 along both axes, a thousandth more by the ridge; 1 from the nearest mean.
        let expected = 1.0 / (0.01 * (1.0 + RIDGE));
        let distance = set.strangeness(Strangeness::Mahalanobis, &found);
        assert!((distance / expected - 1.0).abs() < 1e-4, "{distance} against {expected}");
    }

    #[test]
    fn a_kind_without_a_box_is_named_and_each_object_has_one_box() {
        let (objects, boxes) = frame(&harms(2), features);
        let error = ClosedSet::fit(&[(objects.as_slice(), boxes.as_slice())]).unwrap_err();
        assert!(matches!(error, ClosedSetError::NotFound { kind: Kind::Static }), "{error}");
        let twice = [boxes.clone(), boxes].concat();
        assert_eq!(pair(&objects, &twice).len(), 2);
    }
}
