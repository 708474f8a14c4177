//! Data sets of every format ever released are read as they were meant, and written anew in today's; newer ones are refused.

mod made_data;

use std::path::{Path, PathBuf};

use fs_err as fs;
use harmzone::dataset::{Dataset, health};
use harmzone::episode::manifest::LabelManifest;
use harmzone::episode::{Manifest, Split};
use harmzone::progress::Silent;
use made_data::{done, fails, text};
use serde_json::{Value, json};

const VERSIONS: [u32; 3] = [1, 2, 3];

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
