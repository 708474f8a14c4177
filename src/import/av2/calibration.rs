//! An Argoverse 2 log's calibration: where each sensor sits in the egovehicle frame, and the cameras' intrinsics.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use super::feather::Table;
use crate::files;
use crate::import::ImportError;

/// Poses and intrinsics by sensor name.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Calibration {
    pub(super) ego_from_sensor: BTreeMap<String, Isometry3<f64>>,
    pub(super) cameras: BTreeMap<String, Intrinsics>,
}

/// A camera of which the pictures are free of distortion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Intrinsics {
    /// Row by row.
    pub(super) k: [f64; 9],
    pub(super) size_px: [u32; 2],
}

impl Calibration {
    /// Reads `calibration/`; `None` where the log comes without.
    pub(super) fn read(log: &Path) -> Result<Option<Self>, ImportError> {
        let folder = log.join("calibration");
        if !files::is_dir(&folder)? {
            return Ok(None);
        }
        let poses = Table::read(&folder.join("egovehicle_SE3_sensor.feather"))?;
        let ego_from_sensor = poses.texts("sensor_name")?.iter().cloned().zip(poses_of(&poses)?).collect();
        let table = Table::read(&folder.join("intrinsics.feather"))?;
        let names = table.texts("sensor_name")?;
        let [fx, fy, cx, cy] =
            [table.floats("fx_px")?, table.floats("fy_px")?, table.floats("cx_px")?, table.floats("cy_px")?];
        let (widths, heights) = (table.integers("width_px")?, table.integers("height_px")?);
        let camera = |i: usize| Intrinsics {
            k: [fx[i], 0.0, cx[i], 0.0, fy[i], cy[i], 0.0, 0.0, 1.0],
            size_px: [widths[i] as u32, heights[i] as u32],
        };
        let cameras = names.iter().enumerate().map(|(i, name)| (name.clone(), camera(i))).collect();
        Ok(Some(Self { ego_from_sensor, cameras }))
    }
}

/// The poses in a table's columns `qw, qx, qy, qz, tx_m, ty_m, tz_m`.
pub(super) fn poses_of(table: &Table) -> Result<Vec<Isometry3<f64>>, ImportError> {
    let [qw, qx, qy, qz] =
        [table.floats("qw")?, table.floats("qx")?, table.floats("qy")?, table.floats("qz")?];
    let [tx, ty, tz] = [table.floats("tx_m")?, table.floats("ty_m")?, table.floats("tz_m")?];
    let pose = |i: usize| {
        let quaternion = Quaternion::new(qw[i], qx[i], qy[i], qz[i]);
        let is_unit = (quaternion.norm() - 1.0).abs() < 1e-3;
        let rotation = UnitQuaternion::from_quaternion(quaternion);
        let pose = Isometry3::from_parts(Translation3::new(tx[i], ty[i], tz[i]), rotation);
        is_unit
            .then_some(pose)
            .ok_or_else(|| table.fault(format!("the quaternion in row {i} is not of length 1")))
    };
    (0..table.n_rows).map(pose).collect()
}
