//! The sensor rig: cameras and spinning LiDARs on the ego, the front camera and the top LiDAR first.
//!
//! Positions are in the ego frame (origin: rear-axle centre on the ground), metres.

use std::collections::BTreeMap;

use nalgebra::{UnitQuaternion, Vector3};
use rand::RngExt;

use super::lidar::Pattern;
use super::rig_config::{LidarSector, OdometryConfig, RigCameraConfig, RigConfig, RigLidarConfig};
use crate::config::{Check, InvalidConfig};
use crate::geometry::{Camera, Ego, Frame, Lidar, Pinhole, Transform};
use crate::random;

/// The checked rig.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    /// `cam_front` first, then by name.
    pub cameras: Vec<RigCamera>,
    /// `lidar_top` first, then by name.
    pub lidars: Vec<RigLidar>,
    pub odometry: OdometryConfig,
}

/// A camera of the rig.
#[derive(Debug, Clone, PartialEq)]
pub struct RigCamera {
    pub name: String,
    pub ego_from_camera: Transform<Ego, Camera>,
    pub intrinsics: Pinhole,
    /// The config, with values in their ranges.
    pub config: RigCameraConfig,
}

/// A LiDAR of the rig.
#[derive(Debug, Clone, PartialEq)]
pub struct RigLidar {
    pub name: String,
    pub ego_from_lidar: Transform<Ego, Lidar>,
    /// The rays of its sector.
    pub pattern: Pattern,
    pub n_rings: usize,
    /// The config, with values in their ranges.
    pub config: RigLidarConfig,
}

impl RigLidar {
    /// Whether it reports its whole turn.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.config.sector == LidarSector::Full
    }
}

impl RigCamera {
    /// The seed of its own noise in an episode: the episode's for the front camera.
    #[must_use]
    pub fn seed(&self, episode_seed: u64) -> u64 {
        own_seed(episode_seed, &self.name, Camera::NAME)
    }
}

impl RigLidar {
    /// The seed of its own noise in an episode: the episode's for the top LiDAR.
    #[must_use]
    pub fn seed(&self, episode_seed: u64) -> u64 {
        own_seed(episode_seed, &self.name, Lidar::NAME)
    }
}

fn own_seed(episode_seed: u64, name: &str, first: &str) -> u64 {
    if name == first { episode_seed } else { random::stream(episode_seed, name, 0).random() }
}

impl Rig {
    /// The camera that a network reads.
    #[must_use]
    pub fn front(&self) -> &RigCamera {
        &self.cameras[0]
    }

    /// The LiDAR that a network reads.
    #[must_use]
    pub fn top(&self) -> &RigLidar {
        &self.lidars[0]
    }
}

impl TryFrom<&RigConfig> for Rig {
    type Error = InvalidConfig;

    fn try_from(config: &RigConfig) -> Result<Self, InvalidConfig> {
        config.check()?;
        let cameras: Vec<RigCamera> = with_first(&config.cameras, Camera::NAME).map(camera).collect();
        let lidars = with_first(&config.lidars, Lidar::NAME).map(|of| lidar(of, &cameras[0])).collect();
        Ok(Self { cameras, lidars, odometry: config.odometry.clone() })
    }
}

/// The entries of a map by name, but this one first.
fn with_first<'a, T>(
    of: &'a BTreeMap<String, T>,
    first: &'a str,
) -> impl Iterator<Item = (&'a String, &'a T)> {
    of.get_key_value(first).into_iter().chain(of.iter().filter(move |(name, _)| *name != first))
}

fn camera((name, config): (&String, &RigCameraConfig)) -> RigCamera {
    let [yaw_rad, pitch_rad, roll_rad] =
        [config.yaw_deg, config.pitch_deg, config.roll_deg].map(f64::to_radians);
    let position_m = Vector3::new(config.x_m, config.y_m, config.z_m);
    let fov_rad = config.horizontal_fov_deg.to_radians();
    RigCamera {
        name: name.clone(),
        ego_from_camera: Transform::looking_along(position_m, yaw_rad, pitch_rad, roll_rad),
        intrinsics: Pinhole::from_horizontal_fov(config.width_px, config.height_px, fov_rad),
        config: config.clone(),
    }
}

fn lidar((name, config): (&String, &RigLidarConfig), front: &RigCamera) -> RigLidar {
    let [yaw_rad, pitch_rad, roll_rad] =
        [config.yaw_deg, config.pitch_deg, config.roll_deg].map(f64::to_radians);
    let turn = UnitQuaternion::from_euler_angles(roll_rad, pitch_rad, yaw_rad);
    let ego_from_lidar = Transform::new(Vector3::new(config.x_m, config.y_m, config.z_m), turn);
    let elevations_deg = if config.elevations_deg.is_empty() {
        config.preset.elevations_deg()
    } else {
        config.elevations_deg.clone()
    };
    let n_rings = elevations_deg.len();
    let whole = Pattern::spinning(&elevations_deg, config.azimuth_step_deg).without(&config.lost_beams);
    let pattern = match config.sector {
        LidarSector::Full => whole,
        LidarSector::Camera => {
            let camera_from_lidar = front.ego_from_camera.inverse() * ego_from_lidar;
            whole.cut_to(&front.intrinsics, &camera_from_lidar, config.max_range_m)
        }
    };
    RigLidar { name: name.clone(), ego_from_lidar, pattern, n_rings, config: config.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn top(config: &mut RigConfig) -> &mut RigLidarConfig {
        config.lidars.get_mut("lidar_top").unwrap()
    }

    fn front(config: &mut RigConfig) -> &mut RigCameraConfig {
        config.cameras.get_mut("cam_front").unwrap()
    }

    #[test]
    fn the_default_rig_casts_about_seventy_degrees_of_rays() {
        let rig = Rig::try_from(&RigConfig::default()).unwrap();
        // 70 degrees / 0.33 degrees = 212 firings of 32 beams, a few less as the LiDAR sits behind the camera.
        let n_rays = rig.top().pattern.directions.len();
        assert!((206 * 32..=212 * 32).contains(&n_rays), "{n_rays}");
    }

    #[test]
    fn a_full_turn_holds_the_rays_of_the_sector() {
        let mut config = RigConfig::default();
        let sector = Rig::try_from(&config).unwrap().top().pattern.directions.clone();
        top(&mut config).sector = LidarSector::Full;
        let whole = Rig::try_from(&config).unwrap().top().pattern.directions.clone();
        assert_eq!(whole.len(), 1091 * 32);
        assert!(sector.iter().all(|ray| whole.contains(ray)));
    }

    #[test]
    fn a_value_out_of_range_is_named() {
        crate::config::assert_every_number_is_checked(&RigConfig::default());
        let mut config = RigConfig::default();
        top(&mut config).dropout = f64::NAN;
        assert_eq!(Rig::try_from(&config).unwrap_err().key(), "lidars.lidar_top.dropout");
        top(&mut config).dropout = 0.0;
        front(&mut config).horizontal_fov_deg = 171.0;
        assert_eq!(Rig::try_from(&config).unwrap_err().key(), "cameras.cam_front.horizontal_fov_deg");
    }

    fn refusal(text: &str) -> String {
        match toml::from_str::<RigConfig>(text) {
            Ok(config) => Rig::try_from(&config).unwrap_err().to_string(),
            Err(error) => error.to_string(),
        }
    }

    #[test]
    fn a_rig_that_no_reader_could_use_is_refused_and_says_why() {
        let cases = [
            (
                "[camera]\nwidth_px = 640",
                "unknown field `camera`, expected one of `cameras`, `lidars`, `odometry`",
            ),
            ("[cameras]", "cameras is []; one named cam_front is needed"),
            ("[cameras.cam_back]", "[\"cam_back\"]; one named cam_front is needed"),
            ("[lidars.lidar_left]", "one named lidar_top is needed"),
            ("[cameras.cam_front]\n[cameras.cam_front]", "duplicate key"),
            (
                "[cameras.cam_front]\n[cameras.lidar_top]",
                "cameras.lidar_top is named `lidar_top`; cam_ and then",
            ),
            (
                "[cameras.cam_front]\n[cameras.\"cam_/back\"]",
                "named `cam_/back`; cam_ and then lower case letters",
            ),
            ("[lidars.lidar_top]\n[lidars.lidar_]", "lidars.lidar_ is named `lidar_`; lidar_ and then"),
            ("[cameras.cam_front]\nyaw_deg = 180", "a front camera that looks ahead"),
            ("[lidars.lidar_top]\nroll_deg = 90", "at most 60 degrees from upright"),
            ("[lidars.lidar_top]\nsector = \"half\"", "expected `camera` or `full`"),
        ];
        for (text, wanted) in cases {
            let found = refusal(text);
            assert!(found.contains(wanted), "{text}: {found}");
        }
    }

    #[test]
    fn a_camera_turned_to_the_left_looks_along_the_egos_y_axis() {
        let mut config = RigConfig::default();
        let left = RigCameraConfig { yaw_deg: 90.0, ..RigCameraConfig::default() };
        config.cameras.insert("cam_left".into(), left);
        let rig = Rig::try_from(&config).unwrap();
        assert_eq!(rig.cameras[1].name, "cam_left");
        let axis = rig.cameras[1].ego_from_camera.rotate(&Vector3::z());
        assert!((axis - Vector3::y()).norm() < 1e-12, "{axis}");
        let down = rig.cameras[1].ego_from_camera.rotate(&Vector3::y());
        assert!((down + Vector3::z()).norm() < 1e-12, "{down}");
    }
}
