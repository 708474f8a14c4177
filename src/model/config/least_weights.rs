//! The numbers that a network needs at least, by its config alone: a file that holds fewer is refused before a network of
//! that size is made.
//!
//! Only layers count that a config can make large: those that it repeats, those between two wide maps, and the wide kernels over the
//! depth image.

use super::{
    BevBackboneConfig, CameraBackbone, DepthLssConfig, LidarEncoder, ModelConfig, SparseEncoderConfig,
    SwinConfig,
};

/// Weights of a convolution over 3 x 3 cells, of one over 3 x 3 x 3, and of one over 3 along z, for each pair of channels.
const FLAT: usize = 9;
const SOLID: usize = 27;
const HIGH: usize = 3;

impl ModelConfig {
    /// The numbers that the network's largest layers have together; it has more. The config has passed its check.
    #[must_use]
    pub fn least_weights(&self) -> usize {
        let (mut n, voxel) = (0, &self.lidar.voxel);
        if self.use_lidar && self.lidar.encoder == LidarEncoder::Voxels {
            n += voxel.encoder.least_weights();
        }
        if self.has_fuser() {
            n += FLAT * (self.lidar_channels() + self.camera_channels()) * self.fuser_channels;
        }
        if self.has_backbone() {
            n += voxel.backbone.least_weights(self.fused_channels());
        }
        n += self.look_pillars().pow(2) * self.lidar.pillars.channels * self.head.channels;
        if self.use_camera && self.camera.backbone == CameraBackbone::Swin {
            n += self.camera.swin.swin.least_weights() + self.camera.swin.depth_lss.least_weights();
        }
        n
    }
}

impl SparseEncoderConfig {
    /// Of the residual blocks, which have two convolutions each, and of those that thin out the grid.
    fn least_weights(&self) -> usize {
        let of_stage = |(channels, blocks): (&usize, &usize)| 2 * SOLID * channels * channels * blocks;
        let blocks: usize = self.channels.iter().zip(&self.n_blocks).map(of_stage).sum();
        let of_down = |channels: &[usize]| SOLID * channels[0] * channels[1];
        let last = self.channels.last().map_or(0, |widest| HIGH * widest * self.channels_out);
        blocks + self.channels.windows(2).map(of_down).sum::<usize>() + last
    }
}

impl BevBackboneConfig {
    /// Of the convolutions of each scale.
    fn least_weights(&self, channels_in: usize) -> usize {
        let before = std::iter::once(&channels_in).chain(&self.channels);
        let of_scale = |((before, channels), layers): ((&usize, &usize), &usize)| {
            FLAT * channels * (before + channels * layers)
        };
        before.zip(&self.channels).zip(&self.n_layers).map(of_scale).sum()
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
        let mut looking = small.clone();
        looking.head.look_pillars = 5;
        let mut lidar_alone = paper.clone();
        lidar_alone.use_camera = false;
        for (config, times) in [(small, 20), (looking, 20), (paper, 4), (lidar_alone, 2)] {
            let n = Detector::init(&config, 0, &Device::flex()).num_params();
            let least = config.least_weights();
            assert!(least <= n && times * least > n, "{least} of {n}");
        }
        assert!(ModelConfig::paper().least_weights() > 20_000_000);
    }
}
