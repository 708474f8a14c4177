//! From a query's features to its box code and class: separate nets as published, or a class branch that also
//! sees the predicted box.

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};

use super::coder::CODE_SIZE;
use crate::model::config::{GridConfig, HeadConfig, Prediction};
use crate::model::layers::{Mlp, NormedMlp};

/// Numbers of a predicted box that the class branch sees: five points and the rest of its code.
const N_PLACED: usize = 5 * 2 + CODE_SIZE - 2;
/// Length unit of the class branch's input, metres: near zones are decided by tenths of metres.
const FOOTPRINT_UNIT_M: f64 = 5.0;

/// Least and most logarithm of a spread.
const LOG_SPREADS: [f64; 2] = [-5.0, 3.0];

/// Numbers that the net of placed boxes predicts.
fn n_numbers(config: &HeadConfig) -> usize {
    if config.spread { 2 * CODE_SIZE } else { CODE_SIZE }
}

/// The nets that predict boxes and harm.
#[derive(Module, Debug)]
pub enum Predictor {
    Placed(PlacedNets),
    Separate(SeparateNets),
}

/// The input of a prediction.
pub struct Features {
    /// `[row, query, channel]`: from [`Predictor::prepare`]; with speed and steering in the paper's fusion.
    pub decoded: Tensor<3>,
    /// `[row, query, 2]`: x and y of the query's cell, metres.
    pub center_m: Tensor<3>,
    /// `[row, 1, modulation]`: scales and shifts of the class branch, from speed and steering.
    pub modulation: Option<Tensor<3>>,
}

impl Predictor {
    pub fn init(config: &HeadConfig, grid: &GridConfig, device: &Device) -> Self {
        match config.prediction {
            Prediction::Placed => Self::Placed(PlacedNets::init(config, grid, device)),
            Prediction::Separate => Self::Separate(SeparateNets::init(config, device)),
        }
    }

    /// Numbers that modulate the class branch: a scale and a shift for each hidden channel.
    pub fn n_modulations(config: &HeadConfig) -> usize {
        match config.prediction {
            Prediction::Placed => 4 * PlacedNets::n_hidden(config),
            Prediction::Separate => 2 * config.prediction_channels,
        }
    }

    /// The nets' input: the decoder's output, to which placed nets add the position.
    ///
    /// # Shapes
    /// - decoded, position, output: `[batch, query, channel]`
    pub fn prepare(&self, decoded: Tensor<3>, position: Tensor<3>) -> Tensor<3> {
        match self {
            Self::Placed(_) => decoded + position,
            Self::Separate(_) => decoded,
        }
    }

    pub fn forward(&self, features: Features) -> Predicted {
        match self {
            Self::Placed(nets) => nets.forward(features),
            Self::Separate(nets) => nets.forward(features),
        }
    }
}

/// What is predicted of each query.
pub struct Predicted {
    /// `[row, query, CODE_SIZE]`
    pub boxes: Tensor<3>,
    /// `[row, query, CODE_SIZE]`: logarithms of the spreads of a box's numbers, if they are predicted.
    pub spread: Option<Tensor<3>>,
    /// `[row, query, class]`, before the sigmoid.
    pub harm: Tensor<3>,
}

/// Feature-wise modulation (FiLM, Perez et al. 2018) by scale and shift number `layer`.
fn modulate(hidden: Tensor<3>, modulation: Option<&Tensor<3>>, layer: usize) -> Tensor<3> {
    let Some(modulation) = modulation else { return hidden };
    let [_, _, n_channels] = hidden.dims();
    let part = |i: usize| modulation.clone().narrow(2, (2 * layer + i) * n_channels, n_channels);
    hidden * part(0).add_scalar(1.0) + part(1)
}

/// As published: each quantity has a net of its own, from the query's features alone.
#[derive(Module, Debug)]
pub struct SeparateNets {
    center: NormedMlp,
    height: NormedMlp,
    pub dims: NormedMlp,
    rotation: NormedMlp,
    velocity: NormedMlp,
    harm: NormedMlp,
}

impl SeparateNets {
    fn init(config: &HeadConfig, device: &Device) -> Self {
        let net = |n_out| NormedMlp::init(config.channels, config.prediction_channels, n_out, false, device);
        Self {
            center: net(2),
            height: net(1),
            dims: net(3),
            rotation: net(2),
            velocity: net(2),
            harm: net(config.classes.n()),
        }
    }

    fn forward(&self, Features { decoded, modulation, .. }: Features) -> Predicted {
        let parts = [&self.center, &self.height, &self.dims, &self.rotation, &self.velocity];
        let boxes = Tensor::cat(parts.map(|net| net.forward(decoded.clone())).to_vec(), 2);
        let harm = self.harm.forward_with(decoded, |hidden| modulate(hidden, modulation.as_ref(), 0));
        Predicted { boxes, spread: None, harm }
    }
}

/// One net for the box; the class branch sees where its footprint lies.
#[derive(Module, Debug)]
pub struct PlacedNets {
    boxes: Mlp,
    harm: HarmBranch,
    #[module(skip)]
    cell_size_m: f64,
    #[module(skip)]
    has_spread: bool,
}

impl PlacedNets {
    fn init(config: &HeadConfig, grid: &GridConfig, device: &Device) -> Self {
        Self {
            boxes: Mlp::init(config.channels, config.channels, n_numbers(config), device),
            harm: HarmBranch::init(config, device),
            cell_size_m: grid.cell_size_m,
            has_spread: config.spread,
        }
    }

    /// Hidden channels of the class branch.
    fn n_hidden(config: &HeadConfig) -> usize {
        2 * config.channels
    }

    fn forward(&self, features: Features) -> Predicted {
        let numbers = self.boxes.forward(features.decoded.clone());
        let boxes = numbers.clone().narrow(2, 0, CODE_SIZE);
        let [least, most] = LOG_SPREADS;
        let spread = self.has_spread.then(|| numbers.narrow(2, CODE_SIZE, CODE_SIZE).clamp(least, most));
        let placed = self.place(boxes.clone(), features.center_m);
        let known = spread.clone().map(Tensor::detach);
        let seen = [features.decoded, placed].into_iter().chain(known).collect();
        let harm = self.harm.forward(Tensor::cat(seen, 2), features.modulation.as_ref());
        Predicted { boxes, spread, harm }
    }

    /// Input of the harm branch: centre and corners of the predicted footprint in the ego frame, height,
    /// log sizes, direction, velocity. No gradient flows back: the boxes learn from the box loss alone.
    ///
    /// # Shapes
    /// - boxes: `[row, query, CODE_SIZE]`, center_m: `[row, query, 2]`
    /// - output: `[row, query, N_PLACED]`
    fn place(&self, boxes: Tensor<3>, center_m: Tensor<3>) -> Tensor<3> {
        let boxes = boxes.detach();
        let part = |first, n| boxes.clone().narrow(2, first, n);
        let center = part(0, 2).mul_scalar(self.cell_size_m) + center_m;
        // Sizes and direction of an untrained net can be anything.
        let half_m = part(3, 2).clamp(-3.0, 3.0).exp().mul_scalar(0.5);
        let (sin, cos) = (part(6, 1), part(7, 1));
        let norm = (sin.clone() * sin.clone() + cos.clone() * cos.clone()).add_scalar(1e-6).sqrt();
        let (sin, cos) = (sin / norm.clone(), cos / norm);
        let along = Tensor::cat(vec![cos.clone(), sin.clone()], 2) * half_m.clone().narrow(2, 0, 1);
        let across = Tensor::cat(vec![sin.neg(), cos], 2) * half_m.narrow(2, 1, 1);
        let (front, back) = (center.clone() + along.clone(), center.clone() - along);
        let corners = [
            front.clone() + across.clone(),
            front - across.clone(),
            back.clone() + across.clone(),
            back - across,
        ];
        let points = Tensor::cat([vec![center], corners.to_vec()].concat(), 2);
        let velocity = part(8, 2).mul_scalar(0.1);
        Tensor::cat(vec![points.mul_scalar(1.0 / FOOTPRINT_UNIT_M), part(2, 6), velocity], 2)
    }
}

/// From a query to harmful and harmless: two hidden layers, which speed and steering may modulate channel by
/// channel. To turn a position into the direction of travel takes its product with the steering angle; the
/// second layer joins the sides of an area.
#[derive(Module, Debug)]
struct HarmBranch {
    first: Linear,
    second: Linear,
    out: Linear,
}

impl HarmBranch {
    fn init(config: &HeadConfig, device: &Device) -> Self {
        let n_spreads = n_numbers(config) - CODE_SIZE;
        let (n_in, n_hidden) = (config.channels + N_PLACED + n_spreads, PlacedNets::n_hidden(config));
        Self {
            first: LinearConfig::new(n_in, n_hidden).init(device),
            second: LinearConfig::new(n_hidden, n_hidden).init(device),
            out: LinearConfig::new(n_hidden, config.classes.n()).init(device),
        }
    }

    /// # Shapes
    /// - x: `[row, query, channel_in]`
    /// - modulation: `[row, 1, 4 channel]`, scale and shift of the first and of the second layer
    /// - output: `[row, query, class]`
    fn forward(&self, x: Tensor<3>, modulation: Option<&Tensor<3>>) -> Tensor<3> {
        let hidden = relu(modulate(self.first.forward(x), modulation, 0));
        self.out.forward(relu(modulate(self.second.forward(hidden), modulation, 1)))
    }
}
