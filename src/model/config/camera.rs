//! Sizes and choices of the camera branch.

use serde::{Deserialize, Serialize};

use super::grid::{CHANNELS, GridConfig, check_rises};
use super::swin_camera::SwinCameraConfig;
use crate::config::{Check, InvalidConfig, above, define_config, from_to, part, require};

/// The network that turns the image into features.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraBackbone {
    /// Three stages of 3x3 convolutions.
    Cnn,
    /// Published: Swin Transformer, feature pyramid, depth-LSS view transform.
    Swin,
}

define_config! {
    /// The small net, and its lift to bird's-eye view.
    #[derive(Copy)]
    pub struct CnnConfig {
        /// The image is resized to this width; the height follows its aspect.
        image_width_px: usize = 400, in from_to(32.0, 4096.0);
        /// Channels of the three stride-2 stages.
        channels: [usize; 3] = [16, 32, 64], in CHANNELS.list(3, 3);
        /// Channels lifted to bird's-eye view.
        lift_channels: usize = 32, in CHANNELS;
        /// Nearest depth that a pixel's features are lifted to, metres.
        depth_min_m: f64 = 2.0, in above(0.0, 1000.0);
        /// Farthest depth.
        depth_max_m: f64 = 50.0, in above(0.0, 1000.0);
        /// Depths between the two that features are lifted to.
        n_depth_bins: usize = 48, in from_to(1.0, 1000.0);
        /// Image features that each LiDAR point takes along from where the picture shows it, at a quarter of the resized
        /// image; 0 for none. Pillars alone take them.
        paint_channels: usize = 16, in from_to(0.0, 1024.0);
    }
}

define_config! {
    /// The camera branch; the backbone that is not chosen is ignored.
    pub struct CameraConfig {
        /// What makes features of the picture.
        backbone: CameraBackbone = CameraBackbone::Cnn;
        cnn: CnnConfig = CnnConfig::default(), in part::<CnnConfig>();
        swin: SwinCameraConfig = SwinCameraConfig::default(), in part::<SwinCameraConfig>();
    }
}

impl Check for CnnConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        check_rises("depth_max_m", self.depth_min_m, self.depth_max_m)
    }
}

impl CameraConfig {
    /// Checks the chosen backbone's sizes, and that its map is the grid's.
    pub(super) fn check_with(&self, grid: &GridConfig) -> Result<(), InvalidConfig> {
        if self.backbone == CameraBackbone::Cnn {
            return self.cnn.check_relations().map_err(|error| error.within("cnn"));
        }
        self.swin.check_relations().map_err(|error| error.within("swin"))?;
        let lift = &self.swin.depth_lss;
        let cell_size_m = lift.cell_size_m * lift.downsample as f64;
        let found = [lift.x_min_m, lift.x_max_m, lift.y_min_m, lift.y_max_m, cell_size_m];
        let needed = [grid.x_min_m, grid.x_max_m, grid.y_min_m, grid.y_max_m, grid.cell_size_m];
        let is_same = found.iter().zip(&needed).all(|(a, b)| (a - b).abs() <= 1e-6);
        let found = format!("a map (x, y from, to; cell) of {found:?} m");
        require(is_same, "swin.depth_lss", found, "it must be that of `grid`")
    }
}
