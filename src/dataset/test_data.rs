//! A small made-up dataset for tests: boxes of points on a flat street.

use nalgebra::Vector3;
use rand::RngExt;

use super::{Dataset, Fingerprint, LabelledSample, Origin};
use crate::episode::EpisodeMeta;
use crate::geometry::{Box3, Pinhole, Point, Transform};
use crate::object::{Distribution, Event, Kind, LabelledObject, Object};
use crate::random;
use crate::sample::{EgoState, EncodedImage, ImageFormat, LidarPoint, Measured};
use crate::zone::{Zone, ZoneConfig, ZoneKind};

/// `n` labelled samples, always the same.
pub fn dataset(n: usize) -> Dataset {
    dataset_of(n, ZoneKind::Rect)
}

/// The same samples, labelled by a zone of another shape.
pub fn dataset_of(n: usize, kind: ZoneKind) -> Dataset {
    let config = ZoneConfig { kind, ..ZoneConfig::default() };
    let zone = Zone::try_from(config).expect("the default zones are valid");
    Dataset {
        path: "made".into(),
        episodes: Vec::new(),
        samples: (0..n).map(|i| sample(i, &zone)).collect(),
        zone,
        fingerprint: Fingerprint { dataset_sha256: n.to_string(), labels_sha256: String::new() },
    }
}

/// Writes labelled episodes of the split `train` into a folder, each with so many of the samples.
#[cfg(test)]
pub fn write(folder: &std::path::Path, n_samples: &[usize]) {
    use crate::episode::{EpisodeEntry, EpisodeWriter, Manifest, MapDrawing, Split};
    use crate::sample::{Sample, Truth};

    fs_err::create_dir(folder.join("episodes")).expect("the folder can be written");
    let all = dataset(n_samples.iter().sum());
    let mut samples = all.samples().iter();
    let mut manifest = Manifest::new("0".repeat(64), 0, false);
    for (i, &n) in n_samples.iter().enumerate() {
        let (name, file) = (format!("made-{i}"), format!("episodes/made-{i}.mcap"));
        let meta = EpisodeMeta { name: name.clone(), n_samples: n, ..episode_meta("made", "") };
        let mut writer = EpisodeWriter::create(&folder.join(&file), &meta, &MapDrawing::default())
            .expect("the folder can be written");
        for (j, made) in samples.by_ref().take(n).enumerate() {
            let measured = Measured { time_ns: 1_000_000_000 * (j as u64 + 1), ..made.measured.clone() };
            let objects = made.objects.iter().map(|object| object.truth.clone()).collect();
            let truth = Truth { objects, ..Truth::default() };
            writer.write(&Sample { measured, truth: Some(truth) }).expect("the samples are valid");
        }
        let done = writer.finish().expect("the folder can be written");
        manifest.episodes.push(EpisodeEntry {
            name,
            file,
            split: Split::Train,
            seed: i as u64,
            town: meta.town,
            weather: meta.weather,
            ood: false,
            n_samples: done.n_samples,
            n_objects: done.n_objects,
            sha256: done.sha256,
        });
    }
    manifest.write(folder).expect("the folder can be written");
    crate::label::run(folder, &ZoneConfig::default(), "rect", false, &crate::progress::Silent)
        .expect("the episodes can be labelled");
}

fn sample(idx: usize, zone: &Zone) -> LabelledSample {
    let mut rng = random::stream(3, "test-data", idx as u64);
    let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    let ego_state = EgoState {
        speed_mps: between(0.0, 12.0),
        steering_angle_rad: between(-0.2, 0.2),
        yaw_rate_rps: 0.0,
        acceleration_mps2: 0.0,
        wheelbase_m: 2.6,
        front_bumper_x_m: 3.3,
    };
    let mut points = Vec::new();
    let mut objects = Vec::new();
    for object_idx in 0..5 {
        let (x, yaw_rad) = (between(6.0, 45.0), between(-0.4, 0.4));
        let box_in_ego = Box3 {
            center: Point::new(x, between(-0.5, 0.5) * x, 0.75),
            length_m: 4.0,
            width_m: 1.8,
            height_m: 1.5,
            yaw_rad,
        };
        for _ in 0..60 {
            let (along, across) = (between(-2.0, 2.0), between(-0.9, 0.9));
            points.push(LidarPoint {
                x_m: (box_in_ego.center.x() + along * yaw_rad.cos() - across * yaw_rad.sin()) as f32,
                y_m: (box_in_ego.center.y() + along * yaw_rad.sin() + across * yaw_rad.cos()) as f32,
                z_m: between(-1.5, 0.0) as f32,
                intensity: 100.0,
                ring: 3,
            });
        }
        let harm = zone
            .at(&ego_state)
            .and_then(|area| area.harm_of(&box_in_ego, [0.0; 2]))
            .expect("made-up states and boxes are valid")
            .harm;
        objects.push(LabelledObject {
            truth: Object {
                id: Some(format!("car-{object_idx}")),
                category: Some("car".into()),
                kind: Some(Kind::Vehicle),
                distribution: Some(Distribution::Id),
                box_in_ego,
                velocity_in_ego_mps: [0.0; 2],
                n_lidar_points: Some(60),
                visible_px: Some(500),
                visible_fraction: Some(1.0),
                event: Some(Event::None),
                solid: None,
                clearance_m: None,
                spot: None,
                is_tipped: None,
            },
            harm,
        });
    }
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_fn(160, 90, |x, y| image::Rgb([x as u8, y as u8, (idx * 20) as u8]))
        .write_to(&mut bytes, image::ImageFormat::Png)
        .expect("an image in memory can be packed");
    let measured = Measured {
        time_ns: idx as u64 * 300_000_000,
        ego_state,
        world_from_ego: Transform::from_xyz_yaw(0.0, 0.0, 0.0, 0.0),
        ego_from_lidar: Transform::from_xyz_yaw(0.9, 0.0, 1.8, 0.0),
        ego_from_camera: Transform::looking_forward(Vector3::new(1.7, 0.0, 1.5), 0.0),
        intrinsics: Pinhole::from_horizontal_fov(160, 90, 70f64.to_radians()),
        image: EncodedImage { format: ImageFormat::Png, bytes: bytes.into_inner() },
        points,
    };
    let origin = Origin::of_episode(&episode_meta("ClearNoon", ""), None, "made".as_ref(), 0);
    let facts = origin.expect("an empty config is valid").facts_of(&measured, &ego_state, Some(vec![]), zone);
    LabelledSample { id: format!("made/{idx}"), measured, true_state: ego_state, objects, facts }
}

/// Where the samples come from.
pub(super) fn episode_meta(weather: &str, config_toml: &str) -> EpisodeMeta {
    EpisodeMeta {
        name: "made".into(),
        seed: 3,
        town: "made".into(),
        weather: weather.into(),
        ood: false,
        generator_version: String::new(),
        config_toml: config_toml.into(),
        rig_toml: String::new(),
        n_samples: 0,
        background: String::new(),
    }
}
