//! The sensor rig as its config states it: the `[rig]` part of `gen.toml`.
//!
//! Positions are in the ego frame (origin: rear-axle centre on the ground), metres.

use serde::{Deserialize, Serialize};

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
