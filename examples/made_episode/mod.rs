//! A made-up episode of three samples, for examples that are given no data: a parked car beside the lane and a sofa in it.

use std::path::{Path, PathBuf};

use harmzone::episode::{EpisodeMeta, EpisodeWriter, MapDrawing};
use harmzone::geometry::{Box3, Pinhole, Point, Transform};
use harmzone::object::{Distribution, Kind, Object};
use harmzone::sample::{EgoState, EncodedImage, ImageFormat, LidarPoint, Measured, Sample, Truth};
use nalgebra::Vector3;

const N_SAMPLES: u64 = 3;

/// Writes the episode into a folder and gives its path.
pub fn write(folder: &Path) -> anyhow::Result<PathBuf> {
    let path = folder.join("street.mcap");
    let meta = EpisodeMeta {
        name: "street".into(),
        seed: 0,
        town: "nowhere".into(),
        weather: "ClearNoon".into(),
        ood: true,
        generator_version: env!("CARGO_PKG_VERSION").into(),
        config_toml: String::new(),
        rig_toml: String::new(),
        n_samples: N_SAMPLES as usize,
        background: String::new(),
    };
    let map = MapDrawing { lane_lines: Vec::new(), drivable_area: Vec::new() };
    let mut episode = EpisodeWriter::create(&path, &meta, &map)?;
    for sample_idx in 0..N_SAMPLES {
        episode.write(&sample(sample_idx)?)?;
    }
    episode.finish()?;
    Ok(path)
}

/// At 8 m/s straight on, 0.3 s after the sample before.
fn sample(sample_idx: u64) -> anyhow::Result<Sample> {
    let driven_m = 2.4 * sample_idx as f64;
    let mut jpeg = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_pixel(32, 18, image::Rgb([90, 120, 150]))
        .write_to(&mut jpeg, image::ImageFormat::Jpeg)?;
    let measured = Measured {
        time_ns: sample_idx * 300_000_000,
        ego_state: EgoState {
            speed_mps: 8.0,
            steering_angle_rad: 0.0,
            yaw_rate_rps: 0.0,
            acceleration_mps2: 0.0,
            wheelbase_m: 2.7,
            front_bumper_x_m: 3.6,
        },
        world_from_ego: Transform::from_xyz_yaw(driven_m, 0.0, 0.0, 0.0),
        ego_from_lidar: Transform::from_xyz_yaw(1.2, 0.0, 1.9, 0.0),
        ego_from_camera: Transform::looking_forward(Vector3::new(1.5, 0.0, 1.6), 0.0),
        intrinsics: Pinhole {
            width_px: 32,
            height_px: 18,
            fx_px: 23.0,
            fy_px: 23.0,
            cx_px: 16.0,
            cy_px: 9.0,
        },
        image: EncodedImage { format: ImageFormat::Jpeg, bytes: jpeg.into_inner() },
        points: vec![LidarPoint { x_m: 17.0, y_m: 0.0, z_m: -1.4, intensity: 80.0, ring: 7 }],
    };
    let object =
        |id: &str, kind, distribution, x_m: f64, y_m, [length_m, width_m, height_m]: [f64; 3]| Object {
            id: Some(id.into()),
            category: id.split(':').next().map(Into::into),
            kind: Some(kind),
            distribution: Some(distribution),
            velocity_in_ego_mps: [0.0, 0.0],
            n_lidar_points: Some(40),
            visible_px: Some(400),
            visible_fraction: Some(1.0),
            event: Some(harmzone::object::Event::None),
            ..Object::new(Box3 {
                center: Point::new(x_m - driven_m, y_m, height_m / 2.0),
                length_m,
                width_m,
                height_m,
                yaw_rad: 0.0,
            })
        };
    let objects = vec![
        object("car:1", Kind::Vehicle, Distribution::Id, 14.0, 3.2, [4.5, 1.9, 1.5]),
        object("sofa:2", Kind::Static, Distribution::Ood, 19.0, 0.3, [0.9, 2.0, 0.8]),
    ];
    Ok(Sample { measured, truth: Some(Truth { objects, ..Truth::default() }) })
}
