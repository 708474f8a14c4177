//! From what the car measured to the arrays a network eats; no truth passes here.

use thiserror::Error;

use super::cnn_input::CnnInput;
use super::config::{CameraBackbone, LidarEncoder, ModelConfig};
use super::pillars::{Pillars, pillars};
use super::swin_camera::{SwinCameraInput, SwinCameraInputError};
use super::voxel::{Voxels, voxelize};
use crate::geometry::{Camera, Ego, Point, Transform};
use crate::sample::{EgoState, Measured};

/// One sample's inputs, ready to be batched.
#[derive(Debug, Clone, PartialEq)]
pub struct Input {
    /// `None` where the detector has no LiDAR branch.
    pub lidar: Option<LidarInput>,
    /// `None` where the detector has no camera branch.
    pub camera: Option<CameraInput>,
    /// Speed over 10 m/s and steering over 0.35 rad, of each state the sample is asked about.
    pub numeric: Vec<[f32; 2]>,
}

/// Points, as the config's encoder takes them.
#[derive(Debug, Clone, PartialEq)]
pub enum LidarInput {
    Pillars(Pillars),
    Voxels(Voxels),
}

/// The image and what goes with it, as the config's backbone takes them.
#[derive(Debug, Clone, PartialEq)]
pub enum CameraInput {
    Cnn(CnnInput),
    Swin(SwinCameraInput),
}

/// Why a sample cannot be an input.
#[derive(Debug, Error)]
pub enum InputError {
    #[error("the camera image cannot be unpacked: {0}")]
    Image(#[from] image::ImageError),
    #[error(transparent)]
    ImageSize(#[from] SwinCameraInputError),
    #[error("{field} is {found}; a finite number is needed")]
    NotFinite { field: &'static str, found: f64 },
}

impl Input {
    /// Prepares a sample. With `mirror`, everything is reflected in the ego's x-z plane, the steering
    /// angle too, which leaves every box's label as it was. Without `with_camera` the picture stays packed.
    ///
    /// # Errors
    /// The image is broken or too flat, or speed or steering is not finite.
    pub fn prepare(
        measured: &Measured,
        config: &ModelConfig,
        mirror: bool,
        with_camera: bool,
    ) -> Result<Self, InputError> {
        let points = points_in_ego(measured, mirror);
        let lidar = LidarInput::prepare(&points, config);
        // A camera without LiDAR gets no depths from it either.
        let seen = if config.use_lidar { points.as_slice() } else { &[] };
        let camera = if config.use_camera && with_camera {
            Some(CameraInput::prepare(measured, seen, config, mirror)?)
        } else {
            None
        };
        let input = Self { lidar, camera, numeric: Vec::new() };
        input.with_states(std::slice::from_ref(&measured.ego_state), mirror)
    }

    /// Memory that the arrays take.
    #[must_use]
    pub fn n_bytes(&self) -> usize {
        let lidar = match &self.lidar {
            Some(LidarInput::Pillars(of)) => {
                size_of_val(&*of.point_features) + size_of_val(&*of.points) + size_of_val(&*of.cells)
            }
            Some(LidarInput::Voxels(of)) => size_of_val(&*of.features) + size_of_val(&*of.cells),
            None => 0,
        };
        let camera = match &self.camera {
            Some(CameraInput::Cnn(of)) => {
                size_of_val(&*of.image) + size_of_val(&*of.depth) + of.plan.n_bytes()
            }
            Some(CameraInput::Swin(of)) => size_of_val(&*of.image) + size_of_val(&*of.depths),
            None => 0,
        };
        lidar + camera
    }

    /// Height of the resized image; inputs of one batch share it. 0 without a camera.
    #[must_use]
    pub fn image_height_px(&self) -> usize {
        match &self.camera {
            Some(CameraInput::Cnn(input)) => input.image_height_px,
            Some(CameraInput::Swin(input)) => input.intrinsics.height_px as usize,
            None => 0,
        }
    }

    /// The same input at other speeds and steering angles (both given before mirroring).
    ///
    /// # Errors
    /// Speed or steering is not finite.
    pub fn with_states(mut self, states: &[EgoState], mirror: bool) -> Result<Self, InputError> {
        self.numeric = states
            .iter()
            .map(|state| {
                for (field, found) in
                    [("speed_mps", state.speed_mps), ("steering_angle_rad", state.steering_angle_rad)]
                {
                    if !found.is_finite() {
                        return Err(InputError::NotFinite { field, found });
                    }
                }
                let side = if mirror { -1.0 } else { 1.0 };
                Ok([(state.speed_mps / 10.0) as f32, (side * state.steering_angle_rad / 0.35) as f32])
            })
            .collect::<Result<_, _>>()?;
        Ok(self)
    }
}

/// x, y, z and intensity of the points in the ego frame, those alone that are finite.
pub fn points_in_ego(measured: &Measured, mirror: bool) -> Vec<[f64; 4]> {
    let side = if mirror { -1.0 } else { 1.0 };
    measured
        .points
        .iter()
        .map(|p| {
            let in_lidar = Point::new(f64::from(p.x_m), f64::from(p.y_m), f64::from(p.z_m));
            let in_ego = measured.ego_from_lidar * in_lidar;
            [in_ego.x(), side * in_ego.y(), in_ego.z(), f64::from(p.intensity)]
        })
        .filter(|p| p.iter().all(|value| value.is_finite()))
        .collect()
}

impl LidarInput {
    /// `points` are in the ego frame.
    pub fn prepare(points: &[[f64; 4]], config: &ModelConfig) -> Option<Self> {
        config.use_lidar.then(|| match config.lidar.encoder {
            LidarEncoder::Pillars => Self::Pillars(pillars(points, config)),
            LidarEncoder::Voxels => Self::Voxels(voxelize(points, &config.lidar.voxel.voxels)),
        })
    }
}

impl CameraInput {
    /// `points` are in the ego frame, and mirrored where the picture is to be.
    ///
    /// # Errors
    /// The image is broken, or not of the size that the backbone takes.
    pub fn prepare(
        measured: &Measured,
        points: &[[f64; 4]],
        config: &ModelConfig,
        mirror: bool,
    ) -> Result<Self, InputError> {
        let mut image = measured.image.decode()?;
        let mut intrinsics = measured.intrinsics;
        let mut ego_from_camera = measured.ego_from_camera;
        if mirror {
            image::imageops::flip_horizontal_in_place(&mut image);
            intrinsics.cx_px = f64::from(intrinsics.width_px) - intrinsics.cx_px;
            ego_from_camera = mirrored(&ego_from_camera);
        }
        Ok(match config.camera.backbone {
            CameraBackbone::Cnn => {
                Self::Cnn(CnnInput::prepare(&image, points, &intrinsics, &ego_from_camera, config))
            }
            CameraBackbone::Swin => Self::Swin(SwinCameraInput::prepare(
                &image,
                points.iter().map(|p| Point::new(p[0], p[1], p[2])),
                &intrinsics,
                &ego_from_camera,
                &config.camera.swin,
            )?),
        })
    }
}

/// The camera pose reflected in the ego's x-z plane; its image is flipped left to right with it.
fn mirrored(ego_from_camera: &Transform<Ego, Camera>) -> Transform<Ego, Camera> {
    let mut isometry = ego_from_camera.isometry;
    isometry.translation.y = -isometry.translation.y;
    // Reflection in y on the ego side and in x (its image) on the camera side keeps a rotation; for a
    // quaternion of a body frame that means flipping the parts about x and z, seen in ego axes.
    let reflect_ego = nalgebra::Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0, -1.0, 1.0));
    let reflect_camera = nalgebra::Matrix3::from_diagonal(&nalgebra::Vector3::new(-1.0, 1.0, 1.0));
    let rotation = reflect_ego * isometry.rotation.to_rotation_matrix().into_inner() * reflect_camera;
    isometry.rotation = nalgebra::UnitQuaternion::from_matrix(&rotation);
    Transform::from_isometry(isometry)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pinhole;
    use nalgebra::Vector3;

    fn camera() -> (Pinhole, Transform<Ego, Camera>) {
        (
            Pinhole::from_horizontal_fov(400, 225, 70f64.to_radians()),
            Transform::looking_forward(Vector3::new(1.7, 0.2, 1.5), 0.02),
        )
    }

    #[test]
    fn a_mirrored_camera_sees_a_mirrored_point_in_the_flipped_column() {
        let (pinhole, ego_from_camera) = camera();
        let flipped = mirrored(&ego_from_camera);
        let seen = pinhole.project(&(ego_from_camera.inverse() * Point::new(12.0, 3.0, 0.7))).unwrap();
        let mirror = pinhole.project(&(flipped.inverse() * Point::new(12.0, -3.0, 0.7))).unwrap();
        assert!((seen.0 + mirror.0 - 400.0).abs() < 1e-9 && (seen.1 - mirror.1).abs() < 1e-9);
    }
}
