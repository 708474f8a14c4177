//! Small building blocks: 3x3 convolutions, pointwise convolution, resampling, pairs of linear layers.

mod conv_norm;
mod norm;

use burn::module::{Module, Param};
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{BatchNorm, BatchNormConfig, Initializer, Linear, LinearConfig};
use burn::tensor::activation::relu;
use burn::tensor::module::interpolate;
use burn::tensor::ops::{InterpolateMode, InterpolateOptions};
use burn::tensor::{Device, Tensor, TensorData};

use crate::kernels::conv3x3;
pub use conv_norm::{ConvNorm, ConvNormConfig};
pub use norm::{batch_norm_relu, conv3x3_norm_relu};

/// 3x3 convolution (padding 1, no bias), batch norm, ReLU.
#[derive(Module, Debug)]
pub struct ConvBlock {
    conv: Conv2d,
    norm: BatchNorm,
}

impl ConvBlock {
    pub fn init(channels_in: usize, channels_out: usize, stride: usize, device: &Device) -> Self {
        Self {
            conv: Conv2dConfig::new([channels_in, channels_out], [3, 3])
                .with_stride([stride, stride])
                .with_bias(false)
                .with_initializer(Initializer::KaimingNormal { gain: 2f64.sqrt(), fan_out_only: false })
                .init(device),
            norm: BatchNormConfig::new(channels_out).with_epsilon(1e-3).init(device),
        }
    }

    /// With PyTorch's batch norm (epsilon 1e-5, momentum 0.1), as in the published fuser and head.
    #[must_use]
    pub fn with_plain_norm(mut self) -> Self {
        (self.norm.epsilon, self.norm.momentum) = (1e-5, 0.1);
        self
    }

    /// The same block whose running statistics follow the batches by another share than burn's 0.1.
    #[must_use]
    pub fn with_momentum(mut self, momentum: f64) -> Self {
        self.norm.momentum = momentum;
        self
    }

    /// # Shapes
    /// - x: `[batch, channel_in, y, x]`
    /// - output: `[batch, channel_out, ceil(y / stride), ceil(x / stride)]`
    pub fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        conv3x3_norm_relu(self.conv.weight.val(), &self.norm, x, self.conv.stride[0])
    }
}

/// 3x3 convolution (stride 1, padding 1) with bias and nothing after it.
#[derive(Module, Debug)]
pub struct PlainConv {
    weight: Param<Tensor<4>>,
    bias: Param<Tensor<1>>,
}

impl PlainConv {
    /// PyTorch's default weights; `bias` gives every channel one value in place of a random one.
    pub fn init(channels_in: usize, channels_out: usize, bias: Option<f64>, device: &Device) -> Self {
        let conv = Conv2dConfig::new([channels_in, channels_out], [3, 3]).init(device);
        let random = conv.bias.expect("a convolution has a bias unless told otherwise");
        let bias = bias.map_or(random, |value| Initializer::Constant { value }.init([channels_out], device));
        Self { weight: conv.weight, bias }
    }

    /// # Shapes
    /// - x: `[batch, channel_in, y, x]`
    /// - output: `[batch, channel_out, y, x]`
    pub fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        let bias = self.bias.val();
        let [n_channels] = bias.dims();
        conv3x3(x, self.weight.val(), 1) + bias.reshape([1, n_channels, 1, 1])
    }
}

/// 1x1 convolution with bias.
pub fn pointwise(channels_in: usize, channels_out: usize, device: &Device) -> Conv2d {
    Conv2dConfig::new([channels_in, channels_out], [1, 1]).init(device)
}

/// What a 1x1 convolution makes of an image, as one matrix product: burn's own lays pixels out anew.
///
/// # Shapes
/// - x: `[batch, channel_in, y, x]`
/// - output: `[batch, channel_out, y, x]`
pub fn mix_channels(conv: &Conv2d, x: Tensor<4>) -> Tensor<4> {
    let [n_batch, channels_in, n_y, n_x] = x.dims();
    let weight = conv.weight.val();
    let channels_out = weight.dims()[0];
    let mixed = weight
        .reshape([1, channels_out, channels_in])
        .matmul(x.reshape([n_batch, channels_in, n_y * n_x]))
        .reshape([n_batch, channels_out, n_y, n_x]);
    match &conv.bias {
        Some(bias) => mixed + bias.val().reshape([1, channels_out, 1, 1]),
        None => mixed,
    }
}

/// Doubles height and width by repeating each cell.
///
/// # Shapes
/// - x: `[batch, channel, y, x]`
/// - output: `[batch, channel, 2 y, 2 x]`
pub fn upsample_nearest(x: Tensor<4>) -> Tensor<4> {
    let nearest = InterpolateOptions::new(InterpolateMode::Nearest);
    interpolate(x, nearest.with_scale_factor([2.0, 2.0]))
}

/// Resamples a map with bilinear weights between the cells' centres, as PyTorch's `interpolate` with
/// `align_corners=False` and no antialiasing. As two matrix products: burn's own has no gradient on GPUs.
///
/// # Shapes
/// - x: `[batch, channel, y, x]`
/// - output: `[batch, channel, n_y, n_x]`
pub fn resize_bilinear(x: Tensor<4>, [n_y, n_x]: [usize; 2]) -> Tensor<4> {
    let device = x.device();
    let [n_batch, n_channels, n_rows, n_columns] = x.dims();
    let of_columns = bilinear_weights(n_columns, n_x, &device).transpose();
    let of_rows = bilinear_weights(n_rows, n_y, &device);
    let wide = x.reshape([n_batch * n_channels * n_rows, n_columns]).matmul(of_columns);
    let resized = of_rows.unsqueeze::<3>().matmul(wide.reshape([n_batch * n_channels, n_rows, n_x]));
    resized.reshape([n_batch, n_channels, n_y, n_x])
}

/// How much each of `n_in` cells in a row gives to each of `n_out`: `[n_out, n_in]`, each row's sum 1.
fn bilinear_weights(n_in: usize, n_out: usize, device: &Device) -> Tensor<2> {
    let mut weights = vec![0f32; n_out * n_in];
    for (i, row) in weights.chunks_exact_mut(n_in).enumerate() {
        let at = ((i as f64 + 0.5) * n_in as f64 / n_out as f64 - 0.5).max(0.0);
        let below = (at as usize).min(n_in - 1);
        let above = (below + 1).min(n_in - 1);
        let share = (at - below as f64) as f32;
        row[below] += 1.0 - share;
        row[above] += share;
    }
    Tensor::from_data(TensorData::new(weights, [n_out, n_in]), device)
}

/// A linear layer over the channels of a map, as one matrix product that leaves the map as it lies.
///
/// # Shapes
/// - x: `[batch, channel_in, cell]`
/// - output: `[batch, channel_out, cell]`
pub fn linear_over_channels(linear: &Linear, x: Tensor<3>) -> Tensor<3> {
    let mixed = linear.weight.val().transpose().unsqueeze::<3>().matmul(x);
    match &linear.bias {
        Some(bias) => mixed + bias.val().reshape([1, -1, 1]),
        None => mixed,
    }
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

/// Two linear layers with batch norm (PyTorch's epsilon and momentum) and a ReLU between them: what the
/// published head writes as two convolutions of kernel 1 over a row of queries or cells.
#[derive(Module, Debug)]
pub struct NormedMlp {
    pub hidden: Linear,
    pub norm: BatchNorm,
    pub out: Linear,
}

impl NormedMlp {
    /// `hidden_bias` gives the first layer a bias, which the norm takes out again.
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
        let normed = self.norm.forward(hidden.reshape([n_rows * n_queries, n_channels]));
        self.out.forward(relu(change(normed.reshape([n_rows, n_queries, n_channels]))))
    }
}

/// Draws a layer's weight as Glorot and Bengio (2010) do, for a matrix of `n_parts` layers' rows side by side.
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
    fn upsampling_repeats_each_cell_in_a_two_by_two_block() {
        let device = Device::flex();
        let x = Tensor::<4>::from_data(TensorData::new(vec![1f32, 2.0, 3.0, 4.0], [1, 1, 2, 2]), &device);
        let values: Vec<f32> = upsample_nearest(x).into_data().try_to_vec().unwrap();
        assert_eq!(values, [1.0, 1.0, 2.0, 2.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 3.0, 3.0, 4.0, 4.0]);
    }

    #[test]
    fn bilinear_resampling_is_burns() {
        let device = Device::flex();
        device.seed(4);
        let x = Tensor::<4>::random([2, 3, 5, 7], burn::tensor::Distribution::Default, &device);
        for size in [[10, 14], [5, 7], [9, 11], [3, 4], [1, 1], [6, 40]] {
            let options = InterpolateOptions::new(InterpolateMode::Bilinear).with_align_corners(false);
            let burns = interpolate(x.clone(), options.with_output_size(size));
            let own = resize_bilinear(x.clone(), size);
            assert!((own - burns).abs().max().into_scalar::<f32>() < 1e-6, "{size:?}");
        }
    }

    #[test]
    fn mixing_channels_is_a_convolution_of_kernel_1() {
        let device = Device::flex().autodiff();
        device.seed(3);
        let conv = pointwise(5, 3, &device);
        let random = |dims| Tensor::<4>::random(dims, burn::tensor::Distribution::Default, &device);
        let (x, dy) = (random([2, 5, 4, 6]), random([2, 3, 4, 6]));
        let run = |is_own: bool| {
            let x = x.clone().require_grad();
            let y = if is_own { mix_channels(&conv, x.clone()) } else { conv.forward(x.clone()) };
            let gradients = (y.clone() * dy.clone()).sum().backward();
            let weight = conv.weight.val().grad(&gradients).unwrap();
            [y.inner(), x.grad(&gradients).unwrap(), weight]
        };
        for (own, burns) in run(true).into_iter().zip(run(false)) {
            assert!((own - burns).abs().max().into_scalar::<f32>() < 1e-5);
        }
    }

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
