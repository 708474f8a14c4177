//! The numbers that a network needs at least, by its config alone: a file that holds fewer is refused before a network of
//! that size is made.
//!
//! Only layers count that a config can make large: those that it repeats, and the wide kernels over the depth image.

use super::{
    BevBackboneConfig, CameraBackbone, DepthLssConfig, LidarEncoder, ModelConfig, SparseEncoderConfig,
    SwinConfig,
};

/// Weights of a convolution over 3 x 3 cells, and of one over 3 x 3 x 3, for each pair of channels.
const FLAT: usize = 9;
const SOLID: usize = 27;

impl ModelConfig {
    /// The numbers that the network's largest layers have together; it has more.
    #[must_use]
    pub fn least_weights(&self) -> usize {
        let (mut n, voxel) = (0, &self.lidar.voxel);
        if self.use_lidar && self.lidar.encoder == LidarEncoder::Voxels {
            n += voxel.encoder.least_weights();
        }
        if self.has_backbone() {
            n += voxel.backbone.least_weights();
        }
        if self.use_camera && self.camera.backbone == CameraBackbone::Swin {
            n += self.camera.swin.swin.least_weights() + self.camera.swin.depth_lss.least_weights();
        }
        n
    }
}

impl SparseEncoderConfig {
    /// Of the residual blocks, which have two convolutions each.
    fn least_weights(&self) -> usize {
        let of_stage = |(channels, blocks): (&usize, &usize)| 2 * SOLID * channels * channels * blocks;
        self.channels.iter().zip(&self.n_blocks).map(of_stage).sum()
    }
}

impl BevBackboneConfig {
    /// Of the convolutions that follow the first one of each scale.
    fn least_weights(&self) -> usize {
        let of_scale = |(channels, layers): (&usize, &usize)| FLAT * channels * channels * layers;
        self.channels.iter().zip(&self.n_layers).map(of_scale).sum()
    }
}

impl SwinConfig {
    /// Of each block's attention (queries, keys, values, output), feed-forward net and table of positions.
    fn least_weights(&self) -> usize {
        let of_block = |stage: usize| {
            let channels = self.channels(stage);
            let table = (2 * self.window_size - 1).pow(2) * self.n_heads[stage];
            (4 + 2 * self.mlp_ratio) * channels * channels + table
        };
        self.depths.iter().enumerate().map(|(stage, blocks)| blocks * of_block(stage)).sum()
    }
}

impl DepthLssConfig {
    /// Of the last two convolutions over the depth image.
    fn least_weights(&self) -> usize {
        let pairs: usize = self.depth_channels.windows(2).map(|pair| pair[0] * pair[1]).sum();
        self.depth_kernel_px.pow(2) * pairs
    }
}

#[cfg(test)]
mod tests {
    use burn::module::Module;
    use burn::tensor::Device;

    use super::*;
    use crate::model::Detector;

    #[test]
    fn a_network_has_at_least_these_weights_and_not_many_times_as_many() {
        let [small, paper] = ModelConfig::in_little();
        assert_eq!(small.least_weights(), 0);
        let n = Detector::init(&paper, 0, &Device::flex()).num_params();
        let least = paper.least_weights();
        assert!(least <= n && 4 * least > n, "{least} of {n}");
        assert!(ModelConfig::paper().least_weights() > 20_000_000);
    }
}
