//! The sensor rig: one front camera and one spinning LiDAR on the ego.
//!
//! Positions are in the ego frame (origin: rear-axle centre on the ground), metres.

use nalgebra::Vector3;

use super::lidar::Pattern;
use super::rig_config::{RigConfig, RigLidarConfig};
use crate::config::{Check, InvalidConfig};
use crate::geometry::{Camera, Ego, Lidar, Pinhole, Transform};

/// The checked rig.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    pub ego_from_camera: Transform<Ego, Camera>,
    pub intrinsics: Pinhole,
    pub ego_from_lidar: Transform<Ego, Lidar>,
    /// The rays that can land in the camera's horizontal field of view.
    pub pattern: Pattern,
    pub n_rings: usize,
    /// The config, with values in their ranges.
    pub lidar: RigLidarConfig,
}

impl TryFrom<&RigConfig> for Rig {
    type Error = InvalidConfig;

    fn try_from(config: &RigConfig) -> Result<Self, InvalidConfig> {
        let RigConfig { camera, lidar } = config;
        config.check()?;
        let ego_from_camera = Transform::looking_forward(
            Vector3::new(camera.x_m, camera.y_m, camera.z_m),
            camera.pitch_deg.to_radians(),
        );
        let intrinsics = Pinhole::from_horizontal_fov(
            camera.width_px,
            camera.height_px,
            camera.horizontal_fov_deg.to_radians(),
        );
        let ego_from_lidar = Transform::from_xyz_yaw(lidar.x_m, lidar.y_m, lidar.z_m, 0.0);
        let camera_from_lidar = ego_from_camera.inverse() * ego_from_lidar;
        let elevations_deg = if lidar.elevations_deg.is_empty() {
            lidar.preset.elevations_deg()
        } else {
            lidar.elevations_deg.clone()
        };
        let n_rings = elevations_deg.len();
        let pattern = Pattern::spinning(&elevations_deg, lidar.azimuth_step_deg).cut_to(
            &intrinsics,
            &camera_from_lidar,
            lidar.max_range_m,
        );
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
        crate::config::assert_every_number_is_checked(&RigConfig::default());
        let mut config = RigConfig::default();
        config.lidar.dropout = f64::NAN;
        assert_eq!(Rig::try_from(&config).unwrap_err().key(), "lidar.dropout");
        config.lidar.dropout = 0.0;
        config.camera.width_px = 0;
        assert_eq!(Rig::try_from(&config).unwrap_err().key(), "camera.width_px");
    }
}
