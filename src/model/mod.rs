//! The fused detector: a sample's measurements in, scored boxes out.
//!
//! 1. [`ModelConfig`] describes a network; every part is built from its piece of the config.
//! 2. [`Input::prepare`] turns one [`crate::sample::Measured`] into arrays: [`LidarInput`] (pillars or voxels),
//!    [`CameraInput`] (picture, depths, where its rays meet the ground), speed and steering.
//! 3. [`Batch::stack`] joins several inputs as tensors.
//! 4. [`Detector::forward`] runs both branches (`lidar`, `camera`) to maps of the ground, fuses them, passes
//!    the [`BevBackbone`] if there is one, and the `head`: heatmap, queries at its peaks, one decoder
//!    layer, box codes and classes, together an [`Output`].
//! 5. [`detections`] reads boxes from it, [`kind_boxes`] those of a closed-set baseline.
//!
//! [`checkpoint`] keeps a network in a file, [`SHIPPED`] holds those inside the program, [`image_weights`] reads
//! other libraries' files. `layers` are the blocks that all parts share; shapes stand at each `forward`.

mod batch;
mod bev_backbone;
mod camera;
pub mod checkpoint;
mod config;
mod detector;
#[cfg(test)]
pub(crate) mod golden;
mod head;
pub mod image_weights;
mod input;
mod layers;
mod lidar;
mod operating_score;
mod parameters;
mod shipped;
mod stages;
mod step_memory;

pub use batch::Batch;
pub use bev_backbone::BevBackbone;
pub use camera::{
    CameraBatch, CameraGeometry, CameraInput, ImageTooFlat, NetworkImage, PAINT_STRIDE, PictureFit, Recolour,
    Swin, SwinCameraBatch, SwinCameraBranch, SwinCameraInput, n_paint_pixels,
};
pub use config::{
    BevBackboneConfig, CameraBackbone, CameraConfig, Classes, CnnConfig, DepthLssConfig, DropsConfig,
    DropsLeftOut, GridConfig, HeadConfig, HeadJudge, Heatmap, LidarConfig, LidarEncoder, LidarVoxelConfig,
    ModelConfig, NumericFusion, PillarConfig, PositionEncoding, Prediction, SparseEncoderConfig,
    SwinCameraConfig, SwinConfig, Upsample, VoxelConfig,
};
pub use detector::Detector;
pub use head::{KindBox, Output, Query, coder, detections, detections_by_state, kind_boxes};
pub use image_weights::{ImageWeightsError, ImageWeightsReport};
pub use input::{Input, InputError};
pub use layers::NormStatistics;
pub use lidar::sparse::SparseEncoder;
pub use lidar::{LidarBatch, LidarInput, N_VOXEL_FEATURES, VoxelBatch, Voxels, voxelize};
pub use operating_score::{OperatingScore, OperatingScores};
pub use parameters::n_trained;
pub use shipped::{SHIPPED, Shipped};
pub use stages::detect_by_stage;
pub use step_memory::{StepTensor, step_tensors};
