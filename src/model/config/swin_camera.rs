//! Sizes of the published camera branch.

use super::depth_lss::DepthLssConfig;
use super::grid::CHANNELS;
use super::swin::SwinConfig;
use crate::config::{Check, InvalidConfig, define_config, from_to, part, require};

define_config! {
    /// Image, backbone, pyramid and view transform; the default is BEVFusion's, restricted to the front.
    #[derive(Copy)]
    pub struct SwinCameraConfig {
        /// The camera's image is resized to this width; its height follows the aspect.
        image_width_px: usize = 704, in from_to(1.0, 4096.0);
        /// Rows kept of the resized image, the lowest ones.
        image_height_px: usize = 256, in from_to(1.0, 4096.0);
        swin: SwinConfig = SwinConfig::default(), in part::<SwinConfig>();
        /// Channels of the feature pyramid.
        fpn_channels: usize = 256, in CHANNELS;
        depth_lss: DepthLssConfig = DepthLssConfig::default(), in part::<DepthLssConfig>();
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
}

impl Check for SwinCameraConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        self.swin.check_relations().map_err(|error| error.within("swin"))?;
        self.depth_lss.check_relations().map_err(|error| error.within("depth_lss"))?;
        let [a, b] = self.depth_lss.depth_strides;
        let wanted = "their product must be the stride of Swin's first map: patch_size_px * 2^out_stages[0]";
        let is_stride = a * b == self.feature_stride_px();
        require(is_stride, "depth_lss.depth_strides", format!("[{a}, {b}]"), wanted)
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
        assert_eq!(config.check().unwrap_err().key(), "depth_lss.depth_strides");
    }
}
