//! A camera's calibration from `sensor_msgs/CameraInfo`, or from the mapping, and the axes of its frame.

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::cdr::{CdrError, Value};
use super::mapping::{CameraAxes, CameraMapping, Rectified};
use super::words::has_word;
use crate::import::Distortion;

/// How far a rotation may be from one, as the largest element of `R * R^T - 1`.
const ROTATION_ERROR: f64 = 1e-3;
/// Words of the topics of rectified pictures.
const RECTIFIED_WORDS: [&str; 3] = ["rect", "rectified", "rectify"];
/// Names of the model that bends a picture even where all of its coefficients are zero.
const FISHEYES: [&str; 3] = ["equidistant", "fisheye", "kannala_brandt"];

/// What is known of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraCalibration {
    pub k: [f64; 9],
    pub distortion: Distortion,
    pub size_px: Option<[u32; 2]>,
    /// From the camera's own axes to those of the rectified picture.
    pub rectified_from_camera: UnitQuaternion<f64>,
    /// A sentence.
    pub source: String,
    /// A sentence on what may not be right.
    pub doubt: Option<String>,
}

impl CameraMapping {
    /// Whether the pictures are rectified.
    #[must_use]
    pub fn is_rectified(&self) -> bool {
        match self.rectified {
            Rectified::Auto => has_word(&self.topic, &RECTIFIED_WORDS),
            Rectified::Yes => true,
            Rectified::No => false,
        }
    }
}

impl CameraCalibration {
    /// Reads a `CameraInfo`.
    ///
    /// # Errors
    /// A part of the picture only (binning, a region), an unknown distortion, or a matrix that is none.
    pub fn of(info: &Value, is_rectified: bool) -> Result<Self, String> {
        let tell = |error: CdrError| error.to_string();
        let binning = info.numbers_at("", ["binning_x", "binning_y"]).map_err(tell)?;
        if binning.iter().any(|&factor| factor > 1.0) {
            let [x, y] = binning;
            return Err(format!(
                "the camera info says a binning of {x} x {y}; a calibration of the whole picture is needed"
            ));
        }
        let size = info.numbers_at("", ["width", "height"]).map_err(tell)?;
        let region = info.numbers_at("roi", ["x_offset", "y_offset", "width", "height"]).map_err(tell)?;
        let whole = [[0.0; 4], [0.0, 0.0, size[0], size[1]]];
        if !whole.contains(&region) {
            return Err(format!(
                "the camera info says a region {region:?} (x, y, width, height) of the picture; all of it is needed"
            ));
        }
        let matrix = |names: [&str; 2], n_wanted: usize| -> Result<Vec<f64>, String> {
            let numbers = info.numbers(names[0]).or_else(|_| info.numbers(names[1])).map_err(tell)?.to_f64();
            let (name, found) = (names[0], numbers.len());
            if n_wanted > 0 && found != n_wanted {
                return Err(format!("the camera info's `{name}` has {found} numbers; {n_wanted} are needed"));
            }
            Ok(numbers)
        };
        let (k, p) = (matrix(["k", "K"], 9)?, matrix(["p", "P"], 12)?);
        let (r, d) = (matrix(["r", "R"], 9)?, matrix(["d", "D"], 0)?);
        let size_px = (size[0] > 0.0 && size[1] > 0.0).then_some(size.map(|side| side as u32));
        let model = info.text("distortion_model").map_err(tell)?;
        if !is_rectified {
            let source = "K and D of the camera info".to_owned();
            let rectified_from_camera = UnitQuaternion::identity();
            let (k, distortion) = (checked_k(&k)?, distortion_of(model, &d)?);
            let doubt = doubt_of(model, &d);
            return Ok(Self { k, distortion, size_px, rectified_from_camera, source, doubt });
        }
        let of_p: Vec<f64> = [0, 1, 2, 4, 5, 6, 8, 9, 10].iter().map(|&i| p[i]).collect();
        let has_p = of_p.iter().any(|&number| number != 0.0);
        Ok(Self {
            k: checked_k(if has_p { &of_p } else { &k })?,
            distortion: Distortion::None,
            size_px,
            rectified_from_camera: rotation_of(&r)?,
            source: format!(
                "{} of the camera info, for pictures that are rectified",
                if has_p { "P" } else { "K" }
            ),
            doubt: None,
        })
    }

    /// What the mapping says where the bag has no `CameraInfo`.
    ///
    /// # Errors
    /// An unknown distortion, or a matrix that is none.
    pub fn from_mapping(mapping: &CameraMapping) -> Result<Self, String> {
        let distortion = if mapping.is_rectified() {
            Distortion::None
        } else {
            distortion_of(&mapping.distortion_model, &mapping.d)?
        };
        Ok(Self {
            k: checked_k(&mapping.k)?,
            distortion,
            size_px: None,
            rectified_from_camera: UnitQuaternion::identity(),
            source: "camera.k and camera.d of the mapping".into(),
            doubt: doubt_of(&mapping.distortion_model, &mapping.d).filter(|_| !mapping.is_rectified()),
        })
    }
}

/// A camera matrix with focal lengths above zero and no skew.
fn checked_k(k: &[f64]) -> Result<[f64; 9], String> {
    let k: [f64; 9] =
        k.try_into().map_err(|_| format!("the camera matrix has {} numbers; 9 are needed", k.len()))?;
    if k.iter().all(|&number| number == 0.0) {
        return Err(
            "the camera matrix is all zero: the camera is not calibrated; camera.k of the mapping can say it"
                .into(),
        );
    }
    let is_valid = k.iter().all(|number| number.is_finite()) && k[0] > 0.0 && k[4] > 0.0 && k[8] == 1.0;
    if !is_valid || [k[3], k[6], k[7]] != [0.0; 3] {
        return Err(format!(
            "the camera matrix is {k:?}; [fx, 0, cx, 0, fy, cy, 0, 0, 1] with fx and fy above 0 is needed"
        ));
    }
    if k[1] != 0.0 {
        return Err(format!("the camera matrix has the skew {}; a camera without skew is needed", k[1]));
    }
    Ok(k)
}

/// A driver that knows no coefficients may name the model of its lens all the same.
fn doubt_of(model: &str, d: &[f64]) -> Option<String> {
    let is_unknown = FISHEYES.contains(&model) && d.iter().all(|&number| number == 0.0);
    is_unknown.then(|| {
        format!(
            "the camera's distortion is `{model}` with coefficients that are all zero; the picture is taken as a pinhole camera's: is \
             the lens calibrated?"
        )
    })
}

fn distortion_of(model: &str, d: &[f64]) -> Result<Distortion, String> {
    if d.iter().all(|&number| number == 0.0) {
        return Ok(Distortion::None);
    }
    if d.iter().any(|number| !number.is_finite()) {
        return Err(format!("the distortion's coefficients are {d:?}; finite numbers are needed"));
    }
    let first = |n: usize| -> Vec<f64> { d.iter().copied().chain(std::iter::repeat(0.0)).take(n).collect() };
    let rest_is_zero = |n: usize| d.iter().skip(n).all(|&number| number == 0.0);
    let fixed = "as many numbers as asked for";
    match model {
        "plumb_bob" | "radtan" | "" if rest_is_zero(5) => {
            Ok(Distortion::PlumbBob(first(5).try_into().expect(fixed)))
        }
        "rational_polynomial" if rest_is_zero(8) => {
            Ok(Distortion::Rational(first(8).try_into().expect(fixed)))
        }
        _ if FISHEYES.contains(&model) && rest_is_zero(4) => {
            Ok(Distortion::Fisheye(first(4).try_into().expect(fixed)))
        }
        "plumb_bob" | "rational_polynomial" | "equidistant" => Err(format!(
            "the distortion `{model}` has {} coefficients; 5, 8 and 4 are known for the three models",
            d.len()
        )),
        _ => Err(format!(
            "the distortion model is `{model}`; plumb_bob, rational_polynomial and equidistant are read"
        )),
    }
}

fn rotation_of(r: &[f64]) -> Result<UnitQuaternion<f64>, String> {
    if r.iter().all(|&number| number == 0.0) {
        return Ok(UnitQuaternion::identity());
    }
    let matrix = Matrix3::from_row_slice(r);
    let error = (matrix * matrix.transpose() - Matrix3::identity()).amax();
    if !(error < ROTATION_ERROR && matrix.determinant() > 0.0) {
        return Err(format!("the camera info's `r` is {r:?}, which is no rotation"));
    }
    Ok(UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_eps(
        &matrix,
        1e-15,
        100,
        Rotation3::identity(),
    )))
}

/// The pose of a camera's optical axes in the base frame, and what was found of its axes where the frame has others.
///
/// # Errors
/// The axes are to be found by where they point, and point neither like a camera's nor like a car's.
pub fn optical_axes(
    base_from_frame: Isometry3<f64>,
    axes: CameraAxes,
    frame: &str,
) -> Result<(Isometry3<f64>, Option<String>), String> {
    let [x, _, z] = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| base_from_frame.rotation * axis);
    let y = base_from_frame.rotation * Vector3::y();
    let is_optical = match axes {
        CameraAxes::Optical => true,
        CameraAxes::Body => false,
        CameraAxes::Auto if y.z < -0.7 && z.z.abs() < 0.7 => true,
        CameraAxes::Auto if z.z > 0.7 && x.z.abs() < 0.7 => false,
        CameraAxes::Auto => {
            return Err(format!(
                "the camera's frame `{frame}` has its x, y and z axes at heights {:.2}, {:.2}, {:.2} in the base frame; \
                 y down (optical) or z up (body) is needed, or camera.axes says which they are",
                x.z, y.z, z.z
            ));
        }
    };
    if is_optical {
        return Ok((base_from_frame, None));
    }
    // Columns: the optical right, down and forward in x forward, y left, z up.
    let body_from_optical = Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(body_from_optical));
    let told = format!(
        "the camera's frame `{frame}` has a body's axes (x forward, z up); they were turned into optical ones"
    );
    Ok((base_from_frame * rotation, Some(told)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_body_frame_is_told_and_turned() {
        let body = Isometry3::translation(1.0, 0.0, 1.5);
        let (optical, told) = optical_axes(body, CameraAxes::Auto, "camera").unwrap();
        assert!(told.unwrap().contains("`camera` has a body's axes"));
        let [right, down, forward] =
            [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| optical.rotation * axis);
        assert!((right + Vector3::y()).norm() < 1e-12 && (down + Vector3::z()).norm() < 1e-12);
        assert!((forward - Vector3::x()).norm() < 1e-12);
        let (same, told) = optical_axes(optical, CameraAxes::Auto, "camera_optical").unwrap();
        assert!(told.is_none() && same == optical);
    }

    #[test]
    fn pictures_are_rectified_where_a_word_of_their_topic_says_so() {
        let is_rectified =
            |topic: &str| CameraMapping { topic: topic.into(), ..CameraMapping::default() }.is_rectified();
        assert!(is_rectified("/cam/image_rect_color/compressed") && is_rectified("/cam/rectified/image"));
        assert!(!is_rectified("/cam/image_unrect") && !is_rectified("/direct/image_raw"));
    }

    #[test]
    fn a_fisheye_without_coefficients_is_doubted() {
        assert!(doubt_of("equidistant", &[0.0; 4]).unwrap().contains("`equidistant`"));
        assert!(doubt_of("equidistant", &[0.1]).is_none() && doubt_of("plumb_bob", &[0.0; 5]).is_none());
    }

    #[test]
    fn a_matrix_that_is_none_is_refused() {
        assert!(checked_k(&[0.0; 9]).unwrap_err().contains("not calibrated"));
        assert!(checked_k(&[500.0, 0.0, 1.0, 0.0, -500.0, 1.0, 0.0, 0.0, 1.0]).is_err());
        assert!(distortion_of("ds", &[0.1]).unwrap_err().contains("`ds`"));
        assert_eq!(distortion_of("plumb_bob", &[0.0; 5]), Ok(Distortion::None));
        assert_eq!(distortion_of("equidistant", &[0.1, 0.2]), Ok(Distortion::Fisheye([0.1, 0.2, 0.0, 0.0])));
    }
}
