//! Poses as the tables write them: a translation and a quaternion `[w, x, y, z]`.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use thiserror::Error;

/// A quaternion is taken as one of length 1 to within this; written with six digits they are off by a millionth.
const UNIT_TOLERANCE: f64 = 1e-3;

/// What is wrong with a pose.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PoseFault {
    #[error("its translation is {found:?}; finite numbers are needed")]
    Translation { found: [f64; 3] },
    #[error(
        "its rotation {found:?} has the length {length:.6}; a quaternion [w, x, y, z] of length 1 is needed"
    )]
    Rotation { found: [f64; 4], length: f64 },
}

/// The rigid transform that a row holds.
///
/// # Errors
/// A number that is not finite, or a quaternion that is not of length 1.
pub fn isometry_of(translation: [f64; 3], rotation: [f64; 4]) -> Result<Isometry3<f64>, PoseFault> {
    if !translation.iter().all(|part| part.is_finite()) {
        return Err(PoseFault::Translation { found: translation });
    }
    let [w, x, y, z] = rotation;
    let quaternion = Quaternion::new(w, x, y, z);
    let length = quaternion.norm();
    // Negated, so that NaN is refused too.
    if !((length - 1.0).abs() <= UNIT_TOLERANCE) {
        return Err(PoseFault::Rotation { found: rotation, length });
    }
    let [x, y, z] = translation;
    Ok(Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_quaternion(quaternion)))
}

/// A transform's translation as a row holds it.
#[must_use]
pub fn translation_of(isometry: &Isometry3<f64>) -> [f64; 3] {
    isometry.translation.vector.into()
}

/// A transform's rotation as a row holds it.
#[must_use]
pub fn rotation_of(isometry: &Isometry3<f64>) -> [f64; 4] {
    let rotation = isometry.rotation;
    [rotation.w, rotation.i, rotation.j, rotation.k]
}

/// Turns a LiDAR with x right and y forward into one with x forward and y left: `(x, y) -> (y, -x)`.
#[must_use]
pub fn quarter_turn() -> Isometry3<f64> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -std::f64::consts::FRAC_PI_2);
    Isometry3::from_parts(Translation3::identity(), turn)
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    #[test]
    fn what_is_ahead_in_their_lidar_is_ahead_in_ours() {
        let ahead = quarter_turn() * Point3::new(1.0, 20.0, 0.5);
        assert!((ahead - Point3::new(20.0, -1.0, 0.5)).norm() < 1e-12);
    }

    #[test]
    fn poses_survive_and_broken_ones_are_told() {
        let pose = isometry_of([1.0, -2.0, 0.5], [0.5, 0.5, -0.5, 0.5]).unwrap();
        assert_eq!(translation_of(&pose), [1.0, -2.0, 0.5]);
        assert_eq!(rotation_of(&pose), [0.5, 0.5, -0.5, 0.5]);
        for rotation in [[0.9, 0.0, 0.0, 0.0], [f64::NAN, 0.0, 0.0, 1.0], [0.0; 4]] {
            assert!(
                matches!(isometry_of([0.0; 3], rotation), Err(PoseFault::Rotation { .. })),
                "{rotation:?}"
            );
        }
        let told = isometry_of([f64::INFINITY, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]).unwrap_err().to_string();
        assert!(told.contains("inf"), "{told}");
    }
}
