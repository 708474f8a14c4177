//! Speed, steering, yaw rate and acceleration from the CAN bus expansion, where a scene has it.

use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

use crate::files;
use crate::files::inside;
use crate::geometry::{Ego, Transform, World};
use crate::import::{ImportError, Odometry, Series, error};
use crate::nuscenes::{CanPose, SteeringWheel, VehicleMonitor};

const NS_PER_US: u64 = 1000;
/// The speed that `vehicle_monitor` tells has no sign: the car drives backwards where its poses move back by more, m/s.
const BACKWARDS_MPS: f64 = 0.3;
/// Poses this far around a message tell the direction, nanoseconds.
const REACH_NS: u64 = 250_000_000;

/// Adds what the CAN bus of a scene measured.
///
/// # Errors
/// A file is not valid or holds a number that is not finite, or the scene's name leads out of the folder.
pub(super) fn add(
    odometry: &mut Odometry,
    root: &Path,
    scene: &str,
    steering_ratio: f64,
) -> Result<(), ImportError> {
    let monitor: Vec<VehicleMonitor> = messages(root, scene, "vehicle_monitor")?;
    let wheel: Vec<SteeringWheel> = messages(root, scene, "steeranglefeedback")?;
    let poses: Vec<CanPose> = messages(root, scene, "pose")?;
    let has_sign = monitor.iter().any(|message| message.vehicle_speed < 0.0);
    let speed = |message: &VehicleMonitor| {
        let time_ns = message.utime.saturating_mul(NS_PER_US);
        let is_back =
            !has_sign && forward_mps(&odometry.poses, time_ns).is_some_and(|mps| mps < -BACKWARDS_MPS);
        (time_ns, message.vehicle_speed / 3.6 * if is_back { -1.0 } else { 1.0 })
    };
    let speeds = monitor.iter().map(speed).collect();
    let wheels =
        wheel.iter().map(|message| (message.utime.saturating_mul(NS_PER_US), message.value / steering_ratio));
    let steering = format!("the steering wheel's angle of the CAN bus over {steering_ratio}");
    odometry.steering_angle_rad = series(&steering, wheels.collect(), root, scene)?;
    odometry.speed_mps = series("the CAN bus's vehicle_monitor", speeds, root, scene)?;
    let rates =
        poses.iter().map(|message| (message.utime.saturating_mul(NS_PER_US), message.rotation_rate[2]));
    odometry.yaw_rate_rps = series("the CAN bus's pose", rates.collect(), root, scene)?;
    let pushes = poses.iter().map(|message| (message.utime.saturating_mul(NS_PER_US), message.accel[0]));
    odometry.acceleration_mps2 = series("the CAN bus's pose", pushes.collect(), root, scene)?;
    Ok(())
}

fn file_of(root: &Path, scene: &str, message: &str) -> Result<PathBuf, ImportError> {
    let folder = root.join("can_bus");
    inside(&folder, &format!("{scene}_{message}.json"))
        .map_err(|error| ImportError::at(&folder, format!("scene `{scene}`: {error}")))
}

/// The messages of a scene; none where there is no file.
fn messages<T: DeserializeOwned>(root: &Path, scene: &str, message: &str) -> Result<Vec<T>, ImportError> {
    let path = file_of(root, scene, message)?;
    if !files::is_there(&path)? {
        return Ok(Vec::new());
    }
    let bytes = error::read(&path)?;
    serde_json::from_slice(&bytes)
        .map_err(|error| ImportError::at(&path, format!("the messages `{message}` are not valid: {error}")))
}

/// Values in order of time, each time once; `None` if there are none.
fn series(
    source: &str,
    mut values: Vec<(u64, f64)>,
    root: &Path,
    scene: &str,
) -> Result<Option<Series>, ImportError> {
    if let Some((time_ns, value)) = values.iter().find(|(_, value)| !value.is_finite()) {
        let message = format!("{source} says {value} at {time_ns} ns; a finite number is needed");
        return Err(ImportError::at(&root.join("can_bus").join(scene), message));
    }
    values.sort_by_key(|(time_ns, _)| *time_ns);
    values.dedup_by_key(|(time_ns, _)| *time_ns);
    Ok((!values.is_empty()).then(|| Series { source: source.to_owned(), values }))
}

/// The speed along the ego's x axis by the poses around a time; `None` without poses there.
fn forward_mps(poses: &[(u64, Transform<World, Ego>)], time_ns: u64) -> Option<f64> {
    let begin = poses.partition_point(|(at_ns, _)| at_ns.saturating_add(REACH_NS) < time_ns);
    let end = poses.partition_point(|(at_ns, _)| *at_ns <= time_ns.saturating_add(REACH_NS));
    let [(first_ns, first), .., (last_ns, last)] = poses.get(begin..end)? else { return None };
    let moved = (first.inverse() * *last).isometry.translation.vector;
    Some(moved.x / ((last_ns - first_ns) as f64 * 1e-9))
}

#[cfg(test)]
mod tests {
    use fs_err as fs;

    use super::*;

    #[test]
    fn speed_gets_its_sign_from_the_poses_and_the_wheel_is_divided() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("can_bus")).unwrap();
        let write = |message: &str, text: &str| {
            fs::write(file_of(folder.path(), "scene-0001", message).unwrap(), text).unwrap();
        };
        write("vehicle_monitor", r#"[{"utime": 1000000, "vehicle_speed": 7.2, "steering": 3, "brake": 0}]"#);
        write("steeranglefeedback", r#"[{"utime": 1000000, "value": 1.52}]"#);
        let at = |ms: u64, x: f64| (ms * 1_000_000, Transform::from_xyz_yaw(x, 0.0, 0.0, 0.0));
        let mut odometry =
            Odometry { poses: vec![at(900, 1.0), at(1000, 0.8), at(1100, 0.6)], ..Odometry::default() };
        add(&mut odometry, folder.path(), "scene-0001", 15.2).unwrap();
        assert_eq!(odometry.speed_mps.as_ref().unwrap().values, [(1_000_000_000, -2.0)]);
        assert!((odometry.steering_angle_rad.as_ref().unwrap().values[0].1 - 0.1).abs() < 1e-12);
        assert_eq!(odometry.yaw_rate_rps, None);
        write("steeranglefeedback", r#"[{"utime": 1000000}]"#);
        let told = add(&mut odometry, folder.path(), "scene-0001", 15.2).unwrap_err().to_string();
        assert!(told.contains("steeranglefeedback") && told.contains("value"), "{told}");
    }

    #[test]
    fn a_scene_whose_name_leads_out_of_the_folder_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("can_bus")).unwrap();
        fs::write(folder.path().join("own_pose.json"), "[]").unwrap();
        let absolute = folder.path().join("own").display().to_string();
        for scene in ["../own", "a/../../own", &absolute] {
            let told = add(&mut Odometry::default(), folder.path(), scene, 15.2).unwrap_err().to_string();
            assert!(told.contains(scene) && told.contains("without `..`"), "{told}");
        }
    }
}
