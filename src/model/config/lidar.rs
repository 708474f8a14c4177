//! Sizes and choices of the LiDAR branch.

use serde::{Deserialize, Serialize};

use super::error::{ModelConfigError, fail};
use super::grid::GridConfig;
use super::voxels::LidarVoxelConfig;

/// The network that turns points into a bird's-eye map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LidarEncoder {
    /// Pillars and a two-scale net of their own.
    Pillars,
    /// Published: voxels and sparse 3D convolutions; a bird's-eye backbone follows the fuser.
    Voxels,
}

/// Pillars have half the side of a feature cell.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PillarConfig {
    /// Most LiDAR points that a pillar keeps.
    pub max_points: usize,
    /// Channels of a pillar.
    pub channels: usize,
    /// Channels of the bird's-eye stages at one and two cells.
    pub bev_channels: [usize; 2],
}

impl Default for PillarConfig {
    fn default() -> Self {
        Self { max_points: 10, channels: 32, bev_channels: [64, 96] }
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

/// The LiDAR branch; the encoder that is not chosen is ignored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LidarConfig {
    pub encoder: LidarEncoder,
    pub pillars: PillarConfig,
    pub voxel: LidarVoxelConfig,
}

impl Default for LidarConfig {
    fn default() -> Self {
        Self {
            encoder: LidarEncoder::Pillars,
            pillars: PillarConfig::default(),
            voxel: LidarVoxelConfig::default(),
        }
    }
}

impl LidarConfig {
    pub(super) fn check(&self, grid: &GridConfig) -> Result<(), ModelConfigError> {
        if self.encoder == LidarEncoder::Voxels {
            return self.check_voxels(grid);
        }
        let counts = [
            ("lidar.pillars.max_points", self.pillars.max_points),
            ("lidar.pillars.channels", self.pillars.channels),
            ("lidar.pillars.bev_channels", self.pillars.bev_channels[0].min(self.pillars.bev_channels[1])),
        ];
        for (field, count) in counts {
            if count == 0 {
                return fail(field, count, "it must be at least 1");
            }
        }
        Ok(())
    }

    fn check_voxels(&self, grid: &GridConfig) -> Result<(), ModelConfigError> {
        self.voxel.check()?;
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
        if found.iter().zip(&needed).any(|(a, b)| (a - b).abs() > 1e-6) {
            return fail(
                "lidar.voxel",
                format!("a map (x, y, z from, to; cell) of {found:?} m"),
                "it must be that of `grid`",
            );
        }
        Ok(())
    }
}
