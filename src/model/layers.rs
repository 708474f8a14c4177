//! Small building blocks: 3x3 convolution with batch norm, pointwise convolution, up-sampling.

use burn::module::Module;
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{BatchNorm, BatchNormConfig, Initializer, Linear, LinearConfig};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};

use crate::kernels::conv3x3;

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
        let x = conv3x3(x, self.conv.weight.val(), self.conv.stride[0]);
        relu(self.norm.forward(x))
    }
}

/// 1x1 convolution with bias.
pub fn pointwise(channels_in: usize, channels_out: usize, device: &Device) -> Conv2d {
    Conv2dConfig::new([channels_in, channels_out], [1, 1]).init(device)
}

/// Doubles height and width by repeating each cell.
///
/// # Shapes
/// - x: `[batch, channel, y, x]`
/// - output: `[batch, channel, 2 y, 2 x]`
pub fn upsample_nearest(x: Tensor<4>) -> Tensor<4> {
    let [n_batch, n_channels, n_y, n_x] = x.dims();
    x.reshape([n_batch, n_channels, n_y, 1, n_x, 1]).expand([n_batch, n_channels, n_y, 2, n_x, 2]).reshape([
        n_batch,
        n_channels,
        n_y * 2,
        n_x * 2,
    ])
}

/// Two linear layers with a ReLU between them.
#[derive(Module, Debug)]
pub struct Mlp {
    hidden: Linear,
    out: Linear,
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::TensorData;

    #[test]
    fn upsampling_repeats_each_cell_in_a_two_by_two_block() {
        let device = Device::flex();
        let x = Tensor::<4>::from_data(TensorData::new(vec![1f32, 2.0, 3.0, 4.0], [1, 1, 2, 2]), &device);
        let values: Vec<f32> = upsample_nearest(x).into_data().try_to_vec().unwrap();
        assert_eq!(values, [1.0, 1.0, 2.0, 2.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 3.0, 3.0, 4.0, 4.0]);
    }
}
