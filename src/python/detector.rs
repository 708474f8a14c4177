//! A trained network.

use std::path::PathBuf;

use burn::tensor::Device;
use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::prelude::*;

use super::arrays::{numbers_of, rows};
use super::dataset::PySample;
use super::raise;
use crate::device::{DeviceError, DeviceName};
use crate::infer::{self, Trained};
use crate::model::Detector;
use crate::object::{Detection, Harm};
use crate::progress::Silent;

/// A network in inference mode.
#[pyclass(name = "Detector", module = "harmzone._native", frozen)]
pub(super) struct PyDetector {
    detector: Detector,
    device: Device,
    operating_score: f64,
}

/// Boxes `(N, 7)`, scores `(N,)`, harmful `(N,)`; best first.
type Boxes<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<bool>>);

#[pymethods]
impl PyDetector {
    #[new]
    #[pyo3(signature = (run, device="cpu"))]
    fn new(py: Python<'_>, run: PathBuf, device: &str) -> PyResult<Self> {
        let name: DeviceName = device.parse().map_err(|error: DeviceError| raise(&error))?;
        py.detach(|| {
            let device = name.open().map_err(|error| raise(&error))?;
            let trained = Trained::find(&run).map_err(|error| raise(&error))?;
            let detector = trained.load(&device).map_err(|error| raise(&error))?;
            let operating_score = trained.eval_config().map_err(|error| raise(&error))?.operating_score;
            Ok(Self { detector, device, operating_score })
        })
    }

    #[getter]
    fn operating_score(&self) -> f64 {
        self.operating_score
    }

    fn predict<'py>(&self, py: Python<'py>, samples: Vec<PyRef<'py, PySample>>) -> PyResult<Vec<Boxes<'py>>> {
        let samples: Vec<_> = samples.iter().map(|sample| sample.0.clone()).collect();
        let named: Vec<_> = samples.iter().map(|sample| (sample.id.as_str(), &sample.measured)).collect();
        let with_camera = self.detector.config().use_camera;
        let found = py.detach(|| infer::predict(&self.detector, &named, with_camera, &self.device, &Silent));
        let found = found.map_err(|error| raise(&error))?;
        Ok(found.iter().map(|found| arrays_of(py, found)).collect())
    }
}

fn arrays_of<'py>(py: Python<'py>, found: &[Detection]) -> Boxes<'py> {
    let boxes = found.iter().map(|found| numbers_of(&found.box_in_ego)).collect();
    let scores: Vec<f64> = found.iter().map(|found| found.score).collect();
    let harmful: Vec<bool> = found.iter().map(|found| found.harm == Harm::Harmful).collect();
    (rows(py, boxes), scores.into_pyarray(py), harmful.into_pyarray(py))
}
