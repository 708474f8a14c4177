//! The interpreter, embedded in the program or the host of the wheel: which packages it uses, and the embedded `harmzone_sim`.

use std::ffi::CString;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::{SimError, text};

/// Names a virtual environment to use in place of the one that is found.
pub const VENV_VARIABLE: &str = "HARMZONE_VENV";

/// The source tree that the program was built from; one that is made for other machines (`make wheel`, `make bundle`) names none.
const SOURCE_TREE: Option<&str> = match option_env!("HARMZONE_MOVABLE") {
    Some(_) => None,
    None => Some(env!("CARGO_MANIFEST_DIR")),
};

/// The modules of `harmzone_sim` in the order of their imports; the package comes last.
const MODULES: [(&str, &str); 12] = [
    ("harmzone_sim.world", include_str!("../../python/harmzone_sim/world.py")),
    ("harmzone_sim.rays", include_str!("../../python/harmzone_sim/rays.py")),
    ("harmzone_sim.shapes", include_str!("../../python/harmzone_sim/shapes.py")),
    ("harmzone_sim.drawing", include_str!("../../python/harmzone_sim/drawing.py")),
    ("harmzone_sim.lights", include_str!("../../python/harmzone_sim/lights.py")),
    ("harmzone_sim.view", include_str!("../../python/harmzone_sim/view.py")),
    ("harmzone_sim.hidden", include_str!("../../python/harmzone_sim/hidden.py")),
    ("harmzone_sim.shaders", include_str!("../../python/harmzone_sim/shaders.py")),
    ("harmzone_sim.painter", include_str!("../../python/harmzone_sim/painter.py")),
    ("harmzone_sim.camera", include_str!("../../python/harmzone_sim/camera.py")),
    ("harmzone_sim.filament", include_str!("../../python/harmzone_sim/filament.py")),
    ("harmzone_sim", include_str!("../../python/harmzone_sim/__init__.py")),
];

/// Whether this code runs in an interpreter that was there before it and knows its packages.
const IS_HOSTED: bool = cfg!(feature = "wheel");
/// Whether the interpreter is set up.
static IS_READY: Mutex<bool> = Mutex::new(false);

/// The Python that this process uses.
#[derive(Debug, Clone)]
pub struct Environment {
    /// `3.11`: what the program was built for.
    pub python: String,
    /// Full version text of the interpreter.
    pub interpreter: String,
    /// The environment with MuJoCo; in the wheel: where the interpreter that runs it is installed.
    pub venv: PathBuf,
}

impl Environment {
    /// Finds the environment: that of the interpreter that runs the wheel; else `HARMZONE_VENV`, else a `.venv` in a folder above the program, else the
    /// `.venv` of the source tree that the program was built from.
    ///
    /// # Errors
    /// [`SimError::NoVenv`], [`SimError::WrongPython`].
    pub fn find() -> Result<Self, SimError> {
        let (python, interpreter) = Self::interpreter();
        if IS_HOSTED {
            let ask = |py: Python<'_>| py.import("sys")?.getattr("prefix")?.extract::<PathBuf>();
            let venv = Python::attach(ask)
                .map_err(|error| SimError::Ask { what: "find its environment", message: text(&error) })?;
            return Ok(Self { python, interpreter, venv });
        }
        let wanted = std::env::var_os(VENV_VARIABLE).map(PathBuf::from);
        let program = std::env::current_exe().ok();
        let venv = choose_venv(wanted, program.as_deref(), SOURCE_TREE.map(Path::new), &python)?;
        Ok(Self { python, interpreter, venv })
    }

    /// Version of the embedded interpreter: `3.11`, and its full text.
    pub fn interpreter() -> (String, String) {
        Python::attach(|py| {
            let version = py.version_info();
            (format!("{}.{}", version.major, version.minor), Python::version_str().to_owned())
        })
    }

    /// MuJoCo's version; imports it.
    ///
    /// # Errors
    /// [`SimError`]: no environment, no MuJoCo.
    pub fn mujoco_version() -> Result<String, SimError> {
        make_ready()?;
        Python::attach(|py| {
            let ask = || py.import("mujoco")?.getattr("__version__")?.extract();
            ask().map_err(|error| SimError::Ask { what: "tell its version", message: text(&error) })
        })
    }
}

fn site_packages(venv: &Path, python: &str) -> PathBuf {
    venv.join("lib").join(format!("python{python}")).join("site-packages")
}

fn choose_venv(
    wanted: Option<PathBuf>,
    program: Option<&Path>,
    source_tree: Option<&Path>,
    python: &str,
) -> Result<PathBuf, SimError> {
    let fits = |venv: &Path| site_packages(venv, python).is_dir();
    if let Some(path) = wanted {
        return match (fits(&path), path.is_dir()) {
            (true, _) => Ok(path),
            (false, true) => Err(SimError::WrongPython { python: python.to_owned(), path }),
            (false, false) => Err(SimError::NoVenv { python: python.to_owned(), looked_at: vec![path] }),
        };
    }
    let above = program.into_iter().flat_map(|program| program.ancestors().skip(1));
    let candidates: Vec<PathBuf> = above.chain(source_tree).map(|folder| folder.join(".venv")).collect();
    if let Some(venv) = candidates.iter().find(|venv| fits(venv)) {
        return Ok(venv.clone());
    }
    match candidates.iter().find(|venv| venv.is_dir()) {
        Some(path) => Err(SimError::WrongPython { python: python.to_owned(), path: path.clone() }),
        None => Err(SimError::NoVenv { python: python.to_owned(), looked_at: candidates }),
    }
}

/// Sets the interpreter up at the first call.
///
/// To be called while not attached: the lock comes before Python's own, which imports let go in between.
pub(super) fn make_ready() -> Result<(), SimError> {
    let mut is_ready = IS_READY.lock().unwrap_or_else(PoisonError::into_inner);
    if !*is_ready {
        let environment = Environment::find()?;
        Python::attach(load_egl).map_err(|error| SimError::NoGl { message: text(&error) })?;
        Python::attach(|py| set_up(py, &environment))
            .map_err(|error| SimError::NoMujoco { message: text(&error), venv: environment.venv.clone() })?;
        *is_ready = true;
    }
    Ok(())
}

/// Loads EGL, without which importing MuJoCo fails with words that do not say so.
fn load_egl(py: Python<'_>) -> PyResult<()> {
    py.import("ctypes")?.call_method1("CDLL", ("libEGL.so.1",)).map(drop)
}

fn set_up(py: Python<'_>, environment: &Environment) -> PyResult<()> {
    let variables = py.import("os")?.getattr("environ")?;
    // Off screen; one thread to a process, since `gen --jobs` fills the cores. All are read on load.
    variables.set_item("MUJOCO_GL", "egl")?;
    variables.set_item("LP_NUM_THREADS", "1")?;
    variables.set_item("OPENBLAS_NUM_THREADS", "1")?;
    if !IS_HOSTED {
        let site_packages = site_packages(&environment.venv, &environment.python);
        py.import("site")?.call_method1("addsitedir", (site_packages.as_os_str(),))?;
    }
    let modules = py.import("sys")?.getattr("modules")?.cast_into::<PyDict>()?;
    for (name, source) in MODULES {
        if modules.contains(name)? {
            continue;
        }
        let c_text = |text: &str| CString::new(text).expect("the embedded sources hold no NUL");
        PyModule::from_code(py, &c_text(source), &c_text(&format!("<{name}>")), &c_text(name))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use fs_err as fs;

    #[test]
    fn the_environment_nearest_above_the_program_wins_over_the_source_tree() {
        let folder = tempfile::tempdir().unwrap();
        let program = folder.path().join("app/target/release/harmzone");
        let source_tree = folder.path().join("source");
        for home in [folder.path().join("app"), source_tree.clone()] {
            fs::create_dir_all(site_packages(&home.join(".venv"), "3.11")).unwrap();
        }
        let chosen = choose_venv(None, Some(&program), Some(&source_tree), "3.11").unwrap();
        assert_eq!(chosen, folder.path().join("app/.venv"));
        let elsewhere = choose_venv(None, Some(Path::new("/nowhere/harmzone")), Some(&source_tree), "3.11");
        assert_eq!(elsewhere.unwrap(), source_tree.join(".venv"));
    }

    #[test]
    fn a_missing_environment_names_the_command_that_makes_it() {
        let error = choose_venv(None, None, Some(Path::new("/nowhere")), "3.11").unwrap_err().to_string();
        assert!(error.contains("make setup") && error.contains("/nowhere/.venv"), "{error}");
    }

    #[test]
    fn an_environment_of_another_python_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir_all(site_packages(&folder.path().join(".venv"), "3.9")).unwrap();
        let error = choose_venv(None, None, Some(folder.path()), "3.11").unwrap_err();
        assert!(matches!(error, SimError::WrongPython { .. }), "{error}");
    }
}
