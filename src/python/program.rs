//! The command `harmzone` in the interpreter that has imported this module.

use std::ffi::OsString;
use std::path::PathBuf;

use pyo3::prelude::*;

use crate::cli;
use crate::worker::Program;

/// Runs the program on the words after its name and ends the process with its exit code.
///
/// Workers are started as `python -P -m harmzone`: nothing in the present folder shadows a package.
#[pyfunction]
pub(super) fn main(py: Python<'_>, words: Vec<OsString>) -> PyResult<()> {
    let interpreter: PathBuf = py.import("sys")?.getattr("executable")?.extract()?;
    Program::new(interpreter, ["-P", "-m", "harmzone"].map(Into::into).into()).start_as_worker();
    py.detach(|| std::process::exit(cli::main_on(words).into()))
}
