//! Inputs that once crashed, hung or took gigabytes: each is run again by the target that found it.
//!
//! `tests/faults_found/<target>/` holds them, and `fuzz/` what finds new ones.

use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use fs_err as fs;

#[allow(dead_code, clippy::pedantic, reason = "the fuzzers share it, and it is no part of the product")]
#[path = "../fuzz/src/targets.rs"]
mod targets;

/// An input that takes longer hangs; most take milliseconds, and the first one of a target waits for what the target makes.
const LONGEST: Duration = Duration::from_mins(1);
/// More resident memory than all inputs together may take at any time, MB.
const MOST_MB: f64 = 4_000.0;

/// Runs a target over files, in one thread, which keeps what the target has made.
fn run_all(name: &str, run: targets::Target, files: Vec<PathBuf>) {
    let (tell, told) = channel();
    let n_files = files.len();
    let worker = thread::spawn(move || {
        for path in files {
            let bytes = fs::read(&path).expect("the input can be read");
            // Who has given up listening has said so.
            let _ = tell.send(path);
            run(&bytes);
        }
    });
    let mut last = PathBuf::new();
    for _ in 0..=n_files {
        match told.recv_timeout(LONGEST) {
            Ok(path) => {
                eprintln!("{}", path.display());
                last = path;
            }
            Err(RecvTimeoutError::Timeout) => {
                panic!("{name} takes more than {LONGEST:?}: {}", last.display());
            }
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    if let Err(panic) = worker.join() {
        resume_unwind(panic);
    }
}

/// The files of a folder, sorted; none if it is not there.
fn files_of(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let mut files: Vec<PathBuf> =
        entries.map(|entry| entry.expect("the folder can be read").path()).collect();
    files.sort();
    files
}

/// The most memory that this process ever had is below the bound; nothing where the system does not tell.
fn assert_small() {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let Some(line) = status.lines().find(|line| line.starts_with("VmHWM:")) else { return };
    let n_kb: f64 = line.split_whitespace().nth(1).and_then(|word| word.parse().ok()).expect("a number");
    eprintln!("at most {:.0} MB", n_kb / 1e3);
    assert!(n_kb / 1e3 < MOST_MB, "the inputs took {:.0} MB", n_kb / 1e3);
}

#[test]
fn no_input_that_was_a_fault_is_one_now() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/faults_found");
    let mut n_inputs = 0;
    for (target, run) in targets::TARGETS {
        let files = files_of(&folder.join(target));
        n_inputs += files.len();
        run_all(target, run, files);
    }
    assert!(n_inputs > 0, "no inputs in {}", folder.display());
    assert_small();
}

/// What a fuzzer changes first must be read without a fault, too.
#[test]
fn what_the_fuzzers_begin_with_is_no_fault() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (target, run) in targets::TARGETS {
        let of_target = folder.path().join(target);
        targets::write_seeds(target, &of_target).expect("seeds can be written");
        run_all(target, run, files_of(&of_target));
    }
    assert_small();
}
