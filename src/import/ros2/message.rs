//! What many messages have: a frame's name, a stamp, a pose.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use super::cdr::{CdrError, Value};

/// A frame's name without the slash of older writers.
#[must_use]
pub fn frame_name(name: &str) -> &str {
    name.trim_start_matches('/')
}

/// The pose that translation and rotation of a message say; `None` if a number is not finite or the rotation none.
///
/// # Errors
/// A field is missing.
pub fn isometry_of(
    value: &Value,
    translation: &str,
    rotation: &str,
) -> Result<Option<Isometry3<f64>>, CdrError> {
    let [x, y, z] = value.numbers_at(translation, ["x", "y", "z"])?;
    let [qx, qy, qz, qw] = value.numbers_at(rotation, ["x", "y", "z", "w"])?;
    let quaternion = Quaternion::new(qw, qx, qy, qz);
    let is_valid = [x, y, z].iter().all(|number| number.is_finite()) && (quaternion.norm() - 1.0).abs() < 0.1;
    let rotation = UnitQuaternion::from_quaternion(quaternion);
    Ok(is_valid.then(|| Isometry3::from_parts(Translation3::new(x, y, z), rotation)))
}

/// The stamp at a path, in nanoseconds; negative ones count as 0.
///
/// # Errors
/// A field is missing.
pub fn stamp_ns(value: &Value, path: &str) -> Result<u64, CdrError> {
    let [seconds, nanoseconds] = value.numbers_at(path, ["sec", "nanosec"])?;
    Ok((seconds.max(0.0) as u64).saturating_mul(1_000_000_000).saturating_add(nanoseconds as u64))
}
