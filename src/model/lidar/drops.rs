//! Drops of rain and fog in a cloud: points that are near, dim and alone.
//!
//! Water in the air sends back little light, and only from near the LiDAR; what answers there and is no water has
//! neighbours, or is brighter. After LIOR (Park, Kim, Kim, "Fast and Accurate Desnowing Algorithm for LiDAR Point
//! Clouds", IEEE Access 8, 2020), which asks for intensity first and lets neighbours plead for a dim point.

use std::ops::RangeInclusive;

use crate::model::config::DropsConfig;
use crate::sample::LidarPoint;

/// Bits of a key for each axis: cells on either side of the LiDAR up to half of what they count to.
const AXIS_BITS: u32 = 20;

impl DropsConfig {
    /// Whether each point is taken for a drop; x, y and z are in the LiDAR's frame.
    #[must_use]
    pub fn among(&self, points: &[LidarPoint]) -> Vec<bool> {
        let mut are_drops = vec![false; points.len()];
        let is_dim = |p: &LidarPoint| {
            f64::from(p.intensity) <= self.most_intensity
                && p.range_m() < self.range_m
                && self.n_neighbours > 0
        };
        if !points.iter().any(is_dim) {
            return are_drops;
        }
        let reach_m = self.range_m + self.radius_m;
        let mut by_cell: Vec<(u64, u32)> = points
            .iter()
            .enumerate()
            .filter(|(_, p)| p.range_m() < reach_m)
            .map(|(i, p)| (key(self.cell_of(p)), i as u32))
            .collect();
        by_cell.sort_unstable();
        for &(_, i) in &by_cell {
            let p = &points[i as usize];
            are_drops[i as usize] = is_dim(p) && !self.has_neighbours(p, points, &by_cell);
        }
        are_drops
    }

    /// Whether enough points stand around one of them.
    fn has_neighbours(&self, p: &LidarPoint, points: &[LidarPoint], by_cell: &[(u64, u32)]) -> bool {
        // The point itself is found, too.
        let mut n_missing = self.n_neighbours + 1;
        let [x, y, z] = self.cell_of(p);
        // Most have enough in their own column.
        for (dx, dy) in [(0, 0), (-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (-1, 1), (1, -1), (1, 1)] {
            let column = key([x + dx, y + dy, z - 1])..=key([x + dx, y + dy, z + 1]);
            for &(_, other) in within(by_cell, &column) {
                let near = distance_m(p, &points[other as usize]) <= self.radius_m;
                n_missing -= usize::from(near);
                if n_missing == 0 {
                    return true;
                }
            }
        }
        false
    }

    /// Cell of a lattice whose side is the radius, so that neighbours lie in the cells around.
    fn cell_of(&self, p: &LidarPoint) -> [i64; 3] {
        [p.x_m, p.y_m, p.z_m].map(|at_m| (f64::from(at_m) / self.radius_m).floor() as i64)
    }
}

/// Cells in order: those of a column follow each other.
fn key(cell: [i64; 3]) -> u64 {
    cell.iter().fold(0, |key, &at| (key << AXIS_BITS) | (at + (1 << (AXIS_BITS - 1))) as u64)
}

/// The part of a sorted list whose keys lie in a range.
fn within<'a>(by_cell: &'a [(u64, u32)], keys: &RangeInclusive<u64>) -> &'a [(u64, u32)] {
    let from = by_cell.partition_point(|(key, _)| key < keys.start());
    let n = by_cell[from..].iter().take_while(|(key, _)| key <= keys.end()).count();
    &by_cell[from..from + n]
}

fn distance_m(a: &LidarPoint, b: &LidarPoint) -> f64 {
    let [x_m, y_m, z_m] = [a.x_m - b.x_m, a.y_m - b.y_m, a.z_m - b.z_m].map(f64::from);
    x_m.hypot(y_m).hypot(z_m)
}

#[cfg(test)]
mod tests {
    use rand::RngExt as _;

    use super::*;
    use crate::random::stream;
    use crate::sensors::lidar::{Finish, Hit, Pattern, Receiver, Reflector, Turn};
    use crate::sensors::{RigLidarConfig, Weather};

    fn point(x_m: f32, y_m: f32, z_m: f32, intensity: f32) -> LidarPoint {
        LidarPoint { x_m, y_m, z_m, intensity, ring: 0 }
    }

    /// A line of points 4 cm apart, as a ring of a LiDAR lays it.
    fn line(x_m: f32, intensity: f32) -> Vec<LidarPoint> {
        (0..20).map(|k| point(x_m, 0.04 * k as f32, -1.0, intensity)).collect()
    }

    #[test]
    fn a_lone_dim_point_near_the_lidar_is_a_drop_and_others_are_none() {
        let lone = [point(4.0, 1.0, 0.3, 0.0), point(4.0, 2.0, 0.3, 30.0), point(14.0, 1.0, 0.3, 0.0)];
        assert_eq!(DropsConfig::default().among(&lone), [true, false, false], "a bright one, a far one");
        assert!(!DropsConfig::default().among(&line(4.0, 0.0)).contains(&true), "a dark thing");
        let mut both = line(4.0, 0.0);
        both.push(point(4.0, 0.4, 0.5, 0.0));
        let found = DropsConfig::default().among(&both);
        assert_eq!(found.iter().filter(|&&drop| drop).count(), 1, "a drop above a dark thing");
        assert!(found[20]);
    }

    #[test]
    fn points_without_a_place_and_far_ones_are_left_to_others() {
        let odd =
            [point(f32::NAN, 0.0, 0.0, 0.0), point(f32::INFINITY, 0.0, 0.0, 0.0), point(3e38, 0.0, 0.0, 0.0)];
        assert_eq!(DropsConfig::default().among(&odd), [false; 3]);
        let dim = point(2.0, 0.0, 0.0, 0.0);
        assert_eq!(DropsConfig::default().among(&[odd[0], dim, odd[2]]), [false, true, false]);
        assert_eq!(DropsConfig { n_neighbours: 0, ..DropsConfig::default() }.among(&[dim]), [false]);
    }

    #[test]
    fn neighbours_are_counted_as_by_looking_at_every_pair() {
        let mut rng = stream(7, "drops", 0);
        for n_neighbours in [1, 3, 8] {
            let config = DropsConfig { n_neighbours, radius_m: 0.35, ..DropsConfig::default() };
            let mut at = || rng.random_range(-2.0..2.0_f32);
            let points: Vec<_> = (0..600).map(|k| point(9.0 + at(), at(), at(), (k % 3) as f32)).collect();
            let is_drop = |p: &LidarPoint| {
                let n_near = points.iter().filter(|q| distance_m(p, q) <= 0.35).count() - 1;
                p.range_m() < 10.0 && p.intensity <= 1.0 && n_near < n_neighbours
            };
            let expected: Vec<bool> = points.iter().map(is_drop).collect();
            assert_eq!(config.among(&points), expected);
            assert!(expected.contains(&true) && expected.contains(&false));
        }
    }

    /// A road, 1.8 m below the LiDAR, and a flat carton on it 5.5 m ahead: what a ray hits, and whether it is the carton.
    fn road_with_carton(ray: &nalgebra::Vector3<f64>) -> (Hit, bool) {
        let (road_m, top_m, front_m) = (-1.8, -1.55, 5.5);
        let matt = |range_m: f64, cos_incidence: f64, reflectivity: f64, is_paved: bool| Hit {
            range_m,
            cos_incidence,
            reflectivity,
            is_paved,
            finish: Finish::Matt,
            leaves_m: 0.0,
        };
        let at_front = ray * (front_m / ray.x);
        let on_top = ray * (top_m / ray.z);
        if ray.z < 0.0 && at_front.y.abs() < 0.3 && (road_m..top_m).contains(&at_front.z) {
            (matt(at_front.norm(), ray.x, 0.3, false), true)
        } else if ray.z < 0.0 && on_top.y.abs() < 0.3 && (front_m..front_m + 0.6).contains(&on_top.x) {
            (matt(on_top.norm(), -ray.z, 0.3, false), true)
        } else if ray.z < 0.0 {
            (matt(road_m / ray.z, -ray.z, 0.17, true), false)
        } else {
            (matt(f64::INFINITY, 1.0, 0.0, false), false)
        }
    }

    #[test]
    fn in_rain_and_fog_most_water_goes_and_what_stands_on_the_road_stays() {
        let elevations_deg: Vec<f64> = (0..32).map(|ring| -25.0 + 40.0 / 31.0 * f64::from(ring)).collect();
        let pattern = Pattern::spinning(&elevations_deg, 0.4);
        let (hits, on_carton): (Vec<_>, Vec<_>) = pattern.directions.iter().map(road_with_carton).unzip();
        for weather in [Weather::SoftRainNoon, Weather::HardRainNoon, Weather::FogNoon] {
            let receiver = Receiver::new(&RigLidarConfig::default(), 32, &weather.state(), 7);
            let returns = receiver.returns(&pattern, &hits, Turn::Sample(0));
            let points: Vec<LidarPoint> = returns.iter().map(|found| found.point).collect();
            let are_drops = DropsConfig::default().among(&points);
            let share = |of: &dyn Fn(usize) -> bool| {
                let of: Vec<usize> = (0..points.len()).filter(|&i| of(i)).collect();
                let n_left_out = of.iter().filter(|&&i| are_drops[i]).count();
                (n_left_out as f64 / of.len() as f64, of.len())
            };
            let is_target = |i: usize| returns[i].reflector == Reflector::Target;
            let (water, n_water) = share(&|i| !is_target(i) && points[i].range_m() < 10.0);
            let (road, _) = share(&|i| is_target(i));
            let (carton, n_carton) = share(&|i| is_target(i) && on_carton[returns[i].ray]);
            assert!(n_water > 30 && n_carton > 20, "{weather:?}: {n_water}, {n_carton}");
            assert!(water > 0.8 && road < 0.01, "{weather:?}: {water}, {road}");
            assert_eq!(carton, 0.0, "{weather:?}");
        }
    }
}
