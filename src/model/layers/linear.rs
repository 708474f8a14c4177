//! Linear layers: over the channels of a map, in pairs, with Glorot's first weights.

use burn::module::Module;
use burn::nn::{BatchNorm, BatchNormConfig, Initializer, Linear, LinearConfig};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};

use super::norm::batch_norm;
use crate::kernels::mix_channels;

/// A linear layer with bias over the channels of a map, which keeps the map's layout.
///
/// # Shapes
/// - x: `[batch, channel_in, cell]`
/// - output: `[batch, channel_out, cell]`
///
/// # Panics
/// If the layer has no bias.
pub fn linear_over_channels(linear: &Linear, x: Tensor<3>) -> Tensor<3> {
    let bias = linear.bias.as_ref().expect("layers over maps have a bias");
    mix_channels(x, linear.weight.val().transpose(), bias.val())
}

/// Two linear layers with a ReLU between them.
#[derive(Module, Debug)]
pub struct Mlp {
    pub hidden: Linear,
    pub out: Linear,
}

impl Mlp {
    pub fn init(n_in: usize, n_hidden: usize, n_out: usize, device: &Device) -> Self {
        Self {
            hidden: LinearConfig::new(n_in, n_hidden).init(device),
            out: LinearConfig::new(n_hidden, n_out).init(device),
        }
    }

    pub fn forward<const D: usize>(&self, x: Tensor<D>) -> Tensor<D> {
        self.out.forward(relu(self.hidden.forward(x)))
    }

    /// The same over the channels of a map, `[batch, channel, cell]`.
    pub fn forward_over_channels(&self, x: Tensor<3>) -> Tensor<3> {
        linear_over_channels(&self.out, relu(linear_over_channels(&self.hidden, x)))
    }
}

/// Two linear layers with batch norm (PyTorch's epsilon and momentum) and a ReLU between them; the published head
/// writes them as two convolutions of kernel 1 over a row of queries or cells.
#[derive(Module, Debug)]
pub struct NormedMlp {
    pub hidden: Linear,
    pub norm: BatchNorm,
    pub out: Linear,
}

impl NormedMlp {
    /// `hidden_bias` gives the first layer a bias, which the norm removes again.
    pub fn init(n_in: usize, n_hidden: usize, n_out: usize, hidden_bias: bool, device: &Device) -> Self {
        Self {
            hidden: LinearConfig::new(n_in, n_hidden).with_bias(hidden_bias).init(device),
            norm: BatchNormConfig::new(n_hidden).init(device),
            out: LinearConfig::new(n_hidden, n_out).init(device),
        }
    }

    /// # Shapes
    /// - x: `[row, query, channel_in]`
    /// - output: `[row, query, channel_out]`
    pub fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        self.forward_with(x, |hidden| hidden)
    }

    /// With a change of the normed hidden channels before the ReLU.
    pub fn forward_with(&self, x: Tensor<3>, change: impl FnOnce(Tensor<3>) -> Tensor<3>) -> Tensor<3> {
        let hidden = self.hidden.forward(x);
        let [n_rows, n_queries, n_channels] = hidden.dims();
        let normed = batch_norm(&self.norm, hidden.reshape([n_rows * n_queries, n_channels]));
        self.out.forward(relu(change(normed.reshape([n_rows, n_queries, n_channels]))))
    }
}

/// Draws a layer's weight as Glorot and Bengio (2010) do, for a matrix that joins the rows of `n_parts` layers.
pub fn xavier(linear: &mut Linear, n_parts: usize, device: &Device) {
    let [n_in, n_out] = linear.weight.lazy_shape().dims();
    // Bound sqrt(6 / (in + out)); the joined matrix has `n_parts` times the outputs.
    let gain = ((n_in + n_out) as f64 / (n_in + n_parts * n_out) as f64).sqrt();
    linear.weight =
        Initializer::XavierUniform { gain }.init_with([n_in, n_out], Some(n_in), Some(n_out), device);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_of_layers_over_a_maps_channels_is_the_pair_over_its_cells() {
        let device = Device::flex();
        let net = Mlp::init(3, 7, 5, &device);
        let x = Tensor::<3>::random([2, 4, 3], burn::tensor::Distribution::Default, &device);
        let over_channels = net.forward_over_channels(x.clone().swap_dims(1, 2)).swap_dims(1, 2);
        assert!((over_channels - net.forward(x)).abs().max().into_scalar::<f32>() < 1e-6);
    }

    #[test]
    fn xavier_weights_of_three_joined_layers_reach_their_bound_and_no_further() {
        let device = Device::flex();
        let mut linear = LinearConfig::new(32, 32).init(&device);
        xavier(&mut linear, 3, &device);
        let weights: Vec<f32> = linear.weight.val().into_data().try_to_vec().unwrap();
        let largest = weights.iter().fold(0f32, |largest, weight| largest.max(weight.abs()));
        let bound = (6f32 / (4.0 * 32.0)).sqrt();
        assert!(largest <= bound && largest > 0.95 * bound, "{largest} against {bound}");
    }
}
