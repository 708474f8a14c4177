//! Data sets of every format ever released are read as they were meant, and written anew in today's; newer ones are refused.

mod made_data;

use std::path::{Path, PathBuf};

use fs_err as fs;
use harmzone::dataset::{Dataset, health};
use harmzone::episode::manifest::LabelManifest;
use harmzone::episode::{DetectionReader, Manifest, Split};
use harmzone::eval::json::read_predictions;
use harmzone::files::{read_sealed, seal, unseal};
use harmzone::object::Detection;
use harmzone::outcome::{DriveOutcome, DriveSummary};
use harmzone::progress::Silent;
use harmzone::report::scores::Scores;
use made_data::{done, fails, text};
use serde_json::{Value, json};

/// Of data sets.
const VERSIONS: [u32; 3] = [1, 2, 3];
/// Of scores, boxes, drives and networks; 0 has no version in its files.
const RESULT_VERSIONS: [u32; 2] = [0, 1];

fn formats() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/formats")
}

/// The data set with the manifests of a version.
fn data_of(version: u32) -> (tempfile::TempDir, PathBuf) {
    let home = tempfile::tempdir().expect("a temporary folder");
    let data = home.path().join("data");
    let copied = std::process::Command::new("cp").arg("-r").arg(formats().join("data")).arg(&data).status();
    assert!(copied.expect("cp runs").success());
    let of = formats().join(version.to_string());
    fs::copy(of.join("dataset.json"), data.join("dataset.json")).expect("a manifest");
    fs::copy(of.join("labels.json"), data.join("labels/rect/labels.json")).expect("a manifest");
    (home, data)
}

/// All that a network and its scores may take from a data set.
fn read(data: &Path) -> Value {
    let manifest = Manifest::read(data).expect("a data set");
    let labels = LabelManifest::read(data, "rect").expect("labels");
    let splits: Vec<&str> = manifest.n_by_split().into_keys().map(Split::name).collect();
    let mut samples = Vec::new();
    for split in manifest.n_by_split().into_keys() {
        let dataset = Dataset::open(data, "rect", split).expect("a data set");
        for sample in dataset.samples() {
            let objects = sample.objects.iter().map(|object| {
                let center = object.truth.box_in_ego.center;
                json!({
                    "id": object.truth.id,
                    "category": object.truth.category,
                    "harm": object.harm,
                    "center_m": [center.x(), center.y(), center.z()],
                    "n_lidar_points": object.truth.n_lidar_points,
                })
            });
            let measured = &sample.measured;
            samples.push(json!({
                "id": sample.id,
                "time_ns": measured.time_ns,
                "speed_mps": measured.ego_state.speed_mps,
                "n_points": measured.points.len(),
                "sum_of_x_m": measured.points.iter().map(|point| f64::from(point.x_m)).sum::<f64>(),
                "picture_sha256": harmzone::files::sha256_hex(&measured.image.bytes),
                "objects": objects.collect::<Vec<_>>(),
            }));
        }
    }
    json!({
        "format_version": manifest.format_version,
        "labels_version": labels.format_version,
        "splits": splits,
        "samples": samples,
    })
}

fn of_results(version: u32) -> PathBuf {
    formats().join("results").join(version.to_string())
}

fn value_of(all: &impl serde::Serialize) -> Value {
    serde_json::to_value(all).expect("a JSON form")
}

fn boxes_in(path: &Path) -> Vec<(String, Vec<Detection>)> {
    read_predictions(path).expect("boxes").samples
}

/// All that a report, a merge, a comparison of drives and a detector may take from what a version wrote.
fn read_results(folder: &Path) -> Value {
    let scores = Scores::read(&folder.join("scores")).expect("scores");
    let boxes = folder.join("boxes");
    let episode = "downtown-ClearNoon-812457482193.mcap";
    let of_episode = DetectionReader::open(&boxes.join(episode)).expect("boxes of an episode");
    let of_episode: Vec<_> = of_episode.samples().iter().map(|sample| sample.detections.clone()).collect();
    let predictions = boxes_in(&boxes.join("predictions.json"));
    let home = tempfile::tempdir().expect("a temporary folder");
    let [joined, found] = ["joined", "found"].map(|name| home.path().join(name));
    done(&["merge", text(&boxes), "--out", text(&joined)]);
    assert_eq!(boxes_in(&joined.join("predictions.json")), predictions, "joined");
    let (_data_home, data) = data_of(3);
    let checkpoint = folder.join("run/model.safetensors");
    done(&["predict", text(&checkpoint), "--data", text(&data), "--out", text(&found)]);
    let drives = folder.join("drives");
    let outcomes = fs::read_dir(drives.join("truth/outcomes")).expect("a folder").map(|file| {
        let text = read_sealed(&file.expect("a file").path()).expect("a whole outcome");
        let outcome: DriveOutcome = serde_json::from_str(&text).expect("an outcome");
        (outcome.episode.clone(), value_of(&outcome))
    });
    json!({
        "metrics.json": scores.evaluation,
        "source.json": scores.provenance.expect("a file"),
        "faults.json": scores.faults.expect("a file"),
        "sweeps.json": scores.sweeps.expect("a file"),
        "predictions.json": predictions,
        "boxes of the episode": of_episode,
        "drive.json": DriveSummary::read(&drives).expect("drives"),
        "outcomes": outcomes.collect::<serde_json::Map<_, _>>(),
        "boxes of the network": boxes_in(&found.join("predictions.json")),
    })
}

/// Where what is wanted is not found, with both. Numbers may differ in their last digits, as a network's do from one processor to
/// another; further keys are of later versions.
fn difference(found: &Value, wanted: &Value, at: &str) -> Option<String> {
    match (found, wanted) {
        (Value::Object(found), Value::Object(wanted)) => wanted.iter().find_map(|(key, wanted)| {
            difference(found.get(key).unwrap_or(&Value::Null), wanted, &format!("{at}/{key}"))
        }),
        (Value::Array(found), Value::Array(wanted)) if found.len() == wanted.len() => found
            .iter()
            .zip(wanted)
            .enumerate()
            .find_map(|(i, (found, wanted))| difference(found, wanted, &format!("{at}/{i}"))),
        (Value::Number(a), Value::Number(b)) => {
            let (a, b) = (a.as_f64().expect("a number"), b.as_f64().expect("a number"));
            ((a - b).abs() > 1e-3 * (1.0 + b.abs())).then(|| format!("{at}: {a}, not {b}"))
        }
        _ => (found != wanted).then(|| format!("{at}: {found}, not {wanted}")),
    }
}

#[test]
fn results_of_every_version_are_read_as_they_were_meant() {
    let path = formats().join("results/expected.json");
    for version in RESULT_VERSIONS {
        let found = read_results(&of_results(version));
        if version == RESULT_VERSIONS[0] && std::env::var_os("UPDATE_FORMATS").is_some() {
            fs::write(&path, serde_json::to_string(&found).expect("JSON") + "\n").expect("writable");
        }
        let wanted: Value = serde_json::from_str(&fs::read_to_string(&path).expect("a file")).expect("JSON");
        assert_eq!(difference(&found, &wanted, ""), None, "version {version}");
    }
    // Networks of before they had a hash.
    let network = |name: &str| fs::read(of_results(0).join("run").join(name)).expect("a network");
    let (hashed, bare) = (network("model.safetensors"), network("model_without_hash.safetensors"));
    let has_hash = |bytes: &[u8]| bytes.windows(6).any(|window| window == b"sha256");
    assert!(has_hash(&hashed) && !has_hash(&bare));
    let (_home, data) = data_of(3);
    let boxes_of = |name: &str| {
        let (home, file) = (tempfile::tempdir().expect("a folder"), of_results(0).join("run").join(name));
        done(&["predict", text(&file), "--data", text(&data), "--out", text(&home.path().join("p"))]);
        boxes_in(&home.path().join("p/predictions.json"))
    };
    assert_eq!(boxes_of("model.safetensors"), boxes_of("model_without_hash.safetensors"));
}

#[test]
fn results_of_a_newer_version_are_told_with_what_is_read() {
    for file in [
        "scores/metrics.json",
        "scores/faults.json",
        "scores/source.json",
        "boxes/predictions.json",
        "drives/drive.json",
    ] {
        let whole = fs::read_to_string(of_results(1).join(file)).expect("a file");
        assert!(whole.contains("\n  \"format_version\": 1,\n  \"sha256\""), "{file}");
        let body = unseal(&whole).expect("a whole file");
        let body = body.strip_suffix("\n}\n").expect("an object");
        let newer = seal(&format!("{body},\n  \"format_version\": 2\n}}\n"));
        let home = tempfile::tempdir().expect("a temporary folder");
        let path = home.path().join(Path::new(file).file_name().expect("a name"));
        fs::write(&path, newer).expect("writable");
        let told = read_sealed(&path).expect_err("a newer version").to_string();
        assert!(told.contains("format version 2") && told.contains("reads 1"), "{told}");
        assert!(told.ends_with(text(&path)), "{told}");
    }
}

#[test]
fn every_version_is_read_as_it_was_meant() {
    for version in VERSIONS {
        let (_home, data) = data_of(version);
        let path = formats().join(version.to_string()).join("expected.json");
        let found = read(&data);
        if std::env::var_os("UPDATE_FORMATS").is_some() {
            fs::write(&path, serde_json::to_string_pretty(&found).expect("JSON") + "\n").expect("writable");
        }
        let wanted: Value = serde_json::from_str(&fs::read_to_string(path).expect("a file")).expect("JSON");
        assert_eq!(found, wanted, "version {version}");
        let health = health::examine(&data, &Silent).expect("a data set");
        assert_eq!(health.count(health::Severity::Fault), 0, "version {version}: {:?}", health.symptoms);
    }
}

#[test]
fn every_version_is_migrated_to_the_bytes_of_todays() {
    for version in VERSIONS {
        let (_home, data) = data_of(version);
        let before = fs::read(data.join("dataset.json")).expect("a manifest");
        let told = done(&["migrate", text(&data), "--dry-run"]);
        assert!(told.contains(&format!("version {version} -> 3")), "{told}");
        assert!(fs::read(data.join("dataset.json")).expect("a manifest") == before);
        done(&["migrate", text(&data)]);
        for (file, of) in [("dataset.json", "dataset.json"), ("labels/rect/labels.json", "labels.json")] {
            let found = fs::read_to_string(data.join(file)).expect("a manifest");
            let wanted = fs::read_to_string(formats().join("3").join(of)).expect("a manifest");
            assert_eq!(found, wanted, "{file} of version {version}");
        }
        assert!(!data.join("writer.partial").exists());
    }
}

#[test]
fn a_newer_version_is_told_with_those_that_are_read() {
    let (_home, data) = data_of(2);
    let path = data.join("dataset.json");
    let newer = fs::read_to_string(&path)
        .expect("a manifest")
        .replace("\"format_version\": 2", "\"format_version\": 4");
    fs::write(&path, newer).expect("writable");
    let told = fails(&["info", text(&data)]);
    assert!(
        told.contains("format version 4") && told.contains("[1, 2, 3]") && told.contains("dataset.json"),
        "{told}"
    );
    // A manifest of today's version without its hash, or with another's, was changed.
    let (_home, data) = data_of(3);
    let path = data.join("dataset.json");
    let whole = fs::read_to_string(&path).expect("a manifest");
    fs::write(&path, whole.replace("downtown", "oldtown")).expect("writable");
    assert!(fails(&["info", text(&data)]).contains("was changed"));
    let cut = whole.find(",\n  \"sha256\"").expect("a hash at the end");
    fs::write(&path, format!("{}\n}}\n", &whole[..cut])).expect("writable");
    assert!(fails(&["info", text(&data)]).contains("is missing"));
}
