//! Sizes and choices of the camera branch.

use serde::{Deserialize, Serialize};

use super::error::{ModelConfigError, fail};
use super::grid::GridConfig;
use super::swin_camera::SwinCameraConfig;

/// The network that turns the image into features.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraBackbone {
    /// Three stages of 3x3 convolutions.
    Cnn,
    /// Published: Swin Transformer, feature pyramid, depth-LSS view transform.
    Swin,
}

/// The small net, and its lift to bird's-eye view.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CnnConfig {
    /// The image is resized to this width; the height follows its aspect.
    pub image_width_px: usize,
    /// Channels of the three stride-2 stages.
    pub channels: [usize; 3],
    /// Channels lifted to bird's-eye view.
    pub lift_channels: usize,
    /// Nearest depth that a pixel's features are lifted to, metres.
    pub depth_min_m: f64,
    /// Farthest depth.
    pub depth_max_m: f64,
    pub n_depth_bins: usize,
}

impl Default for CnnConfig {
    fn default() -> Self {
        Self {
            image_width_px: 400,
            channels: [16, 32, 64],
            lift_channels: 32,
            depth_min_m: 2.0,
            depth_max_m: 50.0,
            n_depth_bins: 48,
        }
    }
}

/// The camera branch; the backbone that is not chosen is ignored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraConfig {
    pub backbone: CameraBackbone,
    pub cnn: CnnConfig,
    pub swin: SwinCameraConfig,
}

impl Default for CameraConfig {
    fn default() -> Self {
        Self { backbone: CameraBackbone::Cnn, cnn: CnnConfig::default(), swin: SwinCameraConfig::default() }
    }
}

impl CameraConfig {
    pub(super) fn check(&self, grid: &GridConfig) -> Result<(), ModelConfigError> {
        if self.backbone == CameraBackbone::Swin {
            return self.check_swin(grid);
        }
        let cnn = &self.cnn;
        let counts = [
            ("camera.cnn.channels", cnn.channels.into_iter().min().unwrap_or(0), 1),
            ("camera.cnn.lift_channels", cnn.lift_channels, 1),
            ("camera.cnn.n_depth_bins", cnn.n_depth_bins, 1),
            ("camera.cnn.image_width_px", cnn.image_width_px, 32),
        ];
        for (field, count, least) in counts {
            if count < least {
                return fail(field, count, "it must be at least 1 (image width: 32 pixels)");
            }
        }
        if !(cnn.depth_max_m > cnn.depth_min_m && cnn.depth_min_m > 0.0) {
            let found = format!("{}..{} m", cnn.depth_min_m, cnn.depth_max_m);
            return fail("camera.cnn.depth", found, "it must rise from above zero");
        }
        Ok(())
    }

    fn check_swin(&self, grid: &GridConfig) -> Result<(), ModelConfigError> {
        self.swin.check()?;
        let lift = &self.swin.depth_lss;
        let cell_size_m = lift.cell_size_m * lift.downsample as f64;
        let found = [lift.x_min_m, lift.x_max_m, lift.y_min_m, lift.y_max_m, cell_size_m];
        let needed = [grid.x_min_m, grid.x_max_m, grid.y_min_m, grid.y_max_m, grid.cell_size_m];
        if found.iter().zip(&needed).any(|(a, b)| (a - b).abs() > 1e-6) {
            return fail(
                "camera.swin.depth_lss",
                format!("a map (x, y from, to; cell) of {found:?} m"),
                "it must be that of `grid`",
            );
        }
        Ok(())
    }
}
