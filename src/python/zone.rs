//! The danger zone.

use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::{boxes_of, rows, state_of, velocities_of};
use super::{HarmzoneError, raise};
use crate::config;
use crate::object::Harm;
use crate::zone::{Zone, ZoneConfig};

/// A rule by which objects are harmful.
#[pyclass(name = "Zone", module = "harmzone._native", frozen)]
pub(super) struct PyZone(Zone);

#[pymethods]
impl PyZone {
    /// `settings`: `key=value`, as `harmzone label --set` takes them.
    #[new]
    #[pyo3(signature = (settings=Vec::new()))]
    fn new(settings: Vec<String>) -> PyResult<Self> {
        let config: ZoneConfig =
            config::load(None, &settings).map_err(|error| HarmzoneError::new_err(error.to_string()))?;
        Zone::try_from(config).map(Self).map_err(|error| raise(&error))
    }

    #[pyo3(signature = (boxes, ego, velocities=None))]
    fn harmful<'py>(
        &self,
        py: Python<'py>,
        boxes: PyReadonlyArray2<'py, f64>,
        ego: &Bound<'py, PyDict>,
        velocities: Option<PyReadonlyArray2<'py, f64>>,
    ) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let boxes = boxes_of(&boxes)?;
        let velocities = velocities_of(velocities.as_ref(), boxes.len())?;
        let here = self.0.at(&state_of(ego)?).map_err(|error| raise(&error))?;
        let judged = boxes.iter().zip(velocities).map(|(of, velocity)| here.harm_of(of, velocity));
        let harms = judged.map(|verdict| verdict.map(|verdict| verdict.harm == Harm::Harmful));
        let harms: Vec<bool> = harms.collect::<Result<_, _>>().map_err(|error| raise(&error))?;
        Ok(harms.into_pyarray(py))
    }

    fn corners<'py>(&self, py: Python<'py>, ego: &Bound<'py, PyDict>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let here = self.0.at(&state_of(ego)?).map_err(|error| raise(&error))?;
        Ok(rows(py, here.corners().iter().map(|corner| [corner.x_m, corner.y_m]).collect()))
    }
}
