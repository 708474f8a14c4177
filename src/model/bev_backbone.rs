//! Bird's-eye backbone and neck: scales of 3x3 convolutions (SECOND, Yan et al. 2018), each brought to the
//! first scale's size and laid channel by channel beside the others (SECOND's FPN).
//!
//! Convolutions have no bias; each is followed by batch norm and ReLU.

use burn::module::Module;
use burn::nn::BatchNorm;
use burn::nn::conv::{Conv2d, Conv2dConfig, ConvTranspose2d, ConvTranspose2dConfig};
use burn::tensor::{Device, Tensor};

use super::config::{BevBackboneConfig, Upsample};
use super::layers::{ConvBlock, batch_norm_relu, convolve_pointwise, kaiming, lidar_norm, upsample_nearest};

/// Brings one scale to the size of the first, then batch norm and ReLU.
#[derive(Module, Debug)]
struct Neck {
    /// For the first scale, and where coarse cells are repeated.
    point: Option<Conv2d>,
    /// For the other scales.
    spread: Option<ConvTranspose2d>,
    norm: BatchNorm,
    #[module(skip)]
    factor: usize,
}

impl Neck {
    fn init(channels: [usize; 2], factor: usize, upsample: Upsample, device: &Device) -> Self {
        let is_spread = factor > 1 && upsample == Upsample::Transpose;
        Self {
            point: (!is_spread).then(|| {
                Conv2dConfig::new(channels, [1, 1]).with_bias(false).with_initializer(kaiming()).init(device)
            }),
            spread: is_spread.then(|| {
                ConvTranspose2dConfig::new(channels, [factor, factor])
                    .with_stride([factor, factor])
                    .with_bias(false)
                    .with_initializer(kaiming())
                    .init(device)
            }),
            norm: lidar_norm(channels[1], device),
            factor,
        }
    }

    /// # Shapes
    /// - x: `[batch, channel_in, y, x]`
    /// - output: `[batch, channel_out, factor * y, factor * x]`
    fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        if let Some(spread) = &self.spread {
            return batch_norm_relu(&self.norm, transpose_without_overlap(x, spread.weight.val()));
        }
        let point = self.point.as_ref().expect("a neck has one of its two convolutions");
        let x = batch_norm_relu(&self.norm, convolve_pointwise(point, x));
        // Strides are 1 or 2, so that their product is a power of two.
        (0..self.factor.ilog2()).fold(x, |x, _| upsample_nearest(x))
    }
}

/// Transposed convolution whose stride is the side of its square kernel: one matrix product, since no two
/// kernels overlap. burn's own op is many times slower on a CPU.
///
/// # Shapes
/// - x: `[batch, channel_in, y, x]`
/// - w: `[channel_in, channel_out, side, side]`
/// - output: `[batch, channel_out, side * y, side * x]`
fn transpose_without_overlap(x: Tensor<4>, w: Tensor<4>) -> Tensor<4> {
    let ([n_batch, channels_in, n_y, n_x], [_, channels_out, side, _]) = (x.dims(), w.dims());
    let w = w.reshape([channels_in, channels_out * side * side]).transpose().unsqueeze::<3>();
    w.matmul(x.reshape([n_batch, channels_in, n_y * n_x]))
        .reshape([n_batch, channels_out, side, side, n_y, n_x])
        .permute([0, 1, 4, 2, 5, 3])
        .reshape([n_batch, channels_out, side * n_y, side * n_x])
}

/// Backbone and neck.
#[derive(Module, Debug)]
pub struct BevBackbone {
    /// Convolutions of each scale.
    scales: Vec<Vec<ConvBlock>>,
    necks: Vec<Neck>,
}

impl BevBackbone {
    pub fn init(channels_in: usize, config: &BevBackboneConfig, device: &Device) -> Self {
        let (mut scales, mut necks) = (Vec::new(), Vec::new());
        let (mut channels_before, mut factor) = (channels_in, 1);
        for (scale, &n_channels) in config.channels.iter().enumerate() {
            let block = |channels_in: usize, stride: usize| {
                ConvBlock::init(channels_in, n_channels, stride, device)
                    .with_norm(lidar_norm(n_channels, device))
            };
            let following = (0..config.n_layers[scale]).map(|_| block(n_channels, 1));
            let first = block(channels_before, config.strides[scale]);
            scales.push([first].into_iter().chain(following).collect());
            if scale > 0 {
                factor *= config.strides[scale];
            }
            necks.push(Neck::init([n_channels, config.channels_out[scale]], factor, config.upsample, device));
            channels_before = n_channels;
        }
        Self { scales, necks }
    }

    /// # Shapes
    /// - x: `[batch, channel_in, y, x]`, y and x divided by the product of the strides
    /// - output: `[batch, sum of channels_out, y / first stride, x / first stride]`
    pub fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        let mut x = x;
        let mut scales = Vec::new();
        for (blocks, neck) in self.scales.iter().zip(&self.necks) {
            x = blocks.iter().fold(x, |x, block| block.forward(x));
            scales.push(neck.forward(x.clone()));
        }
        Tensor::cat(scales, 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::test_device;
    use crate::model::golden::Golden;
    use crate::model::n_trained;

    fn small(upsample: Upsample) -> BevBackboneConfig {
        BevBackboneConfig {
            channels: vec![4, 6, 5],
            strides: vec![1, 2, 2],
            n_layers: vec![1, 2, 0],
            channels_out: vec![3, 4, 2],
            upsample,
        }
    }

    #[test]
    fn the_published_backbone_has_4_281_and_its_neck_0_296_million_parameters() {
        let backbone = BevBackbone::init(256, &BevBackboneConfig::default(), &Device::flex().autodiff());
        let in_scales: usize = backbone.scales.iter().flatten().map(n_trained).sum();
        let in_necks: usize = backbone.necks.iter().map(n_trained).sum();
        assert_eq!((in_scales, in_necks), (4_280_832, 295_936));
        assert_eq!(BevBackboneConfig::default().n_channels_out(), 512);
    }

    #[test]
    fn values_and_gradients_equal_pytorch() {
        let golden = Golden::read("bev_backbone");
        let (device, inner) = (test_device().autodiff(), test_device());
        for (case, upsample) in [("transpose", Upsample::Transpose), ("nearest", Upsample::Nearest)] {
            let name = |part: &str| format!("{case}.{part}");
            let fresh = BevBackbone::init(5, &small(upsample), &device);
            let backbone = golden.load_torch(&name("net"), fresh);
            let x = golden.tensor::<4>(&name("x"), &inner);
            golden.check(&name("y_eval"), &backbone.valid().forward(x));

            let x = golden.tensor::<4>(&name("x"), &device).require_grad();
            let y = backbone.forward(x.clone());
            let gradients = (y.clone() * golden.tensor::<4>(&name("dy"), &device)).sum().backward();
            golden.check(&name("y_train"), &y);
            golden.check(&name("dx"), &x.grad(&gradients).unwrap());
            let neck = &backbone.necks[2];
            let w = neck
                .spread
                .as_ref()
                .map_or_else(|| neck.point.as_ref().unwrap().weight.val(), |spread| spread.weight.val());
            golden.check(&name("d_neck"), &w.grad(&gradients).unwrap());
        }
    }
}
