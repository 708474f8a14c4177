//! Turns the car's measurements into the arrays that a network reads; no truth passes here.

use thiserror::Error;

use super::camera::{CameraGeometry, CameraInput, ImageTooFlat, NetworkImage, unpack_image};
use super::config::{CameraConfig, DropsConfig, ModelConfig};
use super::lidar::LidarInput;
use crate::geometry::Point;
use crate::sample::{EgoState, Measured};

/// One sample's inputs, ready to be batched.
#[derive(Debug, Clone, PartialEq)]
pub struct Input {
    /// `None` if the detector has no LiDAR branch.
    pub lidar: Option<LidarInput>,
    /// `None` if the detector has no camera branch.
    pub camera: Option<CameraInput>,
    /// Speed over 10 m/s and steering over 0.35 rad, for each state of the sample.
    pub numeric: Vec<[f32; 2]>,
}

/// Why a sample cannot be prepared.
#[derive(Debug, Error)]
pub enum InputError {
    #[error("the camera image cannot be unpacked: {0}")]
    Image(#[from] image::ImageError),
    #[error(transparent)]
    ImageSize(#[from] ImageTooFlat),
    #[error("{field} is {found}; a finite number is needed")]
    NotFinite { field: &'static str, found: f64 },
}

impl Input {
    /// Prepares a sample for detection. `mirror` reflects everything in the ego's x-z plane, the steering angle too, so that
    /// labels stay the same. Without `with_camera` the picture stays packed.
    ///
    /// # Errors
    /// The image is broken or too flat, or speed or steering is not finite.
    pub fn prepare(
        measured: &Measured,
        config: &ModelConfig,
        mirror: bool,
        with_camera: bool,
    ) -> Result<Self, InputError> {
        Self::prepare_by_stage(measured, config, mirror, with_camera, &mut |_| ())
    }

    /// As [`Self::prepare`]; calls `done` with the name of each stage when it ends.
    pub(super) fn prepare_by_stage(
        measured: &Measured,
        config: &ModelConfig,
        mirror: bool,
        with_camera: bool,
        done: &mut dyn FnMut(&'static str),
    ) -> Result<Self, InputError> {
        let with_camera = with_camera && config.use_camera;
        let full = with_camera.then(|| unpack_image(measured, mirror)).transpose()?;
        done("image decode");
        let image = full.map(|full| NetworkImage::resize(&full, &config.camera)).transpose()?;
        done("image resize");
        let points = points_in_ego(measured, &config.lidar.drops, false, mirror);
        done("points to ego frame");
        Self::with_points(measured, config, mirror, &points, image.as_ref(), done)
    }

    /// Unpacks a sample's picture and resizes it; with `mirror` flipped left to right.
    ///
    /// # Errors
    /// The image is broken or too flat.
    pub fn picture(
        measured: &Measured,
        mirror: bool,
        config: &CameraConfig,
    ) -> Result<NetworkImage, InputError> {
        Ok(NetworkImage::resize(&unpack_image(measured, mirror)?, config)?)
    }

    /// Prepares a sample for training, whose picture is unpacked and resized already, mirrored if the rest is; without one
    /// the camera takes no part.
    ///
    /// # Errors
    /// Speed or steering is not finite.
    pub fn prepare_with(
        measured: &Measured,
        config: &ModelConfig,
        mirror: bool,
        image: Option<&NetworkImage>,
    ) -> Result<Self, InputError> {
        let points = points_in_ego(measured, &config.lidar.drops, true, mirror);
        Self::with_points(measured, config, mirror, &points, image, &mut |_| ())
    }

    /// Prepares a sample of which these points are seen, in the ego frame and mirrored if the rest is.
    fn with_points(
        measured: &Measured,
        config: &ModelConfig,
        mirror: bool,
        points: &[[f64; 4]],
        image: Option<&NetworkImage>,
        done: &mut dyn FnMut(&'static str),
    ) -> Result<Self, InputError> {
        let lidar = config.use_lidar.then(|| LidarInput::prepare(points, config));
        done("voxelization");
        // A camera without LiDAR gets no depths from it either.
        let seen = if config.use_lidar { points } else { &[] };
        let view = CameraGeometry::of(measured, mirror);
        let camera = image.map(|image| CameraInput::prepare(image, &view, seen, lidar.as_ref(), config));
        done("depths and frustum");
        let input = Self { lidar, camera, numeric: Vec::new() };
        input.with_states(std::slice::from_ref(&measured.ego_state), mirror)
    }

    /// Memory that the arrays take.
    #[must_use]
    pub fn n_bytes(&self) -> usize {
        self.lidar.as_ref().map_or(0, LidarInput::n_bytes)
            + self.camera.as_ref().map_or(0, CameraInput::n_bytes)
    }

    /// Height of the resized image; inputs of one batch share it. 0 without a camera.
    #[must_use]
    pub fn image_height_px(&self) -> usize {
        self.camera.as_ref().map_or(0, CameraInput::image_height_px)
    }

    /// The same input at other speeds and steering angles (both given before mirroring).
    ///
    /// # Errors
    /// Speed or steering is not finite.
    pub fn with_states(mut self, states: &[EgoState], mirror: bool) -> Result<Self, InputError> {
        let side = if mirror { -1.0 } else { 1.0 };
        let scale = |state: &EgoState| {
            let fields = [("speed_mps", state.speed_mps), ("steering_angle_rad", state.steering_angle_rad)];
            match fields.into_iter().find(|(_, found)| !found.is_finite()) {
                Some((field, found)) => Err(InputError::NotFinite { field, found }),
                None => {
                    Ok([(state.speed_mps / 10.0) as f32, (side * state.steering_angle_rad / 0.35) as f32])
                }
            }
        };
        self.numeric = states.iter().map(scale).collect::<Result<_, _>>()?;
        Ok(self)
    }
}

/// x, y, z and intensity of the points in the ego frame; drops are left out where the config says so, and points that are not
/// finite.
fn points_in_ego(measured: &Measured, drops: &DropsConfig, in_training: bool, mirror: bool) -> Vec<[f64; 4]> {
    let side = if mirror { -1.0 } else { 1.0 };
    let are_drops = drops.left_out.applies(in_training).then(|| drops.among(&measured.points));
    let is_seen = |i: usize| are_drops.as_ref().is_none_or(|are_drops| !are_drops[i]);
    measured
        .points
        .iter()
        .enumerate()
        .filter(|&(i, _)| is_seen(i))
        .map(|(_, p)| {
            let in_lidar = Point::new(f64::from(p.x_m), f64::from(p.y_m), f64::from(p.z_m));
            let in_ego = measured.ego_from_lidar * in_lidar;
            [in_ego.x(), side * in_ego.y(), in_ego.z(), f64::from(p.intensity)]
        })
        .filter(|p| p.iter().all(|value| value.is_finite()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::config::DropsLeftOut;
    use super::*;
    use crate::dataset::test_data;
    use crate::sample::LidarPoint;

    #[test]
    fn drops_are_left_out_where_the_config_says_so() {
        let mut measured = test_data::dataset(1).samples()[0].measured.clone();
        let drop = LidarPoint { x_m: 3.0, y_m: 0.0, z_m: 0.5, intensity: 0.0, ring: 0 };
        measured.points.retain(|p| p.x_m.hypot(p.y_m) > 5.0);
        let n_others = measured.points.len();
        measured.points.push(drop);
        for (left_out, n_drops) in [
            (DropsLeftOut::Never, [1, 1]),
            (DropsLeftOut::InDetection, [0, 1]),
            (DropsLeftOut::Always, [0, 0]),
        ] {
            let drops = DropsConfig { left_out, ..DropsConfig::default() };
            let n_seen = |in_training| points_in_ego(&measured, &drops, in_training, false).len();
            assert_eq!([n_seen(false), n_seen(true)], n_drops.map(|n| n_others + n), "{left_out:?}");
            // Both ways into the network.
            let mut config = ModelConfig { use_camera: false, ..ModelConfig::default() };
            config.lidar.drops = drops;
            let detected = Input::prepare(&measured, &config, false, false).unwrap();
            let trained = Input::prepare_with(&measured, &config, false, None).unwrap();
            assert_eq!(detected.lidar == trained.lidar, n_drops[0] == n_drops[1], "{left_out:?}");
        }
    }
}
