//! Height of the ground under a cloud, so that a point's height over the ground reads the same on a hill, before a
//! crest and on a tilted car.
//!
//! Planes stand at the nodes of a coarse lattice, each fitted to the lowest points around it. The fit starts at the
//! car, whose wheels stand at height zero, and goes outwards: what the nearer planes foretell counts as a few more
//! points. Points far above a plane hardly weigh (Cauchy's weights), as those of cars, walls and hedges.

use nalgebra::{Matrix3, Vector3};

use crate::model::config::GridConfig;

/// Distance between nodes.
const NODE_M: f64 = 6.4;
/// Only the lowest point of each square counts.
const SQUARE_M: f64 = 0.8;
/// A node sees points this near, at weights that fall to `exp(-2)` there.
const REACH_M: f64 = 9.0;
/// A point this much above the plane weighs half: the roughness of a street with its kerbs.
const ABOVE_M: f64 = 0.1;
/// The same below the plane, where only stray returns lie.
const BELOW_M: f64 = 0.4;
/// Weight of what nearer planes foretell, in points.
const PRIOR_POINTS: f64 = 3.0;
/// How far the slope may plausibly change between two nodes.
const SLOPE_CHANGE: f64 = 0.05;
/// A slope that fades out where nothing is seen.
const FADING: f64 = 0.8;
const N_ROUNDS: usize = 5;
/// Points beyond this height from the car's wheels are not ground.
const MOST_M: f64 = 12.0;

/// Planes over the grid.
#[derive(Debug, Clone, PartialEq)]
pub struct GroundMap {
    min_m: [f64; 2],
    n_nodes: [usize; 2],
    /// Height at the node, slope along x and along y.
    planes: Vec<[f64; 3]>,
}

impl GroundMap {
    /// Fits the ground under points (x, y, z in the ego frame). Without points it is flat, at height zero.
    #[must_use]
    pub fn fit(points: &[[f64; 4]], grid: &GridConfig) -> Self {
        let min_m = [grid.x_min_m, grid.y_min_m];
        let extent_m = [grid.x_max_m - grid.x_min_m, grid.y_max_m - grid.y_min_m];
        let n_nodes = extent_m.map(|extent_m| (extent_m / NODE_M).ceil() as usize + 1);
        let squares = Squares::of(points, min_m, extent_m);
        let at = |node: usize| [node % n_nodes[0], node / n_nodes[0]].map(|i| i as f64 * NODE_M);
        let place_m = |node: usize| std::array::from_fn(|axis| min_m[axis] + at(node)[axis]);
        let mut order: Vec<usize> = (0..n_nodes[0] * n_nodes[1]).collect();
        let distance_m = |&node: &usize| {
            let [x_m, y_m]: [f64; 2] = place_m(node);
            x_m.hypot(y_m)
        };
        order.sort_by(|a, b| distance_m(a).total_cmp(&distance_m(b)).then(a.cmp(b)));
        let mut planes: Vec<Option<[f64; 3]>> = vec![None; order.len()];
        for node in order {
            let here = place_m(node);
            let prior = foretell(&planes, n_nodes, node);
            planes[node] = Some(fit_plane(&squares.near(here), prior));
        }
        Self { min_m, n_nodes, planes: planes.into_iter().map(Option::unwrap_or_default).collect() }
    }

    /// Height of the ground at a place in the ego frame; beyond the grid as at its edge.
    #[must_use]
    pub fn height_m(&self, x_m: f64, y_m: f64) -> f64 {
        let at = [x_m, y_m];
        let [x, y]: [f64; 2] = std::array::from_fn(|axis| {
            ((at[axis] - self.min_m[axis]) / NODE_M).clamp(0.0, (self.n_nodes[axis] - 1) as f64)
        });
        let (left, low) = ((x as usize).min(self.n_nodes[0] - 2), (y as usize).min(self.n_nodes[1] - 2));
        let (right_share, up_share) = (x - left as f64, y - low as f64);
        let of = |dx: usize, dy: usize| {
            let [height_m, along_x, along_y] = self.planes[(low + dy) * self.n_nodes[0] + left + dx];
            let [ox, oy] = [x - (left + dx) as f64, y - (low + dy) as f64].map(|nodes| nodes * NODE_M);
            height_m + along_x * ox + along_y * oy
        };
        let low_m = of(0, 0) * (1.0 - right_share) + of(1, 0) * right_share;
        let up_m = of(0, 1) * (1.0 - right_share) + of(1, 1) * right_share;
        low_m * (1.0 - up_share) + up_m * up_share
    }
}

/// The plane at a node as its fitted neighbours continue; at the car a flat one at height zero.
fn foretell(planes: &[Option<[f64; 3]>], n_nodes: [usize; 2], node: usize) -> [f64; 3] {
    let (x, y) = (node % n_nodes[0], node / n_nodes[0]);
    let (mut sum, mut n) = ([0.0; 3], 0.0);
    for other_y in y.saturating_sub(1)..(y + 2).min(n_nodes[1]) {
        for other_x in x.saturating_sub(1)..(x + 2).min(n_nodes[0]) {
            let Some([height_m, along_x, along_y]) = planes[other_y * n_nodes[0] + other_x] else { continue };
            let step_m = |to: usize, from: usize| (to as f64 - from as f64) * NODE_M;
            let (along_x, along_y) = (along_x * FADING, along_y * FADING);
            sum[0] += height_m + along_x * step_m(x, other_x) + along_y * step_m(y, other_y);
            sum[1] += along_x;
            sum[2] += along_y;
            n += 1.0;
        }
    }
    if n > 0.0 { sum.map(|value| value / n) } else { [0.0; 3] }
}

/// Fits a plane to points about a node: offsets in x and y, height, weight of the distance.
fn fit_plane(points: &[[f64; 4]], prior: [f64; 3]) -> [f64; 3] {
    let mut plane = prior;
    for _ in 0..N_ROUNDS {
        let slope_weight = PRIOR_POINTS * (ABOVE_M / SLOPE_CHANGE).powi(2);
        let prior_weights = Vector3::new(PRIOR_POINTS, slope_weight, slope_weight);
        let mut a = Matrix3::from_diagonal(&prior_weights);
        let mut b = prior_weights.component_mul(&Vector3::from(prior));
        for &[x, y, z, weight] in points {
            let above = z - (plane[0] + plane[1] * x + plane[2] * y);
            let scale = if above > 0.0 { ABOVE_M } else { BELOW_M };
            let weight = weight / (1.0 + (above / scale).powi(2));
            let row = Vector3::new(1.0, x, y);
            a += weight * row * row.transpose();
            b += weight * z * row;
        }
        let Some(solved) = a.cholesky().map(|of| of.solve(&b)) else { break };
        plane = [solved.x, solved.y, solved.z];
    }
    plane
}

/// The lowest point of each square.
struct Squares {
    min_m: [f64; 2],
    n: [usize; 2],
    lowest: Vec<Option<[f64; 3]>>,
}

impl Squares {
    fn of(points: &[[f64; 4]], min_m: [f64; 2], extent_m: [f64; 2]) -> Self {
        let n = extent_m.map(|extent_m| (extent_m / SQUARE_M).ceil() as usize);
        let mut lowest: Vec<Option<[f64; 3]>> = vec![None; n[0] * n[1]];
        for &[x_m, y_m, z_m, _] in points {
            let [x, y] = [(x_m - min_m[0]) / SQUARE_M, (y_m - min_m[1]) / SQUARE_M];
            let is_inside = (0.0..n[0] as f64).contains(&x) && (0.0..n[1] as f64).contains(&y);
            if !is_inside || z_m.abs() > MOST_M {
                continue;
            }
            let square = &mut lowest[y as usize * n[0] + x as usize];
            if square.is_none_or(|[_, _, lowest_m]| z_m < lowest_m) {
                *square = Some([x_m, y_m, z_m]);
            }
        }
        Self { min_m, n, lowest }
    }

    /// The lowest points around a place, as [`fit_plane`] takes them.
    fn near(&self, place_m: [f64; 2]) -> Vec<[f64; 4]> {
        let range = |axis: usize| {
            let cell = |m: f64| ((m - self.min_m[axis]) / SQUARE_M).floor().max(0.0) as usize;
            let (from, to) = (place_m[axis] - REACH_M, place_m[axis] + REACH_M);
            cell(from).min(self.n[axis])..(cell(to) + 1).min(self.n[axis])
        };
        let mut found = Vec::new();
        for y in range(1) {
            for [x_m, y_m, z_m] in self.lowest[y * self.n[0]..][range(0)].iter().flatten().copied() {
                let [dx, dy] = [x_m - place_m[0], y_m - place_m[1]];
                let weight = (-2.0 * (dx * dx + dy * dy) / (REACH_M * REACH_M)).exp();
                found.push([dx, dy, z_m, weight]);
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Rings of a LiDAR over a surface, and a wall and cars that hide parts of it.
    fn cloud(surface: impl Fn(f64, f64) -> f64) -> Vec<[f64; 4]> {
        let mut points = Vec::new();
        for ring in 0..24 {
            let radius_m = 5.0 * 1.11f64.powi(ring);
            for step in -60..=60 {
                let azimuth = f64::from(step) * 0.01;
                let (x, y) = (radius_m * azimuth.cos(), radius_m * azimuth.sin());
                // A car to the left and a wall to the right stand on the surface.
                let is_car = (14.0..18.5).contains(&x) && (2.0..4.0).contains(&y);
                let is_wall = y < -7.0;
                let over_m = if is_car {
                    0.4 + 0.02 * f64::from(ring)
                } else if is_wall {
                    1.5
                } else {
                    0.0
                };
                points.push([x, y, surface(x, y) + over_m, 0.0]);
            }
        }
        points
    }

    proptest! {
        #[test]
        fn a_tilted_street_with_a_car_and_a_wall_is_found(
            along_x in -0.08..0.08,
            along_y in -0.04..0.04,
        ) {
            // The car's wheels stand on it.
            let surface = move |x: f64, y: f64| along_x * x + along_y * y;
            let ground = GroundMap::fit(&cloud(surface), &GridConfig::default());
            for (x, y) in [(6.0, 0.0), (16.0, 3.0), (25.0, -2.0), (25.0, 4.0), (40.0, 0.0)] {
                let off_m = ground.height_m(x, y) - surface(x, y);
                prop_assert!(off_m.abs() < 0.15, "{off_m} at {x}, {y}");
            }
        }
    }

    #[test]
    fn a_hill_that_begins_ahead_is_followed() {
        let surface = |x: f64, _: f64| if x > 15.0 { 0.1 * (x - 15.0) } else { 0.0 };
        let ground = GroundMap::fit(&cloud(surface), &GridConfig::default());
        for x in [8.0, 14.0, 20.0, 30.0, 42.0] {
            let off_m = ground.height_m(x, 0.0) - surface(x, 0.0);
            assert!(off_m.abs() < 0.25, "{off_m} at {x}");
        }
    }

    #[test]
    fn nothing_seen_is_flat_and_a_stray_return_below_changes_little() {
        let grid = GridConfig::default();
        assert_eq!(GroundMap::fit(&[], &grid).height_m(30.0, 5.0), 0.0);
        let mut points = cloud(|_, _| 0.0);
        points.push([12.0, 0.5, -4.0, 0.0]);
        assert!(GroundMap::fit(&points, &grid).height_m(12.0, 0.5).abs() < 0.1);
    }
}
