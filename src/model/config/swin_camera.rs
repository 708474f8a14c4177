//! Sizes of the published camera branch.

use serde::{Deserialize, Serialize};

use super::depth_lss::DepthLssConfig;
use super::error::{ModelConfigError, fail};
use super::swin::SwinConfig;

/// Image, backbone, pyramid and view transform; the default is BEVFusion's, restricted to the front.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SwinCameraConfig {
    /// The camera's image is resized to this width; its height follows the aspect.
    pub image_width_px: usize,
    /// Rows kept of the resized image, the lowest ones.
    pub image_height_px: usize,
    pub swin: SwinConfig,
    /// Channels of the feature pyramid.
    pub fpn_channels: usize,
    pub depth_lss: DepthLssConfig,
}

impl Default for SwinCameraConfig {
    fn default() -> Self {
        Self {
            image_width_px: 704,
            image_height_px: 256,
            swin: SwinConfig::default(),
            fpn_channels: 256,
            depth_lss: DepthLssConfig::default(),
        }
    }
}

impl SwinCameraConfig {
    /// Pixels between neighbouring image features that are lifted.
    #[must_use]
    pub fn feature_stride_px(&self) -> usize {
        self.swin.stride_px(self.swin.out_stages[0])
    }

    /// Rows and columns of the image features that are lifted.
    #[must_use]
    pub fn n_features(&self) -> [usize; 2] {
        [self.image_height_px, self.image_width_px].map(|n_px| n_px.div_ceil(self.feature_stride_px()))
    }

    /// Checks what the types cannot say.
    ///
    /// # Errors
    /// Names the first field that does not fit, and what would.
    pub fn check(&self) -> Result<(), ModelConfigError> {
        self.swin.check()?;
        self.depth_lss.check()?;
        let [a, b] = self.depth_lss.depth_strides;
        if a * b != self.feature_stride_px() {
            return fail(
                "depth_lss.depth_strides",
                format!("[{a}, {b}]"),
                "their product must be the stride of Swin's first map: patch_size_px * 2^out_stages[0]",
            );
        }
        let counts = [
            ("image_width_px", self.image_width_px),
            ("image_height_px", self.image_height_px),
            ("fpn_channels", self.fpn_channels),
        ];
        for (field, count) in counts {
            if count == 0 {
                return fail(field, 0, "it must be at least 1");
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_valid_and_lifts_32_by_88_features() {
        let config = SwinCameraConfig::default();
        assert_eq!(config.check(), Ok(()));
        assert_eq!(config.n_features(), [32, 88]);
    }

    #[test]
    fn depth_strides_that_miss_the_features_are_refused() {
        let mut config = SwinCameraConfig::default();
        config.depth_lss.depth_strides = [4, 4];
        assert_eq!(config.check().unwrap_err().field, "depth_lss.depth_strides");
    }
}
