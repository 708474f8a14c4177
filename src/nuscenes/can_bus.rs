//! Messages of the CAN bus expansion that tell speed, steering and motion.

use serde::{Deserialize, Serialize};

/// The steering wheel's angle over the road wheels': a usual car's, since nuScenes does not say that of its Renault Zoe.
pub const STEERING_RATIO: f64 = 15.2;

/// `vehicle_monitor`: 2 Hz in nuScenes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct VehicleMonitor {
    /// Microseconds.
    pub utime: u64,
    /// Kilometres an hour.
    pub vehicle_speed: f64,
    /// The steering wheel's angle in degrees, positive to the left.
    #[serde(default)]
    pub steering: f64,
    /// Degrees a second.
    #[serde(default)]
    pub yaw_rate: f64,
}

/// `steeranglefeedback`: 100 Hz in nuScenes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SteeringWheel {
    /// Microseconds.
    pub utime: u64,
    /// The steering wheel's angle in radians, positive to the left.
    pub value: f64,
}

/// `pose`: 50 Hz in nuScenes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CanPose {
    /// Microseconds.
    pub utime: u64,
    /// In the ego frame, m/s².
    pub accel: [f64; 3],
    pub orientation: [f64; 4],
    pub pos: [f64; 3],
    /// In the ego frame, rad/s.
    pub rotation_rate: [f64; 3],
    /// In the ego frame, m/s.
    pub vel: [f64; 3],
}
