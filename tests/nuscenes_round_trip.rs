//! What is exported to nuScenes and imported again is what it was; folders that are damaged are told, and leave nothing.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod made_drive;

use std::path::Path;

use fs_err as fs;
use harmzone::episode::{EpisodeReader, Split};
use harmzone::export::nuscenes::{self, Naming, NuScenesRequest, Release};
use harmzone::geometry::Box3;
use harmzone::import::nuscenes::NuScenesLog;
use harmzone::import::{self, ImportConfig, ImportError, ImportOptions, LogFormat};
use harmzone::progress::Silent;
use harmzone::sample::Measured;
use made_drive::{N_SAMPLES, make_dataset, sample};
use serde_json::Value;

const TOLERANCE: f64 = 1e-6;

/// The data set as a mini nuScenes.
fn export(dataset: &Path, out: &Path) {
    let request = NuScenesRequest {
        dataset,
        out,
        labels: "rect",
        naming: Naming::Source,
        release: Release::Mini,
        force: false,
    };
    let summary = nuscenes::run(&request, &Silent).unwrap();
    assert_eq!((summary.n_samples, summary.n_annotations), (2 * N_SAMPLES, 6 * N_SAMPLES));
    assert_eq!(summary.black_cameras.len(), 4);
}

fn import(source: &Path, out: &Path) -> Result<import::ImportSummary, ImportError> {
    let overrides = ["cameras=[\"CAM_BACK\"]"];
    let config = ImportConfig::load(LogFormat::Nuscenes, None, &overrides.map(str::to_owned)).unwrap();
    let options = ImportOptions { scenes: Vec::new(), split: Split::Test, skip_bad: false, force: false };
    let log = NuScenesLog::open(source, &config)?;
    import::run(&log, LogFormat::Nuscenes, &config, out, &options, &Silent)
}

fn assert_near(a: f64, b: f64, what: &str) {
    assert!((a - b).abs() < TOLERANCE, "{what}: {a} against {b}");
}

#[test]
fn what_comes_back_is_what_went_out() {
    let folder = tempfile::tempdir().unwrap();
    let [before, between, after] = ["before", "between", "after"].map(|name| folder.path().join(name));
    make_dataset(&before);
    export(&before, &between);
    let summary = import(&between, &after).unwrap();
    assert_eq!((summary.n_episodes, summary.n_samples), (2, 2 * N_SAMPLES));
    for scene in ["scene-0061", "scene-0103"] {
        let reader = EpisodeReader::open(&after.join(format!("episodes/{scene}.mcap"))).unwrap();
        for sample_idx in 0..N_SAMPLES {
            let (wanted, wanted_views) = sample(sample_idx);
            let found = reader.whole_sample(sample_idx).unwrap();
            compare_measured(&found.measured, &wanted.measured);
            let views = reader.views(sample_idx).unwrap();
            assert_eq!(views[0].image, wanted_views[0].image);
            let apart = views[0].ego_from_camera.isometry.to_homogeneous()
                - wanted_views[0].ego_from_camera.isometry.to_homogeneous();
            assert!(apart.abs().max() < TOLERANCE, "{apart}");
            assert_eq!(found.objects().len(), 3);
            for (found, wanted) in found.objects().iter().zip(wanted.objects()) {
                compare_boxes(&found.box_in_ego, &wanted.box_in_ego);
                assert_eq!((found.kind, found.distribution), (wanted.kind, wanted.distribution));
            }
        }
        assert!(reader.log().unwrap().sample_name(reader.times_ns()[0]).is_some());
    }
}

#[test]
fn a_set_without_pictures_of_the_front_is_imported_with_black_ones() {
    let folder = tempfile::tempdir().unwrap();
    let [before, between, after] = ["before", "between", "after"].map(|name| folder.path().join(name));
    make_dataset(&before);
    export(&before, &between);
    fs::remove_dir_all(between.join("samples/CAM_FRONT")).unwrap();
    let summary = import(&between, &after).unwrap();
    assert!(summary.notes.iter().any(|note| note.contains("no pictures of CAM_FRONT")), "{summary:?}");
    let reader = EpisodeReader::open(&after.join("episodes/scene-0061.mcap")).unwrap();
    let (found, (wanted, _)) = (reader.whole_sample(0).unwrap().measured, sample(0));
    assert_eq!(found.intrinsics, wanted.measured.intrinsics);
    assert!(found.image.decode().unwrap().iter().all(|value| *value == 0));
}

fn compare_measured(found: &Measured, wanted: &Measured) {
    assert_eq!(found.points, wanted.points, "points are kept to the bit");
    assert_eq!(found.image, wanted.image, "pictures are kept to the byte");
    assert_eq!(found.intrinsics, wanted.intrinsics);
    let mounts = [
        found.ego_from_lidar.isometry.to_homogeneous() - wanted.ego_from_lidar.isometry.to_homogeneous(),
        found.ego_from_camera.isometry.to_homogeneous() - wanted.ego_from_camera.isometry.to_homogeneous(),
    ];
    assert!(mounts.iter().all(|apart| apart.abs().max() < TOLERANCE), "{mounts:?}");
    let (found, wanted) = (&found.ego_state, &wanted.ego_state);
    assert_near(found.speed_mps, wanted.speed_mps, "speed");
    assert_near(found.steering_angle_rad, wanted.steering_angle_rad, "steering");
    assert_near(found.yaw_rate_rps, wanted.yaw_rate_rps, "yaw rate");
    assert_near(found.acceleration_mps2, wanted.acceleration_mps2, "acceleration");
    assert_eq!((found.wheelbase_m, found.front_bumper_x_m), (wanted.wheelbase_m, wanted.front_bumper_x_m));
}

fn compare_boxes(found: &Box3<harmzone::geometry::Ego>, wanted: &Box3<harmzone::geometry::Ego>) {
    assert!((found.center.coords - wanted.center.coords).norm() < TOLERANCE, "{found:?} {wanted:?}");
    assert_near(found.yaw_rad, wanted.yaw_rad, "yaw");
    let sizes = |of: &Box3<_>| [of.length_m, of.width_m, of.height_m];
    assert_eq!(sizes(found), sizes(wanted));
}

/// A table of an export, to be spoilt.
fn change(export: &Path, table: &str, act: impl Fn(&mut Vec<Value>)) {
    let path = export.join(format!("v1.0-mini/{table}.json"));
    let mut rows: Vec<Value> = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    act(&mut rows);
    fs::write(path, serde_json::to_vec(&rows).unwrap()).unwrap();
}

/// A file of a sensor of an export.
fn some_file(export: &Path, channel: &str) -> std::path::PathBuf {
    let folder = fs::read_dir(export.join("samples").join(channel)).unwrap();
    let mut files: Vec<_> = folder.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files.remove(0)
}

/// Gives the files of a channel another name.
fn name_files(export: &Path, channel: &str, name: &str) {
    change(export, "sample_data", |rows| {
        for row in rows.iter_mut().filter(|row| row["filename"].as_str().unwrap().contains(channel)) {
            row["filename"] = name.into();
        }
    });
}

#[test]
fn damage_is_told_and_leaves_nothing_half() {
    type Damage = fn(&Path);
    let cases: [(&str, Damage, &[&str]); 15] = [
        (
            "a missing table",
            |export| fs::remove_file(export.join("v1.0-mini/ego_pose.json")).unwrap(),
            &["no table `ego_pose.json`"],
        ),
        (
            "a missing row",
            |export| change(export, "instance", |rows| drop(rows.remove(0))),
            &["no row", "`instance`", "sample_annotation", "instance.json"],
        ),
        (
            "a missing pose",
            |export| change(export, "ego_pose", |rows| drop(rows.remove(0))),
            &["no row", "`ego_pose`", "ego_pose.json"],
        ),
        (
            "a missing sample",
            |export| change(export, "sample", |rows| drop(rows.remove(1))),
            &["no row", "`sample`"],
        ),
        (
            "a row twice",
            |export| change(export, "category", |rows| rows.push(rows[0].clone())),
            &["there twice", "category.json"],
        ),
        (
            "broken JSON",
            |export| fs::write(export.join("v1.0-mini/scene.json"), "[{\"token\": 3").unwrap(),
            &["scene.json", "line 1"],
        ),
        (
            "a missing key",
            |export| {
                change(export, "sample_annotation", |rows| {
                    drop(rows[2].as_object_mut().unwrap().remove("size"));
                });
            },
            &["row 2", "`size`", "sample_annotation.json"],
        ),
        (
            "a quaternion of length 2",
            |export| change(export, "calibrated_sensor", |rows| rows[0]["rotation"] = [2, 0, 0, 0].into()),
            &["length 2", "calibrated_sensor.json"],
        ),
        (
            "a pose that is NaN",
            |export| {
                let path = export.join("v1.0-mini/ego_pose.json");
                let text = fs::read_to_string(&path).unwrap().replacen(
                    "\"translation\":[",
                    "\"translation\":[NaN,",
                    1,
                );
                fs::write(path, text).unwrap();
            },
            &["row 0", "ego_pose.json"],
        ),
        (
            "a cloud cut short",
            |export| {
                let path = some_file(export, "LIDAR_TOP");
                let bytes = fs::read(&path).unwrap();
                fs::write(path, &bytes[..bytes.len() - 7]).unwrap();
            },
            &["no multiple of 20", "LIDAR_TOP"],
        ),
        (
            "a missing picture",
            |export| fs::remove_file(some_file(export, "CAM_FRONT")).unwrap(),
            &["missing", "CAM_FRONT"],
        ),
        (
            "a picture of another size",
            |export| {
                change(export, "sample_data", |rows| {
                    for row in rows
                        .iter_mut()
                        .filter(|row| row["filename"].as_str().unwrap().contains("CAM_FRONT__"))
                    {
                        row["width"] = 64.into();
                    }
                });
            },
            &["64"],
        ),
        (
            "a file outside of the folder",
            |export| name_files(export, "CAM_FRONT__", "../../etc/passwd"),
            &["`../../etc/passwd`", "without `..`", "v1.0-mini/sample_data.json"],
        ),
        (
            "a file from the root on",
            |export| name_files(export, "LIDAR_TOP__", "/etc/passwd"),
            &["`/etc/passwd`", "without `..`", "v1.0-mini/sample_data.json"],
        ),
        (
            "a scene's name with a slash",
            |export| change(export, "scene", |rows| rows[0]["name"] = "../scene-0061".into()),
            &["`../scene-0061`", "scene.json"],
        ),
    ];
    let folder = tempfile::tempdir().unwrap();
    let before = folder.path().join("before");
    make_dataset(&before);
    for (what, damage, words) in cases {
        let (broken, after) = (folder.path().join("broken"), folder.path().join("after"));
        export(&before, &broken);
        damage(&broken);
        let told = import(&broken, &after).err().unwrap_or_else(|| panic!("{what} is not told")).to_string();
        assert!(words.iter().all(|word| told.contains(word)), "{what}: {told}");
        let left = fs::read_dir(after.join("episodes")).map(Iterator::count).unwrap_or_default();
        assert_eq!(left, 0, "{what} left an episode");
        fs::remove_dir_all(&broken).unwrap();
        let _ = fs::remove_dir_all(&after);
    }
}

#[test]
fn an_export_is_not_overwritten_and_a_strangers_folder_never() {
    let folder = tempfile::tempdir().unwrap();
    let [before, out] = ["before", "out"].map(|name| folder.path().join(name));
    make_dataset(&before);
    export(&before, &out);
    let request = |force| NuScenesRequest {
        dataset: &before,
        out: &out,
        labels: "rect",
        naming: Naming::Kinds,
        release: Release::Full,
        force,
    };
    let told = nuscenes::run(&request(false), &Silent).unwrap_err().to_string();
    assert!(told.contains("--force"), "{told}");
    let summary = nuscenes::run(&request(true), &Silent).unwrap();
    assert!(summary.versions.keys().eq(["v1.0-test", "v1.0-trainval"].iter()), "{summary}");
    assert!(!out.join("v1.0-mini").exists());
    let harm = NuScenesRequest { naming: Naming::Harm, ..request(true) };
    let told = nuscenes::run(&harm, &Silent).unwrap_err().to_string();
    assert!(told.contains("no label set `rect`"), "{told}");
    assert!(out.join("v1.0-trainval").exists(), "what was there stays");
    let notes = out.join("samples/notes.txt");
    fs::write(&notes, "mine").unwrap();
    let told = nuscenes::run(&request(true), &Silent).unwrap_err().to_string();
    assert!(told.contains("`samples/notes.txt`"), "{told}");
    assert_eq!(fs::read_to_string(&notes).unwrap(), "mine");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "nothing half is left");
}
