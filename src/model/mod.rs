//! The fused detector: inputs, branches, head, box codes, checkpoints. Inputs come from
//! [`crate::sample::Measured`] alone.

mod attention;
mod batch;
mod camera;
pub mod checkpoint;
pub mod coder;
mod config;
mod conv_norm;
mod depth_lss;
mod detector;
#[cfg(test)]
mod formula;
mod head;
pub mod image_weights;
mod input;
mod layers;
mod lidar;
mod lss_fpn;
mod swin;
mod swin_camera;

pub use batch::Batch;
pub use config::{CameraConfig, GridConfig, Heatmap, ModelConfig, ModelConfigError, NumericFusion};
pub use depth_lss::{DepthLssConfig, pool_plan, sparse_depth};
pub use detector::{Detector, detections};
pub use head::{Output, Query, cell_center_m};
pub use image_weights::{ImageWeightsError, ImageWeightsReport, load_image_weights};
pub use input::{Input, InputError};
pub use swin::{Swin, SwinConfig};
pub use swin_camera::{
    SwinCameraBatch, SwinCameraBranch, SwinCameraConfig, SwinCameraInput, SwinCameraInputError,
};
