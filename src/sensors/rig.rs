//! The sensor rig: one front camera and one spinning LiDAR on the ego.
//!
//! Positions are in the ego frame (origin: rear-axle centre on the ground), metres.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::lidar::{Noise, Pattern};
use crate::geometry::{Camera, Ego, Lidar, Pinhole, Transform};

/// Camera and LiDAR as the config file states them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RigConfig {
    pub camera: CameraConfig,
    pub lidar: LidarConfig,
}

/// The front camera; its optical axis lies in the ego's x-z plane.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraConfig {
    /// nuScenes' front camera: 1.7 m ahead of the rear axle, 1.5 m up.
    pub x_m: f64,
    pub y_m: f64,
    pub z_m: f64,
    /// Positive looks down.
    pub pitch_deg: f64,
    pub width_px: u32,
    pub height_px: u32,
    /// From the left edge of the image to its right edge.
    pub horizontal_fov_deg: f64,
}

impl Default for CameraConfig {
    fn default() -> Self {
        Self {
            x_m: 1.7,
            y_m: 0.0,
            z_m: 1.5,
            pitch_deg: 0.0,
            width_px: 800,
            height_px: 450,
            horizontal_fov_deg: 70.0,
        }
    }
}

/// Known LiDARs, by their beams' elevations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LidarPreset {
    /// Velodyne HDL-32E: 32 beams, -30.67 to +10.67 degrees (manual; nuScenes' LiDAR).
    Hdl32e,
    /// Velodyne VLP-16: 16 beams, -15 to +15 degrees.
    Vlp16,
    /// Velodyne HDL-64E: 32 beams from -24.85 to -9.07 and 32 from -8.8 to +4.9 degrees (calibration
    /// file `64e_s2.1-sztaki`; each block evenly spaced here).
    Hdl64e,
    /// Ouster OS1-128: 128 beams, -21.82 to +20.95 degrees.
    #[serde(rename = "os1-128")]
    Os1128,
}

impl LidarPreset {
    /// Elevation of each beam in degrees, the lowest first.
    #[must_use]
    pub fn elevations_deg(self) -> Vec<f64> {
        match self {
            Self::Hdl32e => even(32, -92.0 / 3.0, 32.0 / 3.0),
            Self::Vlp16 => even(16, -15.0, 15.0),
            Self::Hdl64e => [even(32, -24.85, -9.07), even(32, -8.8, 4.9)].concat(),
            Self::Os1128 => even(128, -21.82, 20.95),
        }
    }
}

fn even(n: u32, low: f64, high: f64) -> Vec<f64> {
    (0..n).map(|i| low + (high - low) * f64::from(i) / f64::from(n - 1)).collect()
}

/// The LiDAR; its axes are parallel to the ego's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LidarConfig {
    pub preset: LidarPreset,
    /// One's own beams in place of the preset's: elevations in degrees, rising.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub elevations_deg: Vec<f64>,
    /// nuScenes' roof LiDAR: 0.94 m ahead of the rear axle, 1.84 m up.
    pub x_m: f64,
    pub y_m: f64,
    pub z_m: f64,
    /// Between two firings of a beam.
    pub azimuth_step_deg: f64,
    pub max_range_m: f64,
    /// Range at which a target of reflectivity 0.1 is still detected for sure.
    pub sure_range_m: f64,
    /// Standard deviation of each return's range.
    pub range_noise_m: f64,
    /// Standard deviation of the constant range offsets that the rings have.
    pub ring_bias_m: f64,
    /// Share of returns lost at random, in the mean of the rings.
    pub dropout: f64,
    /// How much more or less a single ring loses, as a part of `dropout`, 0 to 1.
    pub dropout_spread: f64,
    /// Loss of the reported intensity, per metre one way; CARLA's default in clear air.
    pub attenuation_per_m: f64,
}

impl Default for LidarConfig {
    fn default() -> Self {
        Self {
            preset: LidarPreset::Hdl32e,
            elevations_deg: Vec::new(),
            x_m: 0.94,
            y_m: 0.0,
            z_m: 1.84,
            azimuth_step_deg: 0.33,
            max_range_m: 70.0,
            sure_range_m: 100.0,
            range_noise_m: 0.02,
            ring_bias_m: 0.005,
            dropout: 0.02,
            dropout_spread: 0.5,
            attenuation_per_m: 0.004,
        }
    }
}

/// A value of the rig outside its range.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("the rig's {field} is {found}; {wanted} is needed")]
pub struct RigError {
    pub field: &'static str,
    pub found: f64,
    pub wanted: &'static str,
}

/// The checked rig.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    pub ego_from_camera: Transform<Ego, Camera>,
    pub intrinsics: Pinhole,
    pub ego_from_lidar: Transform<Ego, Lidar>,
    /// The rays that can land in the camera's horizontal field of view.
    pub pattern: Pattern,
    pub n_rings: usize,
    pub noise: Noise,
}

impl TryFrom<&RigConfig> for Rig {
    type Error = RigError;

    fn try_from(config: &RigConfig) -> Result<Self, RigError> {
        let RigConfig { camera, lidar } = config;
        let require = |holds: bool, field, found, wanted| {
            if holds { Ok(()) } else { Err(RigError { field, found, wanted }) }
        };
        for (field, found) in [
            ("camera.x_m", camera.x_m),
            ("camera.y_m", camera.y_m),
            ("camera.z_m", camera.z_m),
            ("camera.pitch_deg", camera.pitch_deg),
            ("lidar.x_m", lidar.x_m),
            ("lidar.y_m", lidar.y_m),
            ("lidar.z_m", lidar.z_m),
        ] {
            require(found.is_finite(), field, found, "a finite number")?;
        }
        for (field, found) in [("camera.width_px", camera.width_px), ("camera.height_px", camera.height_px)] {
            require((16..=4096).contains(&found), field, f64::from(found), "16 to 4096")?;
        }
        let fov_deg = camera.horizontal_fov_deg;
        require((10.0..=120.0).contains(&fov_deg), "camera.horizontal_fov_deg", fov_deg, "10 to 120")?;
        let step_deg = lidar.azimuth_step_deg;
        require((0.05..=5.0).contains(&step_deg), "lidar.azimuth_step_deg", step_deg, "0.05 to 5")?;
        let range_m = lidar.max_range_m;
        require((5.0..=500.0).contains(&range_m), "lidar.max_range_m", range_m, "5 to 500")?;
        let sure_m = lidar.sure_range_m;
        require((1.0..=1000.0).contains(&sure_m), "lidar.sure_range_m", sure_m, "1 to 1000")?;
        for (field, found) in
            [("lidar.range_noise_m", lidar.range_noise_m), ("lidar.ring_bias_m", lidar.ring_bias_m)]
        {
            require((0.0..=1.0).contains(&found), field, found, "0 to 1")?;
        }
        let spread = lidar.dropout_spread;
        require((0.0..=1.0).contains(&spread), "lidar.dropout_spread", spread, "0 to 1")?;
        require((0.0..1.0).contains(&lidar.dropout), "lidar.dropout", lidar.dropout, "0 to below 1")?;
        let attenuation = lidar.attenuation_per_m;
        require((0.0..=1.0).contains(&attenuation), "lidar.attenuation_per_m", attenuation, "0 to 1")?;

        let ego_from_camera = Transform::looking_forward(
            Vector3::new(camera.x_m, camera.y_m, camera.z_m),
            camera.pitch_deg.to_radians(),
        );
        let intrinsics =
            Pinhole::from_horizontal_fov(camera.width_px, camera.height_px, fov_deg.to_radians());
        let ego_from_lidar = Transform::from_xyz_yaw(lidar.x_m, lidar.y_m, lidar.z_m, 0.0);
        let camera_from_lidar = ego_from_camera.inverse() * ego_from_lidar;
        let elevations_deg = if lidar.elevations_deg.is_empty() {
            lidar.preset.elevations_deg()
        } else {
            lidar.elevations_deg.clone()
        };
        let n_rings = elevations_deg.len();
        require(n_rings <= 1024, "lidar.elevations_deg", n_rings as f64, "at most 1024 beams")?;
        for (i, &found) in elevations_deg.iter().enumerate() {
            let is_next = i == 0 || found > elevations_deg[i - 1];
            let fits = is_next && (-89.0..=89.0).contains(&found);
            require(fits, "lidar.elevations_deg", found, "rising numbers in -89 to 89")?;
        }
        let pattern =
            Pattern::spinning(&elevations_deg, step_deg).cut_to(&intrinsics, &camera_from_lidar, range_m);
        let noise = Noise {
            max_range_m: range_m,
            sure_range_m: sure_m,
            range_noise_m: lidar.range_noise_m,
            ring_bias_m: lidar.ring_bias_m,
            dropout: lidar.dropout,
            dropout_spread: spread,
            attenuation_per_m: attenuation,
        };
        Ok(Self { ego_from_camera, intrinsics, ego_from_lidar, pattern, n_rings, noise })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_rig_casts_about_seventy_degrees_of_rays() {
        let rig = Rig::try_from(&RigConfig::default()).unwrap();
        // 70 degrees / 0.33 degrees = 212 firings of 32 beams, a few less as the LiDAR sits behind the camera.
        let n_rays = rig.pattern.directions.len();
        assert!((206 * 32..=212 * 32).contains(&n_rays), "{n_rays}");
    }

    #[test]
    fn a_value_out_of_range_is_named() {
        let mut config = RigConfig::default();
        config.lidar.dropout = f64::NAN;
        assert_eq!(Rig::try_from(&config).unwrap_err().field, "lidar.dropout");
        config.lidar.dropout = 0.0;
        config.camera.width_px = 0;
        assert_eq!(Rig::try_from(&config).unwrap_err().field, "camera.width_px");
    }
}
