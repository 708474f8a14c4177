//! The fused detector: inputs, branches, head, box codes, checkpoints. Inputs come from
//! [`crate::sample::Measured`] alone.

mod attention;
mod batch;
mod bev_backbone;
pub mod checkpoint;
mod cnn_branch;
mod cnn_input;
pub mod coder;
mod config;
mod conv_norm;
mod depth_lss;
mod detector;
mod forecast;
#[cfg(test)]
pub(crate) mod formula;
#[cfg(test)]
pub(crate) mod golden;
mod head;
pub mod image_weights;
mod input;
mod kind_boxes;
mod layers;
mod lidar_voxel;
mod lss_fpn;
mod norm;
mod numeric;
mod parameters;
mod pillar_branch;
mod pillars;
mod positions;
mod predict;
mod queries;
mod shipped;
mod sparse;
mod staged;
mod swin;
mod swin_camera;
mod voxel;

pub use batch::Batch;
pub use bev_backbone::BevBackbone;
pub use config::{
    BevBackboneConfig, CameraBackbone, CameraConfig, Classes, CnnConfig, DepthLssConfig, GridConfig,
    HeadConfig, Heatmap, LidarConfig, LidarEncoder, LidarVoxelConfig, ModelConfig, ModelConfigError,
    NumericFusion, PillarConfig, PositionEncoding, Prediction, SparseEncoderConfig, SwinCameraConfig,
    SwinConfig, Upsample, VoxelConfig,
};
pub use depth_lss::{pool_plan, sparse_depth};
pub use detector::{Detector, detections, detections_by_state};
pub use forecast::{MainTensor, main_tensors};
pub use head::Output;
pub use image_weights::{ImageWeightsError, ImageWeightsReport, load_image_weights};
pub use input::{CameraInput, Input, InputError, LidarInput};
pub use kind_boxes::{KindBox, kind_boxes};
pub use lidar_voxel::{LidarVoxelBranch, VoxelBatch};
pub use parameters::n_trained;
pub use queries::{Query, cell_center_m};
pub use shipped::{SHIPPED, Shipped};
pub use sparse::{EncoderRulebooks, Sites, SparseEncoder};
pub use staged::{InferenceStage, detect_by_stage};
pub use swin::Swin;
pub use swin_camera::{SwinCameraBatch, SwinCameraBranch, SwinCameraInput, SwinCameraInputError};
pub use voxel::{N_VOXEL_FEATURES, Voxels, voxelize};
