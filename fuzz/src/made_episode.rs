//! A tiny data set made in code, with labels and predictions: what targets replace parts of.

use std::path::{Path, PathBuf};

use fs_err as fs;
use harmzone::episode::{
    DetectionWriter, DriveLogWriter, EpisodeMeta, EpisodeWriter, LabelManifest, LabelWriter, LogFacts,
    Manifest, MapDrawing, ObjectLabel, OtherSensors, SampleCommand, SampleDetections, SampleLabels,
    SourceMeta, Split, manifest::LabelEntry,
};
use harmzone::geometry::{Box3, Ego, Pinhole, Point, Point2, Transform};
use harmzone::object::{Detection, Distribution, Event, Harm, Kind, Object, Spot};
use harmzone::sample::{
    Around, CameraView, EgoState, EncodedImage, IgnoredRegion, ImageFormat, LidarPoint, LidarView, Measured,
    Sample, Sweep, Truth,
};

use super::scratch;

/// The only episode.
pub const EPISODE: &str = "downtown-ClearNoon-7";
const N_SAMPLES: u64 = 2;
const FIRST_NS: u64 = 1_735_689_600_000_000_000;
const PERIOD_NS: u64 = 300_000_000;
const PICTURE_PX: (u32, u32) = (48, 27);

fn picture() -> EncodedImage {
    let mut bytes = Vec::new();
    let picture =
        image::RgbImage::from_fn(PICTURE_PX.0, PICTURE_PX.1, |x, y| image::Rgb([x as u8, y as u8, 90]));
    picture
        .write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Jpeg)
        .expect("a picture can be packed");
    EncodedImage { format: ImageFormat::Jpeg, bytes }
}

fn points() -> Vec<LidarPoint> {
    let point = |i: u16| {
        let (column, ring) = (f32::from(i % 16), i / 16);
        LidarPoint {
            x_m: 6.0 + f32::from(ring),
            y_m: column - 8.0,
            z_m: -1.8,
            intensity: 30.0 + column,
            ring,
        }
    };
    (0..128).map(point).collect()
}

fn pinhole() -> Pinhole {
    Pinhole::from_horizontal_fov(PICTURE_PX.0, PICTURE_PX.1, 1.2)
}

fn boxed(x_m: f64, y_m: f64) -> Box3<Ego> {
    Box3 { center: Point::new(x_m, y_m, 0.8), length_m: 4.2, width_m: 1.8, height_m: 1.6, yaw_rad: 0.3 }
}

pub fn object(id: &str, kind: Kind, distribution: Distribution, x_m: f64) -> Object {
    Object {
        velocity_in_ego_mps: [1.0, 0.5],
        id: Some(id.into()),
        category: Some("car".into()),
        kind: Some(kind),
        distribution: Some(distribution),
        n_lidar_points: Some(4),
        visible_px: Some(40),
        visible_fraction: Some(0.5),
        event: Some(Event::Lies),
        clearance_m: Some(0.2),
        spot: Some(Spot::Lane),
        ..Object::new(boxed(x_m, 0.5))
    }
}

fn sample(i: u64) -> Sample {
    let measured = Measured {
        time_ns: FIRST_NS + i * PERIOD_NS,
        ego_state: EgoState {
            speed_mps: 8.0,
            steering_angle_rad: 0.02,
            yaw_rate_rps: 0.06,
            acceleration_mps2: 0.1,
            wheelbase_m: 2.7,
            front_bumper_x_m: 3.6,
        },
        world_from_ego: Transform::from_xyz_yaw(2.4 * i as f64, 1.0, 0.0, 0.1),
        ego_from_lidar: Transform::from_xyz_yaw(1.2, 0.0, 1.9, 0.0),
        ego_from_camera: Transform::looking_forward([1.5, 0.0, 1.6].into(), 0.0),
        intrinsics: pinhole(),
        image: picture(),
        points: points(),
    };
    let objects = vec![
        object("car_1", Kind::Vehicle, Distribution::Id, 12.0),
        object("sofa_1", Kind::Static, Distribution::Ood, 20.0),
    ];
    Sample { measured, truth: Some(Truth { objects, ..Truth::default() }) }
}

fn meta() -> EpisodeMeta {
    EpisodeMeta {
        name: EPISODE.into(),
        seed: 7,
        town: "downtown".into(),
        weather: "ClearNoon".into(),
        ood: true,
        generator_version: "0.1.0".into(),
        config_toml: String::new(),
        rig_toml: String::new(),
        n_samples: N_SAMPLES as usize,
        background: String::new(),
    }
}

fn map() -> MapDrawing {
    let at = |x_m: f64, y_m: f64| Point::new(x_m, y_m, 0.0);
    MapDrawing {
        lane_lines: vec![vec![at(0.0, 1.8), at(30.0, 1.8), at(60.0, 4.0)]],
        drivable_area: vec![[at(0.0, -2.0), at(60.0, -2.0), at(60.0, 2.0)]],
    }
}

/// Writes the episode, with a further camera, a further LiDAR and sweeps.
fn write_episode(path: &Path) -> harmzone::episode::FinishedEpisode {
    let others = OtherSensors {
        cameras: vec!["cam_back".into()],
        lidars: vec!["lidar_left".into()],
        sweeping: vec!["lidar_top".into()],
    };
    let mut writer =
        EpisodeWriter::create_rig(path, &meta(), others, &map()).expect("an episode can be begun");
    for i in 0..N_SAMPLES {
        let views = [CameraView {
            name: "cam_back".into(),
            ego_from_camera: Transform::looking_along([-1.0, 0.0, 1.5].into(), 3.1, 0.0, 0.0),
            intrinsics: pinhole(),
            image: picture(),
        }];
        let clouds = [LidarView {
            name: "lidar_left".into(),
            ego_from_lidar: Transform::from_xyz_yaw(1.0, 0.8, 1.0, 1.5),
            points: points(),
        }];
        let sweeps: Vec<Sweep> = (i > 0)
            .then(|| Sweep {
                lidar: "lidar_top".into(),
                time_ns: FIRST_NS + i * PERIOD_NS - PERIOD_NS / 2,
                world_from_lidar: Transform::from_xyz_yaw(1.0, 0.0, 1.9, 0.0),
                points: points(),
            })
            .into_iter()
            .collect();
        let around = Around { views: &views, clouds: &clouds, sweeps: &sweeps };
        writer.write_around(&sample(i), around).expect("a sample can be written");
    }
    writer.finish().expect("an episode can be finished")
}

fn source_meta(sha256: &str) -> SourceMeta {
    SourceMeta {
        episode: EPISODE.into(),
        episode_sha256: sha256.into(),
        set: "harm".into(),
        generator_version: "0.1.0".into(),
        config_toml: String::new(),
    }
}

pub fn detections() -> Vec<Detection> {
    let found = |x_m, harm, score| Detection {
        box_in_ego: boxed(x_m, 0.4),
        velocity_in_ego_mps: [0.5, 0.0],
        harm,
        score,
        spread: None,
    };
    vec![found(12.0, Harm::Harmful, 0.9), found(30.0, Harm::Harmless, 0.2)]
}

/// Files of an episode that others wrote beside it.
pub struct Made {
    pub dataset: PathBuf,
    pub episode: PathBuf,
    pub labels: PathBuf,
    pub detections: PathBuf,
    pub drive_log: PathBuf,
    /// An episode that was imported from a log.
    pub log_episode: PathBuf,
}

/// Makes the data set `name` of the scratch folder.
pub fn dataset(name: &str) -> Made {
    let dataset = scratch::empty_folder(name);
    let file = format!("episodes/{EPISODE}.mcap");
    let labels_folder = LabelManifest::folder(&dataset, "harm");
    for folder in [dataset.join("episodes"), labels_folder.clone(), dataset.join("other")] {
        fs::create_dir_all(folder).expect("a folder can be made");
    }
    let finished = write_episode(&dataset.join(&file));
    let source = source_meta(&finished.sha256);

    let labels = labels_folder.join(format!("{EPISODE}.mcap"));
    let mut writer = LabelWriter::create(&labels, &source).expect("a label file can be begun");
    let detections_path = dataset.join("other/detections.mcap");
    let mut found =
        DetectionWriter::create(&detections_path, &source).expect("a prediction file can be begun");
    let drive_log = dataset.join("other/drive.mcap");
    let mut drive = DriveLogWriter::create(&drive_log, &source).expect("a log can be begun");
    for i in 0..N_SAMPLES {
        let sample = sample(i);
        let time_ns = sample.measured.time_ns;
        writer.write(&labels_of(&sample), &sample).expect("labels can be written");
        let boxes = SampleDetections { time_ns, detections: detections() };
        found.write(&boxes).expect("boxes can be written");
        let command = SampleCommand { time_ns, braking_mps2: Some(3.0), speed_mps: 7.0, is_harmful: true };
        drive.write(&boxes, Some(&command)).expect("a command can be written");
    }
    writer.finish().expect("labels can be finished");
    found.finish().expect("boxes can be finished");
    drive.finish().expect("a log can be finished");

    let mut manifest = Manifest::new("00".into(), 7, true);
    manifest.episodes.push(harmzone::episode::EpisodeEntry {
        name: EPISODE.into(),
        file,
        split: Split::Val,
        seed: 7,
        town: "downtown".into(),
        weather: "ClearNoon".into(),
        ood: true,
        n_samples: finished.n_samples,
        n_objects: finished.n_objects,
        sha256: finished.sha256.clone(),
    });
    manifest.write(&dataset).expect("a manifest can be written");
    let zone_toml = harmzone::config::to_toml(&harmzone::zone::ZoneConfig::default());
    let mut of_labels = LabelManifest::new("harm", zone_toml, &manifest);
    of_labels.episodes.push(LabelEntry {
        name: EPISODE.into(),
        file: format!("{EPISODE}.mcap"),
        episode_sha256: finished.sha256,
        sha256: harmzone::files::sha256_of(&labels).expect("labels can be read"),
        n_samples: finished.n_samples,
    });
    of_labels.write(&dataset).expect("a manifest can be written");

    let log_episode = dataset.join("other/log.mcap");
    write_log_episode(&log_episode);
    Made { episode: finished.path, dataset, labels, detections: detections_path, drive_log, log_episode }
}

fn labels_of(sample: &Sample) -> SampleLabels {
    let corner = |x_m, y_m| Point2 { x_m, y_m };
    let label = |object: &Object| ObjectLabel {
        id: object.id.clone().unwrap_or_default(),
        harm: Harm::Harmful,
        overlap_area_m2: 1.5,
        overlap_ratio: 0.2,
        time_to_collision_s: Some(1.2),
    };
    SampleLabels {
        time_ns: sample.measured.time_ns,
        zone_name: "corridor".into(),
        zone_corners: vec![corner(3.6, 1.0), corner(25.0, 1.0), corner(25.0, -1.0), corner(3.6, -1.0)],
        labels: sample.objects().iter().map(label).collect(),
    }
}

/// An episode of a log, with regions that nobody annotated.
fn write_log_episode(path: &Path) {
    let labelled = harmzone::episode::Labelled {
        kinds: Kind::ALL.to_vec(),
        categories: vec!["car".into()],
        max_range_m: Some(60.0),
        in_camera_view: true,
        sizes: Default::default(),
    };
    let log = LogFacts {
        format: "kitti".into(),
        drive: "0001".into(),
        methods: [("camera".to_owned(), "the log's picture".to_owned())].into(),
        first_cloud_sha256: String::new(),
        sample_names: [(FIRST_NS.to_string(), "000000".to_owned())].into(),
        labelled: Some(labelled),
    };
    let mut writer =
        EpisodeWriter::create_log(path, &meta(), &log, &[], &map()).expect("an episode can be begun");
    let mut sample = sample(0);
    let corner = |x_m, y_m| Point2 { x_m, y_m };
    sample.truth.as_mut().expect("it was made with truth").ignored = vec![
        IgnoredRegion::Image { left_px: 3.0, top_px: 2.0, right_px: 20.0, bottom_px: 12.0 },
        IgnoredRegion::Ground {
            corners_in_ego_m: vec![corner(9.0, 1.0), corner(9.0, 2.0), corner(8.0, 2.0)],
        },
    ];
    writer.write(&sample).expect("a sample can be written");
    writer.finish().expect("an episode can be finished");
}
