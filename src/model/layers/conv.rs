//! Convolutions over maps: with batch norm and ReLU, alone, and of kernel 1 as one matrix product.

use burn::module::{Module, Param};
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{BatchNorm, BatchNormConfig, Initializer, PaddingConfig2d};
use burn::tensor::{Device, Tensor};

use super::norm::{batch_norm_relu, conv3x3_norm_relu};
use crate::kernels::{conv3x3, mix_channels};

/// First weights of a convolution that a ReLU follows (He et al. 2015).
pub fn kaiming() -> Initializer {
    Initializer::KaimingNormal { gain: 2f64.sqrt(), fan_out_only: false }
}

/// Convolution, batch norm, ReLU.
#[derive(Module, Debug)]
pub struct ConvBlock {
    conv: Conv2d,
    norm: BatchNorm,
}

impl ConvBlock {
    /// Kernel 3x3, no bias, and the norm's epsilon of the LiDAR branch, 1e-3.
    pub fn init(channels_in: usize, channels_out: usize, stride: usize, device: &Device) -> Self {
        let conv = Conv2dConfig::new([channels_in, channels_out], [3, 3]).with_initializer(kaiming());
        let mut block = Self::from_conv(conv.with_stride([stride; 2]).with_bias(false), device);
        block.norm.epsilon = 1e-3;
        block
    }

    /// Any convolution with an odd square kernel, padded by half of it, and PyTorch's batch norm (epsilon 1e-5,
    /// momentum 0.1), as in BEVFusion's camera branch.
    pub fn from_conv(conv: Conv2dConfig, device: &Device) -> Self {
        let half = conv.kernel_size[0] / 2;
        let norm = BatchNormConfig::new(conv.channels[1]).init(device);
        let padding = PaddingConfig2d::Explicit(half, half, half, half);
        Self { conv: conv.with_padding(padding).init(device), norm }
    }

    /// With PyTorch's batch norm (epsilon 1e-5, momentum 0.1), as in the published fuser and head.
    #[must_use]
    pub fn with_plain_norm(mut self) -> Self {
        (self.norm.epsilon, self.norm.momentum) = (1e-5, 0.1);
        self
    }

    /// With another batch norm.
    #[must_use]
    pub fn with_norm(self, norm: BatchNorm) -> Self {
        Self { norm, ..self }
    }

    /// # Shapes
    /// - x: `[batch, channel_in, y, x]`
    /// - output: `[batch, channel_out, ceil(y / stride), ceil(x / stride)]`
    pub fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        if has_own_kernel(&self.conv) && self.conv.bias.is_none() {
            return conv3x3_norm_relu(self.conv.weight.val(), &self.norm, x, self.conv.stride[0]);
        }
        batch_norm_relu(&self.norm, convolve(&self.conv, x))
    }
}

/// Whether [`conv3x3`] can compute a convolution.
fn has_own_kernel(conv: &Conv2d) -> bool {
    conv.kernel_size == [3, 3] && conv.stride[0] <= 2
}

/// A convolution with bias and nothing after it: kernel 3x3, stride 1, padding 1, PyTorch's first weights.
///
/// # Arguments
/// - `bias`: gives every channel one value in place of a random one
pub fn plain_conv(channels_in: usize, channels_out: usize, bias: Option<f64>, device: &Device) -> Conv2d {
    let mut conv = Conv2dConfig::new([channels_in, channels_out], [3, 3]).init(device);
    if let Some(value) = bias {
        conv.bias = Some(Initializer::Constant { value }.init([channels_out], device));
    }
    conv
}

/// Convolves, with our own kernel if it applies.
///
/// # Shapes
/// - x: `[batch, channel_in, y, x]`
/// - output: `[batch, channel_out, ceil(y / stride), ceil(x / stride)]`
pub fn convolve(conv: &Conv2d, x: Tensor<4>) -> Tensor<4> {
    if !has_own_kernel(conv) {
        return conv.forward(x);
    }
    let y = conv3x3(x, conv.weight.val(), conv.stride[0]);
    match &conv.bias {
        Some(bias) => y + bias.val().reshape([1, -1, 1, 1]),
        None => y,
    }
}

/// 1x1 convolution with bias.
pub fn pointwise(channels_in: usize, channels_out: usize, device: &Device) -> Conv2d {
    Conv2dConfig::new([channels_in, channels_out], [1, 1]).init(device)
}

/// A 1x1 convolution by our own kernel; burn's copies the pixels to another layout first.
///
/// # Shapes
/// - x: `[batch, channel_in, y, x]`
/// - output: `[batch, channel_out, y, x]`
pub fn convolve_pointwise(conv: &Conv2d, x: Tensor<4>) -> Tensor<4> {
    let [n_batch, channels_in, n_y, n_x] = x.dims();
    let weight = conv.weight.val();
    let channels_out = weight.dims()[0];
    let bias = conv.bias.as_ref().map_or_else(|| Tensor::zeros([channels_out], &x.device()), Param::val);
    let x = x.reshape([n_batch, channels_in, n_y * n_x]);
    mix_channels(x, weight.reshape([channels_out, channels_in]), bias).reshape([
        n_batch,
        channels_out,
        n_y,
        n_x,
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pointwise_convolution_is_one_of_kernel_1() {
        let device = Device::flex().autodiff();
        device.seed(3);
        let conv = pointwise(5, 3, &device);
        let random = |dims| Tensor::<4>::random(dims, burn::tensor::Distribution::Default, &device);
        let (x, dy) = (random([2, 5, 4, 6]), random([2, 3, 4, 6]));
        let run = |is_own: bool| {
            let x = x.clone().require_grad();
            let y = if is_own { convolve_pointwise(&conv, x.clone()) } else { conv.forward(x.clone()) };
            let gradients = (y.clone() * dy.clone()).sum().backward();
            let weight = conv.weight.val().grad(&gradients).unwrap();
            [y.inner(), x.grad(&gradients).unwrap(), weight]
        };
        for (own, burns) in run(true).into_iter().zip(run(false)) {
            assert!((own - burns).abs().max().into_scalar::<f32>() < 1e-5);
        }
    }
}
