//! Sizes of a Swin Transformer; the default is Swin-T as BEVFusion's camera branch uses it.

use serde::{Deserialize, Serialize};

use super::error::{ModelConfigError, fail};

/// Stages of a Swin Transformer; every published one has four.
pub const N_STAGES: usize = 4;

/// A Swin Transformer (Liu et al. 2021).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SwinConfig {
    /// Side of an image patch in pixels: stride of the first stage's map.
    pub patch_size_px: usize,
    /// Channels of the first stage; each later stage doubles them.
    pub embed_channels: usize,
    /// Blocks of each stage; every second one shifts its windows.
    pub depths: [usize; N_STAGES],
    /// Attention heads of each stage.
    pub n_heads: [usize; N_STAGES],
    /// Side of an attention window in tokens; at least 2.
    pub window_size: usize,
    /// Hidden channels of a block's feed-forward net over its channels.
    pub mlp_ratio: usize,
    /// Whether queries, keys and values have a bias.
    pub qkv_bias: bool,
    /// Whether the patch embedding is normalised.
    pub patch_norm: bool,
    /// In training: probability that a sample skips a branch of the last block; it grows evenly from 0 at the
    /// first block. 0 turns it off.
    pub drop_path: f64,
    /// Stages whose maps are outputs, each through a layer norm of its own; rising.
    pub out_stages: [usize; 3],
}

impl Default for SwinConfig {
    fn default() -> Self {
        Self {
            patch_size_px: 4,
            embed_channels: 96,
            depths: [2, 2, 6, 2],
            n_heads: [3, 6, 12, 24],
            window_size: 7,
            mlp_ratio: 4,
            qkv_bias: true,
            patch_norm: true,
            drop_path: 0.2,
            out_stages: [1, 2, 3],
        }
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

    /// Checks what the types cannot say.
    ///
    /// # Errors
    /// Names the first field that does not fit, and what would.
    pub fn check(&self) -> Result<(), ModelConfigError> {
        let counts = [
            ("swin.patch_size_px", self.patch_size_px, 1),
            ("swin.embed_channels", self.embed_channels, 1),
            ("swin.depths", self.depths.into_iter().min().unwrap_or(0), 1),
            ("swin.window_size", self.window_size, 2),
            ("swin.mlp_ratio", self.mlp_ratio, 1),
        ];
        for (field, found, least) in counts {
            if found < least {
                return fail(field, found, "it must be at least 1 (a window: 2)");
            }
        }
        for (stage, &n_heads) in self.n_heads.iter().enumerate() {
            if n_heads == 0 || !self.channels(stage).is_multiple_of(n_heads) {
                return fail(
                    "swin.n_heads",
                    format!("{:?}", self.n_heads),
                    "each must divide its stage's channels: embed_channels * 2^stage",
                );
            }
        }
        if !(0.0..1.0).contains(&self.drop_path) {
            return fail("swin.drop_path", self.drop_path, "it must lie in 0..1");
        }
        if !self.out_stages.is_sorted_by(|a, b| a < b) || self.out_stages[2] >= N_STAGES {
            return fail(
                "swin.out_stages",
                format!("{:?}", self.out_stages),
                "they must rise and lie between 0 and 3",
            );
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_valid_and_what_is_not_is_named() {
        assert_eq!(SwinConfig::default().check(), Ok(()));
        let wrong = |config: SwinConfig| config.check().unwrap_err().field;
        assert_eq!(wrong(SwinConfig { window_size: 1, ..SwinConfig::default() }), "swin.window_size");
        assert_eq!(wrong(SwinConfig { n_heads: [3, 6, 12, 25], ..SwinConfig::default() }), "swin.n_heads");
        assert_eq!(wrong(SwinConfig { drop_path: f64::NAN, ..SwinConfig::default() }), "swin.drop_path");
        assert_eq!(wrong(SwinConfig { out_stages: [1, 1, 2], ..SwinConfig::default() }), "swin.out_stages");
        assert_eq!(wrong(SwinConfig { out_stages: [1, 2, 4], ..SwinConfig::default() }), "swin.out_stages");
    }

    #[test]
    fn the_share_of_skipped_branches_grows_evenly_to_the_last_block() {
        let shares = SwinConfig::default().drop_path_of_blocks();
        assert_eq!((shares.len(), shares[0], shares[11]), (12, 0.0, 0.2));
        assert!((shares[6] - 0.2 * 6.0 / 11.0).abs() < 1e-12);
    }
}
