//! `harmzone report` on a small real data set, in a real browser; and detectors side by side.
//!
//! Predictions are made up around those of the network inside the program, so that there are faults to show. The
//! browser's part is `tests/browser/check_report.py`; where no Chromium is installed it is skipped, and says so.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod made_data;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use fs_err as fs;
use made_data::{Fixture, done, fails, fixture, harmzone, text};
use serde_json::{Value, json};

/// What `check_report.py` ends with where there is no browser.
const SKIPPED: i32 = 77;

/// A labelled data set of two short episodes, and the scores of made-up predictions on it: `<name>-scores`.
fn scored(folder: &Path, name: &str, more: &[&str], flags: &[&str]) -> PathBuf {
    let data = folder.join(name);
    let base =
        ["gen", "--town", "downtown", "--episodes", "2", "--samples", "4", "--seed", "5", "--jobs", "2"];
    let base = [&base[..], &["--set", "val_every=1"], more, &["--out", text(&data)]].concat();
    done(&base);
    done(&["label", text(&data)]);
    let found = folder.join(format!("{name}-found"));
    done(&["predict", "small", "--data", text(&data), "--out", text(&found)]);
    let file = found.join("predictions.json");
    let mut boxes: Value = serde_json::from_slice(&fs::read(&file).unwrap()).unwrap();
    for (i, (_, found)) in boxes["results"].as_object_mut().unwrap().iter_mut().enumerate() {
        // Beside the street, where nothing is: farther and farther, surer and surer.
        found.as_array_mut().unwrap().push(json!({
            "translation": [18.0 + 2.0 * i as f64, 14.0, 0.8], "size": [1.8, 4.2, 1.6], "rotation": [1, 0, 0, 0],
            "velocity": [0, 0], "detection_name": "harmful", "detection_score": 0.6 + 0.02 * i as f64,
        }));
    }
    fs::write(&file, boxes.to_string()).unwrap();
    let scores = folder.join(format!("{name}-scores"));
    let eval = ["eval", "--predictions", text(&file), "--data", text(&data), "--out", text(&scores)];
    done(&[&eval[..], flags].concat());
    scores
}

#[test]
fn a_report_opens_from_disk_and_its_gallery_sorts_and_filters() {
    let folder = tempfile::tempdir().unwrap();
    let id = scored(folder.path(), "id", &[], &[]);
    let ood = scored(folder.path(), "ood", &["--ood"], &["--ood"]);
    let page = folder.path().join("report.html");
    let report = ["report", text(&page), "--id", text(&id), "--ood", text(&ood)];
    let told = done(&report);
    assert!(told.contains("report.html") && told.contains("cards"), "{told}");
    let html = fs::read_to_string(&page).unwrap();
    assert!(
        html.matches("data:image/jpeg;base64,").count() >= 8,
        "camera and bird's-eye pictures are inside"
    );
    for part in ["gen.toml", "time_gap_s", "harmzone eval --predictions", "false alarm: nothing there"] {
        assert!(html.contains(part), "{part}");
    }
    let output = harmzone(&report);
    assert_eq!(output.status.code(), Some(1), "a page is not overwritten without --force");
    // The page tells its own command, so that only the same one gives the same page.
    let again = || {
        done(&[&report[..], &["--force"]].concat());
        fs::read_to_string(&page).unwrap()
    };
    assert!(again() == again(), "the same scores give the same bytes");

    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python = root.join(".venv-test/bin/python");
    assert!(python.is_file(), "no {}: run `make setup-test` first", python.display());
    let mut check = Command::new(&python);
    check.arg(root.join("tests/browser/check_report.py")).arg(&page);
    // To look at what the browser shows.
    check.args(std::env::var_os("HARMZONE_KEEP_PICTURES"));
    let checked = check.output().unwrap();
    let said =
        [checked.stdout, checked.stderr].map(|said| String::from_utf8_lossy(&said).into_owned()).concat();
    if checked.status.code() == Some(SKIPPED) {
        // Not by `eprintln!`, which a passing test does not show.
        writeln!(std::io::stderr(), "\nSKIPPED: the report was not opened in a browser: {said}").unwrap();
        return;
    }
    assert!(checked.status.success() && said.contains("wide and narrow"), "{said}");
}

#[test]
fn what_is_gone_or_changed_of_the_scored_data_is_named_and_not_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let scores = scored(folder.path(), "ood", &["--ood"], &["--ood"]);
    let (data, page) = (folder.path().join("ood"), folder.path().join("report.html"));
    let report = |more: &[&str]| {
        let fixed = ["report", text(&page), "--ood", text(&scores), "--force"];
        let output = harmzone(&[&fixed[..], more].concat());
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let n_pictures = || fs::read_to_string(&page).unwrap().matches("data:image/jpeg;base64,").count();
    let (code, told) = report(&[]);
    assert!(code == Some(0) && n_pictures() > 0, "{told}");

    // Missing parts of what the scores name are left out; what a flag names has to be whole.
    for (part, left_out, refused) in [
        ("episodes", "since their labels or episodes are not there", "/episodes/"),
        ("labels", "since the labels that were scored are not there", "no label set `rect`"),
    ] {
        let elsewhere = folder.path().join("elsewhere");
        fs::rename(data.join(part), &elsewhere).unwrap();
        let (code, told) = report(&[]);
        assert!(code == Some(3) && told.contains(left_out), "{told}");
        assert_eq!(n_pictures(), 0, "{part}");
        let (code, told) = report(&["--ood-data", text(&data)]);
        assert!(code == Some(1) && told.contains(refused), "{told}");
        fs::rename(elsewhere, data.join(part)).unwrap();
    }
    assert_eq!(report(&[]).0, Some(0), "all is there again");
    done(&["label", text(&data), "--set", "width_m=6", "--force"]);
    let by_flag = ["--ood-data", text(&data)];
    for more in [&by_flag[..0], &by_flag[..]] {
        let (code, told) = report(more);
        assert!(code == Some(3) && told.contains("are not those that were scored"), "{told}");
        assert_eq!(n_pictures(), 0);
    }
}

#[test]
fn detectors_stand_side_by_side_on_the_same_samples() {
    let Fixture { ood, run, .. } = fixture();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (boxes, out) = (folder.path().join("zone"), folder.path().join("versus"));
    done(&["baseline", "zone", text(run), "--data", text(ood), "--out", text(&boxes)]);
    let rule = format!("rule={}", text(&boxes.join("predictions.json")));
    let (own, dark) = (format!("own={}", text(run)), format!("dark=camera-blind:{}", text(run)));
    let judged = format!("judged=zone:{}", text(run));
    let args = [
        &["versus", &own, &rule, &dark, &judged, "truth", "--data", text(ood), "--ood"],
        ["--out", text(&out)].as_slice(),
    ]
    .concat();
    let told = done(&args);
    assert!(told.starts_with("Development figures, on dev"), "{told}");
    assert!(told.contains("AP, mean of both") && told.contains("own") && told.contains("rule"), "{told}");
    let read = |text: &str| serde_json::from_str::<Value>(text).expect("JSON");
    let kept = read(&fs::read_to_string(out.join("versus.json")).expect("it is written"));
    let named: Vec<&str> =
        kept["detectors"].as_array().expect("a list").iter().filter_map(|of| of["name"].as_str()).collect();
    assert_eq!(named, ["own", "rule", "dark", "judged", "truth"]);
    assert!(kept["fingerprint"]["dataset_sha256"].is_string() && kept["detectors"][1]["sha256"].is_string());
    assert!(kept["detectors"][4]["sha256"].is_null(), "the truth is the data set's");
    let score = |args: &[&str]| {
        let of = read(&done(&[&["eval"], args, &["--data", text(ood), "--ood", "--json"]].concat()));
        of["total"]["mean"].as_f64().expect("a score")
    };
    let alone = [
        score(&[text(run)]),
        score(&["--predictions", text(&boxes.join("predictions.json"))]),
        score(&[text(run), "--blind", "camera"]),
    ];
    let total = &kept["of"]["mean"][0]["figures"];
    for (i, alone) in alone.into_iter().enumerate() {
        let of = &total[i];
        assert!((of["value"].as_f64().expect("a score") - alone).abs() < 1e-12, "{i}: {kept}");
        let gain = of["over_first"].as_f64().expect("a difference");
        assert!((gain - (alone - total[0]["value"].as_f64().expect("a score"))).abs() < 1e-12, "{kept}");
    }

    let values = |i: usize| {
        let lines = ["missed", "warned", "harmful", "mean"].map(|lines| kept["of"][lines].as_array());
        let lines = lines.into_iter().flat_map(|lines| lines.expect("lines"));
        lines.map(|line| line["figures"][i]["value"].as_f64()).collect::<Vec<_>>()
    };
    assert_eq!(values(3), values(1), "the rule over the network's boxes, asked in another way");
    let [of_truth, of_own] = [4, 0].map(|i| total[i]["value"].as_f64().expect("a score"));
    assert!(of_truth > 0.9 && of_truth > of_own, "{of_truth} {of_own}");

    // A file of boxes may name the samples in any order.
    let path = boxes.join("predictions.json");
    let file = read(&fs::read_to_string(&path).expect("boxes"));
    let of = |key: &str| file[key].as_object().expect("an object").iter();
    let turned: Vec<String> =
        of("results").rev().map(|(id, boxes)| format!("{}: {boxes}", json!(id))).collect();
    let (other, again) = (folder.path().join("turned.json"), folder.path().join("again"));
    let text_of = format!("{{\"meta\": {}, \"results\": {{{}}}}}", file["meta"], turned.join(", "));
    fs::write(&other, text_of).expect("a writable folder");
    let turned = format!("rule={}", text(&other));
    done(&[
        "versus",
        &own,
        &turned,
        &dark,
        &judged,
        "truth",
        "--data",
        text(ood),
        "--ood",
        "--out",
        text(&again),
    ]);
    let told_again = read(&fs::read_to_string(again.join("versus.json")).expect("it is written"));
    assert_eq!(told_again["of"], kept["of"]);

    for (wrong, wanted) in [
        (args.as_slice(), "--force"),
        (&["versus", text(run), text(run), "--data", text(ood)], "NAME=DETECTOR"),
        (&["versus", text(run), "none.json", "--data", text(ood)], "none.json"),
    ] {
        let message = fails(wrong);
        assert!(message.contains(wanted), "{message}");
    }
}
