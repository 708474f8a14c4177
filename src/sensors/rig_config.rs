//! The sensor rig as its config states it: the `[rig]` part of `gen.toml`.
//!
//! Positions are in the ego frame (origin: rear-axle centre on the ground), metres.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::config::{
    Check, InvalidConfig, Rule, SHARE, above, below, define_config, from_to, part, parts, require,
};
use crate::geometry::{Camera, Frame, Lidar};

define_config! {
    /// Cameras (`cam_..`) and LiDARs (`lidar_..`) by name; topics and frames are named after them. `cam_front` and
    /// `lidar_top` are what a network reads.
    pub struct RigConfig {
        /// By name.
        cameras: BTreeMap<String, RigCameraConfig> = one(Camera::NAME), in parts::<RigCameraConfig>();
        /// By name.
        lidars: BTreeMap<String, RigLidarConfig> = one(Lidar::NAME), in parts::<RigLidarConfig>();
        odometry: OdometryConfig = OdometryConfig::default(), in part::<OdometryConfig>();
    }
}

fn one<T: Default>(name: &str) -> BTreeMap<String, T> {
    [(name.to_owned(), T::default())].into()
}

define_config! {
    /// A camera; at angles of zero its optical axis points along the ego's x axis.
    pub struct RigCameraConfig {
        /// nuScenes' front camera: 1.7 m ahead of the rear axle, 1.5 m up.
        x_m: f64 = 1.7, in PLACE;
        /// Left of the rear axle's middle.
        y_m: f64 = 0.0, in PLACE;
        /// Above the ground.
        z_m: f64 = 1.5, in PLACE;
        /// Positive looks to the left.
        yaw_deg: f64 = 0.0, in TURN;
        /// Positive looks down.
        pitch_deg: f64 = 0.0, in TILT;
        /// Positive lowers the right side.
        roll_deg: f64 = 0.0, in TURN;
        /// Width of the picture.
        width_px: u32 = 800, in from_to(16.0, 4096.0);
        /// Height of the picture.
        height_px: u32 = 450, in from_to(16.0, 4096.0);
        /// Angle from the left edge of the image to its right edge.
        horizontal_fov_deg: f64 = 70.0, in from_to(10.0, 170.0);
        /// Steps of light more (above zero) or less than a well exposed picture.
        exposure_ev: f64 = 0.0, in from_to(-4.0, 4.0);
        /// Standard deviation of the lens's blur.
        blur_px: f64 = 0.0, in from_to(0.0, 3.0);
        /// 1 to 100 in place of `render.jpeg_quality`.
        #[serde(skip_serializing_if = "Option::is_none")]
        jpeg_quality: Option<u8> = None, in from_to(1.0, 100.0);
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
    pub fn elevations_deg(self) -> Vec<f64> {
        match self {
            Self::Hdl32e => even(32, -92.0 / 3.0, 32.0 / 3.0),
            Self::Vlp16 => even(16, -15.0, 15.0),
            Self::Hdl64e => [even(32, -24.85, -9.07), even(32, -8.8, 4.9)].concat(),
            Self::Os1128 => even(128, -21.82, 20.95),
        }
    }
}

impl LidarPreset {
    /// Angle between two firings at the turns a second that data sets use: 20 for the HDL-32E, 10 for the others.
    pub fn azimuth_step_deg(self) -> f64 {
        match self {
            Self::Hdl32e => 0.33,
            Self::Vlp16 => 0.2,
            Self::Hdl64e => 0.18,
            Self::Os1128 => 0.35,
        }
    }
}

impl RigLidarConfig {
    /// Dead beams are beams that it has, and one is alive.
    fn check_beams(&self, key: &str) -> Result<(), InvalidConfig> {
        let (n, lost) = (self.n_beams(), &self.lost_beams);
        let is_some_alive = lost.len() < n && lost.iter().all(|&beam| usize::from(beam) < n);
        let wanted = format!("numbers of its {n} beams, 0 to {}, but not of all are needed", n - 1);
        require(is_some_alive, &format!("{key}.lost_beams"), format!("{lost:?}"), wanted)
    }

    /// How many beams it has, dead ones included.
    #[must_use]
    pub fn n_beams(&self) -> usize {
        if self.elevations_deg.is_empty() {
            self.preset.elevations_deg().len()
        } else {
            self.elevations_deg.len()
        }
    }
}

fn even(n: u32, low: f64, high: f64) -> Vec<f64> {
    (0..n).map(|i| low + (high - low) * f64::from(i) / f64::from(n - 1)).collect()
}

/// Which part of its turn a LiDAR reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LidarSector {
    /// What lies between the left and the right edge of the front camera's picture.
    #[default]
    Camera,
    /// All of it.
    Full,
}

define_config! {
    /// A LiDAR; at angles of zero its axes are parallel to the ego's.
    pub struct RigLidarConfig {
        /// Whose beams, intensity and turn it has.
        preset: LidarPreset = LidarPreset::Hdl32e;
        /// Beams in place of the preset's: elevations in degrees, rising.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        elevations_deg: Vec<f64> = Vec::new(), in from_to(-89.0, 89.0).rising(0, 1024);
        /// nuScenes' roof LiDAR: 0.94 m ahead of the rear axle, 1.84 m up.
        x_m: f64 = 0.94, in PLACE;
        /// Left of the rear axle's middle.
        y_m: f64 = 0.0, in PLACE;
        /// Above the ground.
        z_m: f64 = 1.84, in PLACE;
        /// Positive turns to the left.
        yaw_deg: f64 = 0.0, in TURN;
        /// Positive tilts the front down.
        pitch_deg: f64 = 0.0, in TILT;
        /// Positive lowers the right side.
        roll_deg: f64 = 0.0, in TURN;
        /// Which part of its turn it reports.
        sector: LidarSector = LidarSector::Camera;
        /// Angle between two firings of a beam.
        azimuth_step_deg: f64 = 0.33, in from_to(0.05, 5.0);
        /// Nothing farther than this returns.
        max_range_m: f64 = 70.0, in from_to(5.0, 500.0);
        /// Range at which a target of reflectivity 0.1 is still detected for sure.
        sure_range_m: f64 = 100.0, in from_to(1.0, 1000.0);
        /// Standard deviation of each return's range.
        range_noise_m: f64 = 0.02, in from_to(0.0, 1.0);
        /// Standard deviation of the constant range offsets that the rings have.
        ring_bias_m: f64 = 0.005, in from_to(0.0, 1.0);
        /// Share of returns lost at random, in the mean of the rings.
        dropout: f64 = 0.02, in below(0.0, 1.0);
        /// How much more or less a single ring loses, as a part of `dropout`, 0 to 1.
        dropout_spread: f64 = 0.5, in SHARE;
        /// Loss of the reported intensity, per metre one way; CARLA's default in clear air.
        attenuation_per_m: f64 = 0.004, in from_to(0.0, 1.0);
        /// Beams that are dead, 0 the lowest.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        lost_beams: Vec<u16> = Vec::new(), in from_to(0.0, 1023.0).rising(0, 1023);
        /// Share of the beams on windows that return.
        glass_return: f64 = 0.2, in SHARE;
        intensity: IntensityConfig = IntensityConfig::default(), in part::<IntensityConfig>();
    }
}

define_config! {
    /// What bends the intensity curve of a LiDAR's make.
    pub struct IntensityConfig {
        /// Factor on the strength of each return.
        scale: f64 = 1.0, in above(0.0, 10.0);
        /// Exponent of the strength, 1 being full scale.
        gamma: f64 = 1.0, in from_to(0.1, 4.0);
        /// Values that are told apart, 0 and full scale among them; 0: as the make has them.
        steps: u32 = 0, in from_to(0.0, 65536.0);
        /// Nearer than this the intensity falls with the range, as the receiver sees only part of the spot, metres.
        near_m: f64 = 0.0, in from_to(0.0, 50.0);
        /// How much rings and shots differ, as a part of what they do in the make.
        spread: f64 = 1.0, in from_to(0.0, 5.0);
    }
}

define_config! {
    /// What the car's own sensors tell of speed and steering; at the defaults, the truth.
    pub struct OdometryConfig {
        /// Measured speed over true speed: a tyre's size.
        speed_factor: f64 = 1.0, in from_to(0.5, 2.0);
        /// Standard deviation of each measurement.
        speed_noise_mps: f64 = 0.0, in from_to(0.0, 5.0);
        /// What the steering sensor tells beside the true road-wheel angle, positive to the left.
        steering_bias_deg: f64 = 0.0, in from_to(-20.0, 20.0);
        /// Standard deviation of each measurement.
        steering_noise_deg: f64 = 0.0, in from_to(0.0, 20.0);
    }
}

impl Check for RigConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        let Self { cameras, lidars, .. } = self;
        let list = |names: Vec<&String>| format!("{names:?}");
        let has_front = cameras.contains_key(Camera::NAME);
        require(has_front, "cameras", list(cameras.keys().collect()), "one named cam_front is needed")?;
        let has_top = lidars.contains_key(Lidar::NAME);
        require(has_top, "lidars", list(lidars.keys().collect()), "one named lidar_top is needed")?;
        let cameras_named = cameras.keys().map(|name| ("cameras", "cam_", name));
        for (of, start, name) in cameras_named.chain(lidars.keys().map(|name| ("lidars", "lidar_", name))) {
            let is_name = name.len() > start.len()
                && name.starts_with(start)
                && name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_');
            let wanted = format!("{start} and then lower case letters, digits and _ are needed");
            require(is_name, &format!("{of}.{name}"), format!("named `{name}`"), wanted)?;
        }
        let front = &cameras[Camera::NAME];
        let [yaw, pitch, roll] = [front.yaw_deg, front.pitch_deg, front.roll_deg].map(f64::to_radians);
        // As a reader wants them: within 60 degrees of straight ahead, and upright.
        let (ahead, up) = (yaw.cos() * pitch.cos(), pitch.cos() * roll.cos());
        require(
            ahead >= 0.5 && up >= 0.5,
            "cameras.cam_front",
            format!("turned by {} and {} and rolled by {}", front.yaw_deg, front.pitch_deg, front.roll_deg),
            "a front camera that looks ahead, upright, within 60 degrees is needed",
        )?;
        let top = &lidars[Lidar::NAME];
        let up = top.pitch_deg.to_radians().cos() * top.roll_deg.to_radians().cos();
        let found = format!("tilted by {} and rolled by {}", top.pitch_deg, top.roll_deg);
        require(up >= 0.5, "lidars.lidar_top", found, "at most 60 degrees from upright are needed")?;
        lidars.iter().try_for_each(|(name, lidar)| lidar.check_beams(&format!("lidars.{name}")))
    }
}

/// Bounds of a sensor's place, metres.
const PLACE: Rule = from_to(-100.0, 100.0);
/// Bounds of a turn, degrees.
const TURN: Rule = from_to(-180.0, 180.0);
/// Bounds of a tilt, degrees.
const TILT: Rule = from_to(-90.0, 90.0);
