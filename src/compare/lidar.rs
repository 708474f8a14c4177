//! What a cloud shows: how many points, where, how strong, from which rings, and how many of them no box explains.

use super::objects::BOX_MARGIN_M;
use super::structure::{add_irregular, add_spacing};
use super::{Quantity, Tallies};
use crate::geometry::{Box3, Ego, Point};
use crate::sample::Measured;

/// Points lower than this over the ego's ground plane count as ground.
pub const GROUND_M: f64 = 0.2;
/// Points from here on hang over the road or are walls and crowns: no obstacle for a car.
pub const OBSTACLE_TOP_M: f64 = 3.0;
/// Clutter is counted to this range, where boxes are scored (`max_range_m` of `eval.toml`).
pub const CLUTTER_RANGE_M: f64 = 50.0;

/// A ring of fewer points says nothing of steps.
const MIN_RING_POINTS: usize = 8;
/// Intensities within this of 0 or 255 count as 0 or as saturated.
const INTENSITY_MARGIN: f32 = 0.5;

/// Counts a sample's points; `boxes` are its annotated objects, if it says which there are.
pub(super) fn add_points(tallies: &mut Tallies, measured: &Measured, boxes: Option<&[Box3<Ego>]>) {
    let points = &measured.points;
    tallies.add(Quantity::PointsPerSample, points.len() as f64);
    tallies.add(Quantity::LidarHeight, measured.ego_from_lidar.isometry.translation.z);
    if points.is_empty() {
        return;
    }
    let mut rings: Vec<Ring> = Vec::new();
    let (mut n_ground, mut n_zero, mut n_saturated, mut n_obstacle, mut n_clutter) = (0, 0, 0, 0, 0);
    let (mut ranges, mut heights, mut elevations) = (Vec::new(), Vec::new(), Vec::new());
    let (mut near, mut unexplained) = (Vec::new(), Vec::new());
    for point in points {
        let [x, y, z] = [point.x_m, point.y_m, point.z_m].map(f64::from);
        let in_ego = measured.ego_from_lidar * Point::new(x, y, z);
        let range_m = in_ego.x().hypot(in_ego.y());
        let elevation_rad = z.atan2(x.hypot(y));
        ranges.push(range_m);
        heights.push(in_ego.z());
        elevations.push(elevation_rad.to_degrees());
        let ring = usize::from(point.ring);
        if rings.len() <= ring {
            rings.resize_with(ring + 1, Ring::default);
        }
        rings[ring].azimuths_rad.push(y.atan2(x));
        rings[ring].elevation_sum_rad += elevation_rad;
        n_ground += u32::from(in_ego.z() < GROUND_M);
        n_zero += u32::from(point.intensity < INTENSITY_MARGIN);
        n_saturated += u32::from(point.intensity > 255.0 - INTENSITY_MARGIN);
        if range_m >= CLUTTER_RANGE_M {
            continue;
        }
        near.push(in_ego.coords);
        if in_ego.z() >= GROUND_M {
            let is_explained =
                boxes.is_some_and(|boxes| boxes.iter().any(|of| of.contains(&in_ego, BOX_MARGIN_M)));
            let is_obstacle = in_ego.z() < OBSTACLE_TOP_M;
            n_obstacle += u32::from(is_obstacle);
            n_clutter += u32::from(is_obstacle && !is_explained);
            unexplained.extend((!is_explained).then_some(in_ego.coords));
        }
    }
    tallies.add_all(Quantity::PointRange, ranges);
    tallies.add_all(Quantity::PointHeight, heights);
    tallies.add_all(Quantity::PointElevation, elevations);
    tallies.add_all(Quantity::PointRing, points.iter().map(|point| f64::from(point.ring)));
    tallies.add_all(Quantity::Intensity, points.iter().map(|point| f64::from(point.intensity)));
    let share = |n: u32| f64::from(n) / points.len() as f64;
    tallies.add(Quantity::GroundShare, share(n_ground));
    tallies.add(Quantity::ZeroIntensityShare, share(n_zero));
    tallies.add(Quantity::SaturatedShare, share(n_saturated));
    if boxes.is_some() && n_obstacle > 0 {
        tallies.add(Quantity::ClutterShare, f64::from(n_clutter) / f64::from(n_obstacle));
    }
    add_spacing(tallies, &near);
    if boxes.is_some() {
        add_irregular(tallies, &unexplained, near.len());
    }
    add_rings(tallies, rings);
}

/// The points of one ring.
#[derive(Debug, Default)]
struct Ring {
    azimuths_rad: Vec<f64>,
    elevation_sum_rad: f64,
}

/// Counts the rings, and the steps in them and between them.
fn add_rings(tallies: &mut Tallies, mut rings: Vec<Ring>) {
    let n_returning = rings.iter().filter(|ring| !ring.azimuths_rad.is_empty()).count();
    tallies.add(Quantity::RingsReturning, n_returning as f64);
    rings.retain(|ring| ring.azimuths_rad.len() >= MIN_RING_POINTS);
    for ring in &mut rings {
        if let Some(step_rad) = median_step(&mut ring.azimuths_rad) {
            tallies.add(Quantity::AzimuthStep, step_rad.to_degrees());
        }
    }
    let mean = |ring: &Ring| ring.elevation_sum_rad / ring.azimuths_rad.len() as f64;
    let mut elevations: Vec<f64> = rings.iter().map(mean).collect();
    elevations.sort_by(f64::total_cmp);
    let steps = elevations.windows(2).map(|pair| (pair[1] - pair[0]).to_degrees());
    tallies.add_all(Quantity::ElevationStep, steps);
}

/// Median of the steps between neighbours; `None` where all are at one place.
fn median_step(azimuths_rad: &mut [f64]) -> Option<f64> {
    azimuths_rad.sort_by(f64::total_cmp);
    let mut steps: Vec<f64> =
        azimuths_rad.windows(2).map(|pair| pair[1] - pair[0]).filter(|&step| step > 0.0).collect();
    let middle = steps.len() / 2;
    (!steps.is_empty()).then(|| *steps.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;
    use crate::sample::LidarPoint;

    /// A LiDAR at (0.9, 0, 1.8).
    fn measured(points: Vec<LidarPoint>) -> Measured {
        let mut measured = test_data::dataset(1).samples()[0].measured.clone();
        measured.points = points;
        measured
    }

    fn point(x_m: f32, y_m: f32, z_m: f32, intensity: f32, ring: u16) -> LidarPoint {
        LidarPoint { x_m, y_m, z_m, intensity, ring }
    }

    fn mean(tallies: &Tallies, quantity: Quantity) -> f64 {
        tallies.get(quantity).expect("it was measured").mean()
    }

    #[test]
    fn points_are_ground_explained_or_clutter_and_walls_and_far_points_are_none_of_them() {
        let car = Box3 {
            center: Point::new(10.0, 0.0, 0.75),
            length_m: 4.0,
            width_m: 2.0,
            height_m: 1.5,
            yaw_rad: 0.0,
        };
        let points = vec![
            point(5.0, 0.0, -1.7, 0.0, 0),   // 0.1 m over ground
            point(8.0, 0.0, -1.0, 255.0, 0), // on the car
            point(8.0, 5.0, -1.0, 10.0, 1),  // clutter
            point(8.0, 5.0, 4.0, 10.0, 3),   // a wall
            point(60.0, 5.0, -1.0, 10.0, 3), // too far to judge
        ];
        let mut tallies = Tallies::default();
        add_points(&mut tallies, &measured(points.clone()), Some(&[car]));
        assert_eq!(mean(&tallies, Quantity::ClutterShare), 0.5);
        assert!((mean(&tallies, Quantity::GroundShare) - 0.2).abs() < 1e-12);
        assert!((mean(&tallies, Quantity::ZeroIntensityShare) - 0.2).abs() < 1e-12);
        assert!((mean(&tallies, Quantity::SaturatedShare) - 0.2).abs() < 1e-12);
        assert_eq!(
            (mean(&tallies, Quantity::RingsReturning), mean(&tallies, Quantity::LidarHeight)),
            (3.0, 1.8)
        );
        let mut tallies = Tallies::default();
        add_points(&mut tallies, &measured(points), None);
        assert!(tallies.get(Quantity::ClutterShare).is_none(), "without truth nothing is known of clutter");
    }

    #[test]
    fn steps_are_those_of_the_pattern_in_spite_of_gaps() {
        let mut points = Vec::new();
        for (ring, elevation_deg) in [(0, -10.0_f64), (1, -8.5), (2, -7.0)] {
            for i in (0..100).filter(|i| i % 10 != 3) {
                let (azimuth, elevation) = ((f64::from(i) * 0.2).to_radians(), elevation_deg.to_radians());
                let [x, y, z] = [
                    20.0 * elevation.cos() * azimuth.cos(),
                    20.0 * elevation.cos() * azimuth.sin(),
                    20.0 * elevation.sin(),
                ];
                points.push(point(x as f32, y as f32, z as f32, 50.0, ring));
            }
        }
        let mut tallies = Tallies::default();
        add_points(&mut tallies, &measured(points), None);
        assert!((mean(&tallies, Quantity::AzimuthStep) - 0.2).abs() < 1e-4);
        assert!((mean(&tallies, Quantity::ElevationStep) - 1.5).abs() < 1e-4);
    }

    #[test]
    fn an_empty_cloud_counts_as_a_sample_without_points() {
        let mut tallies = Tallies::default();
        add_points(&mut tallies, &measured(vec![]), Some(&[]));
        assert_eq!(mean(&tallies, Quantity::PointsPerSample), 0.0);
        assert!(
            tallies.get(Quantity::PointRange).is_none() && tallies.get(Quantity::RingsReturning).is_none()
        );
    }
}
