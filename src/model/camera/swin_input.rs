//! Inputs of the published camera branch: a cropped image, the LiDAR's depths in it, the calibration.

use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};

use super::frustum::{pool_plan, sparse_depth};
use super::picture::{CameraGeometry, NetworkImage};
use crate::kernels::PoolPlan;
use crate::model::config::SwinCameraConfig;

/// Mean and standard deviation of ImageNet's pixels by channel, from 0 to 1: pretrained weights expect them.
const IMAGE_MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const IMAGE_STD: [f32; 3] = [0.229, 0.224, 0.225];

/// One sample's inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct SwinCameraInput {
    /// `[3, y, x]`, 8-bit RGB, resized and cropped.
    pub image: Vec<u8>,
    /// `(y * width + x, depth in metres)` of pixels with a LiDAR point, sorted by pixel.
    pub depths: Vec<(u32, f32)>,
    /// View of the cropped image.
    pub view: CameraGeometry,
}

impl SwinCameraInput {
    /// # Arguments
    /// - `view`: the view of `image`
    /// - `points`: the LiDAR's, in the ego frame
    #[must_use]
    pub fn prepare(image: &NetworkImage, view: &CameraGeometry, points: &[[f64; 4]]) -> Self {
        Self { image: image.planes(), depths: sparse_depth(points, view), view: *view }
    }
}

/// Inputs of several samples.
#[derive(Debug, Clone)]
pub struct SwinCameraBatch {
    /// `[batch, 3, y, x]`, normalised as ImageNet's.
    pub image: Tensor<4>,
    /// `[batch, 1, y, x]` in metres, 0 where no LiDAR point falls.
    pub depth: Tensor<4>,
    /// One for each sample.
    pub plans: Vec<Arc<PoolPlan>>,
}

impl SwinCameraBatch {
    /// Stacks inputs prepared with `config`; neighbours with the same calibration share a plan.
    #[must_use]
    pub fn stack(inputs: &[&SwinCameraInput], config: &SwinCameraConfig, device: &Device) -> Self {
        let n_batch = inputs.len();
        let n_pixels = config.image_width_px * config.image_height_px;
        let mut image = Vec::with_capacity(n_batch * 3 * n_pixels);
        let mut depth = vec![0f32; n_batch * n_pixels];
        let mut plans: Vec<Arc<PoolPlan>> = Vec::with_capacity(n_batch);
        for (sample, input) in inputs.iter().enumerate() {
            for (channel, plane) in input.image.chunks(n_pixels).enumerate() {
                let (mean, std) = (IMAGE_MEAN[channel] * 255.0, IMAGE_STD[channel] * 255.0);
                image.extend(plane.iter().map(|&value| (f32::from(value) - mean) / std));
            }
            for &(pixel, depth_m) in &input.depths {
                depth[sample * n_pixels + pixel as usize] = depth_m;
            }
            let before = sample.checked_sub(1).filter(|&before| inputs[before].view == input.view);
            plans.push(match before {
                Some(before) => plans[before].clone(),
                None => Arc::new(pool_plan(&config.depth_lss, config.n_features(), &input.view)),
            });
        }
        let (height_px, width_px) = (config.image_height_px, config.image_width_px);
        Self {
            image: Tensor::from_data(TensorData::new(image, [n_batch, 3, height_px, width_px]), device),
            depth: Tensor::from_data(TensorData::new(depth, [n_batch, 1, height_px, width_px]), device),
            plans,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Camera, Pinhole, Point, Transform};
    use crate::model::config::{CameraBackbone, CameraConfig};
    use image::RgbImage;
    use nalgebra::Vector3;

    #[test]
    fn the_crop_keeps_the_lowest_rows_and_the_calibration_follows() {
        let camera = Pinhole::from_horizontal_fov(800, 450, 70f64.to_radians());
        let pose = Transform::looking_forward(Vector3::new(1.7, 0.0, 1.5), 0.0);
        // Red is the row over two, so that it survives resizing.
        let image = RgbImage::from_fn(800, 450, |_, y| image::Rgb([(y / 2) as u8, 0, 255]));
        // A point that the camera sees at column 600, row 400.
        let ray = [(600.0 - camera.cx_px) / camera.fx_px, (400.0 - camera.cy_px) / camera.fy_px];
        let point = pose * Point::<Camera>::new(ray[0] * 12.0, ray[1] * 12.0, 12.0);
        let config = CameraConfig { backbone: CameraBackbone::Swin, ..CameraConfig::default() };
        let image = NetworkImage::resize(&image, &config).unwrap();
        let view = image.view(&CameraGeometry { intrinsics: camera, ego_from_camera: pose });
        let input = SwinCameraInput::prepare(&image, &view, &[[point.x(), point.y(), point.z(), 0.0]]);
        assert_eq!(input.image.len(), 3 * 704 * 256);
        let [red, green, blue] = [0, 1, 2].map(|channel| input.image[channel * 704 * 256 + 255 * 704 + 9]);
        assert!(red.abs_diff(224) <= 1, "the last row is the image's last, not {red}");
        assert_eq!((green, blue), (0, 255));
        // 0.88 of (600, 400) is (528, 352); the upper 140 of 396 rows are gone.
        assert_eq!(input.depths.len(), 1);
        assert_eq!(input.depths[0].0, 212 * 704 + 528);
        assert!((input.depths[0].1 - 12.0).abs() < 1e-5);
        let batch = SwinCameraBatch::stack(&[&input, &input], &config.swin, &Device::flex());
        assert_eq!(batch.depth.clone().sum().into_scalar::<f32>(), 2.0 * input.depths[0].1);
        assert!(Arc::ptr_eq(&batch.plans[0], &batch.plans[1]), "one calibration, one plan");
        let blue: f32 = batch.image.slice([1..2, 2..3, 0..1, 0..1]).into_scalar();
        assert!((blue - (1.0 - 0.406) / 0.225).abs() < 1e-5);
    }
}
