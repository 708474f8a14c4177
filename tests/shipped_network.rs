//! The network inside the program keeps its scores: on data made here they are what they were when it was shipped.
//!
//! Data and network are the same bytes everywhere; the tolerance is for what another renderer makes of a picture.

mod made_data;

use made_data::{done, text};
use serde_json::Value;

const TOLERANCE: f64 = 0.02;

/// Makes 24 labelled samples, in distribution or not, and scores the network `small` on them; the seed gives harmful objects of
/// either distribution.
fn score(seed: &str, more: &[&str]) -> Value {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (data, scores) = (folder.path().join("data"), folder.path().join("scores"));
    let size = ["--town", "downtown,market", "--episodes", "4", "--samples", "6", "--seed", seed];
    done(&[&["gen", "--out", text(&data), "--set", "val_every=1"], size.as_slice(), more].concat());
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

#[test]
fn in_distribution_the_shipped_network_scores_as_it_did() {
    assert_near(&score("11", &[]), "total", [0.925, 0.656]);
}

#[test]
fn out_of_distribution_the_shipped_network_scores_as_it_did() {
    let metrics = score("12", &["--ood"]);
    assert_near(&metrics, "total", [0.507, 0.662]);
    assert_near(&metrics, "id_matched", [0.871, 0.869]);
    assert_near(&metrics, "ood_all", [0.320, 0.262]);
    assert_near(&metrics, "ood_matched", [0.597, 0.877]);
}
