//! The picture as a network sees it, resized to the network's width and cropped if it needs fewer rows, and
//! the calibration that belongs to it.

use image::RgbImage;
use image::imageops::{crop_imm, flip_horizontal_in_place};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use thiserror::Error;

use super::resize::resize;
use crate::geometry::{Camera, Ego, Pinhole, Point, Transform};
use crate::model::config::{CameraBackbone, CameraConfig};
use crate::sample::Measured;

/// A camera's intrinsics and its pose on the car.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraGeometry {
    pub intrinsics: Pinhole,
    pub ego_from_camera: Transform<Ego, Camera>,
}

impl CameraGeometry {
    /// The view of a sample's picture; with `mirror` reflected in the ego's x-z plane.
    #[must_use]
    pub fn of(measured: &Measured, mirror: bool) -> Self {
        let Measured { mut intrinsics, ego_from_camera, .. } = *measured;
        if !mirror {
            return Self { intrinsics, ego_from_camera };
        }
        intrinsics.cx_px = f64::from(intrinsics.width_px) - intrinsics.cx_px;
        Self { intrinsics, ego_from_camera: reflect(&ego_from_camera) }
    }

    /// Pixel column, pixel row and depth in metres of the points (x, y, z in the ego frame) that lie in the image.
    pub fn see(&self, points: &[[f64; 4]]) -> impl Iterator<Item = (f64, f64, f32)> {
        let camera_from_ego = self.ego_from_camera.inverse();
        points.iter().filter_map(move |p| {
            let in_camera = camera_from_ego * Point::new(p[0], p[1], p[2]);
            let (u, v) = self.intrinsics.project(&in_camera)?;
            self.intrinsics.contains(u, v).then_some((u, v, in_camera.z() as f32))
        })
    }
}

/// The camera pose reflected in the ego's x-z plane; its image is flipped left to right with it.
fn reflect(ego_from_camera: &Transform<Ego, Camera>) -> Transform<Ego, Camera> {
    let mut isometry = ego_from_camera.isometry;
    isometry.translation.y = -isometry.translation.y;
    // A reflection in y on the ego side and one in x (its image) on the camera side keep a rotation.
    let reflect_ego = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0));
    let reflect_camera = Matrix3::from_diagonal(&Vector3::new(-1.0, 1.0, 1.0));
    let rotation = reflect_ego * isometry.rotation.to_rotation_matrix().into_inner() * reflect_camera;
    isometry.rotation = UnitQuaternion::from_matrix(&rotation);
    Transform::from_isometry(isometry)
}

/// Unpacks a sample's picture; with `mirror` flipped left to right.
///
/// # Errors
/// The image is broken.
pub fn unpack_image(measured: &Measured, mirror: bool) -> Result<RgbImage, image::ImageError> {
    let mut full = measured.image.decode()?;
    if mirror {
        flip_horizontal_in_place(&mut full);
    }
    Ok(full)
}

/// Other colours for a picture: a curve for each of red, green and blue.
#[derive(Debug, Clone, PartialEq)]
pub struct Recolour {
    curves: [[u8; 256]; 3],
}

impl Recolour {
    /// A factor for each colour, and then an exponent on its share of full light.
    #[must_use]
    pub fn new(gains: [f64; 3], gamma: f64) -> Self {
        let curve = |gain: f64| {
            std::array::from_fn(|value| {
                let share = (value as f64 / 255.0 * gain).min(1.0).powf(gamma);
                (255.0 * share).round() as u8
            })
        };
        Self { curves: gains.map(curve) }
    }

    /// A picture without light.
    #[must_use]
    pub fn black() -> Self {
        Self { curves: [[0; 256]; 3] }
    }
}

/// A picture at the network's size.
#[derive(Debug, Clone, PartialEq)]
pub struct NetworkImage {
    pub pixels: RgbImage,
    /// Width and height over those of the full picture, before the crop.
    scale: [f64; 2],
    /// Rows cut off at the top.
    cut_px: u32,
}

/// The picture is too flat for the network.
#[allow(clippy::struct_field_names, reason = "a quantity says its unit")]
#[derive(Debug, Error, PartialEq)]
#[error(
    "the camera image of {width_px} x {height_px} px is {resized_height_px} px high when {needed_width_px} px wide; \
     the network needs at least {needed_height_px} px"
)]
pub struct ImageTooFlat {
    width_px: u32,
    height_px: u32,
    resized_height_px: u32,
    needed_width_px: u32,
    needed_height_px: u32,
}

/// What becomes of a picture on its way to the network, by its size alone.
#[allow(clippy::struct_field_names, reason = "a quantity says its unit")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PictureFit {
    /// The network's.
    width_px: u32,
    /// At that width, before the crop.
    resized_height_px: u32,
    /// Rows that the crop cuts off at the top.
    cut_px: u32,
}

impl PictureFit {
    /// The same for a picture of this width and height. The published backbone keeps only the lowest rows.
    ///
    /// # Errors
    /// The resized picture has fewer rows than the published backbone needs.
    pub fn of([width_px, height_px]: [u32; 2], config: &CameraConfig) -> Result<Self, ImageTooFlat> {
        let (needed_width_px, kept_height_px) = match config.backbone {
            CameraBackbone::Cnn => (config.cnn.image_width_px as u32, None),
            CameraBackbone::Swin => {
                (config.swin.image_width_px as u32, Some(config.swin.image_height_px as u32))
            }
        };
        let scale = f64::from(needed_width_px) / f64::from(width_px);
        let resized_height_px = (f64::from(height_px) * scale).round() as u32;
        let cut_px = match kept_height_px {
            None => 0,
            Some(needed_height_px) => {
                resized_height_px.checked_sub(needed_height_px).ok_or(ImageTooFlat {
                    width_px,
                    height_px,
                    resized_height_px,
                    needed_width_px,
                    needed_height_px,
                })?
            }
        };
        Ok(Self { width_px: needed_width_px, resized_height_px, cut_px })
    }

    /// Height of the network's picture.
    #[must_use]
    pub fn height_px(&self) -> u32 {
        self.resized_height_px - self.cut_px
    }

    /// Whether the crop cuts off the middle row, and with it what is far ahead of a level camera.
    #[must_use]
    pub fn leaves_out_middle(&self) -> bool {
        self.cut_px > self.resized_height_px / 2
    }
}

impl NetworkImage {
    /// Resizes a picture to the network's width; the published backbone keeps only the lowest rows.
    ///
    /// # Errors
    /// The resized picture has fewer rows than the published backbone needs.
    pub fn resize(full: &RgbImage, config: &CameraConfig) -> Result<Self, ImageTooFlat> {
        let fit = PictureFit::of([full.width(), full.height()], config)?;
        let PictureFit { width_px, resized_height_px, cut_px } = fit;
        let scale = f64::from(width_px) / f64::from(full.width());
        let resized = resize(full, width_px, resized_height_px);
        if config.backbone == CameraBackbone::Cnn {
            return Ok(Self { pixels: resized, scale: [scale; 2], cut_px });
        }
        Ok(Self {
            pixels: crop_imm(&resized, 0, cut_px, width_px, fit.height_px()).to_image(),
            scale: [scale, f64::from(resized_height_px) / f64::from(full.height())],
            cut_px,
        })
    }

    /// Gives every pixel other colours.
    pub fn recolour(&mut self, colours: &Recolour) {
        for pixel in self.pixels.pixels_mut() {
            for (value, curve) in pixel.0.iter_mut().zip(&colours.curves) {
                *value = curve[usize::from(*value)];
            }
        }
    }

    /// The view of this picture, from the view of the full one.
    #[must_use]
    pub fn view(&self, full: &CameraGeometry) -> CameraGeometry {
        let ([scale_x, scale_y], of) = (self.scale, &full.intrinsics);
        let intrinsics = Pinhole {
            width_px: self.pixels.width(),
            height_px: self.pixels.height(),
            fx_px: of.fx_px * scale_x,
            fy_px: of.fy_px * scale_y,
            cx_px: of.cx_px * scale_x,
            cy_px: of.cy_px * scale_y - f64::from(self.cut_px),
        };
        CameraGeometry { intrinsics, ..*full }
    }

    /// Pixels as `[3, y, x]`, 8-bit RGB.
    #[must_use]
    pub fn planes(&self) -> Vec<u8> {
        (0..3).flat_map(|channel| self.pixels.pixels().map(move |pixel| pixel[channel])).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::config::SwinCameraConfig;

    #[test]
    fn a_mirrored_camera_sees_a_mirrored_point_in_the_flipped_column() {
        let camera = Pinhole::from_horizontal_fov(400, 225, 70f64.to_radians());
        let pose = Transform::looking_forward(Vector3::new(1.7, 0.2, 1.5), 0.02);
        let seen = camera.project(&(pose.inverse() * Point::new(12.0, 3.0, 0.7))).unwrap();
        let mirror = camera.project(&(reflect(&pose).inverse() * Point::new(12.0, -3.0, 0.7))).unwrap();
        assert!((seen.0 + mirror.0 - 400.0).abs() < 1e-9 && (seen.1 - mirror.1).abs() < 1e-9);
    }

    #[test]
    fn an_image_too_flat_for_the_crop_is_refused() {
        let config = CameraConfig {
            backbone: CameraBackbone::Swin,
            swin: SwinCameraConfig::default(),
            ..CameraConfig::default()
        };
        assert_eq!(
            NetworkImage::resize(&RgbImage::new(800, 200), &config).unwrap_err().to_string(),
            "the camera image of 800 x 200 px is 176 px high when 704 px wide; the network needs at least 256 px"
        );
    }
}
