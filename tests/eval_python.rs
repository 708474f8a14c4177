//! The four columns, fair and strict, against a second implementation in Python, from files, through the command line.
//!
//! `tests/python/table_columns.py` holds it: numpy, its own reading, its own matching.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;
use std::process::Command;

use harmzone::dataset::SampleFacts;
use harmzone::eval::{self, EvalSample};
use harmzone::geometry::{Box3, Point};
use harmzone::object::{Detection, Distribution, Harm, LabelledObject, Object};
use harmzone::random;
use rand::RngExt;
use serde_json::{Value, json};

/// Crowded samples of a seed: boxes near and on each other, far ones, truths without points, tied scores.
fn random_samples(seed: u64) -> Vec<EvalSample> {
    let mut rng = random::stream(seed, "eval-python", 0);
    let is_tied = seed.is_multiple_of(2);
    let mut place = |x_m: f64, y_m: f64, spread_m: f64| {
        let mut off = || spread_m * (2.0 * rng.random::<f64>() - 1.0);
        let center = Point::new(x_m + off(), y_m + off(), 1.0);
        let box_in_ego = Box3 { center, length_m: 3.0, width_m: 1.5, height_m: 1.5, yaw_rad: off() };
        let (harm, raw) = (Harm::ALL[usize::from(off() > 0.0)], rng.random::<f64>());
        let score = if is_tied { (raw * 8.0).floor() / 8.0 } else { raw };
        (box_in_ego, harm, score)
    };
    (0..12)
        .map(|i| {
            let mut objects = Vec::new();
            let mut detections = Vec::new();
            for k in 0..9_u32 {
                let (box_in_ego, harm, luck) = place(26.0, 0.0, 26.0);
                objects.push(LabelledObject {
                    harm,
                    truth: Object {
                        distribution: Some([Distribution::Id, Distribution::Ood][usize::from(luck > 0.6)]),
                        n_lidar_points: [None, Some(0), Some(3)][(k % 7).min(2) as usize],
                        ..Object::new(box_in_ego)
                    },
                });
                for n in 0..2 {
                    let (found, other, score) = place(box_in_ego.center.x(), box_in_ego.center.y(), 1.5);
                    let harm = if n == 0 { harm } else { other };
                    let velocity_in_ego_mps = [0.0; 2];
                    detections.push(Detection {
                        box_in_ego: found,
                        velocity_in_ego_mps,
                        harm,
                        score,
                        spread: None,
                    });
                }
            }
            EvalSample::new(format!("s{i}"), SampleFacts::default(), objects, detections)
        })
        .collect()
}

/// What the truth of a sample leaves out, in turns: a part of the picture and people, a part of the ground and what is far.
fn gaps(sample_idx: usize) -> SampleFacts {
    let facts = match sample_idx % 3 {
        0 => json!({
            "labelled": {"kinds": ["vehicle"], "in_camera_view": true, "sizes": {"vehicle":
                {"length_m": [2.9, 16.0], "width_m": [1.0, 3.0], "height_m": [1.2, 4.0]}}},
            "ignored": [{"image": {"left_px": 420.0, "top_px": 0.0, "right_px": 800.0, "bottom_px": 450.0}}],
            "camera": {"translation": [1.5, 0.1, 1.6], "rotation": [0.5, -0.5, 0.51, -0.5], "width_px": 800,
                "height_px": 450, "fx_px": 571.0, "fy_px": 570.0, "cx_px": 401.0, "cy_px": 225.0},
        }),
        1 => json!({
            "labelled": {"kinds": ["vehicle", "static"], "max_range_m": 35.0, "sizes": {}},
            "ignored": [{"ground": {"corners_in_ego_m": [{"x_m": 5.0, "y_m": -9.0}, {"x_m": 30.0, "y_m": -2.0},
                {"x_m": 9.0, "y_m": 12.0}]}}],
        }),
        _ => json!({}),
    };
    serde_json::from_value(facts).unwrap()
}

/// Gives the predictions of a file the points in their boxes; a third is empty and a third unknown. Every fifth gets the
/// size of a pole.
fn add_points(path: &Path) {
    let mut file: Value = serde_json::from_str(&fs_err::read_to_string(path).unwrap()).unwrap();
    let boxes = file["results"].as_object_mut().unwrap().values_mut();
    for (i, found) in boxes.flat_map(|of| of.as_array_mut().unwrap()).enumerate() {
        found["num_pts"] = json!([-1, 0, 4][i % 3]);
        if i.is_multiple_of(5) {
            found["size"] = json!([0.3, 0.4, 3.0]);
        }
    }
    fs_err::write(path, file.to_string()).unwrap();
}

#[test]
fn every_column_equals_that_of_the_python_implementation() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python = root.join(".venv-test/bin/python");
    assert!(python.is_file(), "no {}: run `make setup-test` first", python.display());
    for seed in 0..8 {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let mut samples = random_samples(seed);
        let is_log = seed >= 4;
        for (i, sample) in samples.iter_mut().enumerate().filter(|_| is_log) {
            sample.facts = gaps(i);
        }
        let boxes = samples.iter().map(|sample| (sample.id.as_str(), sample.detections.as_slice()));
        eval::json::write_predictions(&path("p.json"), boxes).unwrap();
        eval::json::write_truth(&path("t.json"), &samples).unwrap();
        if is_log {
            add_points(&path("p.json"));
        }
        let scored = Command::new(assert_cmd::cargo::cargo_bin!("harmzone"))
            .args(["eval", "--ood", "--set", "n_resamples=0", "--predictions"])
            .arg(path("p.json"))
            .arg("--truth")
            .arg(path("t.json"))
            .arg("--out")
            .arg(path("out"))
            .output()
            .unwrap();
        assert!(scored.status.success(), "{}", String::from_utf8_lossy(&scored.stderr));
        let checked = Command::new(&python)
            .arg(root.join("tests/python/table_columns.py"))
            .args([path("p.json"), path("t.json"), path("out/metrics.json")])
            .output()
            .unwrap();
        let told = String::from_utf8_lossy(&checked.stdout);
        assert!(checked.status.success(), "seed {seed}: {told}{}", String::from_utf8_lossy(&checked.stderr));
        let words: Vec<&str> = told.split([' ', ',']).collect();
        let (n_between, n_neutral): (usize, usize) =
            (words[3].parse().unwrap(), words[words.len() - 2].parse().unwrap());
        assert!(told.starts_with("40 compared") && n_between > 20, "the set hardly tests anything: {told}");
        assert!((n_neutral > 100) == is_log, "{told}");
    }
}
