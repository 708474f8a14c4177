//! The published camera branch (BEVFusion, Liu et al. 2023), front camera only: Swin Transformer, feature
//! pyramid, depth-LSS view transform.

use burn::module::Module;
use burn::tensor::{Device, Tensor};

use super::depth_lss::DepthLss;
use super::lss_fpn::LssFpn;
use super::swin::Swin;
use super::swin_input::SwinCameraBatch;
use crate::model::config::SwinCameraConfig;

/// From an image and the LiDAR's depths to features on the bird's-eye grid.
#[derive(Module, Debug)]
pub struct SwinCameraBranch {
    swin: Swin,
    fpn: LssFpn,
    view: DepthLss,
}

impl SwinCameraBranch {
    /// `config` has passed its check.
    pub fn init(config: &SwinCameraConfig, device: &Device) -> Self {
        Self {
            swin: Swin::init(&config.swin, device),
            fpn: LssFpn::init(config.swin.out_channels(), config.fpn_channels, device),
            view: DepthLss::init(&config.depth_lss, config.fpn_channels, device),
        }
    }

    /// The backbone.
    pub fn swin(&self) -> &Swin {
        &self.swin
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

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::geometry::{Pinhole, Transform};
    use crate::model::camera::picture::{CameraGeometry, NetworkImage};
    use crate::model::camera::swin_input::SwinCameraInput;
    use crate::model::config::{CameraConfig, ModelConfig};
    use crate::model::golden::formula::{fill, gradients};
    use crate::model::golden::values;
    use crate::model::parameters::n_trained;

    fn little() -> CameraConfig {
        let [_, paper] = ModelConfig::in_little();
        let mut camera = paper.camera;
        camera.swin.swin.drop_path = 0.0;
        camera
    }

    /// Two samples, the second with its camera turned a little.
    fn batch(config: &CameraConfig, device: &Device) -> SwinCameraBatch {
        let intrinsics = Pinhole::from_horizontal_fov(200, 112, 70f64.to_radians());
        let image =
            image::RgbImage::from_fn(200, 112, |x, y| image::Rgb([x as u8, y as u8, (x * y % 251) as u8]));
        let image = NetworkImage::resize(&image, config).expect("the image is high enough");
        let points: Vec<[f64; 4]> =
            (0..500).map(|i| [f64::from(i % 25), f64::from(i / 25) - 10.0, 0.3, 0.0]).collect();
        let inputs = [0.0, 0.1].map(|pitch| {
            let ego_from_camera = Transform::looking_forward(Vector3::new(1.5, 0.0, 1.5), pitch);
            let view = image.view(&CameraGeometry { intrinsics, ego_from_camera });
            SwinCameraInput::prepare(&image, &view, &points)
        });
        SwinCameraBatch::stack(&[&inputs[0], &inputs[1]], &config.swin, device)
    }

    #[test]
    fn gradients_reach_every_weight_and_runs_repeat_to_the_bit() {
        let (config, device) = (little(), Device::flex().autodiff());
        let batch = batch(&config, &device);
        assert_ne!(batch.plans[0], batch.plans[1], "two calibrations, two plans");
        let mut branch = SwinCameraBranch::init(&config.swin, &device);
        fill(&mut branch);
        let out = branch.forward(&batch);
        assert_eq!(out.dims(), [2, 6, 20, 20]);
        let again = values(branch.forward(&batch));
        assert_eq!(values(out.clone()), again, "same input, same bits");
        let found = out.powf_scalar(2.0).mean().backward();
        for (name, gradient) in gradients(branch, &found) {
            assert!(gradient.iter().all(|value| value.is_finite()), "{name}");
            let reaches = gradient.iter().any(|&value| value != 0.0);
            assert!(reaches, "no gradient reaches {name}");
        }
    }

    #[test]
    fn the_published_branch_has_the_published_size() {
        let branch = SwinCameraBranch::init(&SwinCameraConfig::default(), &Device::flex().autodiff());
        // Swin-T 27.521 M, pyramid 1.591 M, view transform .058 M + 1.380 M + .173 M.
        assert_eq!(n_trained(&branch), 27_520_506 + 1_591_296 + 57_920 + 1_379_526 + 173_280);
    }

    #[test]
    fn the_image_reaches_the_map_and_so_do_the_depths() {
        let (config, device) = (little(), Device::flex());
        let mut branch = SwinCameraBranch::init(&config.swin, &device);
        fill(&mut branch);
        let whole = batch(&config, &device);
        let dark = SwinCameraBatch { image: whole.image.zeros_like(), ..whole.clone() };
        let blind = SwinCameraBatch { depth: whole.depth.zeros_like(), ..whole.clone() };
        let map = values(branch.forward(&whole));
        assert_ne!(map, values(branch.forward(&dark)));
        assert_ne!(map, values(branch.forward(&blind)));
    }
}
