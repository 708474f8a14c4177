//! The published camera branch (BEVFusion, Liu et al. 2023), front camera only: Swin Transformer, feature
//! pyramid, depth-LSS view transform.

mod config;
mod input;

use burn::module::Module;
use burn::tensor::{Device, Tensor};

use super::depth_lss::DepthLss;
use super::lss_fpn::LssFpn;
use super::swin::Swin;
pub use config::SwinCameraConfig;
pub use input::{SwinCameraBatch, SwinCameraInput, SwinCameraInputError};

/// From an image and the LiDAR's depths to features on the bird's-eye grid.
#[derive(Module, Debug)]
pub struct SwinCameraBranch {
    swin: Swin,
    fpn: LssFpn,
    view: DepthLss,
}

impl SwinCameraBranch {
    /// `config` is one that passes its check.
    pub fn init(config: &SwinCameraConfig, device: &Device) -> Self {
        Self {
            swin: Swin::init(&config.swin, device),
            fpn: LssFpn::init(config.swin.out_channels(), config.fpn_channels, device),
            view: DepthLss::init(&config.depth_lss, config.fpn_channels, device),
        }
    }

    /// The backbone, for pretrained weights.
    pub fn swin_mut(&mut self) -> &mut Swin {
        &mut self.swin
    }

    /// # Shapes
    /// - output: `[batch, out_channel, cell_y, cell_x]`
    pub fn forward(&self, batch: &SwinCameraBatch) -> Tensor<4> {
        let features = self.fpn.forward(self.swin.forward(batch.image.clone()));
        self.view.forward(features, batch.depth.clone(), &batch.plans)
    }
}
