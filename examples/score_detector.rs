//! Scores the boxes of any detector by the nuScenes protocol, in and out of distribution.
//!
//! `cargo run --release --example score_detector [PREDICTIONS.json TRUTH.json]`; without files it scores the two that
//! stand below. `harmzone eval` prints more of the same: curves, breakdowns, safety.

use std::path::PathBuf;

use harmzone::eval::{Column, Mode, Protocol, evaluate, json};

/// One object in distribution and one out of it; sizes are width, length, height.
const TRUTH: &str = r#"{"results": {"street/0": [
    {"translation": [14.0, 3.2, 0.75], "size": [1.9, 4.5, 1.5], "rotation": [1, 0, 0, 0], "velocity": [0, 0],
     "detection_name": "harmless", "distribution": "id"},
    {"translation": [19.0, 0.3, 0.4], "size": [2.0, 0.9, 0.8], "rotation": [1, 0, 0, 0], "velocity": [0, 0],
     "detection_name": "harmful", "distribution": "ood"}]}}"#;

/// The car to the centimetre, the sofa a metre and a half too near, and a false alarm.
const PREDICTIONS: &str = r#"{"meta": {}, "results": {"street/0": [
    {"translation": [14.0, 3.2, 0.75], "size": [1.9, 4.5, 1.5], "rotation": [1, 0, 0, 0], "velocity": [0, 0],
     "detection_name": "harmless", "detection_score": 0.9},
    {"translation": [17.5, 0.3, 0.4], "size": [2.0, 0.9, 0.8], "rotation": [1, 0, 0, 0], "velocity": [0, 0],
     "detection_name": "harmful", "detection_score": 0.6},
    {"translation": [40.0, 9.0, 0.5], "size": [0.5, 0.5, 1.0], "rotation": [1, 0, 0, 0], "velocity": [0, 0],
     "detection_name": "harmful", "detection_score": 0.3}]}}"#;

fn main() -> anyhow::Result<()> {
    let folder = tempfile::tempdir()?;
    let args: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [predictions, truth] = if let [predictions, truth] = args.as_slice() {
        [predictions.clone(), truth.clone()]
    } else {
        let files = ["predictions.json", "truth.json"].map(|name| folder.path().join(name));
        fs_err::write(&files[0], PREDICTIONS)?;
        fs_err::write(&files[1], TRUTH)?;
        files
    };

    let samples = json::join(json::read_predictions(&predictions)?, json::read_truth(&truth)?)?;
    let found = evaluate(&samples, &Protocol::default(), Mode::Ood)?;

    println!("AP, mean of 0.5, 1, 2 and 4 m");
    for (name, column) in [("all objects", Column::Total), ("in distribution", Column::IdMatched)] {
        let scores = found.metrics.columns.get(column).expect("mode `Ood` fills every column");
        let told = |ap: Option<f64>| ap.map_or_else(|| "no truth".to_owned(), |ap| format!("{ap:.3}"));
        println!("{name:16} harmful {}   harmless {}", told(scores.harmful), told(scores.harmless));
    }
    if let Some(errors) = found.metrics.tp_errors.harmful {
        println!("errors of harmful boxes at 2 m: {:.2} m", errors.ate);
    }
    Ok(())
}
