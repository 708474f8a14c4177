//! Episodes and labels as an outside reader sees them: Python's `mcap` and `mcap-protobuf-support`.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;
use std::process::Command;

use harmzone::episode::{
    EpisodeMeta, EpisodeWriter, LabelWriter, MapDrawing, ObjectLabel, SampleLabels, SourceMeta,
};
use harmzone::geometry::{Box3, Pinhole, Point, Point2, Transform};
use harmzone::object::{Distribution, Event, Harm, Kind, Object, SolidPart, Spot};
use harmzone::sample::{
    EgoState, EncodedImage, IgnoredRegion, ImageFormat, LidarPoint, Measured, Sample, Truth,
};
use nalgebra::Vector3;
use serde_json::{Value, json};

const START_NS: u64 = 1_700_000_000_000_000_001;

fn object(id: &str, x_m: f64, kind: Kind, distribution: Distribution) -> Object {
    let center = Point::new(x_m, -0.5, 0.75);
    Object {
        id: Some(id.into()),
        category: Some(id.split(':').next().unwrap().into()),
        kind: Some(kind),
        distribution: Some(distribution),
        box_in_ego: Box3 { center, length_m: 4.5, width_m: 2.0, height_m: 1.5, yaw_rad: 0.25 },
        velocity_in_ego_mps: [1.5, -0.5],
        n_lidar_points: Some(12),
        visible_px: Some(345),
        visible_fraction: Some(0.5),
        event: Some(if distribution == Distribution::Ood { Event::Falls } else { Event::None }),
        solid: Some(SolidPart { along_m: 0.5, across_m: -0.25, length_m: 1.0, width_m: 0.5 }),
        clearance_m: Some(0.125),
        spot: Some(Spot::Crossing),
        is_tipped: Some(true),
    }
}

fn sample(idx: u32) -> Sample {
    let measured = Measured {
        time_ns: START_NS + u64::from(idx) * 300_000_000,
        ego_state: EgoState {
            speed_mps: 0.1 + f64::from(idx),
            steering_angle_rad: -0.2,
            yaw_rate_rps: 0.03,
            acceleration_mps2: -1.5,
            wheelbase_m: 2.7,
            front_bumper_x_m: 3.6,
        },
        world_from_ego: Transform::from_xyz_yaw(1.0 / 3.0, f64::from(idx), 0.1, 2.5),
        ego_from_lidar: Transform::from_xyz_yaw(1.2, 0.0, 1.9, 0.0),
        ego_from_camera: Transform::looking_forward(Vector3::new(1.5, 0.0, 1.6), 0.02),
        intrinsics: Pinhole {
            width_px: 800,
            height_px: 450,
            fx_px: 571.5,
            fy_px: 571.25,
            cx_px: 400.0,
            cy_px: 225.0,
        },
        image: EncodedImage { format: ImageFormat::Png, bytes: vec![137, 80, 78, 71] },
        points: vec![
            LidarPoint { x_m: 1.5, y_m: -2.25, z_m: 0.125, intensity: 254.5, ring: 31 },
            LidarPoint { x_m: 70.0, y_m: 0.0, z_m: -1.75, intensity: 0.0, ring: 65535 },
        ],
    };
    let objects = vec![
        object("car:1", 10.0, Kind::Vehicle, Distribution::Id),
        object("child:2", 15.0, Kind::Pedestrian, Distribution::Id),
        // Wholly behind the camera: no line of it may be drawn.
        object("hay_bale:3", -10.0, Kind::Static, Distribution::Ood),
    ];
    let corner = |x_m, y_m| Point2 { x_m, y_m };
    let corners_in_ego_m = vec![corner(1.0, 0.0), corner(2.0, 0.0), corner(2.0, 1.0)];
    let ignored = vec![IgnoredRegion::Ground { corners_in_ego_m }];
    Sample { measured, truth: Some(Truth { objects, ignored, ..Truth::default() }) }
}

fn labels_of(sample: &Sample) -> SampleLabels {
    let corner = |x_m, y_m| Point2 { x_m, y_m };
    let harms = [Harm::Harmful, Harm::Harmless, Harm::Harmless];
    let label = |(object, harm): (&Object, Harm)| ObjectLabel {
        id: object.id.clone().unwrap(),
        harm,
        overlap_area_m2: 2.25,
        overlap_ratio: 0.25,
        time_to_collision_s: (harm == Harm::Harmful).then_some(1.5),
    };
    SampleLabels {
        time_ns: sample.measured.time_ns,
        zone_name: "rect".into(),
        zone_corners: vec![corner(3.6, 1.75), corner(3.6, -1.75), corner(12.0, -1.75), corner(12.0, 1.75)],
        labels: sample.objects().iter().zip(harms).map(label).collect(),
    }
}

/// What the Python reader says of two samples with their labels.
fn read_in_python() -> Value {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python = root.join(".venv-test/bin/python");
    assert!(python.exists(), "there is no {}: run `make setup-test` (`make test` does)", python.display());
    let folder = tempfile::tempdir().unwrap();
    let (episode, labels) = (folder.path().join("episode.mcap"), folder.path().join("labels.mcap"));
    let meta = EpisodeMeta {
        name: "oldtown-ClearNoon-7".into(),
        seed: u64::MAX,
        town: "oldtown".into(),
        weather: "ClearNoon".into(),
        ood: true,
        generator_version: "0.1.0".into(),
        config_toml: "a = 1\n".into(),
        rig_toml: "b = 2\n".into(),
        n_samples: 2,
        background: String::new(),
    };
    let at = |x_m, y_m| Point::new(x_m, y_m, 0.5);
    let map = MapDrawing {
        lane_lines: vec![vec![at(0.0, 0.0), at(10.0, 1.0)]],
        drivable_area: vec![[at(0.0, 0.0), at(9.0, 0.0), at(9.0, 4.0)]],
    };
    let mut writer = EpisodeWriter::create(&episode, &meta, &map).unwrap();
    (0..2).for_each(|idx| writer.write(&sample(idx)).unwrap());
    let finished = writer.finish().unwrap();
    let source = SourceMeta {
        episode: meta.name,
        episode_sha256: finished.sha256,
        set: "rect".into(),
        config_toml: "width_m = 3.5\n".into(),
        generator_version: "0.1.0".into(),
    };
    let mut writer = LabelWriter::create(&labels, &source).unwrap();
    (0..2).for_each(|idx| writer.write(&labels_of(&sample(idx)), &sample(idx)).unwrap());
    writer.finish().unwrap();
    let output = Command::new(python)
        .arg(root.join("tests/python/read_episode.py"))
        .args([&episode, &labels])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn expected_object(object: &Object) -> Value {
    let (kind, distribution, event) = match object.id.as_deref().unwrap() {
        "car:1" => ("KIND_VEHICLE", "DISTRIBUTION_ID", "EVENT_NONE"),
        "child:2" => ("KIND_PEDESTRIAN", "DISTRIBUTION_ID", "EVENT_NONE"),
        _ => ("KIND_STATIC", "DISTRIBUTION_OOD", "EVENT_FALLS"),
    };
    json!({
        "id": object.id, "category": object.category, "kind": kind, "distribution": distribution,
        "x_m": object.box_in_ego.center.x(), "y_m": -0.5, "z_m": 0.75,
        "length_m": 4.5, "width_m": 2.0, "height_m": 1.5, "yaw_rad": 0.25,
        "vx_mps": 1.5, "vy_mps": -0.5, "n_lidar_points": 12, "visible_px": 345, "visible_fraction": 0.5,
        "event": event, "clearance_m": 0.125, "spot": "SPOT_CROSSING", "is_tipped": true,
        "solid": {"along_m": 0.5, "across_m": -0.25, "length_m": 1.0, "width_m": 0.5},
    })
}

fn expected_transforms(measured: &Measured) -> Value {
    let parts = |parent: &str, child: &str, isometry: &nalgebra::Isometry3<f64>| {
        let (t, r) = (isometry.translation.vector, isometry.rotation.coords);
        json!([parent, child, [t.x, t.y, t.z], [r.x, r.y, r.z, r.w]])
    };
    json!([
        parts("map", "ego", &measured.world_from_ego.isometry),
        parts("ego", "lidar_top", &measured.ego_from_lidar.isometry),
        parts("ego", "cam_front", &measured.ego_from_camera.isometry),
    ])
}

#[test]
fn an_outside_reader_decodes_every_topic_of_an_episode_and_its_labels() {
    let found = read_in_python();
    let schemas = json!({
        "/tf": "foxglove.FrameTransforms",
        "/ego/pose": "foxglove.PoseInFrame",
        "/ego/state": "harmzone.EgoState",
        "/cam_front/image_rect_compressed": "foxglove.CompressedImage",
        "/cam_front/camera_info": "foxglove.CameraCalibration",
        "/lidar_top": "foxglove.PointCloud",
        "/truth/objects": "harmzone.Objects",
        "/truth/markers": "foxglove.SceneUpdate",
        "/truth/ignored": "harmzone.IgnoredRegions",
        "/map": "foxglove.SceneUpdate",
        "/harm/zone": "foxglove.SceneUpdate",
        "/harm/objects": "foxglove.SceneUpdate",
        "/cam_front/harm_annotations": "foxglove.ImageAnnotations",
        "/harm/labels": "harmzone.HarmLabels",
    });
    assert_eq!(found["schemas"], schemas);
    assert_eq!(found["metadata"]["episode"]["seed"], u64::MAX.to_string());
    assert_eq!(found["metadata"]["episode"]["config_toml"], "a = 1\n");
    assert_eq!(found["metadata"]["scene-info"]["location"], "oldtown");
    assert_eq!(found["metadata"]["labels"]["set"], "rect");
    let map = json!({
        "time_ns": START_NS,
        "frames": ["map"],
        "lines": [[[0.0, 0.0, 0.5], [10.0, 1.0, 0.5]]],
        "area": [[0.0, 0.0, 0.5], [9.0, 0.0, 0.5], [9.0, 4.0, 0.5]],
    });
    assert_eq!(found["map"], map);
    assert_eq!(found["samples"].as_array().map(Vec::len), Some(2));
    for (idx, found) in (0u32..).zip(found["samples"].as_array().unwrap()) {
        let sample = sample(idx);
        let cubes: Vec<Value> = ["car:1", "child:2", "hay_bale:3"]
            .map(|id| json!([id, "ego", 300_000_000, [4.5, 2.0, 1.5]]))
            .to_vec();
        let label = |id: &str, harm: &str| {
            let mut label = json!({ "id": id, "harm": harm, "overlap_area_m2": 2.25, "overlap_ratio": 0.25 });
            if harm == "HARM_HARMFUL" {
                label["time_to_collision_s"] = json!(1.5);
            }
            label
        };
        let k = [571.5, 0.0, 400.0, 0.0, 571.25, 225.0, 0.0, 0.0, 1.0];
        let p = [571.5, 0.0, 400.0, 0.0, 0.0, 571.25, 225.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let no_distortion: [f64; 0] = [];
        let expected = json!({
            "time_ns": sample.measured.time_ns,
            "state": {
                "speed_mps": 0.1 + f64::from(idx), "steering_angle_rad": -0.2, "yaw_rate_rps": 0.03,
                "acceleration_mps2": -1.5, "wheelbase_m": 2.7, "front_bumper_x_m": 3.6,
            },
            "tf": expected_transforms(&sample.measured),
            "pose": ["map", [1.0 / 3.0, f64::from(idx), 0.1]],
            "image": ["cam_front", "png", [137, 80, 78, 71]],
            "camera": ["cam_front", 800, 450, k, p, no_distortion],
            "lidar": ["lidar_top", [
                { "x": 1.5, "y": -2.25, "z": 0.125, "intensity": 254.5, "ring": 31 },
                { "x": 70.0, "y": 0.0, "z": -1.75, "intensity": 0.0, "ring": 65535 },
            ]],
            "objects": sample.objects().iter().map(expected_object).collect::<Vec<_>>(),
            "ignored": [[[1.0, 0.0], [2.0, 0.0], [2.0, 1.0]]],
            "markers": cubes,
            "harm_objects": cubes,
            "zone_name": "rect",
            "zone": [[3.6, 1.75], [3.6, -1.75], [12.0, -1.75], [12.0, 1.75]],
            "zone_frame": "ego",
            "labels": [
                label("car:1", "HARM_HARMFUL"),
                label("child:2", "HARM_HARMLESS"),
                label("hay_bale:3", "HARM_HARMLESS"),
            ],
            // Line lists (4): the zone cut to three edges (its near one lies below the image), two
            // boxes of twelve edges with two ends each, and nothing behind the camera.
            "annotations": [[4, 6], [4, 24], [4, 24]],
        });
        assert_eq!(*found, expected);
    }
}
