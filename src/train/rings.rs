//! The beams of a cloud's LiDAR: the elevation of each ring, as its points show it, and which of them meet an object that
//! another LiDAR saw.

use std::collections::HashMap;

use super::cut_out::Return;
use crate::geometry::{Ego, Lidar, Point, Transform};
use crate::sample::{LidarPoint, Measured};

/// Somewhat more than the step between shots of a ring, so that no ray passes between the points of an object.
const AZIMUTH_BIN_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// Elevations of so many points of a ring are looked at.
const POINTS_OF_RING: usize = 25;

/// A ray's place: ring, and bin of the azimuth.
pub type Ray = (u16, i64);

/// Rings by rising elevation.
pub struct RingElevations {
    lidar_from_ego: Transform<Lidar, Ego>,
    /// Elevation in radians, ring.
    rings: Vec<(f64, u16)>,
}

impl RingElevations {
    pub fn of(measured: &Measured) -> Self {
        let mut by_ring: HashMap<u16, Vec<f64>> = HashMap::new();
        for point in &measured.points {
            by_ring.entry(point.ring).or_default().push(elevation_rad(point));
        }
        let middle = |(ring, elevations): (u16, Vec<f64>)| {
            let step = elevations.len().div_ceil(POINTS_OF_RING);
            let mut some: Vec<f64> = elevations.into_iter().step_by(step).collect();
            let middle = some.len() / 2;
            (*some.select_nth_unstable_by(middle, f64::total_cmp).1, ring)
        };
        let mut rings: Vec<(f64, u16)> = by_ring.into_iter().map(middle).collect();
        rings.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        Self { lidar_from_ego: measured.ego_from_lidar.inverse(), rings }
    }

    /// Ray and distance of a return of this LiDAR's.
    pub fn ray(&self, of: &Return) -> (Ray, f64) {
        let at = self.lidar_from_ego * of.at;
        ((of.ring, azimuth_bin(&at)), at.coords.coords.norm())
    }

    /// Keeps what this LiDAR would have seen of another one's returns, under its own rings: what lies no farther from a ring than
    /// halfway to the next, and of several rings there the nearest one.
    pub fn take(&self, points: Vec<Return>) -> Vec<Return> {
        // By ray of this LiDAR: how far the nearest of the other's rings is, and which it is.
        let mut nearest: HashMap<Ray, (f64, u16)> = HashMap::new();
        let met: Vec<(Ray, Return)> = points
            .into_iter()
            .filter_map(|of| {
                let at = self.lidar_from_ego * of.at;
                let (off_rad, ring) = self.nearest_ring(elevation_of(&at))?;
                let ray = (ring, azimuth_bin(&at));
                let best = nearest.entry(ray).or_insert((off_rad, of.ring));
                if off_rad < best.0 {
                    *best = (off_rad, of.ring);
                }
                Some((ray, of))
            })
            .collect();
        let is_nearest = |(ray, of): &(Ray, Return)| nearest[ray].1 == of.ring;
        met.into_iter().filter(is_nearest).map(|(ray, of)| Return { ring: ray.0, ..of }).collect()
    }

    /// The ring next to an elevation and how far off it is; `None` beyond half a step from all.
    fn nearest_ring(&self, elevation_rad: f64) -> Option<(f64, u16)> {
        let above = self.rings.partition_point(|ring| ring.0 < elevation_rad);
        let off = |i: usize| (self.rings[i].0 - elevation_rad).abs();
        let candidates = [above.checked_sub(1), (above < self.rings.len()).then_some(above)];
        let i = candidates.into_iter().flatten().min_by(|&a, &b| off(a).total_cmp(&off(b)))?;
        let gap = |other: Option<&(f64, u16)>| other.map(|other| (other.0 - self.rings[i].0).abs());
        let (below, over) =
            (gap(i.checked_sub(1).and_then(|i| self.rings.get(i))), gap(self.rings.get(i + 1)));
        // Outermost rings reach as far outwards as inwards.
        let gap = if elevation_rad < self.rings[i].0 { below.or(over) } else { over.or(below) }?;
        (off(i) <= gap / 2.0).then_some((off(i), self.rings[i].1))
    }
}

fn elevation_of(at: &Point<Lidar>) -> f64 {
    at.z().atan2(at.x().hypot(at.y()))
}

fn elevation_rad(of: &LidarPoint) -> f64 {
    f64::from(of.z_m).atan2(f64::from(of.x_m).hypot(f64::from(of.y_m)))
}

fn azimuth_bin(at: &Point<Lidar>) -> i64 {
    (at.y().atan2(at.x()) / AZIMUTH_BIN_RAD).floor() as i64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;

    /// A cloud of rings at these elevations in degrees, some shots each.
    fn seen_by(elevations_deg: &[f64]) -> Measured {
        let mut measured = test_data::dataset(1).samples()[0].measured.clone();
        let shot = |ring: usize, elevation_deg: f64, k: usize| {
            let (azimuth, range_m, elevation) = (0.01 * k as f64, 20.0, elevation_deg.to_radians());
            let [x, y, z] =
                [azimuth.cos() * elevation.cos(), azimuth.sin() * elevation.cos(), elevation.sin()];
            LidarPoint {
                x_m: (range_m * x) as f32,
                y_m: (range_m * y) as f32,
                z_m: (range_m * z) as f32,
                intensity: 9.0,
                ring: ring as u16,
            }
        };
        measured.points = elevations_deg
            .iter()
            .enumerate()
            .flat_map(|(ring, &at)| (0..5).map(move |k| shot(ring, at, k)))
            .collect();
        measured
    }

    fn rings(of: &[Return]) -> Vec<u16> {
        let mut rings: Vec<u16> = of.iter().map(|of| of.ring).collect();
        rings.sort_unstable();
        rings.dedup();
        rings
    }

    #[test]
    fn of_a_finer_lidars_points_the_rings_next_to_its_own_are_kept() {
        let beams = RingElevations::of(&seen_by(&[-10.0, -8.0, -6.0]));
        let fine = seen_by(&[-12.0, -10.4, -9.9, -8.6, -8.1, -7.3, -6.2, -4.0]);
        let taken = beams.take(super::super::cut_out::returns(&fine).collect());
        assert_eq!(taken.len(), 15, "one ring's shots under each of its rings");
        assert_eq!(rings(&taken), [0, 1, 2]);
        let deg = |of: &Return| elevation_of(&(beams.lidar_from_ego * of.at)).to_degrees();
        assert!(taken.iter().all(|of| [-9.9, -8.1, -6.2].iter().any(|at| (deg(of) - at).abs() < 0.01)));
    }

    #[test]
    fn of_a_coarser_lidars_points_all_stay_that_its_rings_reach() {
        let beams = RingElevations::of(&seen_by(&[-10.0, -9.0, -8.0, -7.0, -6.0]));
        let taken = beams.take(super::super::cut_out::returns(&seen_by(&[-9.2, -6.4, 3.0])).collect());
        assert_eq!((taken.len(), rings(&taken)), (10, vec![1, 4]));
        let empty = Measured { points: Vec::new(), ..seen_by(&[]) };
        assert!(RingElevations::of(&empty).take(taken).is_empty());
    }
}
