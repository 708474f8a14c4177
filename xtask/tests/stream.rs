//! A data set of many episodes in little: merged, read, checked and streamed, all stages in processes of their own.

use std::process::Command;

use serde_json::Value;

/// The figures of a data set with so many episodes, of which 9 in 10 are streamed.
fn figures(n_entries: u32) -> Value {
    let (entries, streamed) = (n_entries.to_string(), (n_entries * 9 / 10).to_string());
    let output = Command::new(env!("CARGO_BIN_EXE_xtask"))
        .args(["bench-stream", "--json", "--shards", "3", "--window", "4"])
        .args(["--entries", &entries, "--episodes", &streamed])
        .output()
        .expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("its figures as JSON")
}

/// `HARMZONE_TEST_EPISODES` sets another size; `docs/scaling.md` tells figures of a larger one.
#[test]
fn memory_is_flat_while_episodes_are_streamed() {
    let n = std::env::var("HARMZONE_TEST_EPISODES").map_or(4000, |n| n.parse().unwrap());
    let report = figures(n);
    let stages = report["stages"].as_array().unwrap();
    assert_eq!(stages.len(), 7);
    for name in ["stream", "one_by_one"] {
        let stage = stages.iter().find(|stage| stage["stage"] == name).unwrap();
        assert_eq!(stage["n_samples"], n * 9 / 10 * 4);
        if cfg!(target_os = "linux") {
            let tenths: Vec<f64> =
                stage["tenths_mib"].as_array().unwrap().iter().map(|mib| mib.as_f64().unwrap()).collect();
            assert_eq!(tenths.len(), 10);
            // The files that are read after the second tenth have 100 MB.
            let grown = tenths[9] - tenths[1];
            assert!(grown < 25.0, "{name} grew by {grown} MiB: {tenths:?}");
        }
    }
}
