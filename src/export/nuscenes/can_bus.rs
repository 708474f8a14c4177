//! The CAN bus expansion of a scene: speed, steering wheel, pose, at the samples' times.

use std::collections::BTreeMap;
use std::io;

use serde::Serialize;
use serde_json::json;

use crate::files::NewFolder;
use crate::geometry::{Ego, Transform, World};
use crate::nuscenes::{CanPose, STEERING_RATIO, SteeringWheel, VehicleMonitor, rotation_of, translation_of};
use crate::sample::EgoState;

/// The messages of one scene.
#[derive(Debug, Default)]
pub(super) struct CanMessages {
    vehicle_monitor: Vec<VehicleMonitor>,
    steering_wheel: Vec<SteeringWheel>,
    pose: Vec<CanPose>,
}

impl CanMessages {
    /// Adds a sample's state.
    pub(super) fn add(&mut self, utime: u64, state: &EgoState, global_from_ego: &Transform<World, Ego>) {
        let wheel_rad = state.steering_angle_rad * STEERING_RATIO;
        self.vehicle_monitor.push(VehicleMonitor {
            utime,
            vehicle_speed: state.speed_mps * 3.6,
            steering: wheel_rad.to_degrees(),
            yaw_rate: state.yaw_rate_rps.to_degrees(),
        });
        self.steering_wheel.push(SteeringWheel { utime, value: wheel_rad });
        self.pose.push(CanPose {
            utime,
            accel: [state.acceleration_mps2, 0.0, 0.0],
            orientation: rotation_of(&global_from_ego.isometry),
            pos: translation_of(&global_from_ego.isometry),
            rotation_rate: [0.0, 0.0, state.yaw_rate_rps],
            vel: [state.speed_mps, 0.0, 0.0],
        });
    }

    /// Writes `can_bus/<scene>_<message>.json` and `can_bus/<scene>_meta.json`.
    pub(super) fn write(&self, folder: &NewFolder, scene: &str) -> io::Result<()> {
        let speeds = self.vehicle_monitor.iter().map(|message| message.vehicle_speed);
        let wheels = self.steering_wheel.iter().map(|message| message.value);
        let rates = self.pose.iter().map(|message| message.rotation_rate[2]);
        let times: Vec<u64> = self.pose.iter().map(|message| message.utime).collect();
        let meta = json!({
            "vehicle_monitor": facts(&times, "vehicle_speed", speeds),
            "steeranglefeedback": facts(&times, "value", wheels),
            "pose": facts(&times, "rotation_rate_z", rates),
        });
        let write = |message: &str, value: &dyn Fn() -> serde_json::Result<Vec<u8>>| {
            folder.write(&format!("can_bus/{scene}_{message}.json"), &value()?)
        };
        write("vehicle_monitor", &|| list(&self.vehicle_monitor))?;
        write("steeranglefeedback", &|| list(&self.steering_wheel))?;
        write("pose", &|| list(&self.pose))?;
        write("meta", &|| serde_json::to_vec(&meta))
    }
}

fn list<T: Serialize>(messages: &[T]) -> serde_json::Result<Vec<u8>> {
    serde_json::to_vec(messages)
}

/// What `meta` says of a message: how many, how often, and one value's range.
fn facts(times: &[u64], name: &str, values: impl Iterator<Item = f64>) -> serde_json::Value {
    let values: Vec<f64> = values.collect();
    let n = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / n;
    let span_s = times.last().zip(times.first()).map_or(0.0, |(last, first)| (last - first) as f64 * 1e-6);
    let rate_hz = if span_s > 0.0 { (values.len() - 1) as f64 / span_s } else { 0.0 };
    let stats: BTreeMap<&str, f64> = [
        ("max", values.iter().copied().fold(f64::MIN, f64::max)),
        ("mean", mean),
        ("min", values.iter().copied().fold(f64::MAX, f64::min)),
        ("std", variance.sqrt()),
    ]
    .into();
    json!({
        "message_count": values.len(), "message_freq": rate_hz, "timespan": span_s, "var_stats": {name: stats}
    })
}
