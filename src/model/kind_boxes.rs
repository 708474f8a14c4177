//! Boxes of a network that tells kinds of objects instead of harm: a closed set, for a baseline.

use super::coder::{CODE_SIZE, decode};
use super::config::{Classes, ModelConfig};
use super::head::Output;
use crate::geometry::{Box3, Ego};

/// Kinds that are told.
const N_KINDS: usize = 3;

/// One query's box.
#[derive(Debug, Clone, PartialEq)]
pub struct KindBox {
    pub box_in_ego: Box3<Ego>,
    pub velocity_in_ego_mps: [f64; 2],
    /// Heatmap times the best kind's probability, 0 to 1.
    pub score: f32,
    /// Before the sigmoid, in channel order.
    pub logits: [f32; N_KINDS],
    /// What box and kind were predicted from.
    pub features: Vec<f32>,
}

impl KindBox {
    /// Channel of the best kind, the first of equals.
    #[must_use]
    pub fn kind_idx(&self) -> usize {
        (1..N_KINDS).fold(0, |best, i| if self.logits[i] > self.logits[best] { i } else { best })
    }
}

/// Boxes of each sample of a batch, best first: one of each query whose score reaches `min_score`. Of several states of
/// a sample the first.
///
/// # Panics
/// If the network tells harm.
#[must_use]
pub fn kind_boxes(output: &Output, config: &ModelConfig, min_score: f32) -> Vec<Vec<KindBox>> {
    assert_eq!(config.head.classes, Classes::Kind, "harm is told by `detections`");
    let numbers = |tensor: &burn::tensor::Tensor<3>| -> Vec<f32> {
        tensor.clone().into_data().try_to_vec().expect("the head's output is f32")
    };
    let (codes, logits, features) =
        (numbers(&output.boxes), numbers(&output.harm), numbers(&output.features));
    let [n_rows, n_queries, n_channels] = output.features.dims();
    let n_states = n_rows / output.queries.len().max(1);
    let of_sample = |(sample_idx, queries): (usize, &Vec<super::Query>)| {
        let first = sample_idx * n_states * n_queries;
        let mut found: Vec<KindBox> = (first..)
            .zip(queries)
            .map(|(row, query)| {
                let code = &codes[row * CODE_SIZE..(row + 1) * CODE_SIZE];
                let (box_in_ego, velocity_in_ego_mps) = decode(code, query.center_m, config.grid.cell_size_m);
                let logits: [f32; N_KINDS] = std::array::from_fn(|i| logits[row * N_KINDS + i]);
                let best = logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                KindBox {
                    box_in_ego,
                    velocity_in_ego_mps,
                    score: query.score / (1.0 + (-best).exp()),
                    logits,
                    features: features[row * n_channels..(row + 1) * n_channels].to_vec(),
                }
            })
            .filter(|found| found.score >= min_score)
            .collect();
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        found
    };
    output.queries.iter().enumerate().map(of_sample).collect()
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Device, Tensor, TensorData};

    use super::*;
    use crate::model::Query;

    #[test]
    fn each_query_is_a_box_with_its_logits_and_features_best_first() {
        let mut config = ModelConfig::default();
        (config.head.classes, config.head.n_queries) = (Classes::Kind, 2);
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
            harm: tensor(vec![0.0, -5.0, -5.0, -9.0, 0.0, 0.0], [1, 2, 3]),
            features: tensor(vec![1.0, 2.0, 3.0, 4.0], [1, 2, 2]),
        };
        let found = &kind_boxes(&output, &config, 0.05)[0];
        assert_eq!(found.len(), 2);
        assert!((found[0].score - 0.45).abs() < 1e-6 && (found[1].score - 0.1).abs() < 1e-6);
        assert_eq!((found[0].kind_idx(), found[1].kind_idx()), (1, 0), "the first of equals");
        assert_eq!((&found[0].features[..], &found[1].features[..]), (&[3.0, 4.0][..], &[1.0, 2.0][..]));
        let ahead_m = 20.0 + config.grid.cell_size_m;
        assert!((found[0].box_in_ego.center.x() - ahead_m).abs() < 1e-6);
        assert_eq!(kind_boxes(&output, &config, 0.3)[0].len(), 1);
    }
}
