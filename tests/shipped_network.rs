//! The network inside the program keeps its scores: on data made here it finds and misses what it did when it was shipped.
//!
//! Data and network are the same bytes everywhere; the tolerance is for what another renderer makes of a picture.

mod made_data;

use made_data::{done, text};
use serde_json::Value;

const TOLERANCE: f64 = 0.02;

/// Makes 60 labelled samples, in distribution or not, and scores the network `small` on them; the seed gives harmful objects of
/// either distribution.
fn score(seed: &str, more: &[&str]) -> Value {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, scores) = (folder.path().join("data"), folder.path().join("scores"));
    let size = ["--town", "downtown,market", "--episodes", "10", "--samples", "6", "--seed", seed];
    let apart = ["--set", "sample_period_s=1.2", "--set", "val_every=1"];
    done(&[&["gen", "--out", text(&data)], apart.as_slice(), size.as_slice(), more].concat());
    done(&["label", text(&data)]);
    done(&[&["eval", "small", "--data", text(&data), "--out", text(&scores)], more].concat());
    let text = fs_err::read_to_string(scores.join("metrics.json")).expect("the scores are written");
    serde_json::from_str(&text).expect("JSON")
}

fn assert_near(metrics: &Value, column: &str, [harmful, harmless]: [f64; 2]) {
    for (class, expected) in [("harmful", harmful), ("harmless", harmless)] {
        let found = metrics[column][class].as_f64().expect("an AP");
        assert!((found - expected).abs() <= TOLERANCE, "{column}, {class}: {found}, not {expected}");
    }
}

/// Compares the harmful objects that are missed at 10 and at 100 false alarms a kilometre; one more is for the renderer.
fn assert_missed(metrics: &Value, n_harmful: u64, n_missed: [u64; 2]) {
    let points = metrics["safety"]["alarms"]["points"].as_array().expect("operating points");
    for (per_km, expected) in [10.0, 100.0].into_iter().zip(n_missed) {
        let point = points.iter().find(|point| point["max_false_alarms_per_km"] == per_km).expect("a point");
        assert_eq!(point["n_harmful"], n_harmful);
        let share = point["missed_per_sample"].as_f64().expect("a share");
        let found = (share * n_harmful as f64).round() as u64;
        assert!(
            found <= expected + 1,
            "{found} of {n_harmful} missed at {per_km} false alarms/km, not {expected}"
        );
    }
}

#[test]
fn in_distribution_the_shipped_network_scores_as_it_did() {
    let metrics = score("11", &[]);
    assert_near(&metrics, "total", [0.980, 0.855]);
    assert_missed(&metrics, 29, [1, 0]);
    let config_score = metrics["config"]["operating_score"].as_f64().expect("a number");
    assert!((config_score - 0.2).abs() > 1e-9, "it has no score of its own to warn from");
}

#[test]
fn out_of_distribution_the_shipped_network_scores_as_it_did() {
    let metrics = score("12", &["--ood"]);
    assert_near(&metrics, "total", [0.966, 0.887]);
    assert_near(&metrics, "id_matched", [0.976, 0.938]);
    assert_near(&metrics, "ood_all", [0.955, 0.715]);
    assert_near(&metrics, "ood_matched", [0.985, 0.953]);
    assert_missed(&metrics, 44, [2, 0]);
}
