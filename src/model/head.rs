//! TransFusion head with a numeric branch: heatmap, queries at its peaks, one decoder layer, boxes
//! and harm for each query; speed and steering join the queries after the decoder.

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::nn::{Embedding, EmbeddingConfig, Initializer, Linear, LinearConfig};
use burn::tensor::activation::{relu, sigmoid};
use burn::tensor::{Device, Int, Tensor, TensorData};

use super::attention::DecoderLayer;
use super::coder::CODE_SIZE;
use super::config::{GridConfig, ModelConfig, NumericFusion};
use super::layers::{ConvBlock, Mlp, pointwise};

/// Chance that a cell holds an object at the start of training: the focal loss's prior (Lin et al. 2017).
const PRIOR: f64 = 0.1;

/// The detection head.
#[derive(Module, Debug)]
pub struct Head {
    shared: ConvBlock,
    heatmap_hidden: ConvBlock,
    heatmap_out: Conv2d,
    class_embedding: Embedding,
    position: Mlp,
    decoder: DecoderLayer,
    numeric: Numeric,
    boxes: Mlp,
    harm: HarmBranch,
    #[module(skip)]
    config: HeadSizes,
}

#[derive(Debug, Clone)]
struct HeadSizes {
    n_queries: usize,
    grid: GridConfig,
}

/// How speed and steering enter; the layers that the chosen way does not need are absent.
#[derive(Module, Debug)]
struct Numeric {
    /// `[2] -> [query]` (paper) or `[2] -> [4 channel]` of the harm branch (film).
    embed: Option<Mlp>,
    /// Fuses `[channel + 1]` back to `[channel]` (paper).
    fuse: Option<Linear>,
    #[module(skip)]
    fusion: NumericFusion,
}

/// A cell of the heatmap chosen as a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Query {
    /// Heatmap channel.
    pub channel: usize,
    /// `y * n_cells_x + x`.
    pub cell: usize,
    /// Sigmoid of the heatmap there.
    pub score: f32,
    /// Cell centre in the ego frame: x, y.
    pub center_m: [f64; 2],
}

/// The head's raw output.
#[derive(Debug, Clone)]
pub struct Output {
    /// `[batch, heatmap_channel, cell_y, cell_x]`, before the sigmoid.
    pub heatmap: Tensor<4>,
    /// `[batch][query]`.
    pub queries: Vec<Vec<Query>>,
    /// `[batch * state, query, CODE_SIZE]`; the states of a sample stand side by side.
    pub boxes: Tensor<3>,
    /// `[batch * state, query, 2]`, before the sigmoid, in the order of [`crate::object::Harm::ALL`].
    pub harm: Tensor<3>,
}

impl Head {
    pub fn init(channels_in: usize, config: &ModelConfig, device: &Device) -> Self {
        let hidden = config.hidden_channels;
        let n_channels = config.heatmap.n_channels();
        let mut heatmap_out = pointwise(hidden, n_channels, device);
        let prior_logit = (PRIOR / (1.0 - PRIOR)).ln();
        heatmap_out.bias = Some(Initializer::Constant { value: prior_logit }.init([n_channels], device));
        let (embed, fuse) = match config.numeric_fusion {
            NumericFusion::Paper => (
                Some(Mlp::init(2, hidden, config.n_queries, device)),
                Some(LinearConfig::new(hidden + 1, hidden).init(device)),
            ),
            NumericFusion::Film => (Some(Mlp::init(2, hidden, 8 * hidden, device)), None),
            NumericFusion::None => (None, None),
        };
        Self {
            shared: ConvBlock::init(channels_in, hidden, 1, device),
            heatmap_hidden: ConvBlock::init(hidden, hidden, 1, device),
            heatmap_out,
            class_embedding: EmbeddingConfig::new(n_channels, hidden).init(device),
            position: Mlp::init(2, hidden, hidden, device),
            decoder: DecoderLayer::init(hidden, config.n_heads, device),
            numeric: Numeric { embed, fuse, fusion: config.numeric_fusion },
            boxes: Mlp::init(hidden, hidden, CODE_SIZE, device),
            harm: HarmBranch::init(hidden + CODE_SIZE, 2 * hidden, device),
            config: HeadSizes { n_queries: config.n_queries, grid: config.grid },
        }
    }

    /// # Shapes
    /// - features: `[batch, channel, cell_y, cell_x]`
    /// - numeric: `[batch * state, 2]`; the sample's features serve all of its states
    pub fn forward(&self, features: Tensor<4>, numeric: Tensor<2>) -> Output {
        let device = features.device();
        let shared = self.shared.forward(features);
        let heatmap = self.heatmap_out.forward(self.heatmap_hidden.forward(shared.clone()));
        let [n_batch, n_channels, n_y, n_x] = shared.dims();
        let queries = self.pick_queries(heatmap.clone());

        let memory = shared.permute([0, 2, 3, 1]).reshape([n_batch * n_y * n_x, n_channels]);
        let n_queries = self.config.n_queries;
        let flat = |value: &dyn Fn(usize, &Query) -> i64| -> Tensor<1, Int> {
            let values: Vec<i64> = queries
                .iter()
                .enumerate()
                .flat_map(|(b, of)| of.iter().map(move |q| (b, q)))
                .map(|(b, q)| value(b, q))
                .collect();
            Tensor::from_data(TensorData::new(values, [n_batch * n_queries]), &device)
        };
        let cells = flat(&|b, q| (b * n_y * n_x + q.cell) as i64);
        let channels = flat(&|_, q| q.channel as i64).reshape([n_batch, n_queries]);
        let centers = self.query_centers(&queries, &device);

        let query = memory.clone().select(0, cells).reshape([n_batch, n_queries, n_channels])
            + self.class_embedding.forward(channels);
        let query_position = self.position.forward(centers.clone());
        let cell_position = self.position.forward(self.cell_centers(n_y, n_x, &device));
        let memory = memory.reshape([n_batch, n_y * n_x, n_channels]) + cell_position.unsqueeze::<3>();
        let decoded = self.decoder.forward(query, query_position.clone(), memory) + query_position;

        let n_states = numeric.dims()[0] / n_batch;
        let decoded = repeat_rows(decoded, n_states);
        let centers = repeat_rows(centers, n_states);
        let fused = self.numeric.before_heads(decoded, numeric.clone());
        let boxes = self.boxes.forward(fused.clone());
        let placed = self.place(boxes.clone(), centers);
        let modulation = self.numeric.for_harm(numeric);
        let harm = self.harm.forward(Tensor::cat(vec![fused, placed], 2), modulation);
        Output { heatmap, queries, boxes, harm }
    }

    /// The codes with centre offsets turned into positions (in units of 20 m), as input for the harm
    /// branch. No gradient flows back: the boxes learn from the box loss alone.
    fn place(&self, boxes: Tensor<3>, centers: Tensor<3>) -> Tensor<3> {
        let boxes = boxes.detach();
        let offset_scale = self.config.grid.cell_size_m() / 20.0;
        let position =
            boxes.clone().narrow(2, 0, 2).mul_scalar(offset_scale) + centers.mul_scalar(50.0 / 20.0);
        let shape = boxes.clone().narrow(2, 2, 6);
        let velocity = boxes.narrow(2, 8, 2).mul_scalar(0.1);
        Tensor::cat(vec![position, shape, velocity], 2)
    }

    /// The best `n_queries` local maxima (3x3) of the heatmap, best first; where there are too few,
    /// other cells fill up with a score of zero. Ties: the lower index first.
    fn pick_queries(&self, heatmap: Tensor<4>) -> Vec<Vec<Query>> {
        let [n_batch, n_channels, n_y, n_x] = heatmap.dims();
        let scores: Vec<f32> =
            sigmoid(heatmap.detach()).into_data().try_to_vec().expect("the heatmap is made of f32");
        let grid = &self.config.grid;
        let per_sample = n_channels * n_y * n_x;
        (0..n_batch)
            .map(|b| {
                let map = &scores[b * per_sample..(b + 1) * per_sample];
                let score_at = |channel: usize, y: usize, x: usize| map[(channel * n_y + y) * n_x + x];
                let mut ranked: Vec<(f32, usize)> = (0..per_sample)
                    .map(|i| {
                        let (channel, y, x) = (i / (n_y * n_x), i / n_x % n_y, i % n_x);
                        let here = map[i];
                        let is_peak = (y.saturating_sub(1)..(y + 2).min(n_y)).all(|other_y| {
                            (x.saturating_sub(1)..(x + 2).min(n_x))
                                .all(|other_x| score_at(channel, other_y, other_x) <= here)
                        });
                        (if is_peak { here } else { 0.0 }, i)
                    })
                    .collect();
                ranked.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
                ranked[..self.config.n_queries]
                    .iter()
                    .map(|&(score, i)| Query {
                        channel: i / (n_y * n_x),
                        cell: i % (n_y * n_x),
                        score,
                        center_m: cell_center_m(grid, i % (n_y * n_x), n_x),
                    })
                    .collect()
            })
            .collect()
    }

    /// `[batch, query, 2]`: query centres in units of 50 m.
    fn query_centers(&self, queries: &[Vec<Query>], device: &Device) -> Tensor<3> {
        let values: Vec<f32> =
            queries.iter().flatten().flat_map(|query| query.center_m.map(|m| (m / 50.0) as f32)).collect();
        Tensor::from_data(TensorData::new(values, [queries.len(), self.config.n_queries, 2]), device)
    }

    /// `[cell, 2]`: cell centres in units of 50 m.
    fn cell_centers(&self, n_y: usize, n_x: usize, device: &Device) -> Tensor<2> {
        let values: Vec<f32> = (0..n_y * n_x)
            .flat_map(|cell| cell_center_m(&self.config.grid, cell, n_x).map(|m| (m / 50.0) as f32))
            .collect();
        Tensor::from_data(TensorData::new(values, [n_y * n_x, 2]), device)
    }
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

/// Centre of feature cell `y * n_x + x` in the ego frame: x, y.
#[must_use]
pub fn cell_center_m(grid: &GridConfig, cell: usize, n_x: usize) -> [f64; 2] {
    [
        grid.x_min_m + ((cell % n_x) as f64 + 0.5) * grid.cell_size_m(),
        grid.y_min_m + ((cell / n_x) as f64 + 0.5) * grid.cell_size_m(),
    ]
}

impl Numeric {
    /// The paper's fusion: one number for each query joins its channels.
    fn before_heads(&self, decoded: Tensor<3>, numeric: Tensor<2>) -> Tensor<3> {
        match (&self.embed, &self.fuse) {
            (Some(embed), Some(fuse)) => {
                let [n_batch, n_queries, _] = decoded.dims();
                let per_query = embed.forward(numeric).reshape([n_batch, n_queries, 1]);
                relu(fuse.forward(Tensor::cat(vec![decoded, per_query], 2)))
            }
            _ => decoded,
        }
    }

    /// What modulates the harm branch, `[row, 1, 4 channel]`, where the fusion does that.
    fn for_harm(&self, numeric: Tensor<2>) -> Option<Tensor<3>> {
        let embed = self.embed.as_ref().filter(|_| self.fusion == NumericFusion::Film)?;
        Some(embed.forward(numeric).unsqueeze_dim(1))
    }
}

/// From a query to harmful and harmless: two hidden layers, which speed and steering may modulate
/// channel by channel (FiLM, Perez et al. 2018). A product of position and steering is what turning
/// into the direction of travel takes; the second layer joins the sides of an area.
#[derive(Module, Debug)]
struct HarmBranch {
    first: Linear,
    second: Linear,
    out: Linear,
}

impl HarmBranch {
    fn init(n_in: usize, n_hidden: usize, device: &Device) -> Self {
        Self {
            first: LinearConfig::new(n_in, n_hidden).init(device),
            second: LinearConfig::new(n_hidden, n_hidden).init(device),
            out: LinearConfig::new(n_hidden, 2).init(device),
        }
    }

    /// # Shapes
    /// - x: `[row, query, channel_in]`
    /// - modulation: `[row, 1, 4 channel]`, scale and shift of the first and of the second layer
    /// - output: `[row, query, 2]`
    fn forward(&self, x: Tensor<3>, modulation: Option<Tensor<3>>) -> Tensor<3> {
        let modulated = |hidden: Tensor<3>, layer: usize| {
            let Some(modulation) = &modulation else { return hidden };
            let [_, _, n_channels] = hidden.dims();
            let part = |i: usize| modulation.clone().narrow(2, (2 * layer + i) * n_channels, n_channels);
            hidden * part(0).add_scalar(1.0) + part(1)
        };
        let hidden = relu(modulated(self.first.forward(x), 0));
        self.out.forward(relu(modulated(self.second.forward(hidden), 1)))
    }
}
