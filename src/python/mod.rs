//! `harmzone._native`, the extension module in the wheel: what the Python package `harmzone` is made of.
//!
//! What reads, decodes or predicts does so without the interpreter's lock. Arrays are new ones that belong to Python.

mod arrays;
mod dataset;
mod detector;
mod program;
mod zone;

use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(harmzone, HarmzoneError, PyException, "What harmzone cannot do, and why.");

/// An error of the library as an exception of the same words, with those of its causes that they lack.
fn raise(error: &dyn std::error::Error) -> PyErr {
    HarmzoneError::new_err(crate::worker::with_causes(error))
}

/// The module's content.
///
/// # Errors
/// The interpreter has no memory left.
#[pymodule]
pub fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("HarmzoneError", module.py().get_type::<HarmzoneError>())?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_function(wrap_pyfunction!(program::main, module)?)?;
    module.add_class::<dataset::PyDataset>()?;
    module.add_class::<dataset::PySample>()?;
    module.add_class::<zone::PyZone>()?;
    module.add_class::<detector::PyDetector>()
}
