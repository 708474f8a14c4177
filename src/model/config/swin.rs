//! Sizes of a Swin Transformer; the default is Swin-T as BEVFusion's camera branch uses it.

use super::grid::CHANNELS;
use crate::config::{Check, InvalidConfig, below, define_config, from_to, require};

/// Stages of a Swin Transformer; every published one has four.
pub const N_STAGES: usize = 4;

define_config! {
    /// A Swin Transformer (Liu et al. 2021).
    #[derive(Copy)]
    pub struct SwinConfig {
        /// Side of an image patch in pixels: stride of the first stage's map.
        patch_size_px: usize = 4, in from_to(1.0, 64.0);
        /// Channels of the first stage; each later stage doubles them.
        embed_channels: usize = 96, in CHANNELS;
        /// Blocks of each stage; every second one shifts its windows.
        depths: [usize; N_STAGES] = [2, 2, 6, 2], in from_to(1.0, 100.0).list(N_STAGES, N_STAGES);
        /// Attention heads of each stage.
        n_heads: [usize; N_STAGES] = [3, 6, 12, 24], in CHANNELS.list(N_STAGES, N_STAGES);
        /// Side of an attention window in tokens; at least 2.
        window_size: usize = 7, in from_to(2.0, 64.0);
        /// Hidden channels of a block's feed-forward net over its channels.
        mlp_ratio: usize = 4, in from_to(1.0, 16.0);
        /// Whether queries, keys and values have a bias.
        qkv_bias: bool = true;
        /// Whether the patch embedding is normalised.
        patch_norm: bool = true;
        /// In training: probability that a sample skips a branch of the last block; it grows evenly from 0 at the
        /// first block. 0 turns it off.
        drop_path: f64 = 0.2, in below(0.0, 1.0);
        /// Stages whose maps are outputs, each through a layer norm of its own; rising.
        out_stages: [usize; 3] = [1, 2, 3], in from_to(0.0, 3.0).rising(3, 3);
    }
}

impl SwinConfig {
    /// Channels of a stage's map.
    #[must_use]
    pub fn channels(&self, stage: usize) -> usize {
        self.embed_channels << stage
    }

    /// Pixels between neighbouring tokens of a stage's map.
    #[must_use]
    pub fn stride_px(&self, stage: usize) -> usize {
        self.patch_size_px << stage
    }

    /// Channels of the output maps.
    #[must_use]
    pub fn out_channels(&self) -> [usize; 3] {
        self.out_stages.map(|stage| self.channels(stage))
    }

    /// Probability of skipping a branch for each block in order.
    #[must_use]
    pub fn drop_path_of_blocks(&self) -> Vec<f64> {
        let n_blocks: usize = self.depths.iter().sum();
        let last = n_blocks.saturating_sub(1).max(1) as f64;
        (0..n_blocks).map(|block| self.drop_path * block as f64 / last).collect()
    }
}

impl Check for SwinConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        let mut stages = self.n_heads.iter().enumerate();
        let divide = stages.all(|(stage, &n_heads)| self.channels(stage).is_multiple_of(n_heads));
        let wanted = "each must divide its stage's channels: embed_channels * 2^stage";
        require(divide, "n_heads", format!("{:?}", self.n_heads), wanted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_valid_and_what_is_not_is_named() {
        assert_eq!(SwinConfig::default().check(), Ok(()));
        let wrong = |config: SwinConfig| config.check().unwrap_err().key().to_owned();
        assert_eq!(wrong(SwinConfig { window_size: 1, ..SwinConfig::default() }), "window_size");
        assert_eq!(wrong(SwinConfig { n_heads: [3, 6, 12, 25], ..SwinConfig::default() }), "n_heads");
        assert_eq!(wrong(SwinConfig { drop_path: f64::NAN, ..SwinConfig::default() }), "drop_path");
        assert_eq!(wrong(SwinConfig { out_stages: [1, 1, 2], ..SwinConfig::default() }), "out_stages");
        assert_eq!(wrong(SwinConfig { out_stages: [1, 2, 4], ..SwinConfig::default() }), "out_stages");
    }

    #[test]
    fn the_share_of_skipped_branches_grows_evenly_to_the_last_block() {
        let shares = SwinConfig::default().drop_path_of_blocks();
        assert_eq!((shares.len(), shares[0], shares[11]), (12, 0.0, 0.2));
        assert!((shares[6] - 0.2 * 6.0 / 11.0).abs() < 1e-12);
    }
}
