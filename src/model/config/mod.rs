//! The config of a detector: one type for both profiles, checked once.
//!
//! The default is the `small` profile, sized for two CPU cores; `paper` is the published model, restricted to
//! the front. The files of `configs/model/` are part of the program.

mod bev_backbone;
mod camera;
mod depth_lss;
mod grid;
mod head;
mod least_weights;
mod lidar;
mod sparse_encoder;
mod swin;
mod swin_camera;
mod voxels;

use self::grid::{CHANNELS, MAX_MAP_NUMBERS};
use crate::config::{Check, InvalidConfig, define_config, part, require};

pub use bev_backbone::{BevBackboneConfig, Upsample};
pub use camera::{CameraBackbone, CameraConfig, CnnConfig};
pub use depth_lss::DepthLssConfig;
pub use grid::GridConfig;
pub use head::{Classes, HeadConfig, HeadJudge, Heatmap, NumericFusion, PositionEncoding, Prediction};
pub use lidar::{DropsConfig, DropsLeftOut, LidarConfig, LidarEncoder, PillarConfig};
pub use sparse_encoder::{SparseEncoderConfig, SparseKernel};
pub use swin::{N_STAGES, SwinConfig};
pub use swin_camera::SwinCameraConfig;
pub use voxels::{LidarVoxelConfig, VoxelConfig};

define_config! {
    /// A detector.
    pub struct ModelConfig {
        /// Whether the LiDAR branch takes part.
        use_lidar: bool = true;
        /// Whether the camera branch takes part; one of the two must.
        use_camera: bool = true;
        /// Output channels of the fuser, a 3x3 convolution over both branches' maps. Default 96; the paper's 256.
        fuser_channels: usize = 96, in CHANNELS;
        grid: GridConfig = GridConfig::default(), in part::<GridConfig>();
        lidar: LidarConfig = LidarConfig::default(), in part::<LidarConfig>();
        camera: CameraConfig = CameraConfig::default(), in part::<CameraConfig>();
        head: HeadConfig = HeadConfig::default(), in part::<HeadConfig>();
    }
}

impl ModelConfig {
    /// The published model, restricted to the front.
    #[must_use]
    pub fn paper() -> Self {
        toml::from_str(PAPER_TOML).expect("a test reads the shipped file")
    }
}

impl Check for ModelConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        require(self.use_lidar || self.use_camera, "use_lidar", false, "LiDAR or camera must take part")?;
        self.grid.check_relations().map_err(|error| error.within("grid"))?;
        if self.use_lidar || self.has_backbone() {
            self.lidar.check_with(&self.grid).map_err(|error| error.within("lidar"))?;
        }
        if self.use_camera {
            self.camera.check_with(&self.grid).map_err(|error| error.within("camera"))?;
        }
        // Pillars have half the side of a feature cell.
        let pillars = if self.use_lidar && self.lidar.encoder == LidarEncoder::Pillars {
            4 * self.lidar.pillars.channels
        } else {
            0
        };
        let n_numbers = self.grid.n_cells() * pillars.max(self.fuser_channels).max(self.head.channels);
        let wanted =
            format!("maps of at most {MAX_MAP_NUMBERS} numbers are needed: larger cells, or fewer channels");
        let (size, told) = (self.grid.cell_size_m, format!("{n_numbers} numbers in a map of this cell size"));
        require(n_numbers <= MAX_MAP_NUMBERS, "grid.cell_size_m", format!("{size}, {told}"), wanted)?;
        self.head.check_with(&self.grid).map_err(|error| error.within("head"))
    }
}

/// Whether training drops anything at random.
impl ModelConfig {
    #[must_use]
    pub fn draws_in_training(&self) -> bool {
        let is_swin = self.use_camera && self.camera.backbone == CameraBackbone::Swin;
        self.head.dropout > 0.0 || (is_swin && self.camera.swin.swin.drop_path > 0.0)
    }
}

/// Channels that the branches hand to the fuser.
impl ModelConfig {
    /// Channels of the LiDAR branch's map; 0 without the branch.
    #[must_use]
    pub fn lidar_channels(&self) -> usize {
        match self.lidar.encoder {
            _ if !self.use_lidar => 0,
            LidarEncoder::Pillars => self.lidar.pillars.channels_out(),
            LidarEncoder::Voxels => self.lidar.voxel.encoded_shape()[0],
        }
    }

    /// Channels of the camera branch's map; 0 without the branch.
    #[must_use]
    pub fn camera_channels(&self) -> usize {
        match self.camera.backbone {
            _ if !self.use_camera => 0,
            CameraBackbone::Cnn => self.camera.cnn.lift_channels,
            CameraBackbone::Swin => self.camera.swin.depth_lss.out_channels,
        }
    }

    /// Image features that each LiDAR point takes along; 0 without LiDAR, without pillars or without a small camera branch.
    #[must_use]
    pub fn paint_channels(&self) -> usize {
        let is_small =
            self.camera.backbone == CameraBackbone::Cnn && self.lidar.encoder == LidarEncoder::Pillars;
        if self.use_lidar && self.use_camera && is_small { self.camera.cnn.paint_channels } else { 0 }
    }

    /// Side of the square of pillars that a query looks at; 0 without pillars.
    #[must_use]
    pub fn look_pillars(&self) -> usize {
        let has_pillars = self.use_lidar && self.lidar.encoder == LidarEncoder::Pillars;
        if has_pillars { self.head.look_pillars } else { 0 }
    }

    /// Whether a bird's-eye backbone follows the fuser. It does with voxels; pillars have their own before it.
    #[must_use]
    pub fn has_backbone(&self) -> bool {
        self.lidar.encoder == LidarEncoder::Voxels
    }

    /// Whether there is a fuser: as published, one branch alone goes straight to the backbone. Without a
    /// backbone the fuser stays, so that networks of an ablation are equally deep.
    #[must_use]
    pub fn has_fuser(&self) -> bool {
        (self.use_lidar && self.use_camera) || !self.has_backbone()
    }

    /// Channels after the fuser; without a fuser, those of the one branch.
    #[must_use]
    pub fn fused_channels(&self) -> usize {
        if self.has_fuser() { self.fuser_channels } else { self.lidar_channels() + self.camera_channels() }
    }

    /// Channels that the head sees.
    #[must_use]
    pub fn head_channels_in(&self) -> usize {
        if self.has_backbone() { self.lidar.voxel.backbone.n_channels_out() } else { self.fused_channels() }
    }
}

#[cfg(test)]
impl ModelConfig {
    /// `small` on a coarse map, and `paper` with every part of it in little.
    pub fn in_little() -> [Self; 2] {
        let mut small = Self::default();
        (small.grid.cell_size_m, small.camera.cnn.image_width_px, small.head.n_queries) = (3.2, 64, 20);
        [small, toml::from_str(include_str!("../../../tests/data/paper_scaled_down.toml")).unwrap()]
    }
}

const PAPER_TOML: &str = include_str!("../../../configs/model/paper.toml");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_small_profile_equals_the_default() {
        let shipped = include_str!("../../../configs/model/small.toml");
        assert_eq!(toml::from_str::<ModelConfig>(shipped).unwrap(), ModelConfig::default());
    }

    #[test]
    fn both_profiles_are_valid_and_have_the_maps_they_should() {
        for (config, cells) in [(ModelConfig::default(), [80, 64]), (ModelConfig::paper(), [180, 90])] {
            crate::config::assert_every_number_is_checked(&config);
            assert_eq!([config.grid.n_cells_y(), config.grid.n_cells_x()], cells);
        }
    }

    /// The branches' own tests hold their defaults against the published counts.
    #[test]
    fn the_paper_profile_states_the_published_sizes() {
        let paper = ModelConfig::paper();
        assert_eq!(paper.lidar.encoder, LidarEncoder::Voxels);
        assert_eq!(paper.lidar.voxel, crate::model::LidarVoxelConfig::default());
        assert_eq!(paper.camera.backbone, CameraBackbone::Swin);
        assert_eq!(paper.camera.swin, crate::model::SwinCameraConfig::default());
        let channels = (paper.camera_channels(), paper.lidar_channels(), paper.head_channels_in());
        assert_eq!(channels, (80, 256, 512));
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let wrong = |change: fn(&mut ModelConfig)| {
            let mut config = ModelConfig::default();
            change(&mut config);
            config.check().unwrap_err().key().to_owned()
        };
        assert_eq!(wrong(|config| config.grid.x_max_m = 51.0), "grid.x_max_m");
        assert_eq!(wrong(|config| config.head.n_heads = 5), "head.n_heads");
        let vast = |config: &mut ModelConfig| {
            config.grid.cell_size_m = 0.1;
            config.lidar.pillars.channels = 1024;
        };
        assert_eq!(wrong(vast), "grid.cell_size_m");
        let high = |config: &mut ModelConfig| {
            *config = ModelConfig::paper();
            (config.use_camera, config.lidar.voxel.voxels.size_z_m) = (false, 0.001);
        };
        assert_eq!(wrong(high), "lidar.voxel.encoder.channels_out");
        assert_eq!(wrong(|config| config.head.dropout = 1.0), "head.dropout");
        let of_kinds = |config: &mut ModelConfig| {
            (config.head.classes, config.head.heatmap) = (Classes::Kind, Heatmap::PerClass);
        };
        assert_eq!(wrong(of_kinds), "head.classes");
        assert_eq!(wrong(|config| config.head.peak_kernels = [3, 2]), "head.peak_kernels");
        assert_eq!(wrong(|config| config.head.n_queries = 80 * 64 + 1), "head.n_queries");
        assert_eq!(wrong(|config| (config.use_lidar, config.use_camera) = (false, false)), "use_lidar");
        assert_eq!(wrong(|config| config.camera.cnn.image_width_px = 31), "camera.cnn.image_width_px");
        assert_eq!(wrong(|config| config.lidar.encoder = LidarEncoder::Voxels), "lidar.voxel");
        assert_eq!(wrong(|config| config.camera.backbone = CameraBackbone::Swin), "camera.swin.depth_lss");
    }
}
