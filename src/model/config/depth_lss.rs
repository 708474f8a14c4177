//! Sizes of the depth-LSS view transform; the default is BEVFusion's, restricted to the front.

use serde::{Deserialize, Serialize};

use super::error::{ModelConfigError, fail};
use super::grid::GridConfig;

/// The view transform.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DepthLssConfig {
    /// Depth of the first bin, metres along the optical axis.
    pub depth_min_m: f64,
    /// End of the bins; the last one lies a step before it.
    pub depth_max_m: f64,
    /// Distance from bin to bin.
    pub depth_step_m: f64,
    /// Bounds of the bird's-eye grid in the ego frame.
    pub x_min_m: f64,
    pub x_max_m: f64,
    pub y_min_m: f64,
    pub y_max_m: f64,
    /// Points lower than this are left out.
    pub z_min_m: f64,
    /// Points at this height and above are left out.
    pub z_max_m: f64,
    /// Side of a pooled cell.
    pub cell_size_m: f64,
    /// Stride of the second of the three convolutions after the pooling: 1 or 2.
    pub downsample: usize,
    /// Channels of the three convolutions over the sparse depth image.
    pub depth_channels: [usize; 3],
    /// Strides of the last two; their product is the stride of the image features.
    pub depth_strides: [usize; 2],
    /// Kernel side of the last two, in pixels; odd.
    pub depth_kernel_px: usize,
    /// Channels of the two convolutions that see image features and depth together.
    pub hidden_channels: usize,
    /// Channels of the bird's-eye map.
    pub out_channels: usize,
}

impl Default for DepthLssConfig {
    fn default() -> Self {
        Self {
            depth_min_m: 1.0,
            depth_max_m: 60.0,
            depth_step_m: 0.5,
            x_min_m: 0.0,
            x_max_m: 54.0,
            y_min_m: -54.0,
            y_max_m: 54.0,
            z_min_m: -10.0,
            z_max_m: 10.0,
            cell_size_m: 0.3,
            downsample: 2,
            depth_channels: [8, 32, 64],
            depth_strides: [4, 2],
            depth_kernel_px: 5,
            hidden_channels: 256,
            out_channels: 80,
        }
    }
}

impl DepthLssConfig {
    /// Depth bins.
    #[must_use]
    pub fn n_depth_bins(&self) -> usize {
        ((self.depth_max_m - self.depth_min_m) / self.depth_step_m).round() as usize
    }

    /// The cells that are pooled into.
    #[must_use]
    pub fn pooled_grid(&self) -> GridConfig {
        let Self { x_min_m, x_max_m, y_min_m, y_max_m, z_min_m, z_max_m, cell_size_m, .. } = *self;
        GridConfig { x_min_m, x_max_m, y_min_m, y_max_m, z_min_m, z_max_m, cell_size_m }
    }

    /// Rows and columns of pooled cells.
    #[must_use]
    pub fn pooled_cells(&self) -> [usize; 2] {
        let grid = self.pooled_grid();
        [grid.n_cells_y(), grid.n_cells_x()]
    }

    /// Columns of the bird's-eye map.
    #[must_use]
    pub fn n_cells_x(&self) -> usize {
        self.pooled_cells()[1].div_ceil(self.downsample)
    }

    /// Rows of the bird's-eye map.
    #[must_use]
    pub fn n_cells_y(&self) -> usize {
        self.pooled_cells()[0].div_ceil(self.downsample)
    }

    /// Checks what the types cannot say.
    ///
    /// # Errors
    /// Names the first field that does not fit, and what would.
    pub fn check(&self) -> Result<(), ModelConfigError> {
        let steps = [
            ("depth_lss.depth", self.depth_min_m, self.depth_max_m, self.depth_step_m),
            ("depth_lss.x", self.x_min_m, self.x_max_m, self.cell_size_m),
            ("depth_lss.y", self.y_min_m, self.y_max_m, self.cell_size_m),
        ];
        for (field, low, high, step) in steps {
            let n = (high - low) / step;
            if !(step > 0.0 && n >= 1.0) || (n - n.round()).abs() > 1e-6 {
                return fail(
                    field,
                    format!("{low}..{high} m in steps of {step} m"),
                    "it must hold a whole number of steps, at least one",
                );
            }
        }
        if !(self.depth_min_m > 0.0) {
            return fail("depth_lss.depth_min_m", self.depth_min_m, "it must lie above zero");
        }
        if !(self.z_max_m > self.z_min_m) {
            let found = format!("{}..{} m", self.z_min_m, self.z_max_m);
            return fail("depth_lss.z", found, "the maximum must lie above the minimum");
        }
        if !matches!(self.downsample, 1 | 2) {
            return fail("depth_lss.downsample", self.downsample, "it must be 1 or 2");
        }
        if self.depth_kernel_px.is_multiple_of(2) {
            return fail("depth_lss.depth_kernel_px", self.depth_kernel_px, "it must be odd");
        }
        let counts = [
            ("depth_lss.depth_channels", self.depth_channels.into_iter().min().unwrap_or(0)),
            ("depth_lss.depth_strides", self.depth_strides[0].min(self.depth_strides[1])),
            ("depth_lss.hidden_channels", self.hidden_channels),
            ("depth_lss.out_channels", self.out_channels),
        ];
        for (field, count) in counts {
            if count == 0 {
                return fail(field, count, "it must be at least 1");
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_valid_and_has_the_published_sizes() {
        let config = DepthLssConfig::default();
        assert_eq!(config.check(), Ok(()));
        assert_eq!(config.n_depth_bins(), 118);
        assert_eq!(config.pooled_cells(), [360, 180]);
        assert_eq!((config.n_cells_y(), config.n_cells_x()), (180, 90));
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let wrong = |config: DepthLssConfig| config.check().unwrap_err().field;
        let base = DepthLssConfig::default();
        assert_eq!(wrong(DepthLssConfig { cell_size_m: 0.35, ..base }), "depth_lss.x");
        assert_eq!(wrong(DepthLssConfig { depth_step_m: 0.0, ..base }), "depth_lss.depth");
        assert_eq!(wrong(DepthLssConfig { depth_max_m: f64::NAN, ..base }), "depth_lss.depth");
        assert_eq!(wrong(DepthLssConfig { downsample: 4, ..base }), "depth_lss.downsample");
        assert_eq!(wrong(DepthLssConfig { depth_strides: [8, 0], ..base }), "depth_lss.depth_strides");
        assert_eq!(wrong(DepthLssConfig { depth_kernel_px: 4, ..base }), "depth_lss.depth_kernel_px");
    }
}
