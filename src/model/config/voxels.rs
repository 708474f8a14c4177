//! The voxel grid, and the published LiDAR branch on it.

use super::bev_backbone::BevBackboneConfig;
use super::grid::{MAX_MAP_NUMBERS, METRES, check_cells};
use super::sparse_encoder::SparseEncoderConfig;
use crate::config::{Check, InvalidConfig, define_config, from_to, part, require};

/// Channels of the map, all heights together; the published one has 256.
const MAX_CHANNELS: usize = 16_384;

define_config! {
    /// The voxel grid, in the ego frame.
    ///
    /// The default is the published grid's front half: 720 by 1440 by 40 voxels. The published LiDAR stands in
    /// the origin of its grid; ours stands 1.84 m above the ego's, so z runs 2 m higher.
    #[derive(Copy)]
    pub struct VoxelConfig {
        /// Rear end, ahead of the rear axle.
        x_min_m: f64 = 0.0, in METRES;
        /// Front end.
        x_max_m: f64 = 54.0, in METRES;
        /// Right end; y points left.
        y_min_m: f64 = -54.0, in METRES;
        /// Left end.
        y_max_m: f64 = 54.0, in METRES;
        /// Points lower than this are left out.
        z_min_m: f64 = -3.0, in METRES;
        /// Points higher than this are left out.
        z_max_m: f64 = 5.0, in METRES;
        /// Length of a voxel along x and y.
        size_xy_m: f64 = 0.075, in from_to(0.001, 100.0);
        /// Height of a voxel.
        size_z_m: f64 = 0.2, in from_to(0.001, 100.0);
        /// Points of one voxel that enter its mean; later ones are dropped.
        max_points_per_voxel: usize = 10, in from_to(1.0, 1000.0);
        /// Voxels of one cloud; points that would open another are dropped. Published: 120,000 in training,
        /// 160,000 in testing, for ten sweeps all around. One sweep of the default LiDAR over the front sector
        /// fills 3,000 to 5,000.
        max_voxels: usize = 120_000, in from_to(1.0, 2e6);
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
}

impl Check for VoxelConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        for (key, (low, high, size)) in ["z_max_m", "y_max_m", "x_max_m"].into_iter().zip(self.axes()) {
            check_cells(key, [low, high], size, u32::from(u16::MAX))?;
        }
        Ok(())
    }
}

define_config! {
    /// The branch; the default is the published net on the front half of its grid.
    pub struct LidarVoxelConfig {
        voxels: VoxelConfig = VoxelConfig::default(), in part::<VoxelConfig>();
        encoder: SparseEncoderConfig = SparseEncoderConfig::default(), in part::<SparseEncoderConfig>();
        backbone: BevBackboneConfig = BevBackboneConfig::default(), in part::<BevBackboneConfig>();
    }
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
}

impl Check for LidarVoxelConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        self.voxels.check_relations().map_err(|error| error.within("voxels"))?;
        self.encoder.check_with(self.sparse_shape()).map_err(|error| error.within("encoder"))?;
        let halvings = 1 << (self.encoder.channels.len() - 1);
        let [_, n_y, n_x] = self.voxels.shape();
        require(
            n_y.is_multiple_of(halvings) && n_x.is_multiple_of(halvings),
            "voxels",
            format!("{n_y} by {n_x} voxels along y and x, halved after each stage but the last"),
            "both must stay whole: cells of the map begin where the grid does and fill it",
        )?;
        let [n_channels, n_y, n_x] = self.encoded_shape();
        let told = format!(
            "{} at each of {} heights",
            self.encoder.channels_out,
            n_channels / self.encoder.channels_out
        );
        let wanted = format!("at most {MAX_CHANNELS} channels of the map, all heights together, are needed");
        require(n_channels <= MAX_CHANNELS, "encoder.channels_out", told, wanted)?;
        let told = format!("{n_channels} channels of {n_y} by {n_x} cells");
        let wanted = format!("a map of at most {MAX_MAP_NUMBERS} numbers is needed");
        require(n_channels * n_y * n_x <= MAX_MAP_NUMBERS, "encoder.channels_out", told, wanted)?;
        self.backbone.check_with([n_y, n_x]).map_err(|error| error.within("backbone"))
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
        assert_eq!(config.check().unwrap_err().key(), "x_max_m");
        let config = VoxelConfig { size_z_m: 0.0, ..VoxelConfig::default() };
        assert_eq!(config.check().unwrap_err().key(), "size_z_m");
        let config = VoxelConfig { max_voxels: 0, ..VoxelConfig::default() };
        assert_eq!(config.check().unwrap_err().key(), "max_voxels");
    }

    #[test]
    fn a_grid_that_cannot_be_halved_is_refused() {
        let mut config = LidarVoxelConfig::default();
        config.voxels.x_max_m = 54.075;
        assert_eq!(config.check().unwrap_err().key(), "voxels");
    }

    #[test]
    fn the_config_survives_toml() {
        let text = crate::config::to_toml(&LidarVoxelConfig::default());
        assert_eq!(toml::from_str::<LidarVoxelConfig>(&text).unwrap(), LidarVoxelConfig::default());
    }
}
