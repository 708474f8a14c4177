//! Truth: each object's box, velocity, LiDAR points and visible pixels at one instant, and the ground that is ignored.

use nalgebra::{Isometry3, Point3, Vector3};

use super::AnnotationConfig;
use super::upright::{upright_box, upright_box_of};
use crate::geometry::{Box3, Ego, Transform, World};
use crate::object::{Event, Object, SolidPart};
use crate::sample::IgnoredRegion;
use crate::scene::SceneObject;
use crate::sensors::{Rig, RigCamera, RigLidar, silhouette_px};

/// Cosine of the greatest tilt at which what is solid of a standing model still is.
const UPRIGHT: f64 = 0.97;
/// How far beside a heap the middle of a detection may lie: the LiDAR sees one side of it.
const BESIDE_M: f64 = 0.3;

/// An object at one instant.
#[derive(Debug, Clone)]
pub(super) struct Observation {
    pub world_from_model: Isometry3<f64>,
    /// One control step earlier.
    pub world_from_model_before: Isometry3<f64>,
    /// Of all LiDARs together.
    pub n_lidar_points: u32,
    /// Of each camera of the rig.
    pub visible_px: Vec<u32>,
    /// Height of the ground under it, in the world frame.
    pub ground_m: f64,
    /// Which of its looks it has.
    pub shape: usize,
}

/// An object that is hit or seen, and in view of a camera, or of a LiDAR that reports its whole turn.
struct InView {
    box_in_ego: Box3<Ego>,
    /// What the camera sees that sees most of it.
    visible_px: u32,
    /// The whole of it in that camera.
    whole_px: u32,
}

/// `None` of what is neither hit nor seen, in nobody's view, or too far.
fn in_view(
    object: &SceneObject,
    seen: &Observation,
    world_from_ego: &Transform<World, Ego>,
    rig: &Rig,
    config: &AnnotationConfig,
) -> Option<InView> {
    let (camera_idx, visible_px) = (0..).zip(seen.visible_px.iter().copied()).max_by_key(|&(_, px)| px)?;
    if seen.n_lidar_points < config.min_lidar_points.max(1) && visible_px < config.min_visible_px.max(1) {
        return None;
    }
    let ego_from_world = world_from_ego.inverse();
    let box_in_ego = box_of(object, seen, &ego_from_world);
    let distance_m = box_in_ego.center.x().hypot(box_in_ego.center.y());
    if distance_m > config.max_range_m {
        return None;
    }
    let whole_px_in = |camera: &RigCamera| {
        let camera_from_world = camera.ego_from_camera.inverse() * ego_from_world;
        let camera_from_model = camera_from_world.isometry * seen.world_from_model;
        let triangles: Vec<[Point3<f64>; 3]> = object
            .triangles_as(seen.shape)
            .iter()
            .map(|triangle| triangle.map(|corner| camera_from_model * corner.cast::<f64>()))
            .collect();
        silhouette_px(&triangles, &camera.intrinsics)
    };
    let whole_px = if visible_px > 0 {
        whole_px_in(&rig.cameras[camera_idx])
    } else {
        rig.cameras.iter().map(whole_px_in).find(|&px| px > 0).unwrap_or(0)
    };
    if whole_px == 0 && !rig.lidars.iter().any(RigLidar::is_full) {
        return None;
    }
    Some(InView { box_in_ego, visible_px, whole_px })
}

/// The object's truth, if the object is annotated: it is hit or seen, and in view; background never is.
pub(super) fn annotate(
    object: &SceneObject,
    seen: &Observation,
    step_s: f64,
    world_from_ego: &Transform<World, Ego>,
    rig: &Rig,
    config: &AnnotationConfig,
) -> Option<Object> {
    if object.is_background {
        return None;
    }
    let InView { visible_px, whole_px, .. } = in_view(object, seen, world_from_ego, rig, config)?;
    Some(Object {
        n_lidar_points: Some(seen.n_lidar_points),
        visible_px: Some(visible_px),
        visible_fraction: Some((f64::from(visible_px) / f64::from(whole_px.max(1))).min(1.0)),
        ..describe(object, seen, step_s, world_from_ego)
    })
}

/// The ground under a heap that is hit or seen, and in view, and a little beside it.
pub(super) fn ignore(
    object: &SceneObject,
    seen: &Observation,
    world_from_ego: &Transform<World, Ego>,
    rig: &Rig,
    config: &AnnotationConfig,
) -> Option<IgnoredRegion> {
    if !object.is_heap() {
        return None;
    }
    let InView { mut box_in_ego, .. } = in_view(object, seen, world_from_ego, rig, config)?;
    box_in_ego.length_m += 2.0 * BESIDE_M;
    box_in_ego.width_m += 2.0 * BESIDE_M;
    Some(IgnoredRegion::Ground { corners_in_ego_m: box_in_ego.footprint().to_vec() })
}

/// What is true of an object, whether it is seen or not.
pub(super) fn describe(
    object: &SceneObject,
    seen: &Observation,
    step_s: f64,
    world_from_ego: &Transform<World, Ego>,
) -> Object {
    let ego_from_world = world_from_ego.inverse();
    let ego_from_model = ego_from_world.isometry * seen.world_from_model;
    let box_in_ego = box_of(object, seen, &ego_from_world);
    let middle = nalgebra::center(&object.bounds[0], &object.bounds[1]);
    let moved = seen.world_from_model * middle - seen.world_from_model_before * middle;
    let velocity: Vector3<f64> = ego_from_world.rotate(&(moved / step_s));
    Object {
        velocity_in_ego_mps: [velocity.x, velocity.y],
        id: Some(object.id.clone()),
        category: Some(object.category.clone()),
        kind: Some(object.kind),
        distribution: Some(object.distribution),
        event: Some(object.event),
        spot: Some(object.spot),
        is_tipped: Some(object.is_tipped),
        solid: solid_part(object, &ego_from_model, &box_in_ego),
        clearance_m: Some(lowest_m(object, &seen.world_from_model) - seen.ground_m),
        ..Object::new(box_in_ego)
    }
}

/// The object's box in the ego frame.
fn box_of(object: &SceneObject, seen: &Observation, ego_from_world: &Transform<Ego, World>) -> Box3<Ego> {
    // Upright is the ego's up: on a slope, a car ahead on the same slope keeps its own sizes.
    let ego_from_model = ego_from_world.isometry * seen.world_from_model;
    let is_upright = matches!(object.event, Event::None | Event::Lies) && !object.is_tipped;
    if is_upright {
        upright_box(&ego_from_model, &object.bounds)
    } else {
        // When a thing tumbles, the corners of its bounds may lie far outside, even below the ground.
        let points = object.triangles_as(seen.shape).iter().flatten().map(|point| point.cast());
        upright_box_of(&ego_from_model, points)
    }
}

/// The solid part of an object that stands upright, where it is not the whole object.
fn solid_part(
    object: &SceneObject,
    ego_from_model: &Isometry3<f64>,
    box_in_ego: &Box3<Ego>,
) -> Option<SolidPart> {
    let is_upright = (ego_from_model.rotation * Vector3::z()).z > UPRIGHT;
    if object.solid == object.bounds || !is_upright {
        return None;
    }
    let Box3 { center, length_m, width_m, yaw_rad, .. } = upright_box::<Ego>(ego_from_model, &object.solid);
    let (x, y) = (center.x() - box_in_ego.center.x(), center.y() - box_in_ego.center.y());
    let (sin, cos) = yaw_rad.sin_cos();
    Some(SolidPart { along_m: x * cos + y * sin, across_m: y * cos - x * sin, length_m, width_m })
}

/// Height of an object's lowest point in the world frame.
fn lowest_m(object: &SceneObject, world_from_model: &Isometry3<f64>) -> f64 {
    let points = object.triangles.iter().flatten();
    points.map(|point| (world_from_model * point.cast::<f64>()).z).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point2;
    use crate::object::{Distribution, Kind, Spot};
    use crate::sensors::RigConfig;
    use nalgebra::{Translation3, UnitQuaternion};
    use std::sync::Arc;

    const BOUNDS: [Point3<f64>; 2] = [Point3::new(-2.0, -1.0, 0.0), Point3::new(2.0, 1.0, 1.5)];

    fn at(x: f64, y: f64, yaw: f64) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::new(x, y, 0.0), UnitQuaternion::from_euler_angles(0.0, 0.0, yaw))
    }

    /// An object of a category, where it stands, and how much of it is seen.
    fn observed(
        category: &str,
        pose: [Isometry3<f64>; 2],
        points: u32,
        px: u32,
    ) -> (SceneObject, Observation) {
        let corner = |x: f32, y: f32, z: f32| Point3::new(x, y, z);
        // The rear face, seen by a driver behind.
        let rear = [
            [corner(-2.0, -1.0, 0.0), corner(-2.0, 1.0, 0.0), corner(-2.0, 1.0, 1.5)],
            [corner(-2.0, -1.0, 0.0), corner(-2.0, 1.0, 1.5), corner(-2.0, -1.0, 1.5)],
        ];
        let object = SceneObject {
            id: "a".into(),
            category: category.into(),
            kind: Kind::Vehicle,
            distribution: Distribution::Id,
            body_name: "obj:a".into(),
            bounds: BOUNDS,
            solid: [BOUNDS[0], Point3::new(0.0, 1.0, 1.5)],
            triangles: Arc::new(rear.to_vec()),
            shapes: Vec::new(),
            reflectivity: 0.5,
            event: Event::None,
            spot: Spot::None,
            is_tipped: false,
            is_background: category != "car",
        };
        let seen = Observation {
            world_from_model: pose[0],
            world_from_model_before: pose[1],
            n_lidar_points: points,
            visible_px: vec![px],
            ground_m: -0.1,
            shape: 0,
        };
        (object, seen)
    }

    fn truth_of(pose: Isometry3<f64>, before: Isometry3<f64>, points: u32, px: u32) -> Option<Object> {
        truth_as("car", pose, before, points, px)
    }

    fn truth_as(
        category: &str,
        pose: Isometry3<f64>,
        before: Isometry3<f64>,
        points: u32,
        px: u32,
    ) -> Option<Object> {
        let (object, seen) = observed(category, [pose, before], points, px);
        let rig = Rig::try_from(&RigConfig::default()).unwrap();
        let world_from_ego = Transform::from_xyz_yaw(0.0, 0.0, 0.0, 0.0);
        annotate(&object, &seen, 0.05, &world_from_ego, &rig, &AnnotationConfig::default())
    }

    fn ignored(category: &str, pose: Isometry3<f64>, points: u32, px: u32) -> Option<IgnoredRegion> {
        let (object, seen) = observed(category, [pose, pose], points, px);
        let rig = Rig::try_from(&RigConfig::default()).unwrap();
        let world_from_ego = Transform::from_xyz_yaw(0.0, 0.0, 0.0, 0.0);
        ignore(&object, &seen, &world_from_ego, &rig, &AnnotationConfig::default())
    }

    #[test]
    fn half_a_metre_in_a_control_step_is_ten_metres_a_second() {
        let truth = truth_of(at(20.5, 0.0, 0.0), at(20.0, 0.0, 0.0), 5, 0).unwrap();
        assert!((truth.velocity_in_ego_mps[0] - 10.0).abs() < 1e-9);
        assert!((truth.box_in_ego.center.x() - 20.5).abs() < 1e-12);
    }

    #[test]
    fn who_is_neither_hit_nor_seen_nor_in_view_is_left_out() {
        let ahead = at(20.0, 0.0, 0.0);
        assert!(truth_of(ahead, ahead, 0, 19).is_none());
        assert!(truth_of(ahead, ahead, 0, 20).is_some());
        for background in ["bush", "crates"] {
            assert!(truth_as(background, ahead, ahead, 5, 20).is_none(), "{background}");
        }
        let behind = at(-20.0, 0.0, 0.0);
        assert!(truth_of(behind, behind, 5, 0).is_none());
        let far = at(71.0, 0.0, 0.0);
        assert!(truth_of(far, far, 5, 0).is_none());
    }

    #[test]
    fn the_ground_of_a_heap_in_view_is_ignored_and_that_of_plants_and_objects_is_not() {
        let ahead = at(20.0, 0.0, 0.0);
        let IgnoredRegion::Ground { corners_in_ego_m } = ignored("crates", ahead, 5, 0).unwrap() else {
            panic!("no rectangle of the picture")
        };
        assert_eq!(corners_in_ego_m.len(), 4);
        let is_beside =
            |of: &Point2| ((of.x_m - 20.0).abs() - 2.3).abs() < 1e-9 && (of.y_m.abs() - 1.3).abs() < 1e-9;
        assert!(corners_in_ego_m.iter().all(is_beside), "{corners_in_ego_m:?}");
        for (category, pose, points, px) in [
            ("bush", ahead, 5, 20),
            ("car", ahead, 5, 20),
            ("crates", ahead, 0, 19),
            ("crates", at(-20.0, 0.0, 0.0), 5, 0),
            ("crates", at(71.0, 0.0, 0.0), 5, 0),
        ] {
            assert!(ignored(category, pose, points, px).is_none(), "{category} {pose}");
        }
    }

    #[test]
    fn the_solid_part_lies_in_the_box_and_the_lowest_point_over_the_ground() {
        // Turned by a right angle, so that the rear half lies to the right, at y from -2 to 0.
        let pose = at(20.0, 0.0, std::f64::consts::FRAC_PI_2);
        let truth = truth_of(pose, pose, 5, 50).unwrap();
        let part = truth.solid.unwrap();
        let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
        assert!(near(part.along_m, -1.0) && near(part.across_m, 0.0), "{part:?}");
        assert!(near(part.length_m, 2.0) && near(part.width_m, 2.0), "{part:?}");
        let solid = truth.solid_in_ego();
        assert!(near(solid.center.x(), 20.0) && near(solid.center.y(), -1.0), "{solid:?}");
        assert!(near(truth.clearance_m.unwrap(), 0.1), "{:?}", truth.clearance_m);
        // Tipped over, the whole of it may be hit.
        let over = UnitQuaternion::from_euler_angles(std::f64::consts::FRAC_PI_2, 0.0, 0.0);
        let tipped = Isometry3::from_parts(Translation3::new(20.0, 0.0, 1.0), over);
        assert_eq!(truth_of(tipped, tipped, 5, 50).unwrap().solid, None);
    }

    #[test]
    fn the_visible_fraction_is_of_the_whole_silhouette() {
        // The rear face is 2 x 1.5 m at 20 - 2 - 1.7 = 16.3 m; fx = 400 / tan 35 degrees = 571.3 px.
        let whole_px = 2.0 * 1.5 * (571.26_f64 / 16.3).powi(2);
        let truth = truth_of(at(20.0, 0.0, 0.0), at(20.0, 0.0, 0.0), 0, 1000).unwrap();
        assert!((truth.visible_fraction.unwrap() - 1000.0 / whole_px).abs() < 0.01);
    }
}
