//! Scores equal those of nuscenes-devkit's own code on random boxes with ties, where a class without a truth is zero.
//!
//! `tests/golden/nuscenes_accumulate.py` made the files. Tolerance 1e-9: the devkit sums in another order.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::PathBuf;

use harmzone::eval::{self, EvalConfig, MissingClass, Mode, Protocol, json};
use harmzone::object::Harm;
use serde_json::Value;

const TOLERANCE: f64 = 1e-9;

fn golden(case: &str, part: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("tests/golden/nuscenes_{case}.{part}.json"))
}

fn assert_near(ours: f64, devkit: &Value, what: &str) {
    let devkit = devkit.as_f64().unwrap();
    assert!((ours - devkit).abs() < TOLERANCE, "{what}: ours {ours}, the devkit's {devkit}");
}

#[test]
fn average_precision_and_errors_equal_the_devkits() {
    let config = EvalConfig { missing_class: MissingClass::Zero, ..EvalConfig::default() };
    let protocol = Protocol::try_from(config).unwrap();
    for case in ["ties", "distinct", "vague", "one_class", "all_equal", "far_off", "grid", "few"] {
        let predictions = json::read_predictions(&golden(case, "predictions")).unwrap();
        let truth = json::read_truth(&golden(case, "truth")).unwrap();
        let samples = json::join(predictions, truth).unwrap();
        let metrics = eval::score(&samples, &protocol, Mode::Id).unwrap();
        let expected: Value =
            serde_json::from_str(&fs_err::read_to_string(golden(case, "expected")).unwrap()).unwrap();
        for class in Harm::ALL {
            let of = |key: &str| &expected[key][class.name()];
            let aps = metrics.per_threshold.total.get(class);
            for (i, &ap) in aps.iter().enumerate() {
                assert_near(
                    ap.unwrap(),
                    &of("per_threshold")[i],
                    &format!("{case}, {}, AP {i}", class.name()),
                );
            }
            let errors = metrics.tp_errors.get(class).unwrap();
            for (name, error) in [("ate", errors.ate), ("ase", errors.ase), ("aoe", errors.aoe)] {
                assert_near(error, &of("tp_errors")[name], &format!("{case}, {}, {name}", class.name()));
            }
            assert_eq!(metrics.counts.truths.get(class).all as u64, of("n_truths").as_u64().unwrap());
            assert_eq!(*metrics.counts.detections.get(class) as u64, of("n_detections").as_u64().unwrap());
        }
    }
}
