//! What is exported to KITTI and imported again is what it was; predictions too; and what cannot be exported is told.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod made_data;
mod made_drive;

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use fs_err as fs;
use harmzone::episode::{EpisodeReader, EpisodeWriter, Manifest, MapDrawing, Split};
use harmzone::export::kitti::{self, KittiRequest, KittiSummary};
use harmzone::export::nuscenes::Naming;
use harmzone::geometry::{Camera, Ego, Transform};

use harmzone::import::{self, ImportConfig, ImportError, ImportOptions, LogFormat, open_kitti};
use harmzone::object::Object;
use harmzone::progress::Silent;
use harmzone::sample::{EncodedImage, IgnoredRegion, ImageFormat, Sample};
use made_drive::{N_SAMPLES, make_dataset, sample};
use nalgebra::Vector3;
use serde_json::{Value, json};

const TOLERANCE: f64 = 1e-6;

fn export(dataset: &Path, out: &Path) -> KittiSummary {
    let request = KittiRequest { dataset, out, labels: "rect", naming: Naming::Source, force: false };
    kitti::run(&request, &Silent).unwrap()
}

fn import(source: &Path, out: &Path) -> Result<import::ImportSummary, ImportError> {
    let overrides = [
        "labelled.kinds=[\"vehicle\", \"pedestrian\", \"static\"]",
        "categories.car={ kind = \"vehicle\", distribution = \"id\" }",
        "categories.traffic_cone={ kind = \"static\", distribution = \"id\" }",
    ];
    let config = ImportConfig::load(LogFormat::Kitti, None, &overrides.map(str::to_owned)).unwrap();
    let options = ImportOptions { scenes: Vec::new(), split: Split::Test, skip_bad: false, force: false };
    let log = open_kitti(source, &config)?;
    import::run(&log, LogFormat::Kitti, &config, out, &options, &Silent)
}

/// The made data set with a level camera, PNG pictures, an ignored region, and a last sample that nobody annotated left out.
fn make_level(dataset: &Path, folder: &Path) {
    let mut manifest = Manifest::read(dataset).unwrap();
    manifest.episodes.truncate(1);
    let file = &manifest.episodes[0].file;
    let reader = EpisodeReader::open(&dataset.join(file)).unwrap();
    fs::create_dir_all(folder.join("episodes")).unwrap();
    let (log, map) = (reader.log().unwrap(), MapDrawing::default());
    let mut writer = EpisodeWriter::create_log(&folder.join(file), reader.meta(), log, &[], &map).unwrap();
    for sample_idx in 0..N_SAMPLES {
        writer.write(&level_sample(sample_idx)).unwrap();
    }
    let done = writer.finish().unwrap();
    manifest.episodes[0].sha256 = done.sha256;
    manifest.write(folder).unwrap();
}

fn level_sample(sample_idx: usize) -> Sample {
    let (mut sample, _) = sample(sample_idx);
    let measured = &mut sample.measured;
    measured.ego_from_camera = Transform::<Ego, Camera>::looking_forward(Vector3::new(1.7, 0.02, 1.5), 0.0);
    let mut bytes = std::io::Cursor::new(Vec::new());
    measured.image.decode().unwrap().write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    measured.image = EncodedImage { format: ImageFormat::Png, bytes: bytes.into_inner() };
    let region = IgnoredRegion::Image { left_px: 1.25, top_px: 2.0, right_px: 9.5, bottom_px: 7.75 };
    sample.truth.as_mut().unwrap().ignored.push(region);
    sample
}

/// Objects that are in the picture: the car and the cone, not the adult behind.
fn in_view(sample: &Sample) -> &[Object] {
    &sample.objects()[..2]
}

fn assert_same(found: &Sample, wanted: &Sample) {
    let (of, wanted_of) = (&found.measured, &wanted.measured);
    assert_eq!(of.points, wanted_of.points, "points and rings are kept to the bit");
    assert_eq!(of.time_ns, wanted_of.time_ns);
    assert_eq!(of.ego_state, wanted_of.ego_state);
    let apart = [
        of.ego_from_lidar.isometry.to_homogeneous() - wanted_of.ego_from_lidar.isometry.to_homogeneous(),
        of.ego_from_camera.isometry.to_homogeneous() - wanted_of.ego_from_camera.isometry.to_homogeneous(),
        of.world_from_ego.isometry.to_homogeneous() - wanted_of.world_from_ego.isometry.to_homogeneous(),
    ];
    assert!(apart.iter().all(|apart| apart.abs().max() < TOLERANCE), "{apart:?}");
    let k = |of: &harmzone::geometry::Pinhole| [of.fx_px, of.fy_px, of.cx_px, of.cy_px];
    let near =
        k(&of.intrinsics).into_iter().zip(k(&wanted_of.intrinsics)).all(|(a, b)| (a - b).abs() < TOLERANCE);
    assert!(near, "{:?} {:?}", of.intrinsics, wanted_of.intrinsics);
    assert_eq!(of.image.decode().unwrap(), wanted_of.image.decode().unwrap(), "pixels are kept");
    let wanted = in_view(wanted);
    assert_eq!(found.objects().len(), wanted.len());
    for (found, wanted) in found.objects().iter().zip(wanted) {
        let (of, wanted_of) = (&found.box_in_ego, &wanted.box_in_ego);
        assert!((of.center.coords - wanted_of.center.coords).norm() < TOLERANCE, "{of:?} {wanted_of:?}");
        let numbers = [
            (of.yaw_rad, wanted_of.yaw_rad),
            (of.length_m, wanted_of.length_m),
            (of.width_m, wanted_of.width_m),
            (of.height_m, wanted_of.height_m),
        ];
        assert!(numbers.iter().all(|(a, b)| (a - b).abs() < TOLERANCE), "{of:?} {wanted_of:?}");
        assert_eq!((&found.category, found.kind), (&wanted.category, wanted.kind));
    }
}

fn imported(after: &Path, frame: usize) -> Sample {
    let path = after.join(format!("episodes/kitti-{frame:06}.mcap"));
    EpisodeReader::open(&path).unwrap().whole_sample(0).unwrap()
}

#[test]
fn what_comes_back_from_a_pitched_camera_is_what_went_out() {
    let folder = tempfile::tempdir().unwrap();
    let [before, between, after] = ["before", "between", "after"].map(|name| folder.path().join(name));
    make_dataset(&before);
    let summary = export(&before, &between);
    assert_eq!(summary.n_frames, [(Split::Train, N_SAMPLES), (Split::Val, N_SAMPLES)].into());
    assert_eq!((summary.n_labels, summary.n_out_of_view), (4 * N_SAMPLES, 2 * N_SAMPLES));
    assert_eq!((summary.n_unpacked, summary.n_pictures_left_out), (2 * N_SAMPLES, 2 * N_SAMPLES));
    import(&between, &after).unwrap();
    for frame in 0..2 * N_SAMPLES {
        assert_same(&imported(&after, frame), &sample(frame % N_SAMPLES).0);
    }
}

#[test]
fn what_comes_back_from_a_level_camera_is_the_same_to_the_digit_and_byte() {
    let folder = tempfile::tempdir().unwrap();
    let [made, before, between, after] =
        ["made", "before", "between", "after"].map(|name| folder.path().join(name));
    make_dataset(&made);
    make_level(&made, &before);
    let summary = export(&before, &between);
    assert_eq!((summary.n_unpacked, summary.n_ignored_regions), (0, N_SAMPLES));
    import(&between, &after).unwrap();
    for sample_idx in 0..N_SAMPLES {
        let (found, wanted) = (imported(&after, sample_idx), level_sample(sample_idx));
        assert_same(&found, &wanted);
        assert_eq!(found.measured.image, wanted.measured.image, "PNG pictures are kept to the byte");
        assert_eq!(found.measured.intrinsics, wanted.measured.intrinsics);
        assert_eq!(found.truth.unwrap().ignored, wanted.truth.unwrap().ignored);
    }
}

#[test]
fn the_folder_has_kittis_layout_and_says_which_sample_each_frame_is() {
    let folder = tempfile::tempdir().unwrap();
    let [before, out] = ["before", "out"].map(|name| folder.path().join(name));
    make_dataset(&before);
    export(&before, &out);
    let list = |name: &str| fs::read_to_string(out.join(format!("ImageSets/{name}.txt"))).unwrap();
    assert_eq!((list("train").as_str(), list("test")), ("000000\n000001\n000002\n000003\n", list("val")));
    assert_eq!(list("trainval"), list("train") + &list("val"));
    for (part, ending) in [("velodyne", "bin"), ("image_2", "png"), ("calib", "txt"), ("label_2", "txt")] {
        let names: BTreeSet<String> = fs::read_dir(out.join("training").join(part))
            .unwrap()
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        assert_eq!(names, (0..8).map(|frame| format!("{frame:06}.{ending}")).collect(), "{part}");
    }
    let index: Value = serde_json::from_slice(&fs::read(out.join("harmzone.json")).unwrap()).unwrap();
    let frame = &index["frames"][5];
    assert_eq!((frame["frame"].as_str(), frame["episode"].as_str()), (Some("000005"), Some("nowhere-1")));
    assert_eq!(
        (&frame["sample_idx"], &frame["split"], &frame["objects"]),
        (&json!(1), &json!("val"), &json!(["a", "b"]))
    );
    let label = fs::read_to_string(out.join("training/label_2/000005.txt")).unwrap();
    let first: Vec<&str> = label.lines().next().unwrap().split(' ').collect();
    assert_eq!((first.len(), first[0], first[2]), (15, "car", "1"), "visible to 70 %: partly occluded");
}

/// The numbers of a file's lines that begin with a word, by their names.
fn numbers(path: &Path, name: &str) -> Vec<Vec<f64>> {
    let text = fs::read_to_string(path).unwrap();
    let of_line = |line: &str| -> Option<Vec<f64>> {
        let (found, rest) = line.split_once([' ', ':'])?;
        (name.is_empty() || found == name)
            .then(|| rest.split_whitespace().map(|word| word.parse().unwrap()).collect())
    };
    text.lines().filter_map(of_line).collect()
}

#[test]
fn kittis_own_frames_are_exported_as_they_were() {
    let samples = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/samples/kitti");
    if !samples.is_dir() {
        println!("skipped: no frames of KITTI in {}", samples.display());
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let [between, after] = ["between", "after"].map(|name| folder.path().join(name));
    import(&samples, &between).unwrap();
    let summary = export(&between, &after);
    assert_eq!((summary.n_unpacked, summary.n_out_of_view), (0, 0));
    let (theirs, ours) = (samples.join("training"), after.join("testing"));
    let mut n_rows = 0;
    for entry in fs::read_dir(theirs.join("calib")).unwrap() {
        let frame = entry.unwrap().path().file_stem().unwrap().to_string_lossy().into_owned();
        let both = |part: &str, ending: &str| {
            [&theirs, &ours].map(|home| home.join(part).join(format!("{frame}.{ending}")))
        };
        let [theirs, ours] = both("image_2", "png").map(|path| fs::read(path).unwrap());
        assert_eq!(theirs, ours, "pictures to the byte");
        let [theirs, ours] = both("velodyne", "bin").map(|path| fs::read(path).unwrap());
        assert_eq!(theirs.len(), ours.len());
        for (theirs, ours) in theirs.chunks_exact(16).zip(ours.chunks_exact(16)) {
            assert_eq!(theirs[..12], ours[..12], "points to the bit");
        }
        let [theirs, ours] = both("calib", "txt").map(|path| numbers(&path, "P2").remove(0));
        let near = theirs
            .iter()
            .zip(&ours)
            .all(|(theirs, ours)| (theirs - ours).abs() <= 1e-9 * theirs.abs().max(1.0));
        assert!(near, "{theirs:?} {ours:?}");
        let [theirs, ours] = both("label_2", "txt").map(|path| numbers(&path, ""));
        assert_eq!(theirs.len(), ours.len(), "{frame}");
        for (theirs, ours) in theirs.iter().zip(&ours) {
            // From the heights on; the picture's box is the annotator's there and the box's here.
            for column in 7..14 {
                assert!((theirs[column] - ours[column]).abs() < TOLERANCE, "{frame}: {theirs:?} {ours:?}");
            }
            n_rows += 1;
        }
    }
    assert!(n_rows > 20, "{n_rows}");
}

#[test]
fn predictions_come_back_in_their_order_and_unknown_files_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let data = at("data");
    make_dataset(&data);
    let boxes = |sample_idx: usize| {
        let of = |i: usize, x: f64, name: &str, score: f64| {
            json!({"translation": [x + sample_idx as f64, 1.25 - i as f64, 0.8], "size": [1.8, 4.2, 1.5],
                "rotation": [(0.2 * i as f64).cos(), 0.0, 0.0, (0.2 * i as f64).sin()], "velocity": [1.0, 0.0],
                "detection_name": name, "detection_score": score})
        };
        // The second is behind the car, where no picture is.
        json!([of(0, 12.0, "harmful", 0.5), of(1, -9.0, "harmless", 0.5), of(2, 20.0, "harmless", 0.031_25)])
    };
    let results: serde_json::Map<String, Value> =
        (0..N_SAMPLES).map(|i| (format!("nowhere-1/{i}"), boxes(i))).collect();
    let ours = at("predictions.json");
    fs::write(&ours, json!({"meta": {}, "results": results}).to_string()).unwrap();
    let [data_arg, ours_arg, there, back] =
        [&data, &ours, &at("there"), &at("back")].map(|path| path.to_str().unwrap().to_owned());
    let export = ["export", "predictions", &ours_arg, &there, "--data", &data_arg, "--format", "kitti"];
    made_data::done(&export);
    assert!(made_data::fails(&export).contains("--force"));
    let text = fs::read_to_string(at("there/000004.txt")).unwrap();
    assert!(text.starts_with("Harmful -1 -1 ") && text.lines().count() == 3, "{text}");
    assert!(text.lines().nth(1).unwrap().contains(" -1.0000 -1.0000 -1.0000 -1.0000 "), "{text}");
    fs::write(at("there/000099.txt"), "").unwrap();
    let import = ["import", "predictions", &there, "--data", &data_arg, "--format", "kitti", "--out", &back];
    let output = Command::new(made_data::program()).args(import).output().unwrap();
    assert_eq!(output.status.code(), Some(3), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8_lossy(&output.stderr).contains("1 lists of boxes are of no sample"));
    let read = |path: &Path| harmzone::eval::json::read_predictions(path).unwrap().samples;
    let (wanted, found) = (read(&ours), read(&at("back/predictions.json")));
    assert_eq!(wanted.len(), found.len());
    for ((wanted_id, wanted), (id, found)) in wanted.iter().zip(&found) {
        assert_eq!((id, found.len()), (wanted_id, 3));
        for (found, wanted) in found.iter().zip(wanted) {
            let (of, wanted_of) = (&found.box_in_ego, &wanted.box_in_ego);
            assert!((of.center.coords - wanted_of.center.coords).norm() < 1e-7, "{of:?} {wanted_of:?}");
            assert!((of.yaw_rad - wanted_of.yaw_rad).abs() < 1e-7 && found.velocity_in_ego_mps[0].is_nan());
            assert_eq!((found.harm, found.score), (wanted.harm, wanted.score));
        }
    }
}

#[test]
fn what_cannot_be_exported_or_imported_is_told_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let [data, out] = ["data", "out"].map(at);
    make_dataset(&data);
    let request = |naming, force| KittiRequest { dataset: &data, out: &out, labels: "rect", naming, force };
    let told = |request: KittiRequest<'_>| kitti::run(&request, &Silent).unwrap_err().to_string();
    assert!(told(request(Naming::Harm, false)).contains("no label set `rect`"));
    let manifest = Manifest::read(&data).unwrap();
    let mut other = manifest.clone();
    other.episodes[0].n_samples -= 1;
    other.write(&data).unwrap();
    assert!(told(request(Naming::Source, false)).contains("dataset.json says"));
    other.episodes[0].n_samples = 2_000_000;
    other.write(&data).unwrap();
    assert!(told(request(Naming::Source, false)).contains("KITTI numbers 1000000 at most"));
    other.episodes[0] = manifest.episodes[0].clone();
    other.episodes[0].sha256 = "0".repeat(64);
    other.write(&data).unwrap();
    assert!(told(request(Naming::Source, false)).contains("content hash"));
    manifest.write(&data).unwrap();
    let episode = data.join("episodes/nowhere-1.mcap");
    let bytes = fs::read(&episode).unwrap();
    fs::write(&episode, &bytes[..bytes.len() / 2]).unwrap();
    assert!(told(request(Naming::Source, false)).contains("nowhere-1.mcap"));
    fs::write(&episode, bytes).unwrap();
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing half is left");
    fs::create_dir(&out).unwrap();
    fs::write(out.join("thesis.tex"), "").unwrap();
    assert!(told(request(Naming::Source, false)).contains("--force"));
    assert!(
        told(request(Naming::Source, true)).contains("harmzone.json"),
        "a stranger's folder is never replaced"
    );
    fs::remove_dir_all(&out).unwrap();
    for force in [false, true] {
        kitti::run(&request(Naming::Source, force), &Silent).unwrap();
    }
    let notes = out.join("training/notes.txt");
    fs::write(&notes, "mine").unwrap();
    assert!(told(request(Naming::Source, true)).contains("`training/notes.txt`"));
    assert_eq!(fs::read_to_string(&notes).unwrap(), "mine");
    fs::remove_dir_all(&out).unwrap();
    // A result with a column too few, and one of no number.
    let results = at("results");
    fs::create_dir(&results).unwrap();
    let [data_arg, results_arg, back] =
        [&data, &results, &at("back")].map(|path| path.to_str().unwrap().to_owned());
    let import =
        ["import", "predictions", &results_arg, "--data", &data_arg, "--format", "kitti", "--out", &back];
    assert!(made_data::fails(&import).contains("one `NNNNNN.txt` a frame is needed"));
    (4..8).for_each(|frame| fs::write(results.join(format!("{frame:06}.txt")), "").unwrap());
    fs::write(results.join("000006.txt"), "Harmful -1 -1 0 1 2 3 4 1.5 1.8 4.2 0 1.5 9 0").unwrap();
    let message = made_data::fails(&import);
    assert!(message.contains("16 are needed") && message.contains("000006.txt"), "{message}");
    fs::remove_file(results.join("000006.txt")).unwrap();
    assert!(made_data::fails(&import).contains("no list of boxes for 1 samples"));
    assert!(!at("back").exists());
}
