//! The fused detector: inputs, branches, head, box codes, checkpoints. Inputs come from
//! [`crate::sample::Measured`] alone.

mod attention;
mod batch;
mod bev_backbone;
mod camera;
pub mod checkpoint;
pub mod coder;
mod config;
mod detector;
#[cfg(test)]
mod golden;
mod head;
mod input;
mod layers;
mod lidar;
mod lidar_voxel;
mod parameters;
mod sparse;
mod voxel;

pub use batch::Batch;
pub use bev_backbone::{BevBackbone, BevBackboneConfig, Upsample};
pub use config::{CameraConfig, GridConfig, Heatmap, ModelConfig, ModelConfigError, NumericFusion};
pub use detector::{Detector, detections};
pub use head::{Output, Query, cell_center_m};
pub use input::{Input, InputError};
pub use lidar_voxel::{LidarVoxelBranch, LidarVoxelConfig, VoxelBatch};
pub use parameters::n_trained;
pub use sparse::{EncoderRulebooks, Sites, SparseEncoder, SparseEncoderConfig};
pub use voxel::{N_VOXEL_FEATURES, VoxelConfig, Voxels, voxelize};
