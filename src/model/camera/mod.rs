//! The camera branch: from the picture and the LiDAR's depths in it to a bird's-eye map, by a small
//! convolutional net or by the published one.

mod cnn_branch;
mod cnn_input;
mod depth_lss;
mod frustum;
mod lift;
mod lss_fpn;
mod picture;
mod resize;
mod swin;
mod swin_branch;
mod swin_input;

use burn::module::Module;
use burn::tensor::{Device, Tensor};

use super::config::{CameraBackbone, ModelConfig};
use cnn_branch::CnnBranch;
pub use cnn_input::{CnnBatch, CnnInput, n_features};
pub use picture::{CameraGeometry, ImageTooFlat, NetworkImage, unpack_image};
pub use swin::Swin;
pub use swin_branch::SwinCameraBranch;
pub use swin_input::{SwinCameraBatch, SwinCameraInput};

/// The reason that a branch never gets the input of another backbone.
const SAME_CONFIG: &str = "input, batch and branch were made with one config";

/// One sample's image with its depths and calibration, as the config's backbone needs them.
#[derive(Debug, Clone, PartialEq)]
pub enum CameraInput {
    Cnn(CnnInput),
    Swin(SwinCameraInput),
}

impl CameraInput {
    /// # Arguments
    /// - `view`: the view of the full picture
    /// - `points`: the LiDAR's, in the ego frame, mirrored if the picture is
    #[must_use]
    pub fn prepare(
        image: &NetworkImage,
        view: &CameraGeometry,
        points: &[[f64; 4]],
        config: &ModelConfig,
    ) -> Self {
        let small = image.view(view);
        match config.camera.backbone {
            CameraBackbone::Cnn => Self::Cnn(CnnInput::prepare(image, &small, points, config)),
            CameraBackbone::Swin => Self::Swin(SwinCameraInput::prepare(image, &small, points)),
        }
    }

    /// Height of the network's image; inputs of one batch share it.
    #[must_use]
    pub fn image_height_px(&self) -> usize {
        match self {
            Self::Cnn(input) => input.image_height_px,
            Self::Swin(input) => input.view.intrinsics.height_px as usize,
        }
    }

    /// Memory that the arrays take.
    #[must_use]
    pub fn n_bytes(&self) -> usize {
        match self {
            Self::Cnn(of) => size_of_val(&*of.image) + size_of_val(&*of.depth) + of.plan.n_bytes(),
            Self::Swin(of) => size_of_val(&*of.image) + size_of_val(&*of.depths),
        }
    }

    fn cnn(&self) -> Option<&CnnInput> {
        if let Self::Cnn(input) = self { Some(input) } else { None }
    }

    fn swin(&self) -> Option<&SwinCameraInput> {
        if let Self::Swin(input) = self { Some(input) } else { None }
    }
}

/// The camera's inputs of a batch.
#[derive(Debug, Clone)]
pub enum CameraBatch {
    Cnn(CnnBatch),
    Swin(SwinCameraBatch),
}

impl CameraBatch {
    /// Stacks inputs prepared with `config`; all images must have one size.
    #[must_use]
    pub fn stack(inputs: &[&CameraInput], config: &ModelConfig, device: &Device) -> Self {
        match config.camera.backbone {
            CameraBackbone::Cnn => {
                let inputs = inputs.iter().map(|input| input.cnn().expect(SAME_CONFIG));
                Self::Cnn(CnnBatch::stack(&inputs.collect::<Vec<_>>(), device))
            }
            CameraBackbone::Swin => {
                let inputs = inputs.iter().map(|input| input.swin().expect(SAME_CONFIG));
                Self::Swin(SwinCameraBatch::stack(&inputs.collect::<Vec<_>>(), &config.camera.swin, device))
            }
        }
    }
}

/// The network over the image.
#[derive(Module, Debug)]
pub enum CameraBranch {
    Cnn(CnnBranch),
    Swin(SwinCameraBranch),
}

impl CameraBranch {
    pub fn init(config: &ModelConfig, device: &Device) -> Self {
        match config.camera.backbone {
            CameraBackbone::Cnn => Self::Cnn(CnnBranch::init(config, device)),
            CameraBackbone::Swin => Self::Swin(SwinCameraBranch::init(&config.camera.swin, device)),
        }
    }

    /// Computes the image features; the published branch computes the map in one go.
    pub fn image_features(&self, batch: &CameraBatch) -> Tensor<4> {
        match (self, batch) {
            (Self::Cnn(branch), CameraBatch::Cnn(batch)) => branch.image_features(batch),
            (Self::Swin(branch), CameraBatch::Swin(batch)) => branch.forward(batch),
            _ => panic!("{SAME_CONFIG}"),
        }
    }

    /// From [`Self::image_features`] to the map `[batch, channel, cell_y, cell_x]`.
    pub fn lift(&self, features: Tensor<4>, batch: &CameraBatch) -> Tensor<4> {
        match (self, batch) {
            (Self::Cnn(branch), CameraBatch::Cnn(batch)) => branch.lift_and_splat(features, batch),
            _ => features,
        }
    }
}
