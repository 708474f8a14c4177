//! Inputs of the published camera branch: a cropped image, the LiDAR's depths in it, the calibration.

use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};
use image::RgbImage;
use image::imageops::{FilterType, crop_imm, resize};
use thiserror::Error;

use crate::geometry::{Camera, Ego, Pinhole, Point, Transform};
use crate::kernels::PoolPlan;
use crate::model::config::SwinCameraConfig;
use crate::model::depth_lss::{pool_plan, sparse_depth};

/// Mean and deviation of ImageNet's pixels by channel, on a scale from 0 to 1: what pretrained weights expect.
const IMAGE_MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const IMAGE_STD: [f32; 3] = [0.229, 0.224, 0.225];

/// One sample's inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct SwinCameraInput {
    /// `[3, y, x]`, 8-bit RGB, resized and cropped.
    pub image: Vec<u8>,
    /// `(y * width + x, depth in metres)` of pixels that a LiDAR point falls into, by rising pixel.
    pub depths: Vec<(u32, f32)>,
    /// Intrinsics of the cropped image.
    pub intrinsics: Pinhole,
    pub ego_from_camera: Transform<Ego, Camera>,
}

/// Why an image cannot be an input.
#[allow(clippy::struct_field_names, reason = "a quantity says its unit")]
#[derive(Debug, Error, PartialEq)]
#[error(
    "the camera image of {width_px} x {height_px} px is {resized_height_px} px high when {needed_width_px} px wide; \
     the network needs at least {needed_height_px} px"
)]
pub struct SwinCameraInputError {
    width_px: u32,
    height_px: u32,
    resized_height_px: u32,
    needed_width_px: u32,
    needed_height_px: u32,
}

impl SwinCameraInput {
    /// Resizes the image to the network's width and keeps its lowest rows; the calibration follows.
    ///
    /// For a mirrored sample give everything mirrored.
    ///
    /// # Arguments
    /// - `points`: the LiDAR's, in the ego frame
    /// - `intrinsics`: of `image`
    ///
    /// # Errors
    /// The resized image has fewer rows than the network needs.
    pub fn prepare(
        image: &RgbImage,
        points: impl IntoIterator<Item = Point<Ego>>,
        intrinsics: &Pinhole,
        ego_from_camera: &Transform<Ego, Camera>,
        config: &SwinCameraConfig,
    ) -> Result<Self, SwinCameraInputError> {
        let (width_px, height_px) = (config.image_width_px as u32, config.image_height_px as u32);
        let scale = f64::from(width_px) / f64::from(image.width());
        let resized_height_px = (f64::from(image.height()) * scale).round() as u32;
        let Some(cut_px) = resized_height_px.checked_sub(height_px) else {
            return Err(SwinCameraInputError {
                width_px: image.width(),
                height_px: image.height(),
                resized_height_px,
                needed_width_px: width_px,
                needed_height_px: height_px,
            });
        };
        let resized = resize(image, width_px, resized_height_px, FilterType::Triangle);
        let cropped = crop_imm(&resized, 0, cut_px, width_px, height_px).to_image();
        let planes = (0..3).flat_map(|channel| cropped.pixels().map(move |pixel| pixel[channel])).collect();
        let scale_y = f64::from(resized_height_px) / f64::from(image.height());
        let intrinsics = Pinhole {
            width_px,
            height_px,
            fx_px: intrinsics.fx_px * scale,
            fy_px: intrinsics.fy_px * scale_y,
            cx_px: intrinsics.cx_px * scale,
            cy_px: intrinsics.cy_px * scale_y - f64::from(cut_px),
        };
        Ok(Self {
            image: planes,
            depths: sparse_depth(points, &intrinsics, ego_from_camera),
            intrinsics,
            ego_from_camera: *ego_from_camera,
        })
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
    /// Stacks inputs prepared with `config`; neighbours of one calibration share a plan.
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
            let before = sample.checked_sub(1).filter(|&before| {
                inputs[before].intrinsics == input.intrinsics
                    && inputs[before].ego_from_camera == input.ego_from_camera
            });
            plans.push(match before {
                Some(before) => plans[before].clone(),
                None => Arc::new(pool_plan(
                    &config.depth_lss,
                    config.n_features(),
                    &input.intrinsics,
                    &input.ego_from_camera,
                )),
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
    use nalgebra::Vector3;

    fn camera() -> (Pinhole, Transform<Ego, Camera>) {
        (
            Pinhole::from_horizontal_fov(800, 450, 70f64.to_radians()),
            Transform::looking_forward(Vector3::new(1.7, 0.0, 1.5), 0.0),
        )
    }

    #[test]
    fn the_crop_keeps_the_lowest_rows_and_the_calibration_follows() {
        let (camera, pose) = camera();
        // Red is the row over two, so that it survives resizing.
        let image = RgbImage::from_fn(800, 450, |_, y| image::Rgb([(y / 2) as u8, 0, 255]));
        // A point that the camera sees at column 600, row 400.
        let ray = [(600.0 - camera.cx_px) / camera.fx_px, (400.0 - camera.cy_px) / camera.fy_px];
        let point = pose * Point::<Camera>::new(ray[0] * 12.0, ray[1] * 12.0, 12.0);
        let config = SwinCameraConfig::default();
        let input = SwinCameraInput::prepare(&image, [point], &camera, &pose, &config).unwrap();
        assert_eq!(input.image.len(), 3 * 704 * 256);
        let [red, green, blue] = [0, 1, 2].map(|channel| input.image[channel * 704 * 256 + 255 * 704 + 9]);
        assert!(red.abs_diff(224) <= 1, "the last row is the image's last, not {red}");
        assert_eq!((green, blue), (0, 255));
        // 0.88 of (600, 400) is (528, 352); the upper 140 of 396 rows are gone.
        assert_eq!(input.depths.len(), 1);
        assert_eq!(input.depths[0].0, 212 * 704 + 528);
        assert!((input.depths[0].1 - 12.0).abs() < 1e-5);
        let batch = SwinCameraBatch::stack(&[&input, &input], &config, &Device::flex());
        assert_eq!(batch.depth.clone().sum().into_scalar::<f32>(), 2.0 * input.depths[0].1);
        assert!(Arc::ptr_eq(&batch.plans[0], &batch.plans[1]), "one calibration, one plan");
        let blue: f32 = batch.image.slice([1..2, 2..3, 0..1, 0..1]).into_scalar();
        assert!((blue - (1.0 - 0.406) / 0.225).abs() < 1e-5);
    }

    #[test]
    fn an_image_too_flat_for_the_crop_is_refused() {
        let (camera, pose) = camera();
        let flat = RgbImage::new(800, 200);
        let error = SwinCameraInput::prepare(&flat, [], &camera, &pose, &SwinCameraConfig::default());
        assert_eq!(
            error.unwrap_err().to_string(),
            "the camera image of 800 x 200 px is 176 px high when 704 px wide; the network needs at least 256 px"
        );
    }
}
