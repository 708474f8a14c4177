//! What an import guesses of bags that mislead it, and what it tells of them. `tests/data/ros2_misleading.py` makes them.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use harmzone::episode::{EpisodeReader, Split};
use harmzone::import::ros2::{FieldMapping, MappingConfig, Ros2Log, list};
use harmzone::import::{ImportConfig, ImportOptions, ImportSummary, LogFormat, run};
use harmzone::progress::Silent;
use tempfile::TempDir;

use super::{data, import, plain_mapping, refusal};

/// The folder of the bags, made once.
fn bags() -> &'static Path {
    static BAGS: OnceLock<PathBuf> = OnceLock::new();
    BAGS.get_or_init(|| {
        let python = Path::new(env!("CARGO_MANIFEST_DIR")).join(".venv-test/bin/python");
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("ros2_misleading");
        let script = data().with_file_name("make_ros2_bags.py");
        let made = Command::new(&python).arg(&script).arg(&folder).arg("--misleading").output();
        let made =
            made.unwrap_or_else(|error| panic!("{}: {error}; `make setup-test` makes it", python.display()));
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        folder
    })
}

struct Imported {
    summary: ImportSummary,
    episode: EpisodeReader,
    _folder: TempDir,
}

impl Imported {
    fn of(name: &str, mapping: Option<MappingConfig>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let summary = import(&bags().join(name), mapping, folder.path(), false).unwrap();
        let episode = EpisodeReader::open(&folder.path().join(format!("episodes/{name}.mcap"))).unwrap();
        Self { summary, episode, _folder: folder }
    }

    fn tells(&self, words: &str) -> bool {
        self.summary.notes.iter().any(|note| note.contains(words))
    }

    fn assert_tells(&self, words: &str) {
        assert!(self.tells(words), "{words}: {:?}", self.summary.notes);
    }

    fn method(&self, part: &str) -> &str {
        &self.episode.log().unwrap().methods[part]
    }
}

fn proposed(name: &str) -> MappingConfig {
    toml::from_str(&list(&bags().join(name)).unwrap()).unwrap()
}

#[test]
fn a_twist_that_nobody_fills_in_is_no_speed() {
    let guessed = Imported::of("zero_twist", None);
    guessed.assert_tells("passed over: `twist.twist.linear.x` of `/odom`, which is 0 throughout");
    assert!(guessed.method("speed").starts_with("from the poses"), "{}", guessed.method("speed"));
    let state = guessed.episode.sample(2).unwrap().measured.ego_state;
    assert!((state.speed_mps - 5.0).abs() < 0.05 && (state.yaw_rate_rps - 0.25).abs() < 1e-6, "{state:?}");
    // What the user names stays, and is told.
    let (topic, field) = ("/odom".to_owned(), "twist.twist.linear.x".to_owned());
    let speed = FieldMapping { topic, field, ..FieldMapping::default() };
    let named = Imported::of("zero_twist", Some(MappingConfig { speed, ..proposed("zero_twist") }));
    named.assert_tells("is 0.00 times what the poses say");
    assert_eq!(named.episode.sample(2).unwrap().measured.ego_state.speed_mps, 0.0);
}

#[test]
fn poses_that_are_none_are_counted_and_speed_and_yaw_rate_added_up() {
    let bag = Imported::of("no_poses", None);
    bag.assert_tells("40 of 40 messages of topic `/odom` hold no pose");
    bag.assert_tells("topic `/odom` tells no pose of any time");
    bag.assert_tells(
        "guessed to be `twist.twist.linear.x` of topic `/odom`, and no poses are there to check it",
    );
    assert!(bag.method("poses").starts_with("speed and yaw rate, added up"), "{}", bag.method("poses"));
    let at = |i: usize| bag.episode.sample(i).unwrap().measured.world_from_ego;
    let way = at(0).inverse() * at(4);
    assert!((way.isometry.translation.vector.norm() - 2.0).abs() < 0.01, "{way:?}");
    assert!((way.yaw_rad() - 0.1).abs() < 0.01, "{way:?}");
}

#[test]
fn a_static_edge_to_the_world_is_no_motion_and_the_assumed_speed_is_told() {
    let mut mapping = proposed("static_map");
    (mapping.poses.topic, mapping.frames.fixed) = ("tf".into(), "map".into());
    let bag = Imported::of("static_map", Some(mapping));
    bag.assert_tells("tf `map` -> `base_link` tells no pose of any time");
    bag.assert_tells("the speed is not known at 5 of 5 samples");
    assert_eq!(bag.episode.sample(0).unwrap().measured.ego_state.speed_mps, 8.0);
}

#[test]
fn the_velocity_of_a_receiver_is_not_the_speed() {
    let bag = Imported::of("gnss_velocity", None);
    bag.assert_tells("passed over: `/gnss/velocity`, by name or frame of a receiver or a command");
    assert!(bag.method("speed").starts_with("unknown; assumed"), "{}", bag.method("speed"));
}

#[test]
fn an_imu_turns_about_the_cars_axis_or_as_the_poses_do() {
    let below = Imported::of("imu_below", None);
    assert!(below.method("yaw_rate").contains("turned by tf into the axes of `base_link`"));
    let state = below.episode.sample(2).unwrap().measured.ego_state;
    assert!((state.yaw_rate_rps - 0.25).abs() < 1e-9, "{state:?}");
    below.assert_tells("guessed to be `twist.linear.x` of topic `/vehicle/twist`");
    let mirrored = Imported::of("imu_mirrored", None);
    mirrored.assert_tells("turns the other way than the poses");
    let state = mirrored.episode.sample(2).unwrap().measured.ego_state;
    assert!((state.yaw_rate_rps - 0.25).abs() < 1e-3, "{state:?}");
    // What the user names stays, and is told.
    let named = Imported::of("imu_mirrored", Some(proposed("imu_mirrored")));
    named.assert_tells("is -1.00 times what the poses say");
    assert!(named.episode.sample(2).unwrap().measured.ego_state.yaw_rate_rps < -0.2);
}

#[test]
fn a_heading_aside_is_told_slow_poses_are_joined_and_a_hole_is_named() {
    Imported::of("heading_aside", None).assert_tells("degrees to the x axis of its poses");
    assert_eq!(Imported::of("slow_poses", None).summary.n_samples, 20);
    let told = refusal(&bags().join("hole"), None);
    assert!(told.contains("the poses have a hole of 2.820 s") && told.contains("up to 1.5 s"), "{told}");
}

#[test]
fn clouds_in_the_worlds_frame_are_passed_over_or_refused() {
    assert_eq!(Imported::of("registered", None).method("lidar"), "topic `/lidar/points`");
    let told = refusal(&bags().join("world_alone"), None);
    assert!(told.contains("`/cloud` are in the frame `odom`, which moves against the car's"), "{told}");
}

#[test]
fn the_upper_lidar_is_taken_and_the_other_is_named() {
    let bag = Imported::of("lidars", None);
    assert_eq!(bag.method("lidar"), "topic `/lidar_top/points`");
    bag.assert_tells("not taken: `/lidar_left/points`");
}

#[test]
fn reflectivity_goes_before_the_number_of_photons() {
    let brightest = |bag: &Imported| {
        let points = bag.episode.sample(0).unwrap().measured.points;
        points.iter().map(|point| point.intensity).fold(0.0, f32::max)
    };
    let bag = Imported::of("ouster", None);
    bag.assert_tells("`reflectivity` is taken");
    assert!(brightest(&bag) > 100.0, "{}", brightest(&bag));
    let mut mapping = proposed("ouster");
    mapping.lidar.intensity_field = "intensity".into();
    let named = Imported::of("ouster", Some(mapping));
    assert!(!named.tells("`reflectivity` is taken") && brightest(&named) < 20.0, "{}", brightest(&named));
}

#[test]
fn places_without_return_have_no_time_and_a_tilted_lidar_keeps_its_rings() {
    let holes = Imported::of("holes_in_cloud", None);
    assert!(holes.method("point_times").contains("the epoch of the stamps"));
    assert!(holes.method("motion").starts_with("each point moved"));
    let tilted = Imported::of("tilted", None);
    assert!(!tilted.tells("do not follow the beams' elevations") && tilted.method("rings") == "the log's");
}

#[test]
fn clouds_without_a_picture_near_them_are_left_out() {
    let bag = Imported::of("slow_camera", None);
    assert_eq!(bag.summary.n_samples, 3);
    bag.assert_tells("2 of 5 clouds have no picture of `/camera/image_raw` within 50 ms");
}

#[test]
fn every_counts_the_samples_with_annotations() {
    let folder = tempfile::tempdir().unwrap();
    let config = ImportConfig { every: 2, ..ImportConfig::shipped(LogFormat::Ros2) };
    let log = Ros2Log::open(&bags().join("boxes_of_some"), None, &config).unwrap();
    let options = ImportOptions { scenes: Vec::new(), split: Split::Test, skip_bad: false, force: false };
    let summary = run(&log, LogFormat::Ros2, &config, folder.path(), &options, &Silent).unwrap();
    assert_eq!((summary.n_samples, summary.n_objects.total()), (1, 2));
    let told = |words: &str| summary.notes.iter().any(|note| note.contains(words));
    assert!(told("3 of 5 samples have no annotations"), "{:?}", summary.notes);
    assert!(told("taken as annotations: topic `/boxes`"), "{:?}", summary.notes);
}

#[test]
fn an_import_that_keeps_nothing_fails() {
    let folder = tempfile::tempdir().unwrap();
    let mut mapping = plain_mapping();
    mapping.lidar.intensity_field = "amplitude".into();
    let told = import(&data().join("plain"), Some(mapping), folder.path(), true).unwrap_err().to_string();
    assert!(told.contains("kept no sample of its 1 drives") && told.contains("left out 5 parts"), "{told}");
}

#[test]
fn annotations_are_known_by_their_name_and_an_id_of_two_boxes_is_none() {
    let bag = Imported::of("same_ids", None);
    bag.assert_tells("taken as annotations: topic `/boxes_gt`");
    bag.assert_tells("give several boxes one id");
    assert_eq!(bag.method("objects"), "topic `/boxes_gt`");
    assert_eq!((bag.summary.n_samples, bag.summary.n_objects.total()), (5, 10));
    let objects = bag.episode.sample(0).unwrap().truth.unwrap().objects;
    assert_ne!(objects[0].id, objects[1].id);
}

#[test]
fn two_recordings_in_one_folder_are_two_drives_with_their_own_mounting() {
    let folder = tempfile::tempdir().unwrap();
    let summary = import(&bags().join("two_drives"), None, folder.path(), false).unwrap();
    assert_eq!((summary.n_episodes, summary.n_samples), (2, 10));
    let lidar_x_m = |name: &str| {
        let episode = EpisodeReader::open(&folder.path().join("episodes").join(name)).unwrap();
        episode.sample(0).unwrap().measured.ego_from_lidar.isometry.translation.x
    };
    let apart_m = lidar_x_m("drive0.mcap") - lidar_x_m("drive1.mcap");
    assert!((apart_m - 0.5).abs() < 0.05, "{apart_m}");
}
