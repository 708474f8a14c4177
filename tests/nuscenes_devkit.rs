//! nuscenes-devkit, unmodified, over an export: what it reads, and what its own evaluation scores. Needs what `make setup-test` makes.

mod made_data;

use std::path::PathBuf;
use std::process::Command;

use fs_err as fs;
use made_data::{done, generate, succeed, text};

/// The check with the devkit; each difference ends it.
fn check(args: &[&str]) -> String {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let mut command = Command::new(root.join(".venv-test/bin/python"));
    command.arg(root.join("tests/import/check_nuscenes.py")).args(args);
    command.env("PYTHONPATH", root.join("tests/import"));
    succeed(&mut command)
}

#[test]
fn the_devkit_reads_the_export_and_scores_as_harmzone_does() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let at = |name: &str| folder.path().join(name);
    let (data, found, results, scores) = (at("data"), at("found"), at("results.json"), at("scores"));
    generate(&data, "2", &["--episodes", "2"]);
    done(&["label", text(&data)]);
    done(&["predict", "small", "--data", text(&data), "--out", text(&found)]);
    let exported = at("exported");
    let summary = done(&[
        "export",
        "nuscenes",
        text(&data),
        text(&exported),
        "--categories",
        "harm-as-car-truck",
        "--version",
        "v1.0-mini",
    ]);
    assert!(summary.contains("1 mini_train, 1 mini_val"), "{summary}");
    let names = ["--names", "harm-as-car-truck"];
    let of = ["--data", text(&data), "--format", "nuscenes"];
    done(&[&["export", "predictions", text(&found), text(&results)], &of[..], &names].concat());
    done(&[
        "eval",
        "--predictions",
        text(&found.join("predictions.json")),
        "--data",
        text(&data),
        "--out",
        text(&scores),
    ]);
    let metrics = scores.join("metrics.json");
    let told =
        check(&[text(&exported), text(&data), "--predictions", text(&results), "--metrics", text(&metrics)]);
    assert!(told.contains("AP harmless at 4.0 m"), "{told}");

    // And back: the same scores, whether names or the zone give harm.
    let back = at("back");
    let import = ["import", "predictions", text(&results), "--out", text(&back), "--harm", "car-truck"];
    done(&[&import, &of[..]].concat());
    let again = at("again");
    done(&[
        "eval",
        "--predictions",
        text(&back.join("predictions.json")),
        "--data",
        text(&data),
        "--out",
        text(&again),
    ]);
    let aps = |path: PathBuf| -> Vec<f64> {
        let metrics: serde_json::Value =
            serde_json::from_slice(&fs::read(path).expect("eval writes it")).expect("it is JSON");
        let of_class =
            |class: &str| metrics["per_threshold"]["total"][class].as_array().cloned().unwrap_or_default();
        let values = ["harmful", "harmless"].map(of_class).concat();
        values.iter().filter_map(serde_json::Value::as_f64).collect()
    };
    let (before, after) = (aps(metrics), aps(again.join("metrics.json")));
    assert!(before.iter().zip(&after).all(|(a, b)| (a - b).abs() < 1e-9), "{before:?} {after:?}");
    let by_zone =
        ["import", "predictions", text(&results), "--out", text(&back), "--harm", "zone", "--force"];
    let told = done(&[&by_zone, &of[..]].concat());
    assert!(told.contains("for 3 samples"), "{told}");
}

#[test]
fn the_devkit_reads_six_cameras_the_whole_turn_and_the_sweeps() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let at = |name: &str| folder.path().join(name);
    let (data, exported) = (at("data"), at("exported"));
    let rig = ["--rig", "surround", "--set", "rig.cameras.cam_back.width_px=640", "--set", "sweeps=2"];
    generate(&data, "2", &[&["--episodes", "2"], &rig[..]].concat());
    let source = ["--categories", "source", "--version", "v1.0-mini"];
    done(&[&["export", "nuscenes", text(&data), text(&exported)], &source[..]].concat());
    let told = check(&[text(&exported), text(&data)]);
    assert!(told.contains("points of sweeps, in order") && !told.contains("absent"), "{told}");
    assert!(!exported.join("samples/absent.jpg").exists(), "no camera is missing");
}
