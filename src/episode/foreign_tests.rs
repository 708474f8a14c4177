//! Episodes from logs and by other writers: what is read all the same, and what is refused.

use std::path::Path;

use foxglove::messages as fox;
use fs_err as fs;
use mcap::records::{MessageHeader, Record};
use nalgebra::Vector3;
use prost::Message as _;

use super::tests::{folder, map, meta, sample, three};
use super::*;
use crate::geometry::{Pinhole, Point2, Transform};
use crate::object::Kind;
use crate::sample::{Around, CameraView, EncodedImage, IgnoredRegion, ImageFormat, Sample};

fn log(labelled: Option<Labelled>) -> LogFacts {
    LogFacts {
        format: "ros2".into(),
        drive: "bag".into(),
        methods: [("speed".to_owned(), "from /odom".to_owned())].into(),
        labelled,
        first_cloud_sha256: String::new(),
        sample_names: [].into(),
    }
}

fn labelled() -> Labelled {
    let size = SizeRange { length_m: [1.0, 20.0], width_m: [0.5, 4.0], height_m: [0.5, 5.0] };
    Labelled {
        kinds: vec![Kind::Vehicle],
        categories: vec!["Car".into()],
        max_range_m: Some(80.0),
        in_camera_view: true,
        sizes: [(Kind::Vehicle, size)].into(),
    }
}

fn write_log(
    path: &Path,
    facts: &LogFacts,
    samples: &[Sample],
    views: &[CameraView],
) -> Result<(), EpisodeError> {
    let cameras: Vec<String> = views.iter().map(|view| view.name.clone()).collect();
    let mut writer = EpisodeWriter::create_log(path, &meta(), facts, &cameras, &map())?;
    samples.iter().try_for_each(|sample| writer.write_with(sample, views))?;
    writer.finish().map(drop)
}

/// Writes the simulated episode again with its messages' log times and bytes changed by topic.
fn rewrite(path: &Path, mut change: impl FnMut(&str, &mut u64, &mut Vec<u8>)) {
    let mut writer = EpisodeWriter::create(path, &meta(), &map()).unwrap();
    three().iter().for_each(|sample| writer.write(sample).unwrap());
    writer.finish().unwrap();
    let bytes = fs::read(path).unwrap();
    let mut writer = mcap::WriteOptions::new().create(fs::File::create(path).unwrap()).unwrap();
    for message in mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap) {
        let channel = &message.channel;
        let schema = channel.schema.as_ref().unwrap();
        let schema = writer.add_schema(&schema.name, &schema.encoding, &schema.data).unwrap();
        let id = writer.add_channel(schema, &channel.topic, "protobuf", &channel.metadata).unwrap();
        let (mut time_ns, mut data) = (message.log_time, message.data.to_vec());
        change(&channel.topic, &mut time_ns, &mut data);
        let header = MessageHeader { channel_id: id, sequence: 0, log_time: time_ns, publish_time: time_ns };
        writer.write_to_known_channel(&header, &data).unwrap();
    }
    for record in mcap::read::LinearReader::new(&bytes).unwrap().map(Result::unwrap) {
        if let Record::Metadata(metadata) = record {
            writer.write_metadata(&metadata).unwrap();
        }
    }
    writer.finish().unwrap();
}

/// Writes the simulated episode again with its clouds changed.
fn rewrite_clouds(path: &Path, change: impl Fn(&mut fox::PointCloud)) {
    rewrite(path, |topic, _, data| {
        if topic == "/lidar_top" {
            let mut cloud = fox::PointCloud::decode(data.as_slice()).unwrap();
            change(&mut cloud);
            *data = cloud.encode_to_vec();
        }
    });
}

fn refusal(path: &Path) -> String {
    EpisodeReader::open(path).unwrap().sample(1).unwrap_err().to_string()
}

#[test]
fn a_log_reads_back_with_its_facts_regions_and_cameras() {
    let (_folder, path) = folder();
    let facts = log(Some(labelled()));
    let mut written = sample(0);
    let ground = [[1.0, 0.0], [2.0, 0.0], [2.0, 1.0]].map(|[x_m, y_m]| Point2 { x_m, y_m }).to_vec();
    written.truth.as_mut().unwrap().ignored = vec![
        IgnoredRegion::Image { left_px: 1.5, top_px: 2.0, right_px: 30.0, bottom_px: 40.25 },
        IgnoredRegion::Ground { corners_in_ego_m: ground },
    ];
    let back = Transform::looking_forward(Vector3::new(-0.5, 0.0, 1.6), 0.1);
    let view = CameraView {
        name: "cam_back".into(),
        ego_from_camera: back,
        intrinsics: Pinhole::from_horizontal_fov(400, 200, 1.5),
        image: EncodedImage { format: ImageFormat::Jpeg, bytes: vec![0xff, 0xd8, 9] },
    };
    write_log(&path, &facts, std::slice::from_ref(&written), std::slice::from_ref(&view)).unwrap();
    let reader = EpisodeReader::open(&path).unwrap();
    assert_eq!((reader.log(), reader.cameras()), (Some(&facts), &["cam_back".to_owned()][..]));
    assert_eq!((reader.sample(0).unwrap(), reader.views(0).unwrap()), (written, vec![view]));
}

#[test]
fn a_log_without_truth_has_none_and_truth_does_not_come_and_go() {
    let (_folder, path) = folder();
    let bare = Sample { truth: None, ..sample(0) };
    write_log(&path, &log(None), std::slice::from_ref(&bare), &[]).unwrap();
    let reader = EpisodeReader::open(&path).unwrap();
    assert!(!reader.has_truth());
    assert_eq!(reader.sample(0).unwrap(), bare);
    for (facts, sample) in [(log(None), sample(0)), (log(Some(labelled())), bare)] {
        let error = write_log(&path, &facts, &[sample], &[]).unwrap_err().to_string();
        assert!(error.contains("`truth`"), "{error}");
    }
}

#[test]
fn unknown_visibility_is_told_from_none() {
    let (_folder, path) = folder();
    let mut written = sample(0);
    let object = &mut written.truth.as_mut().unwrap().objects[0];
    (object.visible_px, object.visible_fraction, object.velocity_in_ego_mps) = (None, None, [f64::NAN; 2]);
    write_log(&path, &log(Some(labelled())), &[written], &[]).unwrap();
    let read = EpisodeReader::open(&path).unwrap().sample(0).unwrap();
    let object = &read.objects()[0];
    assert_eq!((object.visible_px, object.visible_fraction), (None, None));
    assert!(object.velocity_in_ego_mps[0].is_nan());
    assert_eq!(read.objects()[1].visible_px, Some(345));
}

#[test]
fn a_camera_that_fires_late_is_taken_within_the_tolerance_and_named_beyond_it() {
    let (_folder, path) = folder();
    let delay = |late_ns: u64| {
        move |topic: &str, time_ns: &mut u64, _: &mut Vec<u8>| {
            *time_ns += if topic == "/cam_front/image_rect_compressed" { late_ns } else { 0 };
        }
    };
    rewrite(&path, delay(35_000_000));
    assert_eq!(EpisodeReader::open(&path).unwrap().sample(1).unwrap(), sample(1));
    rewrite(&path, delay(60_000_000));
    let told = refusal(&path);
    let (stamp, late) = (sample(1).measured.time_ns, sample(1).measured.time_ns + 60_000_000);
    for part in ["50 ms", "image_rect", &stamp.to_string(), &late.to_string()] {
        assert!(told.contains(part), "{told}");
    }
}

#[test]
fn a_clouds_pose_and_frame_are_read_and_a_strange_frame_is_refused() {
    let (_folder, path) = folder();
    let wanted = sample(1).measured.points[0];
    rewrite_clouds(&path, |cloud| {
        let pose = cloud.pose.as_mut().unwrap();
        pose.position = Some(fox::Vector3 { x: 2.0, y: 0.0, z: -0.5 });
    });
    let moved = EpisodeReader::open(&path).unwrap().whole_sample(1).unwrap().measured.points[0];
    assert_eq!((moved.x_m, moved.z_m), (wanted.x_m + 2.0, wanted.z_m - 0.5));
    rewrite_clouds(&path, |cloud| cloud.frame_id = "ego".into());
    let moved = EpisodeReader::open(&path).unwrap().whole_sample(1).unwrap().measured.points[0];
    assert!((moved.z_m - (wanted.z_m - 1.9)).abs() < 1e-5, "{moved:?}");
    rewrite_clouds(&path, |cloud| cloud.frame_id = "velodyne".into());
    assert!(refusal(&path).contains("`velodyne`; `lidar_top` or `ego` is needed"));
}

#[test]
fn intensities_from_0_to_1_are_scaled_and_millimetres_are_refused() {
    let (_folder, path) = folder();
    let scale = |from: usize, factor: f32| {
        move |cloud: &mut fox::PointCloud| {
            let mut data = cloud.data.to_vec();
            for point in data.chunks_exact_mut(18) {
                let value = f32::from_le_bytes(point[from..from + 4].try_into().unwrap());
                point[from..from + 4].copy_from_slice(&(value * factor).to_le_bytes());
            }
            cloud.data = data.into();
        }
    };
    rewrite_clouds(&path, scale(12, 1.0 / 255.0));
    let reader = EpisodeReader::open(&path).unwrap();
    let read = reader.sample(1).unwrap().measured.points[0].intensity;
    assert!((read - 254.5).abs() < 1e-3 && reader.scales_intensity(), "{read}");
    rewrite_clouds(&path, scale(0, 1000.0));
    assert!(refusal(&path).contains("metres are needed"));
}

#[test]
fn a_whole_turn_is_cut_to_the_view_and_objects_behind_have_no_points() {
    let (_folder, path) = folder();
    let mut written = sample(0);
    let mut behind = written.measured.points[0];
    behind.x_m = -10.0;
    written.measured.points.push(behind);
    let n_points = written.measured.points.len();
    write_log(&path, &log(Some(labelled())), &[written], &[]).unwrap();
    let reader = EpisodeReader::open(&path).unwrap();
    assert_eq!(reader.whole_sample(0).unwrap().measured.points.len(), n_points);
    let cut = reader.sample(0).unwrap();
    assert_eq!(cut.measured.points.len(), n_points - 1);
    // The second box stands beside the car, out of view.
    assert_eq!(cut.objects()[1].n_lidar_points, Some(0));
}

#[test]
fn sensors_whose_axes_are_not_the_frames_are_refused() {
    let (_folder, path) = folder();
    let mut broken = sample(0);
    broken.measured.ego_from_camera = Transform::from_xyz_yaw(1.5, 0.0, 1.6, 0.0);
    let mut writer = EpisodeWriter::create_log(&path, &meta(), &log(Some(labelled())), &[], &map()).unwrap();
    assert!(writer.write(&broken).is_err(), "the writer refuses it too");
    writer.write_unchecked(&broken, Around::default()).unwrap();
    writer.finish().unwrap();
    let told = EpisodeReader::open(&path).unwrap().sample(0).unwrap_err().to_string();
    assert!(told.contains("`cam_front`") && told.contains("optical axes"), "{told}");
}

#[test]
fn a_picture_of_another_size_than_its_calibration_is_refused() {
    let (_folder, path) = folder();
    let mut broken = sample(0);
    let mut bytes = Vec::new();
    image::RgbImage::new(40, 20)
        .write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png)
        .unwrap();
    broken.measured.image = EncodedImage { format: ImageFormat::Png, bytes };
    let mut writer = EpisodeWriter::create_log(&path, &meta(), &log(Some(labelled())), &[], &map()).unwrap();
    assert!(writer.write(&broken).is_err(), "the writer refuses it too");
    writer.write_unchecked(&broken, Around::default()).unwrap();
    writer.finish().unwrap();
    let told = EpisodeReader::open(&path).unwrap().sample(0).unwrap_err().to_string();
    assert!(told.contains("40 x 20 px, and its calibration says 800 x 450"), "{told}");
}
