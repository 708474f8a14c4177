//! Data sets and their samples.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::ndarray::{Array2, Array3};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3};
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use super::arrays::{matrix, numbers_of, rows, state_dict};
use super::raise;
use crate::dataset::{KnownObject, KnownSample, OneByOne};
use crate::episode::Split;
use crate::object::{Distribution, Event, Harm, Kind, Object};
use crate::store::{Access, Location};

/// Samples of a data set's folder, read when they are asked for.
#[pyclass(name = "Dataset", module = "harmzone._native", frozen)]
pub(super) struct PyDataset(OneByOne);

#[pymethods]
impl PyDataset {
    #[new]
    #[pyo3(signature = (path, split=None, labels=None))]
    fn new(py: Python<'_>, path: PathBuf, split: Option<&str>, labels: Option<&str>) -> PyResult<Self> {
        let named = |name: &str| {
            Split::ALL.into_iter().find(|split| split.name() == name).ok_or_else(|| {
                let valid = Split::ALL.map(Split::name).join(", ");
                PyValueError::new_err(format!("there is no split `{name}`; valid are {valid}"))
            })
        };
        let split = split.map(named).transpose()?;
        let place = match path.to_str() {
            None => Ok(Location::Local(path)),
            Some(text) => text.parse(),
        };
        let place = py.detach(|| place?.open(Access::Read)).map_err(|error| raise(&error))?;
        let opened = py.detach(|| OneByOne::open(place.path(), split, labels));
        opened.map(Self).map_err(|error| raise(&error))
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    fn __getitem__(&self, py: Python<'_>, idx: isize) -> PyResult<PySample> {
        let n = self.0.len();
        let from_begin = if idx < 0 { idx + n as isize } else { idx };
        let idx = usize::try_from(from_begin).ok().filter(|&idx| idx < n).ok_or_else(|| {
            PyIndexError::new_err(format!("there is no sample {idx}; the data set has {n}"))
        })?;
        let sample = py.detach(|| self.0.sample(idx)).map_err(|error| raise(&error))?;
        Ok(PySample(Arc::new(sample)))
    }

    /// The data set's folder.
    #[getter]
    fn path(&self) -> PathBuf {
        self.0.path().to_owned()
    }

    /// The label set's name, or None.
    #[getter]
    fn labels(&self) -> Option<&str> {
        self.0.label_set()
    }

    /// What the manifest says of each episode, in the order of the samples.
    #[getter]
    fn episodes<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let of_entry = |entry: &crate::episode::EpisodeEntry| {
            let dict = PyDict::new(py);
            dict.set_item("name", &entry.name)?;
            dict.set_item("file", self.0.path().join(&entry.file))?;
            dict.set_item("split", entry.split.name())?;
            dict.set_item("seed", entry.seed)?;
            dict.set_item("town", &entry.town)?;
            dict.set_item("weather", &entry.weather)?;
            dict.set_item("ood", entry.ood)?;
            dict.set_item("n_samples", entry.n_samples)?;
            dict.set_item("sha256", &entry.sha256)?;
            Ok(dict)
        };
        self.0.episodes().iter().map(of_entry).collect()
    }
}

/// One instant: what the sensors measured and, where it is known, what was there.
#[pyclass(name = "Sample", module = "harmzone._native", frozen)]
pub(super) struct PySample(pub(super) Arc<KnownSample>);

impl PySample {
    fn objects(&self) -> &[KnownObject] {
        self.0.objects.as_deref().unwrap_or_default()
    }

    /// One value of each object.
    fn each<T>(&self, value: impl Fn(&Object) -> T) -> Vec<T> {
        self.objects().iter().map(|object| value(&object.truth)).collect()
    }
}

#[pymethods]
impl PySample {
    #[getter]
    fn id(&self) -> &str {
        &self.0.id
    }

    #[getter]
    fn time_ns(&self) -> u64 {
        self.0.measured.time_ns
    }

    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f32>> {
        let points = &self.0.measured.points;
        let numbers = points
            .iter()
            .flat_map(|point| [point.x_m, point.y_m, point.z_m, point.intensity, f32::from(point.ring)]);
        let array = Array2::from_shape_vec((points.len(), 5), numbers.collect());
        array.expect("each point has five numbers").into_pyarray(py)
    }

    #[getter]
    fn image<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let picture = py.detach(|| self.0.measured.image.decode()).map_err(|error| raise(&error))?;
        let shape = (picture.height() as usize, picture.width() as usize, 3);
        let array = Array3::from_shape_vec(shape, picture.into_raw());
        Ok(array.expect("a pixel has three bytes").into_pyarray(py))
    }

    #[getter]
    fn encoded_image<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.0.measured.image.bytes)
    }

    #[getter]
    fn intrinsics<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let of = &self.0.measured.intrinsics;
        rows(py, vec![[of.fx_px, 0.0, of.cx_px], [0.0, of.fy_px, of.cy_px], [0.0, 0.0, 1.0]])
    }

    #[getter]
    fn ego_from_lidar<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        matrix(py, &self.0.measured.ego_from_lidar)
    }

    #[getter]
    fn ego_from_camera<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        matrix(py, &self.0.measured.ego_from_camera)
    }

    #[getter]
    fn world_from_ego<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        matrix(py, &self.0.measured.world_from_ego)
    }

    #[getter]
    fn ego<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        state_dict(py, &self.0.measured.ego_state)
    }

    #[getter]
    fn true_ego<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        state_dict(py, &self.0.true_state)
    }

    #[getter]
    fn is_annotated(&self) -> bool {
        self.0.objects.is_some()
    }

    #[getter]
    fn boxes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        rows(py, self.each(|object| numbers_of(&object.box_in_ego)))
    }

    #[getter]
    fn velocities<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        rows(py, self.each(|object| object.velocity_in_ego_mps))
    }

    #[getter]
    fn harmful<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<bool>>> {
        let is_harmful = |object: &KnownObject| object.harm == Some(Harm::Harmful);
        let harms: Vec<bool> = self.objects().iter().map(is_harmful).collect();
        self.0.is_labelled.then(|| harms.into_pyarray(py))
    }

    #[getter]
    fn object_ids(&self) -> Vec<Option<String>> {
        self.each(|object| object.id.clone())
    }

    #[getter]
    fn categories(&self) -> Vec<Option<String>> {
        self.each(|object| object.category.clone())
    }

    #[getter]
    fn kinds(&self) -> Vec<Option<&'static str>> {
        self.each(|object| object.kind.map(Kind::name))
    }

    #[getter]
    fn distributions(&self) -> Vec<Option<&'static str>> {
        self.each(|object| object.distribution.map(Distribution::name))
    }

    #[getter]
    fn events(&self) -> Vec<Option<&'static str>> {
        self.each(|object| object.event.map(Event::name))
    }

    #[getter]
    fn n_lidar_points(&self) -> Vec<Option<u32>> {
        self.each(|object| object.n_lidar_points)
    }

    #[getter]
    fn visible_px(&self) -> Vec<Option<u32>> {
        self.each(|object| object.visible_px)
    }
}
