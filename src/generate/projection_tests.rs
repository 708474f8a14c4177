//! Camera and LiDAR agree: points projected into the picture have the depth that the picture has there.

use std::sync::Arc;

use nalgebra::Vector3;

use super::drive::Drive;
use crate::geometry::{Lidar, Point};
use crate::scene::{Lighting, PopulateConfig, Town, populate, town_names};
use crate::sensors::{Rig, RigConfig};
use crate::sim::{CameraMount, Renderer};

/// Depths of neighbouring pixels that differ by more than this share belong to an edge.
const EDGE_SHARE: f32 = 0.03;

/// Differences between the LiDAR's and the picture's depths away from edges, in one town, ascending.
fn differences_m(town: &str) -> Vec<f64> {
    let rig = Rig::try_from(&RigConfig::default()).unwrap();
    let town = Arc::new(Town::load(town).unwrap());
    let world = populate(&town, &PopulateConfig::default(), 4).unwrap();
    let mount = CameraMount {
        body: "ego".into(),
        cameras: vec![(rig.front().ego_from_camera, rig.front().intrinsics)],
        n_samples: 0,
        shadow_size_px: 256,
        renderer: Renderer::Classic,
    };
    let lighting = Lighting { ambient: [0.5; 3], sun: None };
    let mut drive = Drive::new(&world, &lighting, &mount, 4).unwrap();
    // Braking and turning tilt the car by now.
    for _ in 0..60 {
        drive.step().unwrap();
    }
    let depth_m = drive.simulator.render(0, true).unwrap().depth_m;
    let world_from_lidar = drive.world_from_ego() * rig.top().ego_from_lidar;
    let directions: Vec<Vector3<f64>> =
        rig.top().pattern.directions.iter().map(|direction| world_from_lidar.rotate(direction)).collect();
    let origin = (world_from_lidar * Point::new(0.0, 0.0, 0.0)).coords;
    let hits = drive.simulator.cast_rays(&origin, &directions, 70.0).unwrap();
    let camera_from_lidar = rig.front().ego_from_camera.inverse() * rig.top().ego_from_lidar;
    let width = rig.front().intrinsics.width_px as usize;
    let mut found: Vec<f64> = Vec::new();
    for (direction, range_m) in rig.top().pattern.directions.iter().zip(&hits.range_m) {
        if !range_m.is_finite() {
            continue;
        }
        let point = camera_from_lidar * Point::<Lidar>::from_coords((direction * *range_m).into());
        let Some((u, v)) = rig.front().intrinsics.project(&point) else { continue };
        let inside = (2.0..f64::from(rig.front().intrinsics.width_px) - 2.0).contains(&u)
            && (2.0..f64::from(rig.front().intrinsics.height_px) - 2.0).contains(&v);
        if !inside {
            continue;
        }
        let at = v as usize * width + u as usize;
        let here = depth_m[at];
        let near = [at - 2, at + 2, at - 2 * width, at + 2 * width];
        if near.iter().all(|&other| (depth_m[other] - here).abs() < EDGE_SHARE * here) {
            found.push((f64::from(here) - point.z()).abs());
        }
    }
    found.sort_by(f64::total_cmp);
    found
}

#[test]
fn lidar_points_have_the_pictures_depth_in_every_town() {
    for town in town_names() {
        let found = differences_m(&town);
        let median_m = found[found.len() / 2];
        assert!(found.len() > 1000 && median_m < 0.1, "{town}: {median_m} m of {}", found.len());
    }
}
