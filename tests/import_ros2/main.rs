//! Bags of ROS 2 that `rosbags` wrote, imported: geometry against what their maker computed, and damage told in words.
//!
//! `tests/data/make_ros2_bags.py` made the bags and the numbers.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod boxes;
mod guesses;
mod poses;

use std::path::{Path, PathBuf};
use std::process::Command;

use fs_err as fs;
use harmzone::config::load;
use harmzone::episode::{EpisodeReader, Split};
use harmzone::geometry::{Frame, Transform};
use harmzone::import::ros2::{MappingConfig, Ros2Log, list};
use harmzone::import::{ImportConfig, ImportError, ImportOptions, ImportSummary, LogFormat, run};
use harmzone::progress::Silent;
use mcap::WriteOptions;
use nalgebra::Matrix4;
use serde::Deserialize;

const NEAR_M: f64 = 1e-3;
const NEAR_RAD: f64 = 1e-6;

#[derive(Deserialize)]
struct Made {
    samples: Vec<MadeSample>,
    speed_mps: f64,
    steering_rad: f64,
    wheelbase_m: f64,
}

#[derive(Deserialize)]
struct MadeSample {
    time_ns: u64,
    world_from_ego: [[f64; 4]; 4],
    ego_from_lidar: [[f64; 4]; 4],
    ego_from_camera: [[f64; 4]; 4],
    k: [[f64; 3]; 3],
    /// x, y, z in the LiDAR frame at the stamp, intensity, ring.
    points: Vec<[f64; 5]>,
    boxes: Option<Vec<MadeBox>>,
}

#[derive(Deserialize)]
struct MadeBox {
    id: String,
    category: String,
    /// x, y, z, length, width, height, yaw in the ego frame.
    r#box: [f64; 7],
}

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/ros2")
}

fn import(
    bag: &Path,
    mapping: Option<MappingConfig>,
    out: &Path,
    skip_bad: bool,
) -> Result<ImportSummary, ImportError> {
    let config = ImportConfig::shipped(LogFormat::Ros2);
    let log = Ros2Log::open(bag, mapping, &config)?;
    let options = ImportOptions { scenes: Vec::new(), split: Split::Test, skip_bad, force: false };
    run(&log, LogFormat::Ros2, &config, out, &options, &Silent)
}

fn plain_mapping() -> MappingConfig {
    load(Some(&data().join("plain_mapping.toml")), &[]).unwrap()
}

fn assert_near<To: Frame, From: Frame>(found: &Transform<To, From>, wanted: [[f64; 4]; 4]) {
    let wanted = Matrix4::from_fn(|row, column| wanted[row][column]);
    let apart = found.isometry.to_homogeneous() - wanted;
    assert!(apart.fixed_view::<3, 3>(0, 0).amax() < NEAR_RAD, "{found:?} {wanted}");
    assert!(apart.fixed_view::<3, 1>(0, 3).amax() < NEAR_M, "{found:?} {wanted}");
}

/// Compares an episode with what the bag's maker computed.
fn compare(episode: &EpisodeReader, made: &Made) {
    assert_eq!(episode.len(), made.samples.len());
    for (sample, wanted) in episode.samples().zip(&made.samples) {
        let sample = sample.unwrap();
        let measured = sample.measured;
        assert_eq!(measured.time_ns, wanted.time_ns);
        assert_near(&measured.world_from_ego, wanted.world_from_ego);
        assert_near(&measured.ego_from_lidar, wanted.ego_from_lidar);
        assert_near(&measured.ego_from_camera, wanted.ego_from_camera);
        let camera = measured.intrinsics;
        let found = [[camera.fx_px, 0.0, camera.cx_px], [0.0, camera.fy_px, camera.cy_px], [0.0, 0.0, 1.0]];
        assert_eq!(found, wanted.k);
        let state = measured.ego_state;
        assert!((state.speed_mps - made.speed_mps).abs() < 1e-5, "{state:?}");
        assert!((state.steering_angle_rad - made.steering_rad).abs() < NEAR_RAD, "{state:?}");
        assert_eq!(state.wheelbase_m, made.wheelbase_m);
        // The reader cuts the cloud to the camera's view; each point is known again by ring and intensity.
        assert!(measured.points.len() > 50, "{}", measured.points.len());
        for point in &measured.points {
            let key = [f64::from(point.intensity), f64::from(point.ring)];
            let wanted = wanted.points.iter().find(|wanted| wanted[3..] == key).unwrap();
            for (found, wanted) in [point.x_m, point.y_m, point.z_m].into_iter().zip(wanted) {
                assert!((f64::from(found) - wanted).abs() < NEAR_M, "{point:?} {wanted:?}");
            }
        }
        let Some(boxes) = &wanted.boxes else {
            assert!(sample.truth.is_none());
            continue;
        };
        let objects = sample.truth.unwrap().objects;
        assert_eq!(objects.len(), boxes.len());
        for wanted in boxes {
            let object = objects.iter().find(|object| object.id.as_deref() == Some(&wanted.id)).unwrap();
            assert_eq!(object.category.as_deref(), Some(wanted.category.as_str()));
            let found = object.box_in_ego;
            let center = found.center;
            let found = [
                center.x(),
                center.y(),
                center.z(),
                found.length_m,
                found.width_m,
                found.height_m,
                found.yaw_rad,
            ];
            for (i, (found, wanted)) in found.iter().zip(wanted.r#box).enumerate() {
                let near = if i == 6 { NEAR_RAD } else { NEAR_M };
                assert!((found - wanted).abs() < near, "{found} {wanted}");
            }
        }
    }
}

fn made(name: &str) -> Made {
    serde_json::from_slice(&fs::read(data().join(format!("{name}.json"))).unwrap()).unwrap()
}

/// What a message becomes: its topic, then its bytes and its schema.
type Change = dyn Fn(&str, &mut Vec<u8>, &mut String, &mut Vec<u8>);

#[test]
fn a_bag_with_types_of_its_own_is_imported_as_its_maker_measured_it() {
    let folder = tempfile::tempdir().unwrap();
    let summary = import(&data().join("plain"), Some(plain_mapping()), folder.path(), false).unwrap();
    assert_eq!((summary.n_samples, summary.n_objects.total()), (5, 10));
    let episode = EpisodeReader::open(&folder.path().join("episodes/plain.mcap")).unwrap();
    compare(&episode, &made("plain"));
    let methods = &episode.log().unwrap().methods;
    assert_eq!(methods["speed"], "measured: `speed_kph` of topic `/vehicle/status`");
    assert!(methods["ground"].contains("0.3 m"), "{methods:?}");
    // bgr8 in padded rows: blue and red at their places.
    let image = episode.sample(4).unwrap().measured.image.decode().unwrap();
    let pixel = image.get_pixel(40, 30).0.map(i32::from);
    assert!(
        pixel.iter().zip([160, 150, 160]).all(|(found, wanted)| (found - wanted).abs() < 12),
        "{pixel:?}"
    );
}

#[test]
fn a_big_endian_split_bag_of_another_style_is_imported_with_its_proposed_mapping() {
    let text = list(&data().join("odd")).unwrap();
    // What a bag cannot say: the unit of a plain number, the car's sizes, the base frame's height.
    let text =
        text.replace("unit = \"rad\"", "unit = \"deg\"").replace("wheelbase_m = 0.0", "wheelbase_m = 2.8");
    let mut mapping: MappingConfig = toml::from_str(&text).unwrap();
    mapping.frames.base_height_m = Some(0.3);
    let folder = tempfile::tempdir().unwrap();
    let summary = import(&data().join("odd"), Some(mapping), folder.path(), false).unwrap();
    let told = |words: &str| summary.notes.iter().any(|note| note.contains(words));
    assert!(told("rings from above") && told("`camera` has a body's axes"), "{:?}", summary.notes);
    let episode = EpisodeReader::open(&folder.path().join("episodes/odd.mcap")).unwrap();
    compare(&episode, &made("odd"));
    let methods = &episode.log().unwrap().methods;
    assert!(
        methods["camera"].contains("P of the camera info") && methods["motion"].contains("moved"),
        "{methods:?}"
    );
    let image = episode.sample(2).unwrap().measured.image.decode().unwrap();
    assert_eq!(image.get_pixel(20, 30).0, [80, 150, 80]);
}

#[test]
fn a_listing_needs_no_folder_and_an_import_does() {
    let plain = data().join("plain");
    let answer = |args: &[&str]| {
        let program = Command::new(env!("CARGO_BIN_EXE_harmzone"))
            .args(["import", "ros2"])
            .arg(&plain)
            .args(args)
            .output();
        let output = program.unwrap();
        (
            output.status.code(),
            String::from_utf8(output.stdout).unwrap(),
            String::from_utf8(output.stderr).unwrap(),
        )
    };
    let (code, text, _) = answer(&["--list"]);
    assert_eq!((code, text.trim_end()), (Some(0), list(&plain).unwrap().trim_end()));
    let (code, _, told) = answer(&[]);
    assert!(code == Some(2) && told.contains("--out <DIR>"), "{told}");
}

#[test]
fn the_listing_is_a_mapping_that_works_as_it_is() {
    let text = list(&data().join("plain")).unwrap();
    for wanted in [
        "# /lidar/points",
        "sensor_msgs/PointCloud2",
        "# Frames (tf):",
        "#   base_link -> lidar (static)",
        "#   odom -> base_link (40 stamps)",
        "`/vehicle/status` with field = \"speed_kph\"",
        "topic = \"/camera/front/image_raw\"",
        "topic = \"/boxes\"",
    ] {
        assert!(text.contains(wanted), "{wanted}\n{text}");
    }
    let mapping: MappingConfig = toml::from_str(&text).unwrap();
    assert_eq!((mapping.frames.base.as_str(), mapping.poses.topic.as_str()), ("base_link", "tf"));
    let folder = tempfile::tempdir().unwrap();
    let summary = import(&data().join("plain"), Some(mapping), folder.path(), false).unwrap();
    assert_eq!(summary.n_samples, 5);
    // Without a mapping, the same is done and told; another mapping is other data.
    let other = import(&data().join("plain"), None, folder.path(), false).unwrap_err().to_string();
    assert!(other.contains("--force"), "{other}");
    let folder = tempfile::tempdir().unwrap();
    let summary = import(&data().join("plain"), None, folder.path(), false).unwrap();
    assert!(summary.notes.iter().any(|note| note.contains("--list")), "{:?}", summary.notes);
}

/// What an import of a bag tells that must fail; nothing is left of it.
fn refusal(bag: &Path, mapping: Option<MappingConfig>) -> String {
    let folder = tempfile::tempdir().unwrap();
    let error = import(bag, mapping, folder.path(), false).unwrap_err().to_string();
    let episodes = fs::read_dir(folder.path().join("episodes")).map_or(0, Iterator::count);
    assert_eq!(episodes, 0, "{error}");
    error
}

#[test]
fn damaged_files_are_told_with_what_mends_them() {
    let folder = tempfile::tempdir().unwrap();
    let whole = fs::read(data().join("plain/plain.mcap")).unwrap();
    let told = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        refusal(&path, Some(plain_mapping()))
    };
    let cut = told("cut.mcap", &whole[..whole.len() / 2]);
    assert!(cut.contains("cut short") && cut.contains("mcap recover"), "{cut}");
    let path = folder.path().join("checked.mcap");
    rewritten(&path, WriteOptions::new(), |_, _, _, _| {});
    let mut flipped = fs::read(&path).unwrap();
    let at = flipped.len() / 4;
    flipped[at] ^= 0xff;
    let flipped = told("flipped.mcap", &flipped);
    assert!(flipped.contains("damaged"), "{flipped}");
    assert!(told("text.mcap", b"no bag at all").contains("no MCAP"));
    assert!(refusal(&folder.path().join("absent.mcap"), None).contains("missing"));
    let empty = tempfile::tempdir().unwrap();
    assert!(refusal(empty.path(), None).contains("metadata.yaml"));
    fs::copy(data().join("odd/metadata.yaml"), empty.path().join("metadata.yaml")).unwrap();
    let missing = refusal(empty.path(), None);
    assert!(missing.contains("missing") && missing.contains("odd_0.mcap"), "{missing}");
    fs::write(empty.path().join("metadata.yaml"), "  storage_identifier: sqlite3\n").unwrap();
    assert!(refusal(empty.path(), None).contains("rosbags-convert"));
}

/// Writes the bag `plain` anew; `change` gets topic, schema text and message of each.
fn rewritten(
    path: &Path,
    options: WriteOptions,
    mut change: impl FnMut(&str, &mut Vec<u8>, &mut String, &mut Vec<u8>),
) {
    let whole = fs::read(data().join("plain/plain.mcap")).unwrap();
    let mut writer = options.create(fs::File::create(path).unwrap()).unwrap();
    for message in mcap::MessageStream::new(&whole).unwrap() {
        let message = message.unwrap();
        let mut schema = message.channel.schema.as_deref().unwrap().clone();
        let mut channel = (*message.channel).clone();
        let mut data = message.data.to_vec();
        let mut text = schema.data.to_vec();
        change(&channel.topic, &mut text, &mut channel.message_encoding, &mut data);
        schema.data = text.into();
        channel.schema = Some(schema.into());
        let message = mcap::Message { channel: channel.into(), data: data.into(), ..message };
        writer.write(&message).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn files_of_other_writers_are_read_or_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.mcap");
    let out = tempfile::tempdir().unwrap();
    let lz4 = WriteOptions::new().compression(Some(mcap::Compression::Lz4));
    rewritten(&path, lz4, |_, _, _, _| {});
    assert_eq!(import(&path, Some(plain_mapping()), out.path(), false).unwrap().n_samples, 5);

    let told = |options: WriteOptions, change: &Change| {
        rewritten(&path, options, change);
        refusal(&path, Some(plain_mapping()))
    };
    let index =
        told(WriteOptions::new().emit_message_indexes(false).emit_chunk_indexes(false), &|_, _, _, _| {});
    assert!(index.contains("no index") && index.contains("mcap recover"), "{index}");
    let index = told(WriteOptions::new().use_chunks(false), &|_, _, _, _| {});
    assert!(index.contains("no index"), "{index}");
    let text = told(WriteOptions::new(), &|topic, text, _, _| {
        if topic == "/lidar/points" {
            text.clear();
        }
    });
    assert!(text.contains("`/lidar/points`") && text.contains("schema text is empty"), "{text}");
    let encoding = told(WriteOptions::new(), &|topic, _, encoding, _| {
        if topic == "/vehicle/status" {
            *encoding = "json".into();
        }
    });
    assert!(encoding.contains("packed as `json`; `cdr` is needed"), "{encoding}");
    let short = told(WriteOptions::new(), &|topic, _, _, data| {
        if topic == "/camera/front/image_raw" {
            data.truncate(200);
        }
    });
    assert!(short.contains("has 200 bytes, which end in the field `data`"), "{short}");
}

#[test]
fn a_mapping_that_does_not_fit_the_bag_is_told() {
    let told = |change: fn(&mut MappingConfig)| {
        let mut mapping = plain_mapping();
        change(&mut mapping);
        refusal(&data().join("plain"), Some(mapping))
    };
    let missing = told(|mapping| mapping.lidar.topic = "/points".into());
    assert!(missing.contains("lidar.topic is `/points`") && missing.contains("`/lidar/points`"), "{missing}");
    let kind = told(|mapping| mapping.lidar.topic = "/boxes".into());
    assert!(kind.contains("of the type `vision_msgs/Detection3DArray`"), "{kind}");
    let field = told(|mapping| mapping.speed.field = "speed".into());
    assert!(field.contains("no field `speed`") && field.contains("`speed_kph`"), "{field}");
    let frame = told(|mapping| mapping.lidar.frame = "velodyne".into());
    assert!(frame.contains("`velodyne` to `base_link`") && frame.contains("odom -> base_link"), "{frame}");
    let fixed = told(|mapping| mapping.frames.fixed = "map".into());
    assert!(fixed.contains("`base_link` to `map`"), "{fixed}");
    let cloud = told(|mapping| mapping.lidar.intensity_field = "amplitude".into());
    assert!(cloud.contains("no field `amplitude`; it has `x`, `y`"), "{cloud}");
    let empty = told(|mapping| mapping.lidar.topic = String::new());
    assert!(empty.contains("--list"), "{empty}");
}

#[test]
fn damaged_messages_are_told() {
    let python = Path::new(env!("CARGO_MANIFEST_DIR")).join(".venv-test/bin/python");
    let folder = tempfile::tempdir().unwrap();
    let script = data().with_file_name("make_ros2_bags.py");
    let made = Command::new(&python).arg(&script).arg(folder.path()).arg("--damaged").output();
    let made =
        made.unwrap_or_else(|error| panic!("{}: {error}; `make setup-test` makes it", python.display()));
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let bag = |name: &str| folder.path().join(name);
    for (name, words) in [
        ("empty_cloud", "the cloud is empty"),
        ("short_cloud", "the cloud has"),
        ("zero_k", "all zero: the camera is not calibrated"),
        ("binned", "a binning of 2 x 2"),
        ("region", "a region [4.0, 0.0, 60.0, 40.0]"),
        ("other_size", "its calibration is for 128 x 96"),
        ("no_tf_path", "gps -> lidar (static)"),
    ] {
        let told = refusal(&bag(name), None);
        assert!(told.contains(words), "{name}: {told}");
    }
    for (name, n_samples, words) in [
        ("nan_points", 3, "are not finite"),
        ("out_of_order", 3, "are taken in the order of stamps"),
        ("late_camera", 2, "1 of 3 clouds lie outside the time of the pictures"),
        ("fisheye", 3, ""),
        ("plumb_bob", 3, ""),
    ] {
        let out = tempfile::tempdir().unwrap();
        let summary = import(&bag(name), None, out.path(), false).unwrap();
        assert_eq!(summary.n_samples, n_samples, "{name}: {:?}", summary.notes);
        assert!(
            words.is_empty() || summary.notes.iter().any(|note| note.contains(words)),
            "{:?}",
            summary.notes
        );
    }
    let out = tempfile::tempdir().unwrap();
    let summary = import(&bag("empty_cloud"), None, out.path(), true).unwrap();
    assert_eq!((summary.n_samples, summary.skipped.len()), (2, 1));
}
