//! What a detector is made of: one typed config for both profiles, checked once.
//!
//! The default is the `small` profile, sized for two CPU cores.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// How speed and steering reach the prediction heads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NumericFusion {
    /// The paper's: a feed-forward net to `[1, query]`, concatenated with the decoder's output
    /// and fused by a 1x1 convolution.
    Paper,
    /// A feed-forward net to a scale and a shift for each channel of the class branch.
    Film,
    /// Ablation: the network does not see speed and steering.
    None,
}

/// What a peak of the heatmap stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Heatmap {
    /// One channel: any object.
    Agnostic,
    /// A channel for harmful and one for harmless, as the paper's class-specific heatmap.
    PerClass,
}

impl Heatmap {
    /// Number of heatmap channels.
    #[must_use]
    pub fn n_channels(self) -> usize {
        match self {
            Self::Agnostic => 1,
            Self::PerClass => 2,
        }
    }
}

/// The bird's-eye grid in the ego frame; pillars are the fine cells, features have twice their size.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GridConfig {
    pub x_min_m: f64,
    pub x_max_m: f64,
    pub y_min_m: f64,
    pub y_max_m: f64,
    /// Points lower than this (in the ego frame) are left out.
    pub z_min_m: f64,
    /// Points higher than this are left out.
    pub z_max_m: f64,
    pub pillar_size_m: f64,
}

impl Default for GridConfig {
    fn default() -> Self {
        Self {
            x_min_m: 0.0,
            x_max_m: 51.2,
            y_min_m: -32.0,
            y_max_m: 32.0,
            z_min_m: -1.0,
            z_max_m: 5.0,
            pillar_size_m: 0.4,
        }
    }
}

impl GridConfig {
    /// Pillars along x.
    #[must_use]
    pub fn n_pillars_x(&self) -> usize {
        ((self.x_max_m - self.x_min_m) / self.pillar_size_m).round() as usize
    }

    /// Pillars along y.
    #[must_use]
    pub fn n_pillars_y(&self) -> usize {
        ((self.y_max_m - self.y_min_m) / self.pillar_size_m).round() as usize
    }

    /// Feature cells along x.
    #[must_use]
    pub fn n_cells_x(&self) -> usize {
        self.n_pillars_x() / 2
    }

    /// Feature cells along y.
    #[must_use]
    pub fn n_cells_y(&self) -> usize {
        self.n_pillars_y() / 2
    }

    /// Side of a feature cell.
    #[must_use]
    pub fn cell_size_m(&self) -> f64 {
        self.pillar_size_m * 2.0
    }
}

/// The camera branch.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraConfig {
    /// The image is resized to this width; the height follows its aspect.
    pub image_width_px: usize,
    /// Channels of the three stride-2 stages.
    pub channels: [usize; 3],
    /// Channels lifted to bird's-eye view.
    pub lift_channels: usize,
    pub depth_min_m: f64,
    pub depth_max_m: f64,
    pub n_depth_bins: usize,
}

impl Default for CameraConfig {
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

/// A detector.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ModelConfig {
    pub grid: GridConfig,
    /// LiDAR points kept of one pillar.
    pub max_points_per_pillar: usize,
    pub pillar_channels: usize,
    /// Channels of the bird's-eye stages at one and two cells.
    pub bev_channels: [usize; 2],
    /// Whether the camera branch takes part; without it the detector sees LiDAR alone.
    pub use_camera: bool,
    pub camera: CameraConfig,
    /// Channels of the queries.
    pub hidden_channels: usize,
    pub n_queries: usize,
    pub n_heads: usize,
    pub heatmap: Heatmap,
    pub numeric_fusion: NumericFusion,
}

impl Default for ModelConfig {
    fn default() -> Self {
        Self {
            grid: GridConfig::default(),
            max_points_per_pillar: 10,
            pillar_channels: 32,
            bev_channels: [64, 96],
            use_camera: true,
            camera: CameraConfig::default(),
            hidden_channels: 64,
            n_queries: 64,
            n_heads: 4,
            heatmap: Heatmap::Agnostic,
            numeric_fusion: NumericFusion::Film,
        }
    }
}

/// What is wrong with a model config.
#[derive(Debug, Error, PartialEq)]
#[error("model config: `{field}` is {found}; {valid}")]
pub struct ModelConfigError {
    pub field: &'static str,
    pub found: String,
    pub valid: &'static str,
}

impl ModelConfig {
    /// Checks what the types cannot say.
    ///
    /// # Errors
    /// Names the first field that does not fit, and what would.
    pub fn check(&self) -> Result<(), ModelConfigError> {
        let fail =
            |field, found: String, valid| Err(ModelConfigError { field, found, valid });
        let grid = &self.grid;
        if !(grid.pillar_size_m > 0.0) {
            return fail("grid.pillar_size_m", grid.pillar_size_m.to_string(), "it must be above zero");
        }
        for (field, low, high) in
            [("grid.x", grid.x_min_m, grid.x_max_m), ("grid.y", grid.y_min_m, grid.y_max_m)]
        {
            let n_pillars = (high - low) / grid.pillar_size_m;
            if !(n_pillars >= 4.0) || (n_pillars - n_pillars.round()).abs() > 1e-6 || n_pillars.round() as usize % 4 != 0 {
                return fail(field, format!("{low}..{high} m"), "it must hold a multiple of four pillars");
            }
        }
        if !(grid.z_max_m > grid.z_min_m) {
            return fail("grid.z", format!("{}..{} m", grid.z_min_m, grid.z_max_m), "the maximum must lie above the minimum");
        }
        if self.n_heads == 0 || self.hidden_channels % self.n_heads != 0 {
            return fail("n_heads", self.n_heads.to_string(), "it must divide hidden_channels");
        }
        if self.n_queries == 0 || self.n_queries > grid.n_cells_x() * grid.n_cells_y() {
            return fail("n_queries", self.n_queries.to_string(), "it must lie between 1 and the number of cells");
        }
        let counts = [
            ("max_points_per_pillar", self.max_points_per_pillar),
            ("pillar_channels", self.pillar_channels),
            ("bev_channels", self.bev_channels[0].min(self.bev_channels[1])),
            ("camera.channels", self.camera.channels.into_iter().min().unwrap_or(0)),
            ("camera.lift_channels", self.camera.lift_channels),
            ("camera.n_depth_bins", self.camera.n_depth_bins),
            ("camera.image_width_px", self.camera.image_width_px / 32),
        ];
        for (field, count) in counts {
            if count == 0 {
                return fail(field, count.to_string(), "it must be at least 1 (image width: 32 pixels)");
            }
        }
        if !(self.camera.depth_max_m > self.camera.depth_min_m && self.camera.depth_min_m > 0.0) {
            return fail(
                "camera.depth",
                format!("{}..{} m", self.camera.depth_min_m, self.camera.depth_max_m),
                "it must rise from above zero",
            );
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_valid_and_has_an_80_by_64_feature_map() {
        let config = ModelConfig::default();
        assert_eq!(config.check(), Ok(()));
        assert_eq!((config.grid.n_cells_y(), config.grid.n_cells_x()), (80, 64));
    }

    #[test]
    fn a_grid_that_does_not_divide_is_refused() {
        let mut config = ModelConfig::default();
        config.grid.x_max_m = 51.0;
        assert_eq!(config.check().unwrap_err().field, "grid.x");
        config = ModelConfig { n_heads: 5, ..ModelConfig::default() };
        assert_eq!(config.check().unwrap_err().field, "n_heads");
    }
}
