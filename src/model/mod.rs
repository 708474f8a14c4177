//! The fused detector: inputs, branches, head, box codes, checkpoints. Inputs come from
//! [`crate::sample::Measured`] alone.

mod attention;
mod batch;
mod camera;
pub mod checkpoint;
pub mod coder;
mod config;
mod detector;
mod head;
mod input;
mod layers;
mod lidar;

pub use batch::Batch;
pub use config::{CameraConfig, GridConfig, Heatmap, ModelConfig, ModelConfigError, NumericFusion};
pub use detector::{Detector, detections};
pub use head::{Output, Query, cell_center_m};
pub use input::{Input, InputError};
