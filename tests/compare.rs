//! `harmzone compare` from outside: what it prints, writes and refuses, and a data set that says nothing of objects.

mod made_data;

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use fs_err as fs;
use harmzone::episode::{EpisodeReader, EpisodeWriter, LogFacts, Manifest, MapDrawing};
use harmzone::sample::Sample;
use serde_json::Value;

use made_data::{done, fails, generate, text};

/// Two episodes of three samples by the default LiDAR, and the same town by one of 64 beams.
fn sets() -> &'static [PathBuf; 2] {
    static SETS: OnceLock<(tempfile::TempDir, [PathBuf; 2])> = OnceLock::new();
    &SETS
        .get_or_init(|| {
            let folder = tempfile::tempdir().expect("a temporary folder");
            let sets = ["hdl32e", "hdl64e"].map(|preset| {
                let out = folder.path().join(preset);
                generate(
                    &out,
                    "2",
                    &["--episodes", "2", "--set", &format!("rig.lidars.lidar_top.preset={preset}")],
                );
                out
            });
            (folder, sets)
        })
        .1
}

fn compare(a: &Path, b: &Path) -> Value {
    serde_json::from_str(&done(&["compare", text(a), text(b), "--json"])).expect("JSON")
}

fn row<'a>(gap: &'a Value, name: &str) -> Option<&'a Value> {
    gap["rows"].as_array().expect("rows").iter().find(|row| row["name"] == name)
}

#[test]
fn a_data_set_is_nowhere_apart_from_itself() {
    let [a, _] = sets();
    let gap = compare(a, a);
    let rows = gap["rows"].as_array().unwrap();
    assert!(rows.len() > 30, "{}", rows.len());
    for row in rows {
        assert_eq!(
            (row["distance"]["jensen_shannon"].as_f64(), row["distance"]["wasserstein"].as_f64()),
            (Some(0.0), Some(0.0))
        );
        assert_ne!(row["is_apart"], true, "{row}");
        assert_eq!(row["a"], row["b"]);
    }
    assert_eq!(gap["notes"].as_array().unwrap().len(), 0, "{}", gap["notes"]);
    assert_eq!(gap["cloud"]["joint"]["distance"], 0.0, "{}", gap["cloud"]);
}

#[test]
fn clouds_of_another_lidar_are_farther_apart_than_parts_of_one_set() {
    let [a, b] = sets();
    let cloud = &compare(a, b)["cloud"];
    let number = |row: &Value, key: &str| row[key].as_f64().unwrap();
    let joint = &cloud["joint"];
    assert!(number(joint, "distance") > number(joint, "within_a"), "{cloud}");
    // The HDL-64E tells raw intensities, the HDL-32E calibrated ones.
    let [range, _, intensity] = [0, 1, 2].map(|i| number(&cloud["single"][i], "distance"));
    assert!(intensity > 2.0 * range, "{cloud}");
    let table = done(&["compare", text(a), text(b)]);
    assert!(table.contains("range, height, intensity") && table.contains("intensity alone"), "{table}");
}

#[test]
fn another_lidar_differs_in_its_rings_and_not_in_its_pictures() {
    let [a, b] = sets();
    let gap = compare(a, b);
    let rings = row(&gap, "rings that return").unwrap();
    assert_eq!(
        (rings["is_apart"].as_bool(), rings["distance"]["jensen_shannon"].as_f64()),
        (Some(true), Some(1.0))
    );
    let step = row(&gap, "elevation step between rings").unwrap();
    assert!((step["a"]["mean"].as_f64().unwrap() - 4.0 / 3.0).abs() < 0.02, "HDL-32E: {}", step["a"]["mean"]);
    for alike in ["width of pictures", "height of the LiDAR", "speed"] {
        assert_ne!(row(&gap, alike).unwrap()["is_apart"], true, "{alike}");
    }
    assert_eq!(gap["rows"][0]["is_apart"], true, "the farthest apart comes first");
}

#[test]
fn the_files_are_written_and_replaced_only_by_force() {
    let [a, b] = sets();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("gap");
    let printed = done(&["compare", text(a), text(b), "--split", "val", "--out", text(&out)]);
    assert!(printed.contains("(split val)") && printed.contains("Wasserstein-1"), "{printed}");
    assert_eq!(fs::read_to_string(out.join("compare.txt")).unwrap(), printed);
    let gap: Value = serde_json::from_str(&fs::read_to_string(out.join("compare.json")).unwrap()).unwrap();
    assert_eq!((gap["a"]["split"].as_str(), gap["a"]["n_episodes"].as_u64()), (Some("val"), Some(1)));
    assert!(gap["format_version"] == 1 && gap["sha256"].is_string());
    assert!(image::open(out.join("compare.png")).unwrap().width() > 2000);
    let again = ["compare", text(a), text(b), "--split", "val", "--out", text(&out)];
    assert!(fails(&again).contains("--force"));
    assert_eq!(done(&[&again[..], &["--force"]].concat()), printed, "the same bytes");
}

#[test]
fn what_cannot_be_compared_says_what_is_there() {
    let [a, _] = sets();
    let message = fails(&["compare", text(a), text(a), "--split", "test"]);
    assert!(
        message.contains("no sample of split test")
            && message.contains("3 of train, 3 of val, 0 of dev, 0 of test"),
        "{message}"
    );
    assert!(fails(&["compare", text(a), "/nowhere"]).contains("no data set here"));
}

#[test]
fn a_log_without_truth_is_compared_in_what_it_has() {
    let [a, _] = sets();
    let folder = tempfile::tempdir().unwrap();
    let log = unlabelled_copy(a, folder.path());
    let gap = compare(a, &log);
    assert!(row(&gap, "range of points").is_some() && row(&gap, "steering, left positive").is_some());
    assert!(row(&gap, "speed").is_none(), "what was assumed is not compared");
    assert!(
        row(&gap, "vehicles a sample").is_none() && row(&gap, "clutter among points above ground").is_none()
    );
    assert_eq!(gap["b"]["n_samples_with_truth"], 0);
    let notes = gap["notes"].to_string();
    assert!(notes.contains("B says of no sample which objects there are"), "{notes}");
    assert!(notes.contains("B: an assumed speed, which is not compared in 3 of 3 samples"), "{notes}");
    assert!(notes.contains("B has one episode") && notes.contains("in A and not in B: "), "{notes}");
}

/// The first episode of a data set as a log that nobody annotated.
fn unlabelled_copy(dataset: &Path, folder: &Path) -> PathBuf {
    let mut manifest = Manifest::read(dataset).expect("a copy of a data set");
    manifest.episodes.truncate(1);
    let reader =
        EpisodeReader::open(&dataset.join(&manifest.episodes[0].file)).expect("a copy of a data set");
    let log = LogFacts {
        format: "ros2".into(),
        drive: "bag".into(),
        methods: [("speed".into(), "unknown; assumed 8 m/s".into())].into(),
        labelled: None,
        first_cloud_sha256: String::new(),
        sample_names: std::collections::BTreeMap::default(),
    };
    let to = folder.join("log");
    let path = to.join(&manifest.episodes[0].file);
    fs::create_dir_all(path.parent().expect("a folder")).expect("a copy of a data set");
    let mut writer = EpisodeWriter::create_log(&path, reader.meta(), &log, &[], &MapDrawing::default())
        .expect("a copy of a data set");
    for sample in reader.samples() {
        writer.write(&Sample { truth: None, ..sample.expect("a sample") }).expect("a copy of a data set");
    }
    writer.finish().expect("a copy of a data set");
    manifest.write(&to).expect("a copy of a data set");
    to
}
