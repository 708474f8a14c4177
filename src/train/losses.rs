//! Losses of the TransFusion head.
//!
//! - Heatmap: Gaussian focal loss, `-log(p) (1-p)^2` at peaks, `-log(1-p) p^2 (1-t)^4` elsewhere,
//!   over the number of peaks (Law and Deng 2018).
//! - Harm, or kind: sigmoid focal loss, alpha 0.25, gamma 2, over the number of matched queries, `least_objects` a state at least (Lin et al. 2017);
//!   unmatched queries are background for all classes.
//! - Box: L1 over the code of matched queries, velocity weighted 0.2, over their number.

use burn::tensor::activation::{log_sigmoid, sigmoid};
use burn::tensor::{Device, Tensor, TensorData};

use super::assignment::assign;
use super::augment::ObjectsByState;
use super::config::LossConfig;
use super::targets::{IgnoredGround, class_of, draw_heatmap, is_ignored, is_on};
use crate::geometry::{Box3, Ego, Point, Point2};
use crate::model::coder::{CODE_SIZE, encode};
use crate::model::{ModelConfig, Output};
use crate::object::{Kind, LabelledObject};

/// A query this near to an object that is neither object nor nothing, or inside it, learns no class from being unmatched.
const IGNORED_GAP_M: f64 = 0.5;

/// Places of the yaw's sine and cosine in a code.
const SIN: usize = 6;
const COS: usize = 7;

const CODE_WEIGHTS: [f32; CODE_SIZE] = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.2, 0.2];

/// The loss and its parts; the parts are already weighted.
#[derive(Debug, Clone)]
pub struct Losses {
    pub total: Tensor<1>,
    pub parts: LossParts,
}

/// The parts as numbers, for logs.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LossParts {
    pub heatmap: f32,
    pub harm: f32,
    pub boxes: f32,
    /// Of [`super::picture::picture_loss`]; zero where there is none.
    pub picture: f32,
}

impl LossParts {
    #[must_use]
    pub fn total(&self) -> f32 {
        self.heatmap + self.harm + self.boxes + self.picture
    }
}

/// Computes the loss of the head for a batch; `objects` holds the trainable objects `[batch][state]`, `ignored` the ground of each
/// sample where nothing is learnt, or nothing if no sample has any. The heatmap is that of each sample's first state.
#[must_use]
pub fn losses(
    output: &Output,
    objects: &[ObjectsByState],
    ignored: &[IgnoredGround],
    model: &ModelConfig,
    config: &LossConfig,
) -> Losses {
    let device = output.heatmap.device();
    let heatmap =
        heatmap_loss(output, objects, ignored, model, config, &device).mul_scalar(config.heatmap_weight);
    let (harm, boxes) = query_losses(output, objects, ignored, model, config, &device);
    let (harm, boxes) = (harm.mul_scalar(config.harm_weight), boxes.mul_scalar(config.box_weight));
    // Read all at once: a GPU finishes its work before each reading.
    let parts = Tensor::cat([&heatmap, &harm, &boxes].map(|part| part.clone().detach()).to_vec(), 0);
    let parts: Vec<f32> = parts.into_data().try_to_vec().expect("losses are f32");
    let parts = LossParts { heatmap: parts[0], harm: parts[1], boxes: parts[2], picture: 0.0 };
    Losses { total: heatmap + harm + boxes, parts }
}

/// A sample's ignored ground.
fn ground_of(ignored: &[IgnoredGround], sample: usize) -> &[Vec<Point2>] {
    ignored.get(sample).map_or(&[], Vec::as_slice)
}

fn heatmap_loss(
    output: &Output,
    objects: &[ObjectsByState],
    ignored: &[IgnoredGround],
    model: &ModelConfig,
    config: &LossConfig,
    device: &Device,
) -> Tensor<1> {
    let samples = objects.iter().enumerate();
    let target: Vec<f32> = samples
        .flat_map(|(i, states)| draw_heatmap(&states[0], ground_of(ignored, i), model, config))
        .collect();
    gaussian_focal(
        output.heatmap.clone(),
        Tensor::from_data(TensorData::new(target, output.heatmap.dims()), device),
        config.least_objects,
    )
}

/// The Gaussian focal loss of a map, divided by the number of ones in its target, or by `least` if there are fewer.
fn gaussian_focal(logits: Tensor<4>, target: Tensor<4>, least: f64) -> Tensor<1> {
    // Scores are clipped as published, so that a map that is far off keeps a finite loss.
    let p = sigmoid(logits).clamp(1e-4, 1.0 - 1e-4);
    let peak = target.clone().equal_elem(1.0).float();
    let n_peaks = peak.clone().sum().clamp_min(least);
    let not_p = p.clone().neg().add_scalar(1.0);
    let at_peaks = p.clone().log() * not_p.clone() * not_p.clone() * peak;
    let off = target.neg().add_scalar(1.0);
    let off = off.clone() * off;
    let elsewhere = not_p.log() * p.clone() * p * off.clone() * off;
    (at_peaks + elsewhere).sum().neg() / n_peaks
}

fn query_losses(
    output: &Output,
    objects: &[ObjectsByState],
    ignored: &[IgnoredGround],
    model: &ModelConfig,
    config: &LossConfig,
    device: &Device,
) -> (Tensor<1>, Tensor<1>) {
    let [n_rows, n_queries, _] = output.boxes.dims();
    let codes: Vec<f32> = output.boxes.clone().into_data().try_to_vec().expect("codes are f32");
    let logits: Vec<f32> = output.harm.clone().into_data().try_to_vec().expect("class scores are f32");
    let n_classes = model.head.classes.n();
    let mut class_target = vec![0f32; n_rows * n_queries * n_classes];
    let mut class_weight = vec![1f32; n_rows * n_queries * n_classes];
    let mut code_target = vec![0f32; n_rows * n_queries * CODE_SIZE];
    let mut code_weight = vec![0f32; n_rows * n_queries * CODE_SIZE];
    let mut n_matched = 0usize;
    // NaN costs have no best assignment; the loss is NaN then anyway and the caller names the samples.
    if codes.iter().chain(&logits).all(|value| value.is_finite()) {
        let of_states = output
            .queries
            .iter()
            .zip(objects)
            .enumerate()
            .flat_map(|(i, (queries, states))| states.iter().map(move |of| (queries, of, i)));
        for (state_row, (queries, of, sample)) in of_states.enumerate() {
            let ground = ground_of(ignored, sample);
            let first = state_row * n_queries;
            let of_codes = &codes[first * CODE_SIZE..(first + n_queries) * CODE_SIZE];
            let of_logits = &logits[first * n_classes..(first + n_queries) * n_classes];
            let (unhit, counted): (Vec<LabelledObject>, Vec<LabelledObject>) =
                of.iter().cloned().partition(|object| is_ignored(object, config));
            for (q, query) in queries.iter().enumerate() {
                let at = Point::new(query.center_m[0], query.center_m[1], 0.0);
                let is_over_unhit = || unhit.iter().any(|object| is_over(&object.truth.box_in_ego, at));
                if is_on(ground, query.center_m) || is_over_unhit() {
                    class_weight[(first + q) * n_classes..(first + q + 1) * n_classes].fill(0.0);
                }
            }
            for (q, object) in assign(queries, of_codes, of_logits, &counted, model, config) {
                let LabelledObject { truth, .. } = &counted[object];
                let row = first + q;
                class_weight[row * n_classes..(row + 1) * n_classes].fill(1.0);
                class_target[row * n_classes + class_of(&counted[object], model.head.classes)] = 1.0;
                let code = encode(
                    &truth.box_in_ego,
                    truth.velocity_in_ego_mps,
                    queries[q].center_m,
                    model.grid.cell_size_m,
                );
                let code = if config.turns_statics && truth.kind == Some(Kind::Static) {
                    nearer_way(code, &of_codes[q * CODE_SIZE..(q + 1) * CODE_SIZE])
                } else {
                    code
                };
                let (target, weight) = known_part(code);
                code_target[row * CODE_SIZE..(row + 1) * CODE_SIZE].copy_from_slice(&target);
                code_weight[row * CODE_SIZE..(row + 1) * CODE_SIZE].copy_from_slice(&weight);
                n_matched += 1;
            }
        }
    }
    let n_states = n_rows as f64 / output.queries.len().max(1) as f64;
    let n_matched = (n_matched as f64).max(config.least_objects * n_states);
    let tensor =
        |values: Vec<f32>, n| Tensor::<3>::from_data(TensorData::new(values, [n_rows, n_queries, n]), device);
    let weight = tensor(class_weight, n_classes);
    let harm = sigmoid_focal(output.harm.clone(), tensor(class_target, n_classes), weight, n_matched);
    let (target, weight) = (tensor(code_target, CODE_SIZE), tensor(code_weight, CODE_SIZE));
    let boxes = box_l1(output.boxes.clone(), target.clone(), weight.clone(), n_matched);
    let Some(spread) = output.spread.clone() else { return (harm, boxes) };
    let off = (output.boxes.clone().detach() - target).abs();
    (harm, boxes + spread_loss(off, spread, weight, n_matched).mul_scalar(config.spread_weight))
}

/// Whether a place lies on a box's footprint or just beside it.
fn is_over(of: &Box3<Ego>, at: Point<Ego>) -> bool {
    let level = Box3 { center: Point::new(of.center.x(), of.center.y(), 0.0), ..*of };
    level.contains(&at, IGNORED_GAP_M)
}

/// The code of a box that has no front, turned by half a turn if that is nearer to the predicted one.
fn nearer_way(code: [f32; CODE_SIZE], predicted: &[f32]) -> [f32; CODE_SIZE] {
    let along = code[SIN] * predicted[SIN] + code[COS] * predicted[COS];
    let mut way = code;
    if along < 0.0 {
        (way[SIN], way[COS]) = (-way[SIN], -way[COS]);
    }
    way
}

/// A code as target and its weights: what is unknown, as the velocities of some logs, is NaN and has no weight.
fn known_part(code: [f32; CODE_SIZE]) -> ([f32; CODE_SIZE], [f32; CODE_SIZE]) {
    let (mut target, mut weight) = (code, CODE_WEIGHTS);
    for (value, weight) in target.iter_mut().zip(&mut weight).filter(|(value, _)| value.is_nan()) {
        (*value, *weight) = (0.0, 0.0);
    }
    (target, weight)
}

/// The sigmoid focal loss, alpha 0.25, gamma 2, divided by the number of matched queries, or what stands for it.
fn sigmoid_focal(logits: Tensor<3>, target: Tensor<3>, weight: Tensor<3>, n_matched: f64) -> Tensor<1> {
    let p = sigmoid(logits.clone());
    let not_p = p.clone().neg().add_scalar(1.0);
    let positive = log_sigmoid(logits.clone()) * not_p.clone() * not_p * target.clone().mul_scalar(0.25);
    let negative = log_sigmoid(logits.neg()) * p.clone() * p * target.neg().add_scalar(1.0).mul_scalar(0.75);
    ((positive + negative) * weight).sum().div_scalar(-n_matched.max(1.0))
}

/// The weighted L1 distance of codes, divided by the number of matched queries, or what stands for it; `weight` is zero for the
/// other queries.
fn box_l1(codes: Tensor<3>, target: Tensor<3>, weight: Tensor<3>, n_matched: f64) -> Tensor<1> {
    ((codes - target).abs() * weight).sum().div_scalar(n_matched.max(1.0))
}

/// The negative log-likelihood of Laplace's distribution, less a constant: `off / b + log b`, weighted, over the number of
/// matched queries; `spread` is `log b`. The distances `off` get no gradient, so that the spreads change no box.
fn spread_loss(off: Tensor<3>, spread: Tensor<3>, weight: Tensor<3>, n_matched: f64) -> Tensor<1> {
    ((off * spread.clone().neg().exp() + spread) * weight).sum().div_scalar(n_matched.max(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::test_device;
    use crate::model::golden::{Golden, assert_close};

    fn scalar(loss: &Tensor<1>) -> f32 {
        loss.clone().into_scalar()
    }

    /// Compares a loss's gradient with central finite differences.
    fn check_gradient<const D: usize>(
        shape: [usize; D],
        logits: &[f32],
        loss: impl Fn(Tensor<D>) -> Tensor<1>,
    ) {
        let device = test_device().autodiff();
        let tensor = |values: Vec<f32>| Tensor::<D>::from_data(TensorData::new(values, shape), &device);
        let x = tensor(logits.to_vec()).require_grad();
        let grads = loss(x.clone()).backward();
        let gradient: Vec<f32> = x.grad(&grads).unwrap().into_data().try_to_vec().unwrap();
        let step = 1e-2;
        for i in 0..logits.len() {
            let shifted = |by: f32| {
                let mut values = logits.to_vec();
                values[i] += by;
                scalar(&loss(tensor(values)))
            };
            let numeric = (shifted(step) - shifted(-step)) / (2.0 * step);
            assert!((gradient[i] - numeric).abs() < 2e-3, "{i}: {} against {numeric}", gradient[i]);
        }
    }

    #[test]
    fn what_has_no_front_is_wanted_the_nearer_way_round() {
        let mut code = [0.5; CODE_SIZE];
        (code[SIN], code[COS]) = (0.6, 0.8);
        let mut predicted = [0.1; CODE_SIZE];
        assert_eq!(nearer_way(code, &predicted), code);
        predicted[COS] = -0.9;
        let turned = nearer_way(code, &predicted);
        assert_eq!((turned[SIN], turned[COS], turned[0]), (-0.6, -0.8, 0.5));
    }

    #[test]
    fn a_spread_is_best_where_it_is_the_mean_distance() {
        let device = Device::flex();
        let tensor = |value: f32| Tensor::<3>::full([1, 1, 1], value, &device);
        let loss = |log: f32| {
            let of = |off: f32| scalar(&spread_loss(tensor(off), tensor(log), tensor(1.0), 1.0));
            of(0.2) + of(0.6)
        };
        let best = 0.4f32.ln();
        assert!(loss(best) < loss(best - 0.1) && loss(best) < loss(best + 0.1));
    }

    #[test]
    fn an_unknown_velocity_weighs_nothing() {
        let mut code = [0.5; CODE_SIZE];
        assert_eq!(known_part(code), (code, CODE_WEIGHTS));
        code[CODE_SIZE - 2..].fill(f32::NAN);
        let (target, weight) = known_part(code);
        assert_eq!((target[CODE_SIZE - 1], weight[CODE_SIZE - 1]), (0.0, 0.0));
        assert_eq!((target[0], &weight[..CODE_SIZE - 2]), (0.5, &CODE_WEIGHTS[..CODE_SIZE - 2]));
    }

    #[test]
    fn gaussian_focal_loss_of_an_undecided_peak_is_a_quarter_of_ln_2() {
        let device = Device::flex();
        let loss =
            gaussian_focal(Tensor::zeros([1, 1, 1, 1], &device), Tensor::ones([1, 1, 1, 1], &device), 1.0);
        assert!((scalar(&loss) - 2f32.ln() / 4.0).abs() < 1e-6);
    }

    #[test]
    fn gaussian_focal_gradient_equals_finite_differences() {
        let target = vec![1.0f32, 0.6, 0.0, 0.0];
        check_gradient([1, 1, 2, 2], &[0.3, -0.4, 0.8, -1.2], |x| {
            let t = Tensor::from_data(TensorData::new(target.clone(), [1, 1, 2, 2]), &x.device());
            gaussian_focal(x, t, 1.0)
        });
    }

    #[test]
    fn sigmoid_focal_gradient_equals_finite_differences() {
        let target = vec![1.0f32, 0.0, 0.0, 0.0];
        check_gradient([1, 2, 2], &[0.3, -0.4, 0.8, -1.2], |x| {
            let t = Tensor::from_data(TensorData::new(target.clone(), [1, 2, 2]), &x.device());
            let weight = Tensor::ones([1, 2, 2], &x.device());
            sigmoid_focal(x, t, weight, 1.0)
        });
    }

    /// Compares a loss and its gradient with those of a golden case.
    fn check_golden<const D: usize>(
        golden: &Golden,
        [case, input]: [&str; 2],
        loss: impl Fn(Tensor<D>, &dyn Fn(&str) -> Tensor<D>) -> Tensor<1>,
    ) {
        let device = test_device().autodiff();
        let part = |name: &str| golden.tensor::<D>(&format!("{case}.{name}"), &device);
        let x = part(input).require_grad();
        let found = loss(x.clone(), &part);
        let expected = golden.numbers(&format!("{case}.loss"))[0];
        let error = (f64::from(scalar(&found)) - expected).abs();
        assert!(error <= 1e-4 * expected.abs(), "{case}: {} against {expected}", scalar(&found));
        let gradient = x.grad(&found.backward()).unwrap();
        if expected == 0.0 {
            assert_eq!(gradient.abs().max().into_scalar::<f32>(), 0.0, "{case}");
        } else {
            assert_close(&gradient, &part("gradient").inner(), case);
        }
    }

    #[test]
    fn values_and_gradients_equal_pytorchs() {
        let golden = Golden::read("losses");
        for case in ["heatmap.peaks", "heatmap.no_peaks"] {
            check_golden::<4>(&golden, [case, "logits"], |x, part| gaussian_focal(x, part("target"), 1.0));
        }
        for (case, n_matched) in [("matched", 5.0), ("unmatched", 0.0)] {
            check_golden::<3>(&golden, [&format!("harm.{case}"), "input"], |x, part| {
                let weight = Tensor::ones(x.dims(), &x.device());
                sigmoid_focal(x, part("target"), weight, n_matched)
            });
            let is_matched = golden.numbers(&format!("boxes.{case}.is_matched"));
            let weights: Vec<f32> = is_matched
                .iter()
                .flat_map(|&is_matched| CODE_WEIGHTS.map(|weight| weight * is_matched as f32))
                .collect();
            check_golden::<3>(&golden, [&format!("boxes.{case}"), "input"], |x, part| {
                let weight = Tensor::from_data(TensorData::new(weights.clone(), x.dims()), &x.device());
                box_l1(x, part("target"), weight, n_matched)
            });
        }
    }
}
