//! Boxes, transforms and states as numpy arrays and dictionaries.

use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::geometry::{Box3, Ego, Frame, Point, Transform};
use crate::sample::EgoState;

/// Numbers of a box: x, y, z of its centre, length, width, height (m), yaw (rad); ego frame.
pub(super) const N_BOX: usize = 7;

pub(super) fn rows<const N: usize>(py: Python<'_>, rows: Vec<[f64; N]>) -> Bound<'_, PyArray2<f64>> {
    let shape = (rows.len(), N);
    let flat = rows.into_iter().flatten().collect();
    Array2::from_shape_vec(shape, flat).expect("each row has N numbers").into_pyarray(py)
}

pub(super) fn numbers_of(of: &Box3<Ego>) -> [f64; N_BOX] {
    let center = of.center;
    [center.x(), center.y(), center.z(), of.length_m, of.width_m, of.height_m, of.yaw_rad]
}

/// # Errors
/// Another number of columns than 7.
pub(super) fn boxes_of(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<Box3<Ego>>> {
    let array = array.as_array();
    if array.ncols() != N_BOX {
        return Err(PyValueError::new_err(format!(
            "boxes have {} columns; {N_BOX} are needed: x, y, z, length, width, height, yaw",
            array.ncols()
        )));
    }
    let of_row = |row: numpy::ndarray::ArrayView1<'_, f64>| Box3 {
        center: Point::new(row[0], row[1], row[2]),
        length_m: row[3],
        width_m: row[4],
        height_m: row[5],
        yaw_rad: row[6],
    };
    Ok(array.rows().into_iter().map(of_row).collect())
}

/// # Errors
/// Another shape than that of the boxes.
pub(super) fn velocities_of(array: Option<&PyReadonlyArray2<'_, f64>>, n: usize) -> PyResult<Vec<[f64; 2]>> {
    let Some(array) = array else { return Ok(vec![[0.0; 2]; n]) };
    let array = array.as_array();
    if array.dim() != (n, 2) {
        return Err(PyValueError::new_err(format!(
            "velocities have the shape {:?}; ({n}, 2) is needed",
            array.dim()
        )));
    }
    Ok(array.rows().into_iter().map(|row| [row[0], row[1]]).collect())
}

/// A transform as its matrix, 4x4: points of the frame `From` as columns come out in `To`.
pub(super) fn matrix<'py, To: Frame, From: Frame>(
    py: Python<'py>,
    of: &Transform<To, From>,
) -> Bound<'py, PyArray2<f64>> {
    let matrix = of.isometry.to_homogeneous();
    let row = |row: usize| -> [f64; 4] { std::array::from_fn(|column| matrix[(row, column)]) };
    rows(py, (0..4).map(row).collect())
}

/// The ego's state by the names of [`EgoState`].
pub(super) fn state_dict<'py>(py: Python<'py>, state: &EgoState) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("speed_mps", state.speed_mps)?;
    dict.set_item("steering_angle_rad", state.steering_angle_rad)?;
    dict.set_item("yaw_rate_rps", state.yaw_rate_rps)?;
    dict.set_item("acceleration_mps2", state.acceleration_mps2)?;
    dict.set_item("wheelbase_m", state.wheelbase_m)?;
    dict.set_item("front_bumper_x_m", state.front_bumper_x_m)?;
    Ok(dict)
}

/// # Errors
/// A value is missing or no number.
pub(super) fn state_of(dict: &Bound<'_, PyDict>) -> PyResult<EgoState> {
    let value = |name: &str| -> PyResult<f64> {
        let found = dict.get_item(name)?;
        let missing = || PyValueError::new_err(format!("the ego's state lacks `{name}`"));
        found.ok_or_else(missing)?.extract()
    };
    Ok(EgoState {
        speed_mps: value("speed_mps")?,
        steering_angle_rad: value("steering_angle_rad")?,
        yaw_rate_rps: value("yaw_rate_rps")?,
        acceleration_mps2: value("acceleration_mps2")?,
        wheelbase_m: value("wheelbase_m")?,
        front_bumper_x_m: value("front_bumper_x_m")?,
    })
}
