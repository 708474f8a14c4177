//! A made data set of two drives: slopes, bends, two cameras, objects all around; for what leaves harmzone and comes back.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::BTreeMap;
use std::path::Path;

use fs_err as fs;
use harmzone::episode::{
    EpisodeEntry, EpisodeMeta, EpisodeWriter, Labelled, LogFacts, Manifest, MapDrawing, Split,
};
use harmzone::geometry::{Box3, Pinhole, Point, Transform};
use harmzone::object::{Distribution, Event, Kind, Object};
use harmzone::sample::{
    CameraView, EgoState, EncodedImage, ImageFormat, LidarPoint, Measured, Sample, Truth,
};
use nalgebra::{UnitQuaternion, Vector3};

/// Samples of each drive.
pub const N_SAMPLES: usize = 4;

/// A picture of one colour.
fn picture(sample_idx: usize, format: ImageFormat) -> EncodedImage {
    let image = image::RgbImage::from_pixel(32, 16, image::Rgb([10 * sample_idx as u8, 90, 200]));
    let mut bytes = std::io::Cursor::new(Vec::new());
    let encoding = match format {
        ImageFormat::Jpeg => image::ImageFormat::Jpeg,
        ImageFormat::Png => image::ImageFormat::Png,
    };
    image.write_to(&mut bytes, encoding).unwrap();
    EncodedImage { format, bytes: bytes.into_inner() }
}

/// Objects around the ego: a car of which the LiDAR hits the rear, a cone, and an adult behind.
fn objects(sample_idx: usize) -> Vec<Object> {
    let step = sample_idx as f64;
    let object =
        |id: &str, category: &str, kind, distribution, [x, y, length, width, height, yaw]: [f64; 6]| Object {
            id: Some(id.to_owned()),
            category: Some(category.to_owned()),
            kind: Some(kind),
            distribution: Some(distribution),
            velocity_in_ego_mps: [1.0, 0.5],
            n_lidar_points: Some(7),
            visible_px: Some(50),
            visible_fraction: Some(0.7),
            event: Some(Event::None),
            ..Object::new(Box3 {
                center: Point::new(x, y, height / 2.0),
                length_m: length,
                width_m: width,
                height_m: height,
                yaw_rad: yaw,
            })
        };
    vec![
        object("a", "car", Kind::Vehicle, Distribution::Id, [12.0 + step, 1.5, 4.2, 1.8, 1.5, 0.3]),
        object(
            "b",
            "traffic_cone",
            Kind::Static,
            Distribution::Id,
            [8.0, -2.0 - 0.1 * step, 0.4, 0.3, 0.8, -3.0],
        ),
        object("c", "adult", Kind::Pedestrian, Distribution::Id, [-5.0, 3.0, 0.5, 0.6, 1.7, 2.0]),
    ]
}

/// A drive on a slope that bends, with a back camera beside the front one.
pub fn sample(sample_idx: usize) -> (Sample, Vec<CameraView>) {
    let step = sample_idx as f64;
    let tilt = UnitQuaternion::from_euler_angles(0.01, -0.03, 0.2 + 0.05 * step);
    let ego_from_camera = Transform::looking_forward(Vector3::new(1.7, 0.02, 1.5), 0.02);
    let intrinsics =
        Pinhole { width_px: 32, height_px: 16, fx_px: 25.5, fy_px: 25.25, cx_px: 16.5, cy_px: 8.75 };
    let point = |i: usize| {
        let angle = i as f32 * 0.37;
        let (x_m, y_m) = (8.0 * angle.cos() + 0.1, -8.0 * angle.sin());
        LidarPoint {
            x_m,
            y_m,
            z_m: -1.5 + 0.01 * i as f32,
            intensity: (i % 256) as f32,
            ring: (i % 32) as u16,
        }
    };
    let measured = Measured {
        time_ns: 1_735_689_600_000_000_000 + 300_000_000 * sample_idx as u64,
        ego_state: EgoState {
            speed_mps: 6.25 - 0.5 * step,
            steering_angle_rad: 0.03 * step - 0.02,
            yaw_rate_rps: 0.07 + 0.01 * step,
            acceleration_mps2: -0.5 + 0.1 * step,
            wheelbase_m: 2.7,
            front_bumper_x_m: 3.6,
        },
        world_from_ego: Transform::new(Vector3::new(-412.5 + 1.8 * step, 90.25, 1.5 + 0.05 * step), tilt),
        ego_from_lidar: Transform::from_xyz_yaw(0.94, 0.01, 1.84, 0.004),
        ego_from_camera,
        intrinsics,
        image: picture(sample_idx, ImageFormat::Jpeg),
        points: (0..400).map(point).collect(),
    };
    let back = CameraView {
        name: "cam_back".to_owned(),
        ego_from_camera: Transform::<_, harmzone::geometry::Ego>::from_xyz_yaw(0.0, 0.0, 0.0, 3.1)
            * ego_from_camera,
        intrinsics,
        image: picture(sample_idx, ImageFormat::Png),
    };
    (Sample { measured, truth: Some(Truth { objects: objects(sample_idx), ..Truth::default() }) }, vec![back])
}

/// A data set of two drives, with a map left of and below the origin.
pub fn make_dataset(folder: &Path) {
    fs::create_dir_all(folder.join("episodes")).unwrap();
    let mut manifest = Manifest::new("0".repeat(64), 3, false);
    for (seed, split) in [(0, Split::Train), (1, Split::Val)] {
        let name = format!("nowhere-{seed}");
        let text = String::new;
        let meta = EpisodeMeta {
            name: name.clone(),
            seed,
            town: "nowhere".to_owned(),
            weather: "unknown".to_owned(),
            ood: false,
            generator_version: text(),
            config_toml: text(),
            rig_toml: text(),
            n_samples: N_SAMPLES,
            background: String::new(),
        };
        let facts = LogFacts {
            format: "made".to_owned(),
            drive: name.clone(),
            methods: BTreeMap::new(),
            first_cloud_sha256: String::new(),
            sample_names: BTreeMap::new(),
            labelled: Some(Labelled {
                kinds: Kind::ALL.to_vec(),
                categories: Vec::new(),
                max_range_m: None,
                in_camera_view: false,
                sizes: BTreeMap::new(),
            }),
        };
        let corner = |x, y| Point::new(x, y, 0.0);
        let map = MapDrawing {
            lane_lines: vec![vec![corner(-450.0, 80.0), corner(-380.0, 80.0)]],
            drivable_area: vec![[corner(-450.0, 80.0), corner(-380.0, 80.0), corner(-380.0, 120.0)]],
        };
        let file = format!("episodes/{name}.mcap");
        let cameras = ["cam_back".to_owned()];
        let mut writer =
            EpisodeWriter::create_log(&folder.join(&file), &meta, &facts, &cameras, &map).unwrap();
        for sample_idx in 0..N_SAMPLES {
            let (sample, views) = sample(sample_idx);
            writer.write_with(&sample, &views).unwrap();
        }
        let done = writer.finish().unwrap();
        manifest.episodes.push(EpisodeEntry {
            name,
            file,
            split,
            seed,
            town: meta.town,
            weather: meta.weather,
            ood: false,
            n_samples: done.n_samples,
            n_objects: done.n_objects,
            sha256: done.sha256,
        });
    }
    manifest.write(folder).unwrap();
}
