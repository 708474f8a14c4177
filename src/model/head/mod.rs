//! TransFusion head with a numeric branch: heatmap, queries at its peaks, one decoder layer, boxes
//! and harm for each query; speed and steering join the queries after the decoder.

mod attention;
pub mod coder;
mod look;
mod numeric;
mod output;
mod positions;
mod predict;
mod queries;

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::{Device, Int, Tensor, TensorData};

use crate::model::config::{GridConfig, HeadConfig};
use crate::model::layers::{ConvBlock, convolve, plain_conv};
use attention::DecoderLayer;
use look::CloserLook;
use numeric::Numeric;
pub use output::{KindBox, Output, detections, detections_by_state, kind_boxes};
use positions::Positions;
use predict::{Features, Predicted, Predictor};
pub use queries::Query;
use queries::pick_queries;

/// Chance that a cell holds an object at the start of training: the focal loss's prior (Lin et al. 2017).
/// The published head defines it but never applies it; without it the first steps only unlearn objects on half
/// the map.
const PRIOR: f64 = 0.1;

/// The detection head.
#[derive(Module, Debug)]
pub struct Head {
    shared: Shared,
    heatmap_hidden: ConvBlock,
    heatmap_out: Conv2d,
    /// Embeds the one-hot heatmap channel and place in the feature cell.
    class_embedding: Linear,
    position: Positions,
    decoder: DecoderLayer,
    numeric: Numeric,
    predict: Predictor,
    look: Option<CloserLook>,
    #[module(skip)]
    config: HeadConfig,
    #[module(skip)]
    grid: GridConfig,
}

/// The first convolution, whose output is memory and query features.
#[derive(Module, Debug)]
enum Shared {
    /// As published.
    Plain(Conv2d),
    /// With batch norm and ReLU.
    Normed(ConvBlock),
}

impl Head {
    pub fn init(channels_in: usize, config: &HeadConfig, grid: &GridConfig, device: &Device) -> Self {
        let n = config.channels;
        let n_outputs = config.n_heatmap_outputs();
        let prior_logit = (PRIOR / (1.0 - PRIOR)).ln();
        Self {
            shared: if config.shared_norm {
                Shared::Normed(ConvBlock::init(channels_in, n, 1, device).with_plain_norm())
            } else {
                Shared::Plain(plain_conv(channels_in, n, None, device))
            },
            heatmap_hidden: ConvBlock::init(n, n, 1, device).with_plain_norm(),
            heatmap_out: plain_conv(n, n_outputs, Some(prior_logit), device),
            class_embedding: LinearConfig::new(n_outputs, n).init(device),
            position: Positions::init(config, device),
            decoder: DecoderLayer::init(config, device),
            numeric: Numeric::init(config, device),
            predict: Predictor::init(config, grid, device),
            look: None,
            config: *config,
            grid: *grid,
        }
    }

    /// Lets each query look at a square of pillars of this side; 0 for none.
    #[must_use]
    pub fn with_look(mut self, n_side: usize, n_pillar_channels: usize, device: &Device) -> Self {
        self.look =
            (n_side > 0).then(|| CloserLook::init(n_pillar_channels, n_side, self.config.channels, device));
        self
    }

    /// # Shapes
    /// - features: `[batch, channel, cell_y, cell_x]`
    /// - pillars: `[batch, pillar_channel, 2 cell_y, 2 cell_x]`, where queries look at them
    /// - numeric: `[batch * state, 2]`; all states of a sample share its features
    pub fn forward(&self, features: Tensor<4>, pillars: Option<Tensor<4>>, numeric: Tensor<2>) -> Output {
        let device = features.device();
        let shared = match &self.shared {
            Shared::Plain(conv) => convolve(conv, features),
            Shared::Normed(block) => block.forward(features),
        };
        let heatmap = convolve(&self.heatmap_out, self.heatmap_hidden.forward(shared.clone()));
        let heatmap = spread(heatmap, self.config.heatmap_scale);
        let queries = pick_queries(heatmap.clone(), &self.config, &self.grid);
        let (mut decoded, position) = self.decode(shared, &queries, &device);
        if let Some((look, pillars)) = self.look.as_ref().zip(pillars) {
            decoded = decoded + look.forward(pillars, &queries, self.config.heatmap_scale);
        }

        let n_states = numeric.dims()[0] / queries.len();
        let decoded = repeat_rows(self.predict.prepare(decoded, position), n_states);
        let features = self.numeric.before_heads(decoded, numeric.clone());
        let Predicted { boxes, spread, harm } = self.predict.forward(Features {
            decoded: features.clone(),
            center_m: repeat_rows(self.centers_m(&queries, &device), n_states),
            modulation: self.numeric.for_harm(numeric),
        });
        Output { heatmap, queries, boxes, spread, harm, features, picture_objects: None }
    }

    /// The decoder layer over the shared features.
    ///
    /// # Shapes
    /// - shared: `[batch, channel, cell_y, cell_x]`
    /// - output: features and position encodings of the queries, both `[batch, query, channel]`
    fn decode(&self, shared: Tensor<4>, queries: &[Vec<Query>], device: &Device) -> (Tensor<3>, Tensor<3>) {
        let [n_batch, n_channels, n_y, n_x] = shared.dims();
        let n_cells = n_y * n_x;
        let memory = shared.reshape([n_batch, n_channels, n_cells]);
        let cells: Vec<i64> = queries.iter().flatten().map(|query| query.cell as i64).collect();
        let cells = TensorData::new(cells, [n_batch, 1, self.config.n_queries]);
        let cells = Tensor::<3, Int>::from_data(cells, device);
        let at_queries = memory.clone().gather(2, cells.expand([n_batch, n_channels, self.config.n_queries]));
        let class = self.class_embedding.forward(self.one_hot(queries, device));
        let query = at_queries.swap_dims(1, 2) + class.reshape([n_batch, self.config.n_queries, n_channels]);
        let position = self.position.of_queries(queries, &self.grid, device);
        let memory = memory + self.position.of_cells([n_y, n_x], &self.grid, device);
        (self.decoder.forward(query, position.clone(), memory), position)
    }

    /// `[batch * query, heatmap_channel * place]`: one for the channel and place of the query's peak.
    fn one_hot(&self, queries: &[Vec<Query>], device: &Device) -> Tensor<2> {
        let n_outputs = self.config.n_heatmap_outputs();
        let n_places = self.config.heatmap_scale * self.config.heatmap_scale;
        let mut values = vec![0f32; queries.len() * self.config.n_queries * n_outputs];
        for (row, query) in values.chunks_mut(n_outputs).zip(queries.iter().flatten()) {
            row[query.channel * n_places + query.place] = 1.0;
        }
        let n = values.len() / n_outputs;
        Tensor::from_data(TensorData::new(values, [n, n_outputs]), device)
    }

    /// `[batch, query, 2]`: x and y of the queries' cells.
    fn centers_m(&self, queries: &[Vec<Query>], device: &Device) -> Tensor<3> {
        let values: Vec<f32> =
            queries.iter().flatten().flat_map(|query| query.center_m.map(|m| m as f32)).collect();
        Tensor::from_data(TensorData::new(values, [queries.len(), self.config.n_queries, 2]), device)
    }
}

/// Lays the channels of a feature cell out as heatmap cells (sub-pixel convolution, Shi et al. 2016).
///
/// # Shapes
/// - x: `[batch, class * scale * scale, y, x]`
/// - output: `[batch, class, scale * y, scale * x]`
fn spread(x: Tensor<4>, scale: usize) -> Tensor<4> {
    if scale == 1 {
        return x;
    }
    let [n_batch, n_channels, n_y, n_x] = x.dims();
    let n_classes = n_channels / (scale * scale);
    x.reshape([n_batch, n_classes, scale, scale, n_y, n_x]).permute([0, 1, 4, 2, 5, 3]).reshape([
        n_batch,
        n_classes,
        scale * n_y,
        scale * n_x,
    ])
}

/// Repeats each row `n` times, side by side.
///
/// # Shapes
/// - x: `[row, query, channel]`
/// - output: `[row * n, query, channel]`
fn repeat_rows(x: Tensor<3>, n: usize) -> Tensor<3> {
    let [n_rows, n_queries, n_channels] = x.dims();
    x.reshape([n_rows, 1, n_queries, n_channels]).expand([n_rows, n, n_queries, n_channels]).reshape([
        n_rows * n,
        n_queries,
        n_channels,
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::{test_device, test_slack};
    use crate::model::config::{Classes, HeadJudge, Heatmap, NumericFusion, PositionEncoding, Prediction};
    use crate::model::golden::Golden;
    use burn::optim::GradientsParams;

    /// The sizes of `tests/golden/torch_head.py`, in the `paper` profile's ways.
    fn golden_head(device: &Device) -> (Head, Golden) {
        let config = HeadConfig {
            channels: 16,
            n_queries: 10,
            n_heads: 4,
            ffn_channels: 24,
            dropout: 0.0,
            shared_norm: false,
            heatmap: Heatmap::PerClass,
            heatmap_scale: 1,
            peak_kernels: [3, 3],
            border_peaks: false,
            heatmap_power: 1.0,
            positions: PositionEncoding::Separate,
            prediction: Prediction::Separate,
            spread: false,
            look_pillars: 0,
            prediction_channels: 8,
            numeric_fusion: NumericFusion::Paper,
            classes: Classes::Harm,
            judge: HeadJudge::Network,
        };
        let grid = GridConfig {
            x_min_m: 0.0,
            x_max_m: 9.0 * 0.6,
            y_min_m: -2.1,
            y_max_m: 2.1,
            cell_size_m: 0.6,
            ..GridConfig::default()
        };
        let golden = Golden::read("head");
        (golden.load_torch("head.weights", Head::init(12, &config, &grid, device)), golden)
    }

    #[test]
    fn at_inference_it_equals_pytorchs() {
        let device = test_device();
        let (head, golden) = golden_head(&device);
        let found = head.forward(
            golden.tensor("head.features", &device),
            None,
            golden.tensor("head.numeric", &device),
        );
        let expected = |name: &str| format!("head.eval.{name}");
        golden.check(&expected("heatmap"), &found.heatmap);
        let picked = |of: fn(&Query) -> usize| -> Vec<f64> {
            found.queries.iter().flatten().map(|query| of(query) as f64).collect()
        };
        assert_eq!(picked(|query| query.cell), golden.numbers(&expected("cells")));
        assert_eq!(picked(|query| query.channel), golden.numbers(&expected("classes")));
        let scores = golden.numbers(&expected("scores"));
        assert!(
            found
                .queries
                .iter()
                .flatten()
                .zip(&scores)
                .all(|(query, score)| { (f64::from(query.score) - score).abs() < 1e-5 * test_slack() })
        );
        // Both kinds of query are there: peaks, and cells that fill up.
        assert!(scores.contains(&0.0) && scores.iter().any(|&score| score > 0.5));
        golden.check(&expected("boxes"), &found.boxes);
        golden.check(&expected("harm"), &found.harm);
    }

    #[test]
    fn in_training_values_and_gradients_equal_pytorchs() {
        let device = test_device().autodiff();
        let (head, golden) = golden_head(&device);
        let features = golden.tensor::<4>("head.features", &device).require_grad();
        let found = head.forward(features.clone(), None, golden.tensor("head.numeric", &device));
        let expected = |name: &str| format!("head.train.{name}");
        golden.check(&expected("heatmap"), &found.heatmap);
        golden.check(&expected("boxes"), &found.boxes);
        golden.check(&expected("harm"), &found.harm);

        let of = |name: &str| format!("head.train.output_gradients.{name}");
        let loss = (found.heatmap * golden.tensor(&of("heatmap"), &device)).sum()
            + (found.boxes * golden.tensor(&of("boxes"), &device)).sum()
            + (found.harm * golden.tensor(&of("harm"), &device)).sum();
        let gradients = loss.backward();
        let of_features = features.grad(&gradients).unwrap();
        golden.check(&expected("features_gradient"), &of_features);
        let gradients = GradientsParams::from_grads(gradients, &head);
        let Positions::Separate(positions) = &head.position else { unreachable!() };
        for (linear, name) in [
            (&head.class_embedding, "class_embedding"),
            (&positions.query.hidden, "position.query.hidden"),
            (&head.numeric.embed.as_ref().unwrap().out, "numeric.embed.out"),
        ] {
            let name = expected(&format!("weight_gradients.{name}.weight"));
            let gradient = gradients.get::<2>(linear.weight.id).unwrap().transpose();
            golden.check(&name, &gradient);
        }
        let Predictor::Separate(nets) = &head.predict else { unreachable!() };
        let mean = nets.dims.norm.running_mean.value_sync();
        golden.check(&expected("running_mean"), &mean);
    }

    #[test]
    fn states_of_one_sample_share_boxes_by_film_and_differ_in_harm() {
        let device = Device::flex();
        let (config, grid) = (HeadConfig::default(), GridConfig::default());
        let head = Head::init(8, &config, &grid, &device);
        let features = Tensor::<4>::ones([1, 8, grid.n_cells_y(), grid.n_cells_x()], &device);
        let states = TensorData::new(vec![0.3f32, 0.1, 1.2, -0.4], [2, 2]);
        let output = head.forward(features, None, Tensor::from_data(states, &device));
        assert_eq!(output.boxes.dims()[0], 2);
        let difference = |x: Tensor<3>| -> f32 {
            (x.clone().narrow(0, 0, 1) - x.narrow(0, 1, 1)).abs().max().into_scalar()
        };
        assert!(difference(output.boxes) == 0.0 && difference(output.harm) > 0.0);
    }
}
