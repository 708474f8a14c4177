//! From pixels to tokens, and from four tokens to one.

use burn::module::Module;
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{LayerNorm, LayerNormConfig, Linear};
use burn::tensor::ops::PadMode;
use burn::tensor::{Device, Tensor};

use super::window::{fill_up, linear};
use crate::model::config::SwinConfig;

/// One token for each patch of the image.
#[derive(Module, Debug)]
pub struct PatchEmbedding {
    conv: Conv2d,
    norm: Option<LayerNorm>,
}

impl PatchEmbedding {
    pub fn init(config: &SwinConfig, device: &Device) -> Self {
        let side = [config.patch_size_px; 2];
        Self {
            conv: Conv2dConfig::new([3, config.embed_channels], side).with_stride(side).init(device),
            norm: config.patch_norm.then(|| LayerNormConfig::new(config.embed_channels).init(device)),
        }
    }

    /// # Shapes
    /// - image: `[batch, 3, y, x]`; patches that reach over the right and lower borders are padded with zeros
    /// - output: `[batch, ceil(y / patch), ceil(x / patch), channel]`
    pub fn forward(&self, image: Tensor<4>) -> Tensor<4> {
        let [_, _, n_y, n_x] = image.dims();
        let [side_y, side_x] = self.conv.kernel_size;
        let missing = [n_y.next_multiple_of(side_y) - n_y, n_x.next_multiple_of(side_x) - n_x];
        let image = if missing == [0, 0] {
            image
        } else {
            image.pad([(0, missing[0]), (0, missing[1])], PadMode::Constant(0.0))
        };
        let tokens = self.conv.forward(image).permute([0, 2, 3, 1]);
        match &self.norm {
            Some(norm) => norm.forward(tokens),
            None => tokens,
        }
    }
}

/// Halves rows and columns: four neighbours become one token of twice the channels.
///
/// The neighbours stand in the order of Microsoft's, torchvision's and timm's nets: columns outermost, that is
/// upper left, lower left, upper right, lower right.
#[derive(Module, Debug)]
pub struct PatchMerging {
    norm: LayerNorm,
    reduction: Linear,
}

impl PatchMerging {
    pub fn init(n_channels: usize, device: &Device) -> Self {
        Self {
            norm: LayerNormConfig::new(4 * n_channels).init(device),
            reduction: linear(4 * n_channels, 2 * n_channels, false, device),
        }
    }

    /// # Shapes
    /// - x: `[batch, y, x, channel]`; odd rows and columns are padded with zeros
    /// - output: `[batch, ceil(y / 2), ceil(x / 2), 2 channel]`
    pub fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        let [n_batch, n_y, n_x, n_channels] = x.dims();
        let [half_y, half_x] = [n_y.div_ceil(2), n_x.div_ceil(2)];
        let x = fill_up(x, [2 * half_y, 2 * half_x]);
        let four = x
            .reshape([n_batch, half_y, 2, half_x, 2, n_channels])
            .permute([0, 1, 3, 4, 2, 5])
            .reshape([n_batch, half_y, half_x, 4 * n_channels]);
        self.reduction.forward(self.norm.forward(four))
    }
}
