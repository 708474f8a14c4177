//! Labels against shapely: a random data set, labelled, then checked from its MCAP messages alone.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;
use std::process::Command;

use harmzone::episode::{EpisodeEntry, EpisodeMeta, EpisodeWriter, Manifest, MapDrawing, Split};
use harmzone::geometry::{Box3, Pinhole, Point, Transform};
use harmzone::label;
use harmzone::object::{Distribution, Event, Kind, Object, SolidPart};
use harmzone::progress::Silent;
use harmzone::random::{Rng, stream};
use harmzone::sample::{EgoState, EncodedImage, ImageFormat, LidarPoint, Measured, Sample, Truth};
use harmzone::zone::{Zone, ZoneConfig, ZoneKind};
use nalgebra::Vector3;
use rand::RngExt;

const N_SAMPLES: usize = 40;
const N_OBJECTS: usize = 25;

fn between(rng: &mut Rng, low: f64, high: f64) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

fn random_object(i: usize, rng: &mut Rng) -> Object {
    Object {
        id: Some(format!("object-{i}")),
        category: Some("thing".to_owned()),
        kind: Some([Kind::Vehicle, Kind::Pedestrian, Kind::Static][i % 3]),
        distribution: Some(if i.is_multiple_of(4) { Distribution::Ood } else { Distribution::Id }),
        box_in_ego: Box3 {
            center: Point::new(between(rng, -5.0, 50.0), between(rng, -6.0, 6.0), between(rng, 0.8, 5.0)),
            length_m: between(rng, 0.2, 8.0),
            width_m: between(rng, 0.2, 2.5),
            height_m: between(rng, 0.3, 3.0),
            yaw_rad: between(rng, -3.1, 3.1),
        },
        velocity_in_ego_mps: if i % 5 < 2 {
            [0.0, 0.0]
        } else {
            [between(rng, -9.0, 9.0), between(rng, -3.0, 3.0)]
        },
        n_lidar_points: Some(5),
        visible_px: Some(50),
        visible_fraction: Some(0.5),
        event: Some(Event::None),
        solid: (i % 3 == 2).then(|| SolidPart {
            along_m: between(rng, -1.0, 1.0),
            across_m: between(rng, -0.5, 0.5),
            length_m: between(rng, 0.2, 2.0),
            width_m: between(rng, 0.2, 1.0),
        }),
        // Some stand on a rise, some hang over a hollow; of the others the ground is the ego's plane.
        clearance_m: i.is_multiple_of(2).then(|| between(rng, -0.2, 3.5)),
        spot: None,
        is_tipped: None,
    }
}

fn random_sample(sample_idx: usize, rng: &mut Rng) -> Sample {
    let mut bytes = Vec::new();
    let picture = image::RgbImage::new(8, 8);
    picture.write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png).unwrap();
    Sample {
        measured: Measured {
            time_ns: 1_000_000_000_000 + 300_000_000 * sample_idx as u64,
            ego_state: EgoState {
                speed_mps: between(rng, -2.0, 18.0),
                steering_angle_rad: between(rng, -0.6, 0.6),
                yaw_rate_rps: 0.0,
                acceleration_mps2: 0.0,
                wheelbase_m: 2.7,
                front_bumper_x_m: 3.6,
            },
            world_from_ego: Transform::from_xyz_yaw(10.0, 5.0, 0.0, 0.4),
            ego_from_lidar: Transform::from_xyz_yaw(0.9, 0.0, 1.84, 0.0),
            ego_from_camera: Transform::looking_forward(Vector3::new(1.5, 0.0, 1.6), 0.0),
            intrinsics: Pinhole::from_horizontal_fov(8, 8, 1.2),
            image: EncodedImage { format: ImageFormat::Png, bytes },
            points: vec![LidarPoint { x_m: 5.0, y_m: 0.0, z_m: -1.8, intensity: 10.0, ring: 3 }],
        },
        truth: Some(Truth {
            objects: (0..N_OBJECTS).map(|i| random_object(i, rng)).collect(),
            ..Truth::default()
        }),
    }
}

fn make_dataset(folder: &Path) {
    fs_err::create_dir_all(folder.join("episodes")).unwrap();
    let mut manifest = Manifest::new("0".repeat(64), 3, true);
    for seed in 0..2 {
        let name = format!("nowhere-ClearNoon-{seed}");
        let meta = EpisodeMeta {
            name: name.clone(),
            seed,
            town: "nowhere".to_owned(),
            weather: "ClearNoon".to_owned(),
            ood: true,
            generator_version: "test".to_owned(),
            config_toml: String::new(),
            rig_toml: String::new(),
            n_samples: N_SAMPLES,
            background: String::new(),
        };
        let file = format!("episodes/{name}.mcap");
        let mut writer = EpisodeWriter::create(&folder.join(&file), &meta, &MapDrawing::default()).unwrap();
        let mut rng = stream(seed, "label-shapely", 0);
        for sample_idx in 0..N_SAMPLES {
            writer.write(&random_sample(sample_idx, &mut rng)).unwrap();
        }
        let done = writer.finish().unwrap();
        manifest.episodes.push(EpisodeEntry {
            name,
            file,
            split: Split::Train,
            seed,
            town: meta.town,
            weather: meta.weather,
            ood: true,
            n_samples: done.n_samples,
            n_objects: done.n_objects,
            sha256: done.sha256,
        });
    }
    manifest.write(folder).unwrap();
}

/// Labels the random data set by a zone and lets Python compute every label again.
fn assert_python_agrees(kind: ZoneKind) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python = root.join(".venv-test/bin/python");
    assert!(python.is_file(), "no {}: run `make setup-test` first", python.display());
    let folder = tempfile::tempdir().unwrap();
    make_dataset(folder.path());
    let zone = ZoneConfig { kind, ..ZoneConfig::default() };
    let summary = label::run(folder.path(), &zone, kind.name(), false, &Silent).unwrap();
    let all = label::count_of(&summary.counts, None, None);
    assert!(all.harmful > 100 && all.harmless > 100, "{summary}");
    let checked = Command::new(python)
        .arg(root.join("tests/python/check_labels.py"))
        .arg(folder.path())
        .arg(kind.name())
        .output()
        .unwrap();
    let told = String::from_utf8_lossy(&checked.stdout);
    assert!(checked.status.success(), "{told}{}", String::from_utf8_lossy(&checked.stderr));
    let expected = format!("2 episodes, 2000 labels, {} harmful, 0 differences", all.harmful);
    assert_eq!(told.trim(), expected);
}

#[test]
fn labels_equal_those_that_shapely_computes_from_the_messages() {
    assert_python_agrees(ZoneKind::Rect);
}

#[test]
fn arcs_equal_those_of_the_bicycle_model_in_small_steps() {
    assert_python_agrees(ZoneKind::Arc);
}

#[test]
fn times_to_collision_equal_those_that_small_steps_of_time_find() {
    assert_python_agrees(ZoneKind::Ttc);
}

#[test]
fn rss_dangers_equal_bodies_tried_place_by_place() {
    assert_python_agrees(ZoneKind::Rss);
}

#[test]
fn a_comparison_counts_what_the_label_sets_hold() {
    let folder = tempfile::tempdir().unwrap();
    make_dataset(folder.path());
    let zones = ZoneKind::ALL.map(|kind| ZoneConfig { kind, ..ZoneConfig::default() });
    let checked = zones.each_ref().map(|config| Zone::try_from(config.clone()).unwrap());
    let found = label::compare(folder.path(), &checked, &Silent).unwrap();
    assert_eq!((found.n_episodes, found.n_samples, found.n_objects), (2, 80, 2000));
    for (zone, counted) in zones.iter().zip(&found.zones) {
        let labelled = label::run(folder.path(), zone, zone.kind.name(), false, &Silent).unwrap();
        assert_eq!(labelled.counts, counted.counts, "{}", counted.zone);
    }
}

#[test]
fn a_finished_set_is_kept_and_one_of_another_zone_is_not_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    make_dataset(folder.path());
    let zone = ZoneConfig::default();
    let label = |zone: &ZoneConfig, force| label::run(folder.path(), zone, "rect", force, &Silent);
    let first = label(&zone, false).unwrap();
    let again = label(&zone, false).unwrap();
    assert!(!first.was_complete && again.was_complete && first.counts == again.counts);
    let wide = ZoneConfig { width_m: 7.0, ..zone };
    assert!(label(&wide, false).unwrap_err().to_string().contains("--force"));
    assert!(label(&wide, true).unwrap().counts != first.counts);
}
