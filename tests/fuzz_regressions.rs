//! Inputs that once crashed, hung or took gigabytes: each is run again by the target that found it.
//!
//! `tests/faults_found/<target>/` holds them, and `fuzz/` what finds new ones.

use std::path::Path;

use fs_err as fs;

#[allow(dead_code, clippy::pedantic, reason = "the fuzzers share it, and it is no part of the product")]
#[path = "../fuzz/src/targets.rs"]
mod targets;

#[test]
fn no_input_that_was_a_fault_is_one_now() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/faults_found");
    for (target, run) in targets::TARGETS {
        let Ok(inputs) = fs::read_dir(folder.join(target)) else { continue };
        for input in inputs {
            let path = input.expect("the folder can be read").path();
            eprintln!("{}", path.display());
            run(&fs::read(&path).expect("the input can be read"));
        }
    }
}

/// What a fuzzer changes first must be read without a fault, too.
#[test]
fn what_the_fuzzers_begin_with_is_no_fault() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (target, run) in targets::TARGETS {
        let of_target = folder.path().join(target);
        targets::write_seeds(target, &of_target).expect("seeds can be written");
        for seed in fs::read_dir(&of_target).expect("seeds were written") {
            run(&fs::read(seed.expect("the folder can be read").path()).expect("the seed can be read"));
        }
    }
}
