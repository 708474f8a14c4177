//! The voxel grid, and the published LiDAR branch on it.

use serde::{Deserialize, Serialize};

use super::bev_backbone::BevBackboneConfig;
use super::error::{ModelConfigError, fail};
use super::sparse_encoder::SparseEncoderConfig;

/// The voxel grid, in the ego frame.
///
/// The default is the published grid's front half: 720 by 1440 by 40 voxels. The published LiDAR stands in
/// the origin of its grid; ours stands 1.84 m above the ego's, so z runs 2 m higher.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VoxelConfig {
    pub x_min_m: f64,
    pub x_max_m: f64,
    pub y_min_m: f64,
    pub y_max_m: f64,
    pub z_min_m: f64,
    pub z_max_m: f64,
    /// Length of a voxel along x and y.
    pub size_xy_m: f64,
    /// Height of a voxel.
    pub size_z_m: f64,
    /// Points of one voxel that enter its mean; later ones are dropped.
    pub max_points_per_voxel: usize,
    /// Voxels of one cloud; points that would open another are dropped. Published: 120,000 in training,
    /// 160,000 in testing, for ten sweeps all around. One sweep of the default LiDAR over the front sector
    /// fills 3,000 to 5,000.
    pub max_voxels: usize,
}

impl Default for VoxelConfig {
    fn default() -> Self {
        Self {
            x_min_m: 0.0,
            x_max_m: 54.0,
            y_min_m: -54.0,
            y_max_m: 54.0,
            z_min_m: -3.0,
            z_max_m: 5.0,
            size_xy_m: 0.075,
            size_z_m: 0.2,
            max_points_per_voxel: 10,
            max_voxels: 120_000,
        }
    }
}

impl VoxelConfig {
    /// Lower bound, upper bound and voxel size along z, y, x.
    #[must_use]
    pub fn axes(&self) -> [(f64, f64, f64); 3] {
        [
            (self.z_min_m, self.z_max_m, self.size_z_m),
            (self.y_min_m, self.y_max_m, self.size_xy_m),
            (self.x_min_m, self.x_max_m, self.size_xy_m),
        ]
    }

    /// Voxels along z, y, x.
    #[must_use]
    pub fn shape(&self) -> [usize; 3] {
        self.axes().map(|(low, high, size)| ((high - low) / size).round() as usize)
    }

    /// Checks what the types cannot say.
    ///
    /// # Errors
    /// Names the first field that does not fit, and what would.
    pub fn check(&self) -> Result<(), ModelConfigError> {
        for (field, size) in [("voxels.size_xy_m", self.size_xy_m), ("voxels.size_z_m", self.size_z_m)] {
            if !(size > 0.0 && size.is_finite()) {
                return fail(field, size, "it must be above zero");
            }
        }
        for (field, (low, high, size)) in ["voxels.z", "voxels.y", "voxels.x"].into_iter().zip(self.axes()) {
            let n = (high - low) / size;
            if !(1.0 - 1e-6..=f64::from(u16::MAX)).contains(&n) || (n - n.round()).abs() > 1e-6 {
                return fail(
                    field,
                    format!("{low}..{high} m at {size} m"),
                    "it must hold a whole number of voxels, 1 to 65535",
                );
            }
        }
        for (field, count) in [
            ("voxels.max_points_per_voxel", self.max_points_per_voxel),
            ("voxels.max_voxels", self.max_voxels),
        ] {
            if count == 0 {
                return fail(field, count, "it must be at least 1");
            }
        }
        Ok(())
    }
}

/// The branch; the default is the published net on the front half of its grid.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LidarVoxelConfig {
    pub voxels: VoxelConfig,
    pub encoder: SparseEncoderConfig,
    pub backbone: BevBackboneConfig,
}

impl LidarVoxelConfig {
    /// Cells of the sparse grid along z, y, x: one for each voxel, and as published one more along z.
    #[must_use]
    pub fn sparse_shape(&self) -> [usize; 3] {
        let [n_z, n_y, n_x] = self.voxels.shape();
        [n_z + 1, n_y, n_x]
    }

    /// Channels, cells along y and cells along x of the encoder's map.
    ///
    /// # Panics
    /// If the config has not passed its check.
    #[must_use]
    pub fn encoded_shape(&self) -> [usize; 3] {
        let [n_z, n_y, n_x] =
            self.encoder.out_shape(self.sparse_shape()).expect("the config has been checked");
        [self.encoder.channels_out * n_z, n_y, n_x]
    }

    /// Channels, cells along y and cells along x of the branch's output.
    ///
    /// # Panics
    /// If the config has not passed its check.
    #[must_use]
    pub fn out_shape(&self) -> [usize; 3] {
        let [_, n_y, n_x] = self.encoded_shape();
        let stride = self.backbone.stride();
        [self.backbone.n_channels_out(), n_y / stride, n_x / stride]
    }

    /// Length of an output cell along x and along y.
    ///
    /// # Panics
    /// If the config has not passed its check.
    #[must_use]
    pub fn cell_size_m(&self) -> f64 {
        let [_, _, n_x] = self.out_shape();
        (self.voxels.x_max_m - self.voxels.x_min_m) / n_x as f64
    }

    /// Checks what the types cannot say.
    ///
    /// # Errors
    /// Names the first field that does not fit, and what would.
    pub fn check(&self) -> Result<(), ModelConfigError> {
        self.voxels.check()?;
        self.encoder.check(self.sparse_shape())?;
        let halvings = 1 << (self.encoder.channels.len() - 1);
        let [_, n_y, n_x] = self.voxels.shape();
        if !n_y.is_multiple_of(halvings) || !n_x.is_multiple_of(halvings) {
            return fail(
                "voxels",
                format!("{n_y} by {n_x} voxels along y and x, halved after each stage but the last"),
                "both must stay whole: cells of the map begin where the grid does and fill it",
            );
        }
        let [_, n_y, n_x] = self.encoded_shape();
        self.backbone.check([n_y, n_x])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_grid_in_front_ends_in_512_channels_on_180_by_90_cells_of_60_cm() {
        let config = LidarVoxelConfig::default();
        assert_eq!(config.check(), Ok(()));
        assert_eq!((config.voxels.shape(), config.sparse_shape()), ([40, 1440, 720], [41, 1440, 720]));
        assert_eq!((config.encoded_shape(), config.out_shape()), ([256, 180, 90], [512, 180, 90]));
        assert!((config.cell_size_m() - 0.6).abs() < 1e-12);
    }

    #[test]
    fn a_grid_that_does_not_divide_is_refused() {
        let config = VoxelConfig { x_max_m: 54.01, ..VoxelConfig::default() };
        assert_eq!(config.check().unwrap_err().field, "voxels.x");
        let config = VoxelConfig { size_z_m: 0.0, ..VoxelConfig::default() };
        assert_eq!(config.check().unwrap_err().field, "voxels.size_z_m");
        let config = VoxelConfig { max_voxels: 0, ..VoxelConfig::default() };
        assert_eq!(config.check().unwrap_err().field, "voxels.max_voxels");
    }

    #[test]
    fn a_grid_that_cannot_be_halved_is_refused() {
        let mut config = LidarVoxelConfig::default();
        config.voxels.x_max_m = 54.075;
        assert_eq!(config.check().unwrap_err().field, "voxels");
    }

    #[test]
    fn the_config_survives_toml() {
        let text = crate::config::to_toml(&LidarVoxelConfig::default());
        assert_eq!(toml::from_str::<LidarVoxelConfig>(&text).unwrap(), LidarVoxelConfig::default());
    }
}
