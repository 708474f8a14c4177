//! A process of Python that writes recordings for Rerun with rerun-sdk.

use std::io::{BufWriter, Read as _, Seek as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};

use fs_err::File;
use thiserror::Error;

use crate::worker::Program;

/// Names the Python that has rerun-sdk; without it `python3`, or in the wheel the one that runs it.
const PYTHON_VARIABLE: &str = "HARMZONE_PYTHON";
/// What writes the recording.
const SCRIPT: &str = include_str!("../../../python/harmzone/_rerun.py");
/// The version that it was written for.
const RERUN_SDK: &str = "rerun-sdk==0.41.0";

/// Why the process did not write a recording.
#[derive(Debug, Error)]
pub enum RerunError {
    #[error("cannot start `{}` ({source}); {PYTHON_VARIABLE} names another Python", python.display())]
    Start { python: PathBuf, source: std::io::Error },
    #[error(
        "`{}` cannot import rerun; `{} -m pip install {RERUN_SDK}` helps, or {PYTHON_VARIABLE}, which names another Python",
        python.display(),
        python.display()
    )]
    NoPackage { python: PathBuf },
    #[error("the process that writes the recording failed: {message}")]
    Failed { message: String },
}

/// A running process.
pub(super) struct RerunProcess {
    python: PathBuf,
    process: Child,
    input: BufWriter<ChildStdin>,
    /// What it says on standard error.
    said: File,
}

impl RerunProcess {
    /// Starts a process that writes to a path what it is told.
    pub(super) fn start(out: &Path) -> Result<Self, RerunError> {
        let named = std::env::var_os(PYTHON_VARIABLE).map(PathBuf::from);
        let python = named.or_else(Program::python).unwrap_or_else(|| "python3".into());
        let fail = |source| RerunError::Start { python: python.clone(), source };
        let said = File::from_parts(tempfile::tempfile().map_err(fail)?, "what Python says");
        let mut process = Command::new(&python)
            .args(["-c", SCRIPT])
            .arg(out)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(said.file().try_clone().map_err(fail)?)
            .spawn()
            .map_err(fail)?;
        let input = BufWriter::new(process.stdin.take().expect("stdin is piped"));
        Ok(Self { python, process, input, said })
    }

    /// Where it is told.
    pub(super) fn input(&mut self) -> &mut BufWriter<ChildStdin> {
        &mut self.input
    }

    /// Ends its input and waits for it.
    pub(super) fn finish(self) -> Result<(), RerunError> {
        let Self { python, mut process, input, mut said } = self;
        drop(input);
        let fail = |source| RerunError::Start { python: python.clone(), source };
        if process.wait().map_err(fail)?.success() {
            return Ok(());
        }
        let mut text = String::new();
        said.rewind().and_then(|()| said.read_to_string(&mut text)).map_err(fail)?;
        Err(of_python(python, &text))
    }
}

/// What a process said that failed: its last line, or that it lacks Rerun.
fn of_python(python: PathBuf, said: &str) -> RerunError {
    if ["No module named 'rerun", "No module named 'numpy"].iter().any(|lacks| said.contains(lacks)) {
        return RerunError::NoPackage { python };
    }
    let last = said.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it says nothing");
    RerunError::Failed { message: last.trim().to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_python_without_rerun_is_told_what_to_install() {
        let told = of_python("python3".into(), "Traceback\nModuleNotFoundError: No module named 'rerun'\n");
        assert!(told.to_string().contains("python3 -m pip install rerun-sdk=="), "{told}");
        let told = of_python("python3".into(), "Traceback\nValueError: what\n\n").to_string();
        assert!(told.ends_with("ValueError: what"), "{told}");
    }
}
