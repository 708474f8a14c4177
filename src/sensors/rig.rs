//! The sensor rig: one front camera and one spinning LiDAR on the ego.
//!
//! Positions are in the ego frame (origin: rear-axle centre on the ground), metres.

use nalgebra::Vector3;
use thiserror::Error;

use super::lidar::Pattern;
use super::rig_config::{LidarConfig, RigConfig};
use crate::geometry::{Camera, Ego, Lidar, Pinhole, Transform};

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
    /// With values in their ranges.
    pub lidar: LidarConfig,
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
        Ok(Self { ego_from_camera, intrinsics, ego_from_lidar, pattern, n_rings, lidar: lidar.clone() })
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
