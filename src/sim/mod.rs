//! MuJoCo, asked through Python: motion, rays and pictures of one world. The only place with pyo3.
//!
//! The Python side (`python/harmzone_sim`) is compiled into the program; MuJoCo itself comes from the
//! project's virtual environment, which [`python::Environment`] finds. Poses are in the world frame,
//! metres and radians.

mod mount;
#[cfg(test)]
mod picture_tests;
mod python;
mod sensing;
mod simulator;
mod stepping;
mod visible;

use std::path::PathBuf;

use thiserror::Error;

pub use mount::{CameraMount, Renderer};
pub use python::{Environment, VENV_VARIABLE};
pub use sensing::DrawnView;
pub use simulator::Simulator;
pub use stepping::Touch;

/// The command that installs MuJoCo.
pub const INSTALL_VENV: &str = if cfg!(feature = "wheel") { "pip install harmzone" } else { "make setup" };
/// The command that installs software OpenGL.
pub const INSTALL_GL: &str = "apt-get install -y libegl1 libgl1 libgl1-mesa-dri libegl-mesa0";

/// Why the simulator cannot start or go on.
#[derive(Debug, Error)]
pub enum SimError {
    #[error("no virtual environment with Python {python}: run `{INSTALL_VENV}`; looked at {looked_at:?}")]
    NoVenv { python: String, looked_at: Vec<PathBuf> },
    #[error(
        "the virtual environment is not for Python {python}, which this program embeds; \
         run `{INSTALL_VENV}`: {}", path.display()
    )]
    WrongPython { python: String, path: PathBuf },
    #[error("cannot import MuJoCo ({message}); run `{INSTALL_VENV}`: {}", venv.display())]
    NoMujoco { message: String, venv: PathBuf },
    /// There is no OpenGL context: no driver, or no memory for it, which looks the same from here. `gen` ends with this text where
    /// the machine cannot draw at all: the first worker's first context, with memory left ([`crate::worker::lacks_memory`]). A worker
    /// that is refused memory, or has no context after an episode was made, is lost instead, and its episode is tried again.
    #[error("cannot draw off screen with OpenGL ({message}); run `{INSTALL_GL}`")]
    NoGl { message: String },
    #[error("cannot draw with Filament ({message}); the renderer `classic` needs neither")]
    NoFilament { message: String },
    #[error("MuJoCo refuses the world: {message}")]
    Compile { message: String },
    #[error(
        "the geom `{geom}` is of the kind {kind}, which the LiDAR engine `bvh` does not know; use \
         `--lidar-engine mujoco`"
    )]
    RayKind { geom: String, kind: String },
    #[error("MuJoCo failed to {what}: {message}")]
    Ask { what: &'static str, message: String },
}

/// The text of a Python error: its type and message, without the traceback.
fn text(error: &pyo3::PyErr) -> String {
    error.to_string()
}
