//! Sizes of the depth-LSS view transform; the default is BEVFusion's, restricted to the front.

use super::grid::{CHANNELS, GridConfig, METRES, check_cells, check_rises};
use crate::config::{Check, InvalidConfig, above, define_config, from_to, require};

define_config! {
    /// The view transform.
    #[derive(Copy)]
    pub struct DepthLssConfig {
        /// Depth of the first bin, metres along the optical axis.
        depth_min_m: f64 = 1.0, in above(0.0, 1000.0);
        /// End of the bins; the last one lies a step before it.
        depth_max_m: f64 = 60.0, in above(0.0, 1000.0);
        /// Distance from bin to bin.
        depth_step_m: f64 = 0.5, in from_to(0.01, 1000.0);
        /// Rear end of the bird's-eye grid in the ego frame, metres ahead of the rear axle.
        x_min_m: f64 = 0.0, in METRES;
        /// Front end.
        x_max_m: f64 = 54.0, in METRES;
        /// Right end; y points left.
        y_min_m: f64 = -54.0, in METRES;
        /// Left end.
        y_max_m: f64 = 54.0, in METRES;
        /// Points lower than this are left out.
        z_min_m: f64 = -10.0, in METRES;
        /// Points at this height and above are left out.
        z_max_m: f64 = 10.0, in METRES;
        /// Side of a pooled cell.
        cell_size_m: f64 = 0.3, in from_to(0.01, 100.0);
        /// Stride of the second of the three convolutions after the pooling: 1 or 2.
        downsample: usize = 2, in from_to(1.0, 2.0);
        /// Channels of the three convolutions over the sparse depth image.
        depth_channels: [usize; 3] = [8, 32, 64], in CHANNELS.list(3, 3);
        /// Strides of the last two; their product is the stride of the image features.
        depth_strides: [usize; 2] = [4, 2], in from_to(1.0, 64.0).list(2, 2);
        /// Kernel side of the last two, in pixels; odd.
        depth_kernel_px: usize = 5, in from_to(1.0, 15.0);
        /// Channels of the two convolutions that see image features and depth together.
        hidden_channels: usize = 256, in CHANNELS;
        /// Channels of the bird's-eye map.
        out_channels: usize = 80, in CHANNELS;
    }
}

impl DepthLssConfig {
    /// Depth bins.
    #[must_use]
    pub fn n_depth_bins(&self) -> usize {
        ((self.depth_max_m - self.depth_min_m) / self.depth_step_m).round() as usize
    }

    /// The cells into which features are pooled.
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
}

impl Check for DepthLssConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        check_cells("depth_max_m", [self.depth_min_m, self.depth_max_m], self.depth_step_m, 1000)?;
        check_cells("x_max_m", [self.x_min_m, self.x_max_m], self.cell_size_m, 2048)?;
        check_cells("y_max_m", [self.y_min_m, self.y_max_m], self.cell_size_m, 2048)?;
        check_rises("z_max_m", self.z_min_m, self.z_max_m)?;
        let is_odd = !self.depth_kernel_px.is_multiple_of(2);
        require(is_odd, "depth_kernel_px", self.depth_kernel_px, "it must be odd")
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
        let wrong = |config: DepthLssConfig| config.check().unwrap_err().key().to_owned();
        let base = DepthLssConfig::default();
        assert_eq!(wrong(DepthLssConfig { cell_size_m: 0.35, ..base }), "x_max_m");
        assert_eq!(wrong(DepthLssConfig { depth_step_m: 0.0, ..base }), "depth_step_m");
        assert_eq!(wrong(DepthLssConfig { depth_max_m: f64::NAN, ..base }), "depth_max_m");
        assert_eq!(wrong(DepthLssConfig { downsample: 4, ..base }), "downsample");
        assert_eq!(wrong(DepthLssConfig { depth_strides: [8, 0], ..base }), "depth_strides");
        assert_eq!(wrong(DepthLssConfig { depth_kernel_px: 4, ..base }), "depth_kernel_px");
    }
}
