//! The camera branch: from the picture and the LiDAR's depths in it to a bird's-eye map, by a small
//! convolutional net or by the published one.

mod cnn_branch;
mod cnn_input;
mod depth_lss;
mod frustum;
mod lift;
mod lss_fpn;
mod paint;
mod picture;
mod resize;
mod swin;
mod swin_branch;
mod swin_input;

use burn::module::Module;
use burn::tensor::{Device, Tensor};

use super::config::{CameraBackbone, ModelConfig};
use super::lidar::LidarInput;
use cnn_branch::CnnBranch;
pub use cnn_input::{CnnBatch, CnnInput, PAINT_STRIDE, n_features, n_paint_pixels};
use paint::take_pixels;
pub use picture::{CameraGeometry, ImageTooFlat, NetworkImage, PictureFit, Recolour, unpack_image};
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
    /// - `lidar`: what the LiDAR branch makes of them
    #[must_use]
    pub fn prepare(
        image: &NetworkImage,
        view: &CameraGeometry,
        points: &[[f64; 4]],
        lidar: Option<&LidarInput>,
        config: &ModelConfig,
    ) -> Self {
        let small = image.view(view);
        match config.camera.backbone {
            CameraBackbone::Cnn => {
                let painted = lidar.and_then(LidarInput::pillars).filter(|_| config.paint_channels() > 0);
                let sources = painted.map(|pillars| pillars.sources.as_slice()).unwrap_or_default();
                Self::Cnn(CnnInput::prepare(image, &small, points, sources, config))
            }
            CameraBackbone::Swin => Self::Swin(SwinCameraInput::prepare(image, &small, points)),
        }
    }

    /// The view of the network's image, if points take features from it, be there points or not.
    #[must_use]
    pub fn painted_view(&self, config: &ModelConfig) -> Option<&CameraGeometry> {
        self.cnn().filter(|_| config.paint_channels() > 0).map(|input| &input.view)
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
            Self::Cnn(of) => {
                let of_points = size_of_val(&*of.depth) + size_of_val(&*of.pixel_of_point);
                size_of_val(&*of.image) + of_points + of.plan.n_bytes()
            }
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

/// Maps over the image.
#[derive(Debug, Clone)]
pub struct ImageFeatures {
    /// `[batch, channel, feature_y, feature_x]`: what the lift takes; of the published branch already the ground's map.
    pub joint: Tensor<4>,
    /// `[batch, paint_channel, y, x]` at a quarter of the image's size: what points take along, if they do.
    pub paint: Option<Tensor<4>>,
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
    pub fn image_features(&self, batch: &CameraBatch) -> ImageFeatures {
        match (self, batch) {
            (Self::Cnn(branch), CameraBatch::Cnn(batch)) => branch.image_features(batch),
            (Self::Swin(branch), CameraBatch::Swin(batch)) => {
                ImageFeatures { joint: branch.forward(batch), paint: None }
            }
            _ => panic!("{SAME_CONFIG}"),
        }
    }

    /// From [`Self::image_features`] to the map `[batch, channel, cell_y, cell_x]`.
    pub fn lift(&self, features: ImageFeatures, batch: &CameraBatch) -> Tensor<4> {
        match (self, batch) {
            (Self::Cnn(branch), CameraBatch::Cnn(batch)) => branch.lift_and_splat(features.joint, batch),
            _ => features.joint,
        }
    }

    /// Whether each pixel of the painting's map shows an object, before the sigmoid: `[batch, 1, y, x]`, if points take
    /// features from it.
    pub fn objects(&self, features: &ImageFeatures) -> Option<Tensor<4>> {
        match self {
            Self::Cnn(branch) => branch.objects(features),
            Self::Swin(_) => None,
        }
    }
}

impl ImageFeatures {
    /// What the LiDAR's points take along, `[point, paint_channel]`, if they do.
    pub fn of_points(&self, batch: &CameraBatch) -> Option<Tensor<2>> {
        match (&self.paint, batch) {
            (Some(map), CameraBatch::Cnn(batch)) => {
                Some(take_pixels(map.clone(), batch.pixels_of_points.clone()?))
            }
            _ => None,
        }
    }
}
