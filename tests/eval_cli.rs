//! `harmzone eval` on files of boxes: what it prints, writes and refuses. Snapshots lie in tests/cli/eval.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use fs_err as fs;
use serde_json::Value;

const BOX: &str = r#"{"translation":[10,0,1],"size":[2,4,1.5],"rotation":[1,0,0,0],"velocity":[0,0],"detection_name":"harmful""#;

struct Folder(tempfile::TempDir);

impl Folder {
    /// Predictions and truth of one sample `s1` with one harmful box, found exactly.
    fn new() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        folder.write(
            "p.json",
            &format!(r#"{{"meta":{{}},"results":{{"s1":[{BOX},"detection_score":0.9}}]}}}}"#),
        );
        folder.write(
            "t.json",
            &format!(r#"{{"meta":{{}},"results":{{"s1":[{BOX},"distribution":"ood"}}]}}}}"#),
        );
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    fn replace(&self, name: &str, from: &str, to: &str) {
        let text = fs::read_to_string(self.path(name)).unwrap();
        assert!(text.contains(from));
        self.write(name, &text.replace(from, to));
    }

    /// Exit code, stdout, stderr; the folder's name is taken out.
    fn eval(&self, flags: &[&str]) -> (i32, String, String) {
        let output = harmzone().current_dir(self.0.path()).arg("eval").args(flags).output().unwrap();
        let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
        (output.status.code().unwrap(), text(&output.stdout), text(&output.stderr))
    }

    fn eval_files(&self, more: &[&str]) -> (i32, String, String) {
        self.eval(&[&["--predictions", "p.json", "--truth", "t.json"], more].concat())
    }
}

fn harmzone() -> Command {
    Command::new(assert_cmd::cargo::cargo_bin!("harmzone"))
}

fn assert_snapshot(name: &str, text: &str) {
    let mut settings = insta::Settings::clone_current();
    settings.set_snapshot_path("cli/eval");
    settings.set_prepend_module_to_snapshot(false);
    settings.set_omit_expression(true);
    settings.bind(|| insta::assert_snapshot!(name, text));
}

fn golden(part: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/golden/nuscenes_ties.{part}.json"));
    path.to_str().unwrap().to_owned()
}

#[test]
fn the_table_of_a_protocol_run() {
    let (predictions, truth) = (golden("predictions"), golden("truth"));
    let flags = ["--predictions", predictions.as_str(), "--truth", truth.as_str()];
    let (code, first, errors) = Folder::new().eval(&flags);
    assert_eq!((code, errors.as_str()), (0, ""));
    assert_snapshot("table_id", &first);
    assert_eq!(Folder::new().eval(&flags).1, first);
}

#[test]
fn the_table_of_an_ood_run_and_its_files() {
    let folder = Folder::new();
    let (code, table, errors) = folder.eval_files(&["--ood", "--out", "out", "--set", "max_range_m=40"]);
    assert_eq!((code, errors.as_str()), (0, ""));
    assert_snapshot("table_ood", &table);
    assert_eq!(fs::read_to_string(folder.path("out/table.txt")).unwrap(), table);
    assert!(fs::read_to_string(folder.path("out/eval.toml")).unwrap().contains("max_range_m = 40.0"));
    let metrics = fs::read_to_string(folder.path("out/metrics.json")).unwrap();
    // Curves are lines of 101 numbers: their beginning will do.
    let cut = |line: &str| line.chars().take(100).collect::<String>();
    assert_snapshot("metrics_ood", &metrics.lines().map(cut).collect::<Vec<_>>().join("\n"));
    let (_, printed, _) = folder.eval_files(&["--ood", "--json", "--set", "max_range_m=40"]);
    // The file ends with a hash of itself, what is printed does not.
    let content = |text: &str| {
        serde_json::from_str::<serde_json::Value>(&harmzone::files::unseal(text).unwrap()).unwrap()
    };
    assert!(harmzone::files::is_sealed(&metrics) && !harmzone::files::is_sealed(&printed));
    assert_eq!(content(&printed), content(&metrics));
}

#[test]
fn the_breakdown_of_what_the_truth_file_tells() {
    let folder = Folder::new();
    folder.replace(
        "t.json",
        r#""distribution":"ood"}]}"#,
        r#""distribution":"ood","category":"barrel","kind":"static","id":"barrel-1"}]},
           "samples":{"s1":{"town":"oldtown","episode":"e","time_s":0.3,"zone_in_ego_m":[[3,-2],[9,-2],[9,2],[3,2]]}}"#,
    );
    let (code, text, errors) = folder.eval_files(&["--ood", "--breakdown", "--out", "out"]);
    assert_eq!((code, errors.as_str()), (0, ""));
    let breakdown = fs::read_to_string(folder.path("out/breakdown.txt")).unwrap();
    assert!(text.ends_with(&breakdown));
    assert_snapshot("breakdown", &breakdown);
}

#[test]
fn metrics_hold_the_keys_that_readers_rely_on() {
    let (_, text, _) = Folder::new().eval_files(&["--ood", "--json"]);
    let metrics: Value = serde_json::from_str(&text).unwrap();
    for column in ["total", "id_matched", "ood_all", "ood_matched"] {
        assert_eq!(metrics["per_threshold"][column]["harmless"].as_array().unwrap().len(), 4);
    }
    assert!(metrics["tp_errors"]["harmful"]["aoe"].is_f64());
    // The one harmful OOD object is found; there is nothing else.
    assert_eq!(metrics["ood_all"], serde_json::json!({"harmful": 1.0, "harmless": null, "mean": 1.0}));
    assert_eq!(metrics["id_matched"]["mean"], Value::Null);
    assert_eq!(metrics["tp_errors"]["harmless"], Value::Null);
}

#[test]
fn a_missing_class_counts_as_zero_where_nuscenes_rule_is_asked_for() {
    let (code, table, _) = Folder::new().eval_files(&["--ood", "--set", "missing_class=zero"]);
    assert_eq!(code, 0);
    assert_snapshot("table_missing_is_zero", &table);
    let (code, _, errors) = Folder::new().eval_files(&["--set", "missing_class=none"]);
    assert!(code == 1 && errors.contains("absent"), "{errors}");
}

#[test]
fn the_table_of_a_log_whose_truth_leaves_out_things_has_neutral_detections_and_the_strict_score() {
    let folder = Folder::new();
    // Beside the harmful object: a pole-sized box with points and one without, above it in rank.
    let pole =
        r#"{"translation":[20,3,1],"size":[0.3,0.3,3],"rotation":[1,0,0,0],"detection_name":"harmful""#;
    let more = format!(
        r#""detection_score":0.9}},{pole},"detection_score":0.95,"num_pts":6}},{pole},"detection_score":0.3,"num_pts":0}}]"#
    );
    folder.replace("p.json", r#""detection_score":0.9}]"#, &more);
    folder.replace(
        "t.json",
        r#""distribution":"ood"}]}"#,
        r#""distribution":"ood"}]}, "samples":{"s1":{"labelled":{"kinds":["vehicle"],"max_range_m":40,"sizes":
           {"vehicle":{"length_m":[2.5,14],"width_m":[1.2,3],"height_m":[1,4]}}}}}"#,
    );
    let (code, table, errors) = folder.eval_files(&["--ood"]);
    assert_eq!((code, errors.as_str()), (0, ""));
    assert_snapshot("table_of_a_log", &table);
    let metrics: Value = serde_json::from_str(&folder.eval_files(&["--ood", "--json"]).1).unwrap();
    assert!(metrics["total"]["harmful"].as_f64().unwrap() > 0.98);
    assert_eq!(metrics["counts"]["outcomes"]["harmful"][2]["neutral"]["kind"], 1);
    assert!(metrics["strict"]["total"]["harmful"].as_f64().unwrap() < 0.6);
}

#[test]
fn a_log_that_nobody_labelled_has_nothing_to_score() {
    let folder = Folder::new();
    folder.replace(
        "t.json",
        r#""distribution":"ood"}]}"#,
        r#""distribution":"ood"}]}, "samples":{"s1":{"is_unlabelled":true}}"#,
    );
    let (code, _, errors) = folder.eval_files(&[]);
    assert_eq!(code, 1);
    assert!(errors.contains("nothing to score") && errors.contains("harmzone predict"), "{errors}");
}

#[test]
fn metrics_are_overwritten_only_when_forced() {
    let folder = Folder::new();
    assert_eq!(folder.eval_files(&["--out", "out"]).0, 0);
    let (code, table, errors) = folder.eval_files(&["--out", "out"]);
    assert_eq!((code, table.as_str()), (1, ""));
    assert_eq!(errors, "error: metrics exist already; give --force to overwrite them: out/metrics.json\n");
    assert_eq!(folder.eval_files(&["--out", "out", "--force"]).0, 0);
}

#[test]
fn bad_inputs_are_refused_with_file_and_sample() {
    let more = format!("[{}]", vec![format!("{BOX},\"detection_score\":0.1}}"); 501].join(","));
    let one = format!("[{BOX},\"detection_score\":0.9}}]");
    let cases: &[(&str, &str, &str, &str)] = &[
        ("nan", "p.json", "[10,0,1]", "[10,NaN,1]"),
        ("no_number", "p.json", "0.9", "\"high\""),
        ("unknown_class", "p.json", "harmful", "pedestrian"),
        ("no_size", "t.json", "[2,4,1.5]", "[2,0,1.5]"),
        ("other_samples", "p.json", "\"s1\"", "\"s2\""),
        ("too_many", "p.json", &one, &more),
        ("no_distribution", "t.json", ",\"distribution\":\"ood\"", ""),
        ("unknown_distribution", "t.json", "\"ood\"", "\"odd\""),
        ("no_score", "p.json", ",\"detection_score\":0.9", ""),
        ("cut_off", "p.json", "}]}}", ""),
        ("no_results", "p.json", "results", "boxes"),
        ("no_samples", "p.json", &format!("\"s1\":{one}"), ""),
    ];
    let mut told = String::new();
    for &(name, file, from, to) in cases {
        let folder = Folder::new();
        folder.replace(file, from, to);
        if name == "no_samples" {
            folder.write("t.json", "{\"results\":{}}");
        }
        let (code, table, errors) = folder.eval_files(&["--ood"]);
        assert_eq!((code, table.as_str()), (1, ""), "{name}");
        told += &format!("{name}\n{errors}\n");
    }
    let (code, _, errors) = Folder::new().eval(&["--predictions", "absent.json", "--truth", "t.json"]);
    assert_eq!(code, 1);
    told += &format!("absent\n{errors}\n");
    assert_snapshot("bad_inputs", &told);
}

#[test]
fn bad_configs_are_refused() {
    let folder = Folder::new();
    for (setting, expected) in [
        ("max_rnge_m=3", "max_rnge_m"),
        ("max_range_m=-3", "max_range_m is -3"),
        ("tp_threshold_m=3", "tp_threshold_m is 3"),
        ("dist_thresholds_m=[]", "dist_thresholds_m is []"),
    ] {
        let (code, _, errors) = folder.eval_files(&["--set", setting]);
        assert!(code == 1 && errors.contains(expected), "{errors}");
    }
}

#[test]
fn predictions_without_truth_and_no_detector_at_all_are_usage_errors() {
    let folder = Folder::new();
    for flags in [&["--predictions", "p.json"][..], &["--truth", "t.json"], &[], &["run"]] {
        assert_eq!(folder.eval(flags).0, 2, "{flags:?}");
    }
}

#[test]
fn a_closed_pipe_ends_a_command_quietly() {
    let folder = Folder::new();
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let output = std::process::Command::new(assert_cmd::cargo::cargo_bin!("harmzone"))
        .current_dir(folder.0.path())
        .args(["eval", "--predictions", "p.json", "--truth", "t.json"])
        .stdout(writer)
        .output()
        .unwrap();
    assert_eq!((output.status.code(), output.stderr.as_slice()), (Some(0), b"".as_slice()));
}
