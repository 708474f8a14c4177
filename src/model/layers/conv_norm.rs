//! Convolution, batch norm (epsilon 1e-5), ReLU, as BEVFusion's camera branch strings them together.

use burn::module::Module;
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{BatchNorm, BatchNormConfig, PaddingConfig2d};
use burn::tensor::{Device, Tensor};

use super::norm::{batch_norm_relu, conv3x3_norm_relu};
use crate::kernels::conv3x3;

/// Sizes of one block.
#[derive(Debug, Clone, Copy)]
pub struct ConvNormConfig {
    pub channels_in: usize,
    pub channels_out: usize,
    /// Side of the kernel, odd; the padding is half of it.
    pub kernel_px: usize,
    pub stride: usize,
    pub has_bias: bool,
}

impl ConvNormConfig {
    /// A kernel of 3x3, stride 1, no bias.
    pub fn new(channels_in: usize, channels_out: usize) -> Self {
        Self { channels_in, channels_out, kernel_px: 3, stride: 1, has_bias: false }
    }

    pub fn with_kernel(self, kernel_px: usize) -> Self {
        Self { kernel_px, ..self }
    }

    pub fn with_stride(self, stride: usize) -> Self {
        Self { stride, ..self }
    }

    pub fn with_bias(self) -> Self {
        Self { has_bias: true, ..self }
    }

    pub fn init(self, device: &Device) -> ConvNorm {
        let half = self.kernel_px / 2;
        ConvNorm {
            conv: Conv2dConfig::new([self.channels_in, self.channels_out], [self.kernel_px; 2])
                .with_stride([self.stride; 2])
                .with_padding(PaddingConfig2d::Explicit(half, half, half, half))
                .with_bias(self.has_bias)
                .init(device),
            norm: BatchNormConfig::new(self.channels_out).init(device),
        }
    }
}

/// The block.
#[derive(Module, Debug)]
pub struct ConvNorm {
    conv: Conv2d,
    norm: BatchNorm,
}

impl ConvNorm {
    /// # Shapes
    /// - x: `[batch, channel_in, y, x]`
    /// - output: `[batch, channel_out, ceil(y / stride), ceil(x / stride)]`
    pub fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        let stride = self.conv.stride[0];
        let weight = self.conv.weight.val();
        let x = match &self.conv.bias {
            _ if self.conv.kernel_size != [3, 3] || stride > 2 => self.conv.forward(x),
            Some(bias) => conv3x3(x, weight, stride) + bias.val().reshape([1, -1, 1, 1]),
            None => return conv3x3_norm_relu(weight, &self.norm, x, stride),
        };
        batch_norm_relu(&self.norm, x)
    }
}
