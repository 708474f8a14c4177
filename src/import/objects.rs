//! A log's annotations as an episode's truth: categories mapped by the config, points in each box counted.

use std::path::Path;

use super::config::{CategoryRule, CheckedImport};
use super::{ImportError, RawObject};
use crate::geometry::{Ego, Lidar, Point, Transform};
use crate::object::{Event, Object};
use crate::sample::{IgnoredRegion, LidarPoint, Truth};

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

/// Counts the points in each object's box.
pub(super) fn count_points(truth: &mut Truth, ego_from_lidar: &Transform<Ego, Lidar>, points: &[LidarPoint]) {
    let points: Vec<Point<Ego>> = points
        .iter()
        .map(|point| *ego_from_lidar * Point::new(point.x_m.into(), point.y_m.into(), point.z_m.into()))
        .collect();
    for object in &mut truth.objects {
        object.n_lidar_points = Some(object.box_in_ego.count_inside(&points));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Box3;
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
        count_points(&mut truth, &Transform::from_xyz_yaw(0.0, 0.0, 1.8, 0.0), &points);
        assert_eq!(truth.objects[0].n_lidar_points, Some(2));
    }
}
