//! What the objects are like: how many, how large, how far, and how many points fall on one.

use super::quantity::{N_RANGE_BINS, RANGE_BIN_M};
use super::{Quantity, Tallies};
use crate::geometry::{Ego, Point};
use crate::object::{Kind, Object};
use crate::sample::Measured;

/// A box holds the points within it and this far around: twice and more the noise of a range.
pub const BOX_MARGIN_M: f64 = 0.1;

/// Counts the objects of a sample, in which these kinds are annotated; one of unknown kind tells nothing.
pub(super) fn add_objects(tallies: &mut Tallies, measured: &Measured, objects: &[Object], kinds: &[Kind]) {
    let to_ego = |point: &crate::sample::LidarPoint| {
        measured.ego_from_lidar * Point::new(f64::from(point.x_m), f64::from(point.y_m), f64::from(point.z_m))
    };
    let points: Vec<Point<Ego>> = measured.points.iter().map(to_ego).collect();
    for &kind in kinds {
        let of_kind = objects.iter().filter(|object| object.kind == Some(kind));
        tallies.add(Quantity::ObjectsPerSample(kind), of_kind.clone().count() as f64);
        for object in of_kind {
            let of = &object.box_in_ego;
            let range_m = of.center.x().hypot(of.center.y());
            tallies.add(Quantity::ObjectRange(kind), range_m);
            tallies.add(Quantity::Length(kind), of.length_m);
            tallies.add(Quantity::Width(kind), of.width_m);
            tallies.add(Quantity::Height(kind), of.height_m);
            let bin = (range_m / RANGE_BIN_M) as usize;
            if bin < usize::from(N_RANGE_BINS) {
                let reach_m = of.length_m.hypot(of.width_m) / 2.0 + 2.0 * BOX_MARGIN_M;
                let is_near = |point: &&Point<Ego>| {
                    (point.x() - of.center.x()).abs() <= reach_m
                        && (point.y() - of.center.y()).abs() <= reach_m
                };
                let n_points =
                    points.iter().filter(is_near).filter(|point| of.contains(point, BOX_MARGIN_M)).count();
                tallies.add(Quantity::PointsOnObject(kind, bin as u8), n_points as f64);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;

    #[test]
    fn points_count_for_the_box_that_holds_them_in_its_bin_of_range() {
        let dataset = test_data::dataset(1);
        let sample = &dataset.samples()[0];
        let objects: Vec<Object> = sample.objects.iter().map(|object| object.truth.clone()).collect();
        let mut tallies = Tallies::default();
        add_objects(&mut tallies, &sample.measured, &objects, &[Kind::Vehicle, Kind::Static]);
        let of = |quantity| tallies.get(quantity);
        assert_eq!(of(Quantity::ObjectsPerSample(Kind::Vehicle)).unwrap().mean(), 5.0);
        assert_eq!(of(Quantity::ObjectsPerSample(Kind::Static)).unwrap().mean(), 0.0);
        assert_eq!(of(Quantity::Length(Kind::Vehicle)).unwrap().mean(), 4.0);
        assert!(of(Quantity::ObjectsPerSample(Kind::Pedestrian)).is_none(), "nobody annotates them");
        // The made-up points lie in the car's frame before the LiDAR's mounting moves them; so count by hand.
        let by_hand = |object: &Object| {
            let in_box = |point: &&crate::sample::LidarPoint| {
                let [x, y, z] = [point.x_m, point.y_m, point.z_m].map(f64::from);
                object
                    .box_in_ego
                    .contains(&(sample.measured.ego_from_lidar * Point::new(x, y, z)), BOX_MARGIN_M)
            };
            sample.measured.points.iter().filter(in_box).count()
        };
        for bin in 0..N_RANGE_BINS {
            let is_in_bin = |object: &&Object| {
                let center = &object.box_in_ego.center;
                (center.x().hypot(center.y()) / RANGE_BIN_M) as u8 == bin
            };
            let wanted: Vec<f64> =
                objects.iter().filter(is_in_bin).map(|object| by_hand(object) as f64).collect();
            let found = of(Quantity::PointsOnObject(Kind::Vehicle, bin));
            assert_eq!(found.map_or(0, super::super::tally::Tally::n), wanted.len() as u64);
            if let Some(tally) = found {
                assert_eq!(tally.mean(), wanted.iter().sum::<f64>() / wanted.len() as f64);
            }
        }
    }
}
