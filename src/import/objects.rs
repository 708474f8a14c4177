//! A log's annotations as an episode's truth: categories mapped by the config, points in each box counted.

use std::path::Path;

use super::config::{CategoryRule, CheckedImport};
use super::{ImportError, RawObject};
use crate::geometry::{Box3, Ego, Lidar, Point, Transform};
use crate::object::{Event, Object};
use crate::sample::{IgnoredRegion, LidarPoint, Truth};

/// What stands less above or below the ego's plane is taken to stand on it.
const LEVEL_M: f64 = 1.0;
/// Around a box its ground is looked for, so far beyond its half diagonal ..
const AROUND_M: f64 = 2.5;
/// .. and so far outside of it, since boxes are drawn tight ..
const BODY_M: f64 = 0.1;
/// .. by so many points, of which this share lies lower ..
const MIN_POINTS: usize = 20;
const LOW_SHARE: f64 = 0.1;
/// .. a box is drawn into it by so much at most ..
const SUNK_M: f64 = 0.5;
/// .. and a road to it is at most so steep.
const MAX_GRADE: f64 = 0.25;

/// Makes the truth of a sample; objects of ignored categories become ignored ground.
///
/// # Errors
/// A category that the config does not map.
pub(super) fn truth_of(
    objects: Vec<RawObject>,
    mut ignored: Vec<IgnoredRegion>,
    config: &CheckedImport,
    path: &Path,
) -> Result<Truth, ImportError> {
    let mut kept = Vec::with_capacity(objects.len());
    for object in objects {
        let Some(rule) = config.categories.get(&object.category) else {
            let known: Vec<&String> = config.categories.keys().collect();
            let message = format!(
                "the category `{}` is not in the config's table `categories`; it has {known:?}, and takes \"ignore\" too",
                object.category
            );
            return Err(ImportError::at(path, message));
        };
        match rule {
            CategoryRule::Ignore(_) => {
                ignored
                    .push(IgnoredRegion::Ground { corners_in_ego_m: object.box_in_ego.footprint().to_vec() });
            }
            CategoryRule::Object(rule) => kept.push(Object {
                velocity_in_ego_mps: object.velocity_in_ego_mps,
                id: Some(object.id),
                category: Some(object.category),
                kind: Some(rule.kind),
                distribution: Some(rule.distribution),
                event: Some(Event::None),
                ..Object::new(object.box_in_ego)
            }),
        }
    }
    Ok(Truth { objects: kept, ignored, ego_state: None })
}

/// Finds what the cloud says of each object: the points in its box, and, where it stands well above or below the ego's plane, how
/// high it is above the ground around it. Else a car uphill would count as one that hangs above the road.
pub(super) fn look_at_cloud(
    truth: &mut Truth,
    ego_from_lidar: &Transform<Ego, Lidar>,
    points: &[LidarPoint],
) {
    let points: Vec<Point<Ego>> = points
        .iter()
        .map(|point| *ego_from_lidar * Point::new(point.x_m.into(), point.y_m.into(), point.z_m.into()))
        .collect();
    for object in &mut truth.objects {
        let of = &object.box_in_ego;
        object.n_lidar_points = Some(of.count_inside(&points));
        let bottom_m = of.bottom_m();
        if bottom_m.abs() > LEVEL_M {
            object.clearance_m = ground_m(of, &points).map(|ground_m| (bottom_m - ground_m).max(0.0));
        }
    }
}

/// The height of the lowest points around a box; `None` where there are too few, or they cannot be the ground.
fn ground_m(of: &Box3<Ego>, points: &[Point<Ego>]) -> Option<f64> {
    let reach_m = of.length_m.hypot(of.width_m) / 2.0 + AROUND_M;
    let is_around = |point: &&Point<Ego>| {
        (point.x() - of.center.x()).hypot(point.y() - of.center.y()) < reach_m && !of.contains(point, BODY_M)
    };
    let mut heights_m: Vec<f64> = points.iter().filter(is_around).map(Point::z).collect();
    if heights_m.len() < MIN_POINTS {
        return None;
    }
    let low = (heights_m.len() as f64 * LOW_SHARE) as usize;
    let ground_m = *heights_m.select_nth_unstable_by(low, f64::total_cmp).1;
    let steepest_m = of.center.x().hypot(of.center.y()) * MAX_GRADE;
    (ground_m.abs() <= steepest_m && ground_m <= of.bottom_m() + SUNK_M).then_some(ground_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{ImportConfig, LogFormat};

    fn object(category: &str) -> RawObject {
        let center = Point::new(10.0, 0.0, 0.8);
        let box_in_ego = Box3 { center, length_m: 4.0, width_m: 2.0, height_m: 1.6, yaw_rad: 0.5 };
        let (id, category) = ("7".to_owned(), category.to_owned());
        RawObject { id, category, box_in_ego, velocity_in_ego_mps: [f64::NAN; 2] }
    }

    fn truth(category: &str, overrides: &[&str]) -> Result<Truth, ImportError> {
        let overrides: Vec<String> = overrides.iter().map(|text| (*text).to_owned()).collect();
        let config = ImportConfig::load(LogFormat::Kitti, None, &overrides).unwrap();
        truth_of(vec![object(category)], Vec::new(), &CheckedImport::new(config).unwrap(), Path::new("log"))
    }

    #[test]
    fn a_category_is_mapped_ignored_or_told() {
        assert!(
            !truth("Car", &[]).unwrap().objects[0].is_ood()
                && truth("Misc", &[]).unwrap().objects[0].is_ood()
        );
        let ignored = truth("Car", &["categories.Car=ignore"]).unwrap();
        assert!(ignored.objects.is_empty() && ignored.ignored.len() == 1);
        assert!(truth("Zebra", &[]).unwrap_err().to_string().contains("`Zebra`"));
    }

    #[test]
    fn points_in_a_turned_box_are_counted() {
        let mut truth = truth("Car", &[]).unwrap();
        let at = |x_m, y_m| LidarPoint { x_m, y_m, z_m: -1.0, intensity: 0.0, ring: 0 };
        // The box's front left corner lies at about (11.28, 1.84), so (11.9, 0.5) is inside only because it is turned.
        let points = [at(10.0, 0.0), at(11.0, 0.9), at(11.9, -0.3), at(30.0, 0.0)];
        look_at_cloud(&mut truth, &Transform::from_xyz_yaw(0.0, 0.0, 1.8, 0.0), &points);
        assert_eq!(truth.objects[0].n_lidar_points, Some(2));
    }

    #[test]
    fn a_car_uphill_stands_on_the_road_and_a_gantry_hangs_above_it() {
        let uphill = |bottom_m: f64, ground_m: Option<f32>| {
            let mut truth = truth("Car", &[]).unwrap();
            let of = &mut truth.objects[0].box_in_ego;
            of.center = Point::new(40.0, 0.0, bottom_m + of.height_m / 2.0);
            // The road before the car, and its own points.
            let road = (0..30).map(|i| (36.0, 0.05 * i as f32 - 1.0)).filter_map(|(x_m, y_m)| {
                Some(LidarPoint { x_m, y_m, z_m: ground_m?, intensity: 0.0, ring: 0 })
            });
            let body = (0..20).map(|i| LidarPoint {
                x_m: 40.0,
                y_m: 0.02 * i as f32,
                z_m: bottom_m as f32 + 0.4,
                intensity: 0.0,
                ring: 1,
            });
            let points: Vec<LidarPoint> = road.chain(body).collect();
            look_at_cloud(&mut truth, &Transform::from_xyz_yaw(0.0, 0.0, 0.0, 0.0), &points);
            truth.objects[0].clearance_m
        };
        let is_about = |found: Option<f64>, wanted_m: f64| (found.unwrap() - wanted_m).abs() < 1e-6;
        assert!(is_about(uphill(3.0, Some(3.0)), 0.0));
        assert!(is_about(uphill(5.0, Some(0.0)), 5.0));
        // Downhill, a sign above the road is no higher than the ego's plane.
        assert!(is_about(uphill(1.5, Some(-2.0)), 3.5));
        // On the ego's plane nothing is looked for; without ground nothing is known; so steep is no road.
        assert_eq!(uphill(0.2, Some(0.0)), None);
        assert_eq!(uphill(3.0, None), None);
        assert_eq!(uphill(13.0, Some(13.0)), None);
        // What hangs beside it is no ground.
        assert_eq!(uphill(5.0, Some(6.0)), None);
    }
}
