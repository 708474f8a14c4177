//! Depth-LSS view transform (Liu et al. 2023, after Philion and Fidler 2020): the LiDAR's sparse depth image
//! and image features give a distribution over depth and a context at each feature; their outer product,
//! spread along the feature's ray, is summed into bird's-eye cells.

mod config;
mod geometry;

use std::sync::Arc;

use burn::module::Module;
use burn::nn::conv::Conv2d;
use burn::tensor::activation::softmax;
use burn::tensor::{Device, Tensor};

use super::conv_norm::{ConvNorm, ConvNormConfig};
use super::layers::pointwise;
use crate::kernels::{PoolPlan, lift_pool};
pub use config::DepthLssConfig;
pub use geometry::{pool_plan, sparse_depth};

/// From image features to the bird's-eye map.
#[derive(Module, Debug)]
pub struct DepthLss {
    depth: Vec<ConvNorm>,
    joint: Vec<ConvNorm>,
    lift: Conv2d,
    smooth: Vec<ConvNorm>,
    #[module(skip)]
    n_depth_bins: usize,
    /// Columns and rows of the pooled grid.
    #[module(skip)]
    n_pooled: [usize; 2],
}

impl DepthLss {
    /// `config` is one that passes its check; `channels_in` are the image features'.
    pub fn init(config: &DepthLssConfig, channels_in: usize, device: &Device) -> Self {
        let [a, b, c] = config.depth_channels;
        let [stride_b, stride_c] = config.depth_strides;
        let (hidden, out) = (config.hidden_channels, config.out_channels);
        let depth = |n_in, n_out, kernel_px, stride| {
            let block = ConvNormConfig::new(n_in, n_out).with_kernel(kernel_px).with_stride(stride);
            block.with_bias().init(device)
        };
        let smooth = |stride| ConvNormConfig::new(out, out).with_stride(stride).init(device);
        Self {
            depth: vec![
                depth(1, a, 1, 1),
                depth(a, b, config.depth_kernel_px, stride_b),
                depth(b, c, config.depth_kernel_px, stride_c),
            ],
            joint: vec![depth(c + channels_in, hidden, 3, 1), depth(hidden, hidden, 3, 1)],
            lift: pointwise(hidden, config.n_depth_bins() + out, device),
            smooth: vec![smooth(1), smooth(config.downsample), smooth(1)],
            n_depth_bins: config.n_depth_bins(),
            n_pooled: config.n_pooled(),
        }
    }

    /// # Shapes
    /// - features: `[batch, channel, feature_y, feature_x]`
    /// - depth_image: `[batch, 1, y, x]` in metres, 0 where no LiDAR point falls
    /// - plans: [`pool_plan`] of each sample
    /// - output: `[batch, out_channel, cell_y, cell_x]`
    pub fn forward(&self, features: Tensor<4>, depth_image: Tensor<4>, plans: &[Arc<PoolPlan>]) -> Tensor<4> {
        self.smooth.iter().fold(self.pool(features, depth_image, plans), |x, block| block.forward(x))
    }

    /// The pooled map before the last three convolutions, `[batch, out_channel, y, x]`.
    fn pool(&self, features: Tensor<4>, depth_image: Tensor<4>, plans: &[Arc<PoolPlan>]) -> Tensor<4> {
        let depth = self.depth.iter().fold(depth_image, |x, block| block.forward(x));
        let joint = Tensor::cat(vec![depth, features], 1);
        let lifted = self.lift.forward(self.joint.iter().fold(joint, |x, block| block.forward(x)));
        let [n_batch, n_lifted, n_y, n_x] = lifted.dims();
        let lifted = lifted.permute([0, 2, 3, 1]).reshape([n_batch, n_y * n_x, n_lifted]);
        let n_channels = n_lifted - self.n_depth_bins;
        let depth = softmax(lifted.clone().narrow(2, 0, self.n_depth_bins), 2);
        let context = lifted.narrow(2, self.n_depth_bins, n_channels);
        let [n_pooled_x, n_pooled_y] = self.n_pooled;
        lift_pool(depth, context, plans)
            .reshape([n_batch, n_pooled_y, n_pooled_x, n_channels])
            .permute([0, 3, 1, 2])
    }
}
