//! `shim.c`, which stands between a program and the disk.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use fs_err as fs;

use super::skipped;

/// What happens to the calls on files below a folder.
#[derive(Debug, Clone, Copy)]
pub enum Fault {
    /// Nothing; they are counted.
    None,
    /// The call of this number fails with this error.
    Call { number: u64, errno: i32 },
    /// The disk holds so many bytes more.
    Room { n_bytes: u64 },
    /// No call moves all that it is asked to.
    Short,
    /// The time of day jumps.
    Clock,
    /// No call comes back soon.
    Hang,
}

/// The shim, compiled once; `None`, told, where there is no C compiler.
fn library() -> Option<&'static Path> {
    static LIBRARY: OnceLock<Option<(tempfile::TempDir, PathBuf)>> = OnceLock::new();
    let built = LIBRARY.get_or_init(|| {
        let home = tempfile::tempdir().expect("a temporary folder");
        let path = home.path().join("shim.so");
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/faults/shim.c");
        let compiled = Command::new("cc")
            .args(["-shared", "-fPIC", "-O1", "-o"])
            .arg(&path)
            .arg(source)
            .arg("-ldl")
            .status();
        match compiled {
            Ok(status) => assert!(status.success(), "the shim does not compile"),
            Err(error) => {
                skipped(&format!("faults of the disk, there is no C compiler `cc`: {error}"));
                return None;
            }
        }
        Some((home, path))
    });
    built.as_ref().map(|(_, path)| path.as_path())
}

/// Counts of calls and bytes that a command and its workers share; it must live as long as they.
#[must_use]
pub struct Counter {
    file: tempfile::NamedTempFile,
}

impl Counter {
    /// How many calls there were.
    pub fn n_calls(&self) -> u64 {
        self.numbers()[0]
    }

    /// How many bytes they wrote.
    pub fn n_bytes(&self) -> u64 {
        self.numbers()[1]
    }

    fn numbers(&self) -> [u64; 2] {
        let bytes = fs::read(self.file.path()).expect("the counter is there");
        [0, 8].map(|at| u64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes")))
    }
}

/// Gives a command a disk with faults below a folder; `None` where that cannot be.
pub fn with_fault(command: &mut Command, folder: &Path, fault: Fault) -> Option<Counter> {
    let library = library()?;
    let file = tempfile::NamedTempFile::new().expect("a temporary file");
    fs::write(file.path(), [0; 16]).expect("a temporary file");
    command.env("LD_PRELOAD", library).env("FAULT_FOLDER", folder).env("FAULT_COUNTER", file.path());
    match fault {
        Fault::None => command,
        Fault::Call { number, errno } => {
            command.env("FAULT_CALL", number.to_string()).env("FAULT_ERRNO", errno.to_string())
        }
        Fault::Room { n_bytes } => command.env("FAULT_BYTES", n_bytes.to_string()),
        Fault::Short => command.env("FAULT_SHORT", "1"),
        Fault::Clock => command.env("FAULT_CLOCK", "1"),
        Fault::Hang => command.env("FAULT_HANG", "1"),
    };
    Some(Counter { file })
}
