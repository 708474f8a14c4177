//! Sizes and choices of the LiDAR branch.

use serde::{Deserialize, Serialize};

use super::grid::{CHANNELS, GridConfig};
use super::voxels::LidarVoxelConfig;
use crate::config::{Check, InvalidConfig, define_config, from_to, part, require};

/// The network that turns points into a bird's-eye map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LidarEncoder {
    /// Pillars and a two-scale net of their own.
    Pillars,
    /// Published: voxels and sparse 3D convolutions; a bird's-eye backbone follows the fuser.
    Voxels,
}

define_config! {
    /// Pillars have half the side of a feature cell.
    #[derive(Copy)]
    pub struct PillarConfig {
        /// Most LiDAR points that a pillar keeps.
        max_points: usize = 10, in from_to(1.0, 1000.0);
        /// Channels of a pillar.
        channels: usize = 48, in CHANNELS;
        /// Channels of the bird's-eye stages at one and two cells.
        bev_channels: [usize; 2] = [96, 144], in CHANNELS.list(2, 2);
        /// Whether points tell their height over a ground fitted to the cloud beside that over the wheels; the grid's
        /// lowest and highest point are then heights over that ground.
        ground: bool = true;
    }
}

impl PillarConfig {
    /// Channels that each of the two scales hands on.
    #[must_use]
    pub fn channels_out_of_scale(&self) -> usize {
        self.bev_channels[0] * 3 / 4
    }

    /// Channels of the branch's map, both scales together.
    #[must_use]
    pub fn channels_out(&self) -> usize {
        2 * self.channels_out_of_scale()
    }
}

/// Where points that are taken for drops are left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DropsLeftOut {
    /// Nowhere: as published.
    Never,
    /// Where the network detects; training sees them.
    InDetection,
    /// In training, too.
    Always,
}

impl DropsLeftOut {
    /// Whether they are left out here.
    #[must_use]
    pub fn applies(self, in_training: bool) -> bool {
        match self {
            Self::Never => false,
            Self::InDetection => !in_training,
            Self::Always => true,
        }
    }
}

define_config! {
    /// Points that are taken for drops of rain and fog: near, dim and alone. They hide what stands behind and below them.
    #[derive(Copy)]
    pub struct DropsConfig {
        /// Where they are left out: `never`, `in_detection` (training sees them) or `always`. Default in_detection; published: never.
        left_out: DropsLeftOut = DropsLeftOut::InDetection;
        /// Drops are nearer than this to the LiDAR, in metres.
        range_m: f64 = 10.0, in from_to(0.0, 100.0);
        /// Intensity of the brightest drops, of 255.
        most_intensity: f64 = 1.0, in from_to(0.0, 255.0);
        /// A point with so many others around it is no drop.
        n_neighbours: usize = 4, in from_to(0.0, 1000.0);
        /// How far around, in metres.
        radius_m: f64 = 0.2, in from_to(0.01, 10.0);
    }
}

define_config! {
    /// The LiDAR branch; the encoder that is not chosen is ignored.
    pub struct LidarConfig {
        /// What makes a map of the cloud.
        encoder: LidarEncoder = LidarEncoder::Pillars;
        drops: DropsConfig = DropsConfig::default(), in part::<DropsConfig>();
        pillars: PillarConfig = PillarConfig::default(), in part::<PillarConfig>();
        voxel: LidarVoxelConfig = LidarVoxelConfig::default(), in part::<LidarVoxelConfig>();
    }
}

impl LidarConfig {
    /// Checks that the chosen encoder's map is the grid's.
    pub(super) fn check_with(&self, grid: &GridConfig) -> Result<(), InvalidConfig> {
        if self.encoder == LidarEncoder::Pillars {
            return Ok(());
        }
        self.voxel.check_relations().map_err(|error| error.within("voxel"))?;
        let voxels = &self.voxel.voxels;
        let found = [
            voxels.x_min_m,
            voxels.x_max_m,
            voxels.y_min_m,
            voxels.y_max_m,
            voxels.z_min_m,
            voxels.z_max_m,
            self.voxel.cell_size_m(),
        ];
        let needed = [
            grid.x_min_m,
            grid.x_max_m,
            grid.y_min_m,
            grid.y_max_m,
            grid.z_min_m,
            grid.z_max_m,
            grid.cell_size_m,
        ];
        let is_same = found.iter().zip(&needed).all(|(a, b)| (a - b).abs() <= 1e-6);
        let found = format!("a map (x, y, z from, to; cell) of {found:?} m");
        require(is_same, "voxel", found, "it must be that of `grid`")
    }
}
