//! The head's raw output, and the boxes in it: with harm, or with kinds for a closed-set baseline.

use burn::tensor::Tensor;

use super::coder::{CODE_SIZE, decode, decode_spread};
use super::queries::Query;
use crate::geometry::{Box3, Ego};
use crate::model::config::{Classes, Heatmap, ModelConfig};
use crate::object::{BoxSpread, Detection, Harm};

/// The head's raw output.
#[derive(Debug, Clone)]
pub struct Output {
    /// `[batch, heatmap_channel, scale * cell_y, scale * cell_x]`, before the sigmoid.
    pub heatmap: Tensor<4>,
    /// `[batch][query]`.
    pub queries: Vec<Vec<Query>>,
    /// `[batch * state, query, CODE_SIZE]`; the states of a sample stand side by side.
    pub boxes: Tensor<3>,
    /// `[batch * state, query, CODE_SIZE]`: logarithms of the spreads (of Laplace's distribution) of a box's numbers, if the
    /// network predicts them.
    pub spread: Option<Tensor<3>>,
    /// `[batch * state, query, class]`, before the sigmoid, in the order of [`crate::object::Harm::ALL`], or of
    /// [`crate::object::Kind::ALL`] if the config's classes are kinds.
    pub harm: Tensor<3>,
    /// `[batch * state, query, channel]`: the features from which boxes and classes are predicted.
    pub features: Tensor<3>,
    /// `[batch, 1, y, x]`, before the sigmoid: whether each pixel of a quarter of the picture shows an object; only in
    /// training, and only of a network whose points take the picture's features along.
    pub picture_objects: Option<Tensor<4>>,
}

/// The head's output for one query in one state.
struct QueryOutput<'a> {
    query: &'a Query,
    /// Index into `[batch * state, query]`, flattened.
    row: usize,
    box_in_ego: Box3<Ego>,
    velocity_in_ego_mps: [f64; 2],
    spread: Option<BoxSpread>,
    /// Before the sigmoid.
    logits: &'a [f32],
}

/// Numbers of a tensor in order.
fn numbers<const D: usize>(tensor: &Tensor<D>) -> Vec<f32> {
    tensor.clone().into_data().try_to_vec().expect("the head's output is f32")
}

impl Output {
    /// The first sample of the batch for which the network gave anything but finite numbers, of which no box would be left.
    #[must_use]
    pub fn first_not_finite(&self) -> Option<usize> {
        let parts = [numbers(&self.heatmap), numbers(&self.boxes), numbers(&self.harm)];
        let spread = self.spread.as_ref().map(numbers);
        let n_samples = self.queries.len();
        let is_broken = |part: &Vec<f32>, sample: usize| {
            let n = part.len() / n_samples;
            !part[sample * n..(sample + 1) * n].iter().all(|number| number.is_finite())
        };
        (0..n_samples).find(|&sample| parts.iter().chain(&spread).any(|part| is_broken(part, sample)))
    }

    /// Reads boxes from each query and keeps those whose score reaches `min_score`, best first:
    /// `[sample][state][box]`.
    fn read<T, I: IntoIterator<Item = T>>(
        &self,
        cell_size_m: f64,
        min_score: f32,
        score: fn(&T) -> f32,
        read: impl Fn(&QueryOutput<'_>) -> I,
    ) -> Vec<Vec<Vec<T>>> {
        let (codes, logits) = (numbers(&self.boxes), numbers(&self.harm));
        let spreads = self.spread.as_ref().map(numbers);
        let [n_rows, _, n_classes] = self.harm.dims();
        let n_states = n_rows / self.queries.len().max(1);
        let of_state = |queries: &[Query], first_row: usize| {
            let boxes = (first_row..).zip(queries).flat_map(|(row, query)| {
                let code = &codes[row * CODE_SIZE..(row + 1) * CODE_SIZE];
                let (box_in_ego, velocity_in_ego_mps) = decode(code, query.center_m, cell_size_m);
                let logits = &logits[row * n_classes..(row + 1) * n_classes];
                let spread = spreads
                    .as_ref()
                    .map(|all| decode_spread(&all[row * CODE_SIZE..(row + 1) * CODE_SIZE], cell_size_m));
                read(&QueryOutput { query, row, box_in_ego, velocity_in_ego_mps, spread, logits })
            });
            let mut found: Vec<T> = boxes.filter(|found| score(found) >= min_score).collect();
            found.sort_by(|a, b| score(b).total_cmp(&score(a)));
            found
        };
        let of_sample = |(sample_idx, queries): (usize, &Vec<Query>)| {
            let first = sample_idx * n_states;
            (first..first + n_states).map(|state| of_state(queries, state * queries.len())).collect()
        };
        self.queries.iter().enumerate().map(of_sample).collect()
    }
}

/// The first state of each sample.
fn first_states<T>(by_state: Vec<Vec<Vec<T>>>) -> Vec<Vec<T>> {
    by_state.into_iter().map(|states| states.into_iter().next().unwrap_or_default()).collect()
}

/// The classes that a query may report: only its peak's if the heatmap has one channel for each class.
fn reportable_classes(query: &Query, heatmap: Heatmap) -> &'static [Harm] {
    match heatmap {
        Heatmap::Agnostic => &Harm::ALL,
        Heatmap::PerClass => &Harm::ALL[query.channel..=query.channel],
    }
}

/// Boxes of each sample of a batch, best first: every query reports each class whose score, the product of
/// the heatmap, raised to the config's power, and class probability, reaches `min_score`. Samples with several states give the boxes of the first.
///
/// # Panics
/// If the network detects kinds, not harm.
#[must_use]
pub fn detections(output: &Output, config: &ModelConfig, min_score: f32) -> Vec<Vec<Detection>> {
    first_states(detections_by_state(output, config, min_score))
}

/// As [`detections`], for each state of each sample: `[sample][state][box]`.
///
/// # Panics
/// If the network detects kinds, not harm.
#[must_use]
pub fn detections_by_state(
    output: &Output,
    config: &ModelConfig,
    min_score: f32,
) -> Vec<Vec<Vec<Detection>>> {
    assert_eq!(config.head.classes, Classes::Harm, "`kind_boxes` reads a network that tells kinds");
    output.read(
        config.grid.cell_size_m,
        min_score,
        |found| found.score as f32,
        |of| {
            let peak = config.head.raise_peak(of.query.score);
            let detection = |&harm: &Harm| {
                let probability = 1.0 / (1.0 + (-of.logits[harm.index()]).exp());
                Detection {
                    box_in_ego: of.box_in_ego,
                    velocity_in_ego_mps: of.velocity_in_ego_mps,
                    harm,
                    score: (peak * probability).into(),
                    spread: of.spread,
                }
            };
            reportable_classes(of.query, config.head.heatmap).iter().map(detection).collect::<Vec<_>>()
        },
    )
}

/// Number of kinds.
const N_KINDS: usize = 3;

/// The box of a query of a network that detects kinds of objects instead of harm.
#[derive(Debug, Clone, PartialEq)]
pub struct KindBox {
    pub box_in_ego: Box3<Ego>,
    pub velocity_in_ego_mps: [f64; 2],
    /// `None` where the network does not tell.
    pub spread: Option<BoxSpread>,
    /// The heatmap, raised to the config's power, times the best kind's probability, 0 to 1.
    pub score: f32,
    /// The same with the sum of the kinds' probabilities, 0 to 1: that there is an object, of whatever kind. A network that tells
    /// harm is ranked by the sum of its classes in the same way.
    pub objectness: f32,
    /// Before the sigmoid, in channel order.
    pub logits: [f32; N_KINDS],
    /// The features from which box and kind were predicted.
    pub features: Vec<f32>,
}

impl KindBox {
    /// Channel of the best kind; on ties the first.
    #[must_use]
    pub fn kind_idx(&self) -> usize {
        (1..N_KINDS).fold(0, |best, i| if self.logits[i] > self.logits[best] { i } else { best })
    }

    /// The box alone, as sure as that there is an object, for a rule that decides on its harm. Nobody has yet: the class in it
    /// means nothing.
    #[must_use]
    pub fn to_detection(&self) -> Detection {
        Detection {
            box_in_ego: self.box_in_ego,
            velocity_in_ego_mps: self.velocity_in_ego_mps,
            harm: Harm::Harmless,
            score: self.objectness.into(),
            spread: self.spread,
        }
    }
}

/// Boxes of each sample of a batch, best first: one for each query whose score reaches `min_score`. Samples with
/// several states give the boxes of the first.
///
/// # Panics
/// If the network detects harm, not kinds.
#[must_use]
pub fn kind_boxes(output: &Output, config: &ModelConfig, min_score: f32) -> Vec<Vec<KindBox>> {
    assert_eq!(config.head.classes, Classes::Kind, "`detections` reads a network that tells harm");
    let features = numbers(&output.features);
    let [_, _, n_channels] = output.features.dims();
    first_states(output.read(
        config.grid.cell_size_m,
        min_score,
        |found| found.score,
        |of| {
            let peak = config.head.raise_peak(of.query.score);
            let probability = |logit: f32| 1.0 / (1.0 + (-logit).exp());
            let best = of.logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            [KindBox {
                box_in_ego: of.box_in_ego,
                velocity_in_ego_mps: of.velocity_in_ego_mps,
                spread: of.spread,
                score: peak * probability(best),
                objectness: (peak * of.logits.iter().copied().map(probability).sum::<f32>()).min(1.0),
                logits: of.logits.try_into().expect("there is a logit for each kind"),
                features: features[of.row * n_channels..(of.row + 1) * n_channels].to_vec(),
            }]
        },
    ))
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Device, Tensor, TensorData};

    use super::*;

    #[test]
    fn each_query_is_a_box_with_its_logits_and_features_best_first() {
        let mut config = ModelConfig::default();
        (config.head.classes, config.head.n_queries, config.head.heatmap_power) = (Classes::Kind, 2, 1.0);
        let device = Device::flex();
        let tensor =
            |values: Vec<f32>, shape| Tensor::<3>::from_data(TensorData::new(values, shape), &device);
        let query = |score, x_m| Query { channel: 0, cell: 0, place: 0, score, center_m: [x_m, 0.0] };
        let mut codes = vec![0.0; 2 * CODE_SIZE];
        codes[CODE_SIZE] = 1.0; // the second is a cell ahead of its query
        let output = Output {
            heatmap: Tensor::zeros([1, 1, 1, 1], &device),
            queries: vec![vec![query(0.2, 10.0), query(0.9, 20.0)]],
            boxes: tensor(codes, [1, 2, CODE_SIZE]),
            spread: None,
            harm: tensor(vec![0.0, -5.0, -5.0, -9.0, 0.0, 0.0], [1, 2, 3]),
            features: tensor(vec![1.0, 2.0, 3.0, 4.0], [1, 2, 2]),
            picture_objects: None,
        };
        let found = &kind_boxes(&output, &config, 0.05)[0];
        assert_eq!(found.len(), 2);
        assert!((found[0].score - 0.45).abs() < 1e-6 && (found[1].score - 0.1).abs() < 1e-6);
        assert_eq!((found[0].kind_idx(), found[1].kind_idx()), (1, 0), "the first of equals");
        assert_eq!((&found[0].features[..], &found[1].features[..]), (&[3.0, 4.0][..], &[1.0, 2.0][..]));
        let ahead_m = 20.0 + config.grid.cell_size_m;
        assert!((found[0].box_in_ego.center.x() - ahead_m).abs() < 1e-6);
        let alone = found[0].to_detection();
        assert_eq!((alone.box_in_ego, alone.spread), (found[0].box_in_ego, None));
        // As sure as that any kind is there: what resembles two kinds is no weaker for it.
        let of_others = 0.9 / (1.0 + 9_f32.exp()) + 0.9 * 0.5;
        assert!((alone.score as f32 - (0.45 + of_others)).abs() < 1e-6, "{}", alone.score);
        assert!(found.iter().all(|found| (found.score..=1.0).contains(&found.objectness)));
        assert_eq!(kind_boxes(&output, &config, 0.3)[0].len(), 1);
        // By the class alone: its probability is one half for both.
        config.head.heatmap_power = 0.0;
        assert!(kind_boxes(&output, &config, 0.05)[0].iter().all(|found| (found.score - 0.5).abs() < 1e-6));
        config.head.heatmap_power = 0.5;
        let raised = &kind_boxes(&output, &config, 0.05)[0];
        assert!((raised[0].score - 0.5 * 0.9_f32.sqrt()).abs() < 1e-6, "{}", raised[0].score);
    }
}
