//! What `harmzone export kitti` keeps beside KITTI's own files: the ego's state, pose and mounting of a frame, and its rings.

use std::path::Path;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};
use serde::Deserialize;

use crate::files;
use crate::geometry::Transform;
use crate::import::error::{read, read_text};
use crate::import::{ImportError, Odometry, RawPoint, Series};

/// `ego_state/NNNNNN.json`; other keys are for people.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(super) struct ExportedState {
    pub(super) time_ns: u64,
    speed_mps: f64,
    steering_angle_rad: f64,
    yaw_rate_rps: f64,
    acceleration_mps2: f64,
    pub(super) wheelbase_m: f64,
    pub(super) front_bumper_x_m: f64,
    world_from_ego: [[f64; 4]; 4],
    ego_from_lidar: [[f64; 4]; 4],
}

impl ExportedState {
    /// The state of a frame; `None` in a set that is KITTI's own.
    pub(super) fn read(folder: &Path, stem: &str) -> Result<Option<Self>, ImportError> {
        let path = folder.join("ego_state").join(format!("{stem}.json"));
        if !files::is_file(&path)? {
            return Ok(None);
        }
        let wanted = "the state of a frame, as `harmzone export kitti` writes it, is needed";
        let fail = |found: String| ImportError::at(&path, format!("{found}; {wanted}"));
        let state: Self =
            serde_json::from_str(&read_text(&path)?).map_err(|error| fail(error.to_string()))?;
        for (name, matrix) in
            [("world_from_ego", &state.world_from_ego), ("ego_from_lidar", &state.ego_from_lidar)]
        {
            isometry(matrix).ok_or_else(|| fail(format!("`{name}` is no rotation and translation")))?;
        }
        Ok(Some(state))
    }

    pub(super) fn ego_from_lidar(&self) -> Isometry3<f64> {
        isometry(&self.ego_from_lidar).expect("it was checked on reading")
    }

    /// The pose and what was measured at the frame's time.
    pub(super) fn odometry(&self) -> Odometry {
        let world_from_ego = isometry(&self.world_from_ego).expect("it was checked on reading");
        let source = "stated beside the export, in ego_state".to_owned();
        let series =
            |value: f64| Some(Series { source: source.clone(), values: vec![(self.time_ns, value)] });
        Odometry {
            poses: vec![(self.time_ns, Transform::from_isometry(world_from_ego))],
            speed_mps: series(self.speed_mps),
            steering_angle_rad: series(self.steering_angle_rad),
            yaw_rate_rps: series(self.yaw_rate_rps),
            acceleration_mps2: series(self.acceleration_mps2),
        }
    }
}

/// `None` where the matrix is no motion of a rigid body.
fn isometry(rows: &[[f64; 4]; 4]) -> Option<Isometry3<f64>> {
    let rotation = Matrix3::from_fn(|row, column| rows[row][column]);
    let is_rigid = (rotation.transpose() * rotation - Matrix3::identity()).abs().max() < 1e-6
        && rotation.determinant() > 0.0
        && rows.iter().flatten().all(|number| number.is_finite());
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    is_rigid.then(|| Isometry3::from_parts(Translation3::new(rows[0][3], rows[1][3], rows[2][3]), turn))
}

/// Gives the points of a frame the rings of `ring/NNNNNN.bin`, 16 bits each.
pub(super) fn read_rings(folder: &Path, stem: &str, points: &mut [RawPoint]) -> Result<(), ImportError> {
    let path = folder.join("ring").join(format!("{stem}.bin"));
    let bytes = read(&path)?;
    if bytes.len() != 2 * points.len() {
        let message =
            format!("{} bytes of rings for {} points; 2 for each are needed", bytes.len(), points.len());
        return Err(ImportError::at(&path, message));
    }
    for (point, ring) in points.iter_mut().zip(bytes.chunks_exact(2)) {
        point.ring = Some(u16::from_le_bytes([ring[0], ring[1]]));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATE: &str = r#"{"episode": "a", "sample_idx": 0, "split": "val", "time_ns": 7, "speed_mps": 3.5,
        "steering_angle_rad": 0.1, "yaw_rate_rps": 0, "acceleration_mps2": 0, "wheelbase_m": 2.7, "front_bumper_x_m": 3.6,
        "world_from_ego": [[0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 0], [0, 0, 0, 1]],
        "ego_from_lidar": [[1, 0, 0, 1.5], [0, 1, 0, 0], [0, 0, 1, 1.8], [0, 0, 0, 1]]}"#;

    fn folder(state: &str) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        fs_err::create_dir(folder.path().join("ego_state")).unwrap();
        fs_err::write(folder.path().join("ego_state/000003.json"), state).unwrap();
        folder
    }

    #[test]
    fn the_state_is_taken_as_it_is_stated() {
        let folder = folder(STATE);
        let state = ExportedState::read(folder.path(), "000003").unwrap().unwrap();
        let odometry = state.odometry();
        assert_eq!(odometry.speed_mps.unwrap().values, [(7, 3.5)]);
        assert!((odometry.poses[0].1.yaw_rad() - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert_eq!(state.ego_from_lidar().translation.z, 1.8);
        assert_eq!(ExportedState::read(folder.path(), "000004").unwrap(), None);
    }

    #[test]
    fn a_torn_state_a_twisted_mounting_and_missing_rings_are_told_with_their_path() {
        let told = |state: &str| ExportedState::read(folder(state).path(), "000003").unwrap_err().to_string();
        let torn = told(&STATE[..60]);
        assert!(torn.contains("export kitti") && torn.contains("000003.json"), "{torn}");
        assert!(told(&STATE.replace("[1, 0, 0, 1.5]", "[2, 0, 0, 1.5]")).contains("`ego_from_lidar`"));
        let folder = folder(STATE);
        fs_err::create_dir(folder.path().join("ring")).unwrap();
        fs_err::write(folder.path().join("ring/000003.bin"), [1, 0, 2]).unwrap();
        let point =
            RawPoint { x_m: 1.0, y_m: 0.0, z_m: 0.0, intensity: 0.0, ring: None, time_offset_s: None };
        let message = read_rings(folder.path(), "000003", &mut [point; 2]).unwrap_err().to_string();
        assert!(message.contains("3 bytes of rings for 2 points"), "{message}");
    }
}
