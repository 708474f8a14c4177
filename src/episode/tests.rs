//! Round trips and refusals of the three kinds of files.

use fs_err::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};

use super::archive::ArchiveWriter;
use super::messages::wire;
use super::topics::Topic;
use super::*;
use crate::geometry::{Box3, Pinhole, Point, Point2, Transform};
use crate::object::{BoxSpread, Detection, Distribution, Event, Harm, Kind, Object, SolidPart, Spot};
use crate::sample::{
    Around, EgoState, EncodedImage, IgnoredRegion, ImageFormat, LidarPoint, Measured, Sample, Truth,
};
use nalgebra::Vector3;

pub(super) fn meta() -> EpisodeMeta {
    EpisodeMeta {
        name: "oldtown-ClearNoon-7".into(),
        seed: u64::MAX,
        town: "oldtown".into(),
        weather: "ClearNoon".into(),
        ood: true,
        generator_version: "0.1.0".into(),
        config_toml: "n_samples = 3\n".into(),
        rig_toml: "[cameras.cam_front]\nwidth_px = 800\n".into(),
        n_samples: 3,
        background: String::new(),
    }
}

fn object(id: &str, x_m: f64, kind: Kind, distribution: Distribution) -> Object {
    Object {
        id: Some(id.into()),
        category: Some("hay_bale".into()),
        kind: Some(kind),
        distribution: Some(distribution),
        box_in_ego: Box3 {
            center: Point::new(x_m, -1.0 / 3.0, 0.7),
            length_m: 4.1,
            width_m: 1.9,
            height_m: 1.4,
            yaw_rad: 0.3,
        },
        velocity_in_ego_mps: [0.1, -0.2],
        n_lidar_points: Some(12),
        visible_px: Some(345),
        visible_fraction: Some(f64::from(0.7_f32)), // the file holds 32 bits
        event: Some(if distribution == Distribution::Ood { Event::Rolls } else { Event::None }),
        solid: Some(SolidPart { along_m: 0.4, across_m: -0.1 / 3.0, length_m: 0.7, width_m: 0.3 }),
        clearance_m: (distribution == Distribution::Ood).then_some(2.6),
        spot: Some(Spot::Behind),
        is_tipped: Some(true),
    }
}

pub(super) fn sample(idx: u32) -> Sample {
    let shift = f64::from(idx);
    let measured = Measured {
        time_ns: 1_700_000_000_000_000_001 + u64::from(idx) * 300_000_000,
        ego_state: EgoState {
            speed_mps: 0.1 + shift,
            steering_angle_rad: -0.2,
            yaw_rate_rps: 0.03,
            acceleration_mps2: -1.5,
            wheelbase_m: 2.7,
            front_bumper_x_m: 3.6,
        },
        world_from_ego: Transform::from_xyz_yaw(1.0 / 3.0 + shift, 2.0, 0.1, 2.5),
        ego_from_lidar: Transform::from_xyz_yaw(1.2, 0.0, 1.9, 0.01),
        ego_from_camera: Transform::looking_forward(Vector3::new(1.5, 0.0, 1.6), 0.02),
        intrinsics: Pinhole::from_horizontal_fov(800, 450, 1.22),
        image: EncodedImage { format: ImageFormat::Jpeg, bytes: vec![0xff, 0xd8, 1, 2, 3] },
        points: (0..100u16)
            .map(|i| LidarPoint {
                x_m: 4.0 + f32::from(i) / 3.0,
                y_m: -1.5,
                z_m: 0.1,
                intensity: 254.5,
                ring: i,
            })
            .collect(),
    };
    let objects = vec![
        object("car:1", 10.0 + shift, Kind::Vehicle, Distribution::Id),
        object("hay_bale:2", 2.0, Kind::Static, Distribution::Ood),
    ];
    let corner = |x_m, y_m| Point2 { x_m, y_m };
    let corners_in_ego_m = vec![corner(4.0, 5.0), corner(6.0, 5.0), corner(6.0, 7.0 + shift)];
    let ignored = vec![IgnoredRegion::Ground { corners_in_ego_m }];
    Sample { measured, truth: Some(Truth { objects, ignored, ..Truth::default() }) }
}

pub(super) fn map() -> MapDrawing {
    let at = |x_m, y_m| Point::new(x_m, y_m, 0.0);
    MapDrawing {
        lane_lines: vec![vec![at(0.0, 0.0), at(10.0, 0.0), at(20.0, 1.0)]],
        drivable_area: vec![[at(0.0, 0.0), at(9.0, 0.0), at(9.0, 4.0)]],
    }
}

#[test]
fn a_map_with_a_point_nowhere_is_told() {
    let (_folder, path) = folder();
    let mut nowhere = map();
    nowhere.drivable_area[0][1] = Point::new(f64::NAN, 0.0, 0.0);
    let mut writer = EpisodeWriter::create(&path, &meta(), &nowhere).unwrap();
    writer.write(&sample(0)).unwrap();
    writer.finish().unwrap();
    let error = EpisodeReader::open(&path).unwrap().map().unwrap_err().to_string();
    assert!(error.contains("`point of the map` is [NaN") && error.contains("episode.mcap"), "{error}");
}

fn write_episode(path: &Path, samples: &[Sample]) -> FinishedEpisode {
    let mut writer = EpisodeWriter::create(path, &meta(), &map()).unwrap();
    samples.iter().for_each(|sample| writer.write(sample).unwrap());
    writer.finish().unwrap()
}

pub(super) fn three() -> Vec<Sample> {
    (0..3).map(sample).collect()
}

pub(super) fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("episode.mcap");
    (folder, path)
}

pub(super) fn labels_of(sample: &Sample) -> SampleLabels {
    let corner = |x_m, y_m| Point2 { x_m, y_m };
    let label = |id: &str, harm, overlap_area_m2| ObjectLabel {
        id: id.into(),
        harm,
        overlap_area_m2,
        overlap_ratio: overlap_area_m2 / 7.79,
        time_to_collision_s: (harm == Harm::Harmful).then_some(1.75),
    };
    SampleLabels {
        time_ns: sample.measured.time_ns,
        zone_name: "rect".into(),
        zone_corners: vec![corner(3.6, 1.75), corner(3.6, -1.75), corner(9.0, -1.75), corner(9.0, 1.75)],
        labels: vec![label("car:1", Harm::Harmless, 0.0), label("hay_bale:2", Harm::Harmful, 1.25)],
    }
}

pub(super) fn source(sha256: &str) -> SourceMeta {
    SourceMeta {
        episode: "oldtown-ClearNoon-7".into(),
        episode_sha256: sha256.into(),
        set: "rect".into(),
        config_toml: "width_m = 3.5\n".into(),
        generator_version: "0.1.0".into(),
    }
}

#[test]
fn an_episode_reads_back_exactly() {
    let (_folder, path) = folder();
    let finished = write_episode(&path, &three());
    assert_eq!((finished.n_samples, finished.n_objects.total()), (3, 6));
    assert_eq!(finished.n_objects.ood.static_object, 3);
    assert_eq!(finished.sha256, crate::files::sha256_hex(&fs_err::read(&path).unwrap()));
    let reader = EpisodeReader::open(&path).unwrap();
    assert_eq!((reader.len(), reader.meta()), (3, &meta()));
    assert_eq!(reader.samples().collect::<Result<Vec<_>, _>>().unwrap(), three());
    assert_eq!(reader.sample(1).unwrap(), sample(1));
    assert!(matches!(reader.sample(3), Err(EpisodeError::NoSample { n_samples: 3, .. })));
}

#[test]
fn the_same_samples_give_the_same_bytes() {
    let (_folder, path) = folder();
    let first = write_episode(&path, &three());
    assert_eq!(write_episode(&path, &three()).sha256, first.sha256);
    assert_ne!(write_episode(&path, &three()[..2]).sha256, first.sha256);
}

#[test]
fn an_unfinished_episode_leaves_nothing() {
    let (folder, path) = folder();
    let mut writer = EpisodeWriter::create(&path, &meta(), &map()).unwrap();
    writer.write(&sample(0)).unwrap();
    drop(writer);
    assert_eq!(fs_err::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_file_cut_short_anywhere_is_refused_with_its_path() {
    let (_folder, path) = folder();
    write_episode(&path, &three());
    let bytes = fs_err::read(&path).unwrap();
    for n_bytes in [0, 1, 100, bytes.len() / 2, bytes.len() - 1] {
        fs_err::write(&path, &bytes[..n_bytes]).unwrap();
        let message = EpisodeReader::open(&path).err().expect("a cut file is refused").to_string();
        assert!(message.contains("cut short") && message.ends_with("episode.mcap"), "{n_bytes}: {message}");
    }
}

#[test]
fn a_flipped_byte_in_a_chunk_is_found() {
    let (_folder, path) = folder();
    write_episode(&path, &three());
    let mut bytes = fs_err::read(&path).unwrap();
    let archive = EpisodeReader::open(&path).unwrap();
    assert!(archive.samples().all(|sample| sample.is_ok()));
    let middle = bytes.len() / 4;
    bytes[middle] ^= 0x55;
    fs_err::write(&path, &bytes).unwrap();
    let read = EpisodeReader::open(&path).and_then(|reader| reader.samples().collect::<Result<Vec<_>, _>>());
    assert!(matches!(read, Err(EpisodeError::Damaged { .. })), "{:?}", read.map(|samples| samples.len()));
}

/// Flips one bit of each byte in turn: whatever is still readable must equal what was written, and errors
/// name the file.
fn flip_each_byte<T: PartialEq + std::fmt::Debug>(path: &Path, read: impl Fn() -> Result<T, EpisodeError>) {
    let (whole, expected) = (fs_err::read(path).unwrap(), read().unwrap());
    let file = fs_err::OpenOptions::new().write(true).open(path).unwrap();
    for (at, &byte) in (0..).zip(&whole) {
        file.write_all_at(&[byte ^ 0x40], at).unwrap();
        match read() {
            Ok(found) => assert_eq!(found, expected, "byte {at}"),
            Err(error) => assert!(error.to_string().contains("episode.mcap"), "byte {at}: {error}"),
        }
        file.write_all_at(&[byte], at).unwrap();
    }
}

#[test]
fn a_flipped_bit_anywhere_is_an_error_or_changes_nothing() {
    let (_folder, path) = folder();
    write_episode(&path, &three()[..1]);
    flip_each_byte(&path, || EpisodeReader::open(&path)?.sample(0));
    let mut writer = LabelWriter::create(&path, &source("abc")).unwrap();
    writer.write(&labels_of(&sample(0)), &sample(0)).unwrap();
    writer.finish().unwrap();
    flip_each_byte(&path, || Ok(LabelReader::open(&path)?.samples().to_vec()));
}

#[test]
fn a_foreign_mcap_is_refused_with_its_topics() {
    let (_folder, path) = folder();
    let other: Topic<wire::EgoState> = Topic::new("/other");
    let mut archive = ArchiveWriter::create(&path, &[other.spec()]).unwrap();
    archive.begin_sample(5).unwrap();
    archive.write(other, &wire::EgoState::default()).unwrap();
    archive.finish(Vec::<(String, _)>::new()).unwrap();
    let message = EpisodeReader::open(&path).err().expect("no episode").to_string();
    assert!(message.contains("/other") && message.contains("/lidar_top"), "{message}");
    assert!(LabelReader::open(&path).unwrap_err().to_string().contains("/harm/labels"));
    assert!(DetectionReader::open(&path).unwrap_err().to_string().contains("/detections"));
}

#[test]
fn a_file_without_an_index_says_how_to_add_one() {
    let (_folder, path) = folder();
    let options = mcap::WriteOptions::new().emit_summary_records(false).emit_summary_offsets(false);
    options.create(fs_err::File::create(&path).unwrap()).unwrap().finish().unwrap();
    let message = EpisodeReader::open(&path).err().expect("no index").to_string();
    assert!(message.contains("no index"), "{message}");
}

/// Writes an episode whose second sample is `broken`, unchecked, and returns the reader's error.
fn error_on_reading(broken: Sample) -> String {
    let (_folder, path) = folder();
    let mut writer = EpisodeWriter::create(&path, &meta(), &map()).unwrap();
    writer.write(&sample(0)).unwrap();
    assert!(writer.write(&broken).is_err(), "the writer refuses it too");
    writer.write_unchecked(&broken, Around::default()).unwrap();
    writer.finish().unwrap();
    let reader = EpisodeReader::open(&path).unwrap();
    assert!(reader.sample(0).is_ok());
    reader.sample(1).unwrap_err().to_string()
}

#[test]
fn a_nan_in_the_speed_names_episode_sample_and_field() {
    let mut broken = sample(1);
    broken.measured.ego_state.speed_mps = f64::NAN;
    let message = error_on_reading(broken);
    for part in ["oldtown-ClearNoon-7", "sample 1", "`speed_mps` is NaN", "episode.mcap"] {
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn a_nan_or_empty_box_names_the_object_and_field() {
    let mut broken = sample(1);
    broken.truth.as_mut().unwrap().objects[1].box_in_ego.width_m = f64::NAN;
    let message = error_on_reading(broken);
    assert!(message.contains("object `hay_bale:2`: `width_m` is NaN"), "{message}");
    let mut broken = sample(1);
    broken.truth.as_mut().unwrap().objects[0].box_in_ego.height_m = 0.0;
    assert!(error_on_reading(broken).contains("object `car:1`: `height_m` is 0; a size above zero"));
}

#[test]
fn an_unspecified_enum_is_refused() {
    let mut messages = objects::objects_message(0, sample(0).objects()).objects;
    messages[0].kind = 0;
    let fault = objects::object_of(messages[0].clone()).unwrap_err();
    assert_eq!((fault.object.as_deref(), fault.field), (Some("car:1"), "kind"));
    messages[1].distribution = 0;
    assert_eq!(objects::object_of(messages[1].clone()).unwrap_err().field, "distribution");
    assert_eq!(objects::harm_of(0).unwrap_err().field, "harm");
    assert_eq!(objects::harm_of(9).unwrap_err().field, "harm");
}

#[test]
fn a_topic_with_fewer_messages_than_samples_is_refused() {
    let (_folder, path) = folder();
    let mut writer = EpisodeWriter::create(&path, &meta(), &map()).unwrap();
    writer.write(&sample(0)).unwrap();
    writer.extra_objects_for_test();
    writer.finish().unwrap();
    let message = EpisodeReader::open(&path).err().expect("counts differ").to_string();
    assert!(message.contains("`/truth/objects` holds 2 messages; 1 are needed"), "{message}");
}

#[test]
fn times_must_advance_and_ids_differ() {
    let (_folder, path) = folder();
    let mut writer = EpisodeWriter::create(&path, &meta(), &map()).unwrap();
    writer.write(&sample(1)).unwrap();
    assert!(matches!(writer.write(&sample(1)), Err(EpisodeError::TimeOrder { sample_idx: 1, .. })));
    let mut twins = sample(2);
    twins.truth.as_mut().unwrap().objects[1].id = Some("car:1".into());
    assert!(writer.write(&twins).unwrap_err().to_string().contains("object `car:1`"));
    let empty = EpisodeWriter::create(&path, &meta(), &map()).unwrap();
    assert!(matches!(empty.finish(), Err(EpisodeError::Empty { .. })));
}

#[test]
fn labels_read_back_exactly_and_only_for_their_episode() {
    let (_folder, path) = folder();
    let mut writer = LabelWriter::create(&path, &source("abc")).unwrap();
    three().iter().for_each(|sample| writer.write(&labels_of(sample), sample).unwrap());
    writer.finish().unwrap();
    let reader = LabelReader::open(&path).unwrap();
    assert_eq!(reader.meta(), &source("abc"));
    assert_eq!(reader.samples(), three().iter().map(labels_of).collect::<Vec<_>>());
    assert!(reader.check_episode("abc").is_ok());
    assert!(reader.check_episode("def").unwrap_err().to_string().contains("abc, not def"));
}

#[test]
fn labels_that_are_not_one_for_each_object_are_refused() {
    let (_folder, path) = folder();
    let mut writer = LabelWriter::create(&path, &source("abc")).unwrap();
    let mut labels = labels_of(&sample(0));
    labels.labels.pop();
    let message = writer.write(&labels, &sample(0)).unwrap_err().to_string();
    assert!(message.contains("1 labels for 2 objects"), "{message}");
    let late = labels_of(&sample(1));
    assert!(writer.write(&late, &sample(0)).unwrap_err().to_string().contains("the sample's time"));
}

#[test]
fn detections_read_back_exactly() {
    let (_folder, path) = folder();
    let detection = |score| Detection {
        box_in_ego: sample(0).objects()[0].box_in_ego,
        velocity_in_ego_mps: [1.0, -0.1],
        harm: Harm::Harmful,
        score,
        // As floats hold them.
        spread: Some(BoxSpread {
            x_m: 0.5,
            y_m: 0.25,
            z_m: 0.125,
            length: 0.25,
            width: 0.125,
            height: 0.0625,
            yaw_rad: 0.5,
        }),
    };
    let all: Vec<SampleDetections> = three()
        .iter()
        .map(|sample| SampleDetections {
            time_ns: sample.measured.time_ns,
            detections: vec![detection(f64::from(0.9_f32)), detection(0.0)],
        })
        .chain([SampleDetections { time_ns: u64::MAX, detections: vec![] }])
        .collect();
    let mut writer = DetectionWriter::create(&path, &source("abc")).unwrap();
    all.iter().for_each(|sample| writer.write(sample).unwrap());
    let bad = SampleDetections { time_ns: u64::MAX, detections: vec![detection(f64::NAN)] };
    assert!(writer.write(&bad).unwrap_err().to_string().contains("`score` is NaN"));
    writer.finish().unwrap();
    let reader = DetectionReader::open(&path).unwrap();
    assert_eq!(reader.samples(), all);
    assert!(reader.check_episode("def").is_err());
}
