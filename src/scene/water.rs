//! Water below quays: basins as rectangles, the land around them, quay walls and what stands on their edges.
//!
//! Only towns without slopes have basins: the land is one plane there, and the basins are cut out of it.

use super::mesh::TriangleMesh;
use super::occupancy::Footprint;
use super::path::{Vec2, direction_of};
use super::shapes::{Site, round};
use super::town_parts::BasinConfig;

/// How deep quay walls reach below the water.
const BELOW_M: f64 = 1.0;
/// The land reaches this far from the map's origin.
const LAND_M: f64 = 600.0;
const COPING_M: [f64; 2] = [0.6, 0.28];
const BOLLARD_SPACING_M: f64 = 14.0;
/// Edges are cut into pieces of this length at most, which may lie in another basin.
const PIECE_M: f64 = 7.0;

/// The rectangle of a basin.
pub fn footprint(basin: &BasinConfig) -> Footprint {
    Footprint {
        center: Vec2::new(basin.center_m[0], basin.center_m[1]),
        yaw_rad: basin.yaw_deg.to_radians(),
        length_m: basin.size_m[0],
        width_m: basin.size_m[1],
    }
}

/// Meshes of land and water.
#[derive(Debug, Clone, Default)]
pub struct WaterMeshes {
    /// The plane of the ground without the basins.
    pub land: TriangleMesh,
    pub water: TriangleMesh,
    pub quay: TriangleMesh,
    pub bollards: TriangleMesh,
    pub railings: TriangleMesh,
}

/// Builds them: land at `land_m`, water at `water_m`; quays only where `is_near`.
pub fn meshes(
    basins: &[BasinConfig],
    [land_m, water_m]: [f64; 2],
    is_near: impl Fn(Vec2) -> bool,
) -> WaterMeshes {
    let mut meshes = WaterMeshes::default();
    let footprints: Vec<Footprint> = basins.iter().map(footprint).collect();
    let square = Footprint::square(Vec2::zeros(), 2.0 * LAND_M);
    let mut land = vec![corners(&square).to_vec()];
    for basin in &footprints {
        land = land.iter().flat_map(|piece| without(piece, basin)).collect();
    }
    for piece in &land {
        let flat: Vec<[f64; 2]> = piece.iter().map(|at| [at.x, at.y]).collect();
        meshes.land.add_flat(&flat, land_m, 4.0);
    }
    for (i, basin) in footprints.iter().enumerate() {
        let flat = corners(&basin.grow(0.3)).map(|at| [at.x, at.y]);
        // Where two basins meet, one lies a little deeper.
        meshes.water.add_flat(&flat, water_m - 0.02 * i as f64, 16.0);
        let is_elsewhere = |at: Vec2| {
            footprints.iter().enumerate().any(|(j, other)| j != i && other.grow(0.05).contains(at))
        };
        for edge in 0..4 {
            let around = corners(basin);
            let (from, to) = (around[edge], around[(edge + 1) % 4]);
            let n = ((to - from).norm() / PIECE_M).ceil();
            let at = |k: f64| from + (to - from) * (k / n);
            for k in 0..n as usize {
                let (start, end) = (at(k as f64), at(k as f64 + 1.0));
                let middle = (start + end) / 2.0;
                if is_near(middle) && !is_elsewhere(middle) {
                    let is_marked = (k as f64 * PIECE_M / BOLLARD_SPACING_M).fract() < 0.5;
                    meshes.add_edge([start, end], [land_m, water_m], basins[i].railings, is_marked);
                }
            }
        }
    }
    meshes
}

impl WaterMeshes {
    /// One piece of quay; the water is on the left of `from -> to`.
    fn add_edge(&mut self, ends: [Vec2; 2], [land_m, water_m]: [f64; 2], railings: bool, bollard: bool) {
        let [from, to] = ends;
        let (length_m, top_m, foot_m) = ((to - from).norm(), land_m + COPING_M[1], water_m - BELOW_M);
        let wall = |a: Vec2, b: Vec2, low_m: f64, high_m: f64| {
            [
                ([a.x, a.y, low_m], [0.0, low_m]),
                ([b.x, b.y, low_m], [length_m, low_m]),
                ([b.x, b.y, high_m], [length_m, high_m]),
                ([a.x, a.y, high_m], [0.0, high_m]),
            ]
        };
        // Faces look to the water; the coping ends on land in a face of its own.
        self.quay.add_polygon(&wall(to, from, foot_m, top_m));
        let way = (to - from) / length_m;
        let inland = Vec2::new(way.y, -way.x) * COPING_M[0];
        self.quay.add_polygon(&wall(from + inland, to + inland, land_m - 0.02, top_m));
        let edge = [from + inland, to + inland, to, from].map(|at| [at.x, at.y]);
        self.quay.add_flat(&edge, top_m, 1.0);
        let site = Site {
            footprint: Footprint {
                center: (from + to) / 2.0 + inland * 2.2,
                yaw_rad: way.y.atan2(way.x),
                length_m,
                width_m: 1.0,
            },
            base_m: land_m,
        };
        if bollard {
            site.add_prism(&mut self.bollards, &round([0.0, 0.0], 0.2, 8), [0.0, 0.42]);
            site.add_prism(&mut self.bollards, &round([0.0, 0.0], 0.3, 8), [0.42, 0.58]);
        }
        if railings {
            for z in [0.55, 1.05] {
                site.add_beam(&mut self.railings, [-length_m / 2.0, 0.7, z], [length_m / 2.0, 0.7, z], 0.05);
            }
            for k in 0..3 {
                let x = length_m * (f64::from(k) / 3.0 - 0.5);
                site.add_beam(&mut self.railings, [x, 0.7, 0.0], [x, 0.7, 1.05], 0.06);
            }
        }
    }
}

/// Corners, counter-clockwise.
fn corners(footprint: &Footprint) -> [Vec2; 4] {
    footprint.corners().map(|at| Vec2::new(at.x_m, at.y_m))
}

/// The parts of a convex polygon outside a rectangle: at most one for each of its sides.
fn without(piece: &[Vec2], hole: &Footprint) -> Vec<Vec<Vec2>> {
    let (mut rest, mut parts) = (piece.to_vec(), Vec::new());
    for side in 0..4 {
        let yaw_rad = hole.yaw_rad + std::f64::consts::FRAC_PI_2 * f64::from(side);
        let out = direction_of(yaw_rad);
        let reach_m = if side % 2 == 0 { hole.length_m } else { hole.width_m } / 2.0;
        let beyond = |at: &Vec2| (at - hole.center).dot(&out) - reach_m;
        parts.push(cut(&rest, beyond));
        rest = cut(&rest, |at| -beyond(at));
    }
    parts.retain(|part| part.len() >= 3);
    parts
}

/// The part of a convex polygon where `inside` is not negative (Sutherland and Hodgman, 1974).
fn cut(polygon: &[Vec2], inside: impl Fn(&Vec2) -> f64) -> Vec<Vec2> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (i, to) in polygon.iter().enumerate() {
        let from = &polygon[(i + polygon.len() - 1) % polygon.len()];
        let (a, b) = (inside(from), inside(to));
        if a * b < 0.0 {
            kept.push(from + (to - from) * (a / (a - b)));
        }
        if b >= 0.0 {
            kept.push(*to);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn basin(center_m: [f64; 2], yaw_deg: f64, size_m: [f64; 2]) -> BasinConfig {
        BasinConfig { center_m, yaw_deg, size_m, railings: true }
    }

    fn area(mesh: &TriangleMesh) -> f64 {
        let area = |[a, b, c]: [nalgebra::Point3<f32>; 3]| f64::from((b - a).cross(&(c - a)).z) / 2.0;
        mesh.corners().into_iter().map(area).sum()
    }

    #[test]
    fn land_is_the_plane_without_the_basins_once() {
        let basins = [basin([20.0, 10.0], 30.0, [60.0, 40.0]), basin([300.0, 0.0], 0.0, [50.0, 50.0])];
        let meshes = meshes(&basins, [-0.05, -1.6], |_| true);
        let wanted = 1200.0 * 1200.0 - 60.0 * 40.0 - 50.0 * 50.0;
        assert!((area(&meshes.land) / wanted - 1.0).abs() < 1e-4, "{}", area(&meshes.land));
    }

    #[test]
    fn quays_stand_only_between_land_and_water_and_look_at_it() {
        // The second basin opens one side of the first.
        let basins = [basin([0.0, 0.0], 0.0, [40.0, 20.0]), basin([0.0, -30.0], 0.0, [200.0, 40.1])];
        let meshes = meshes(&basins[..], [0.0, -2.0], |at| at.y > -9.0);
        for [a, b, c] in meshes.quay.corners() {
            let (middle, normal) = ((a.coords + b.coords + c.coords) / 3.0, (b - a).cross(&(c - a)));
            assert!(middle.y > -10.0 - 0.7, "{middle}");
            if middle.z < -0.5 && normal.x.abs() > normal.z.abs() {
                assert!(normal.x * middle.x < 0.0, "{a} {b} {c}");
            }
        }
        assert!(!meshes.bollards.is_empty() && !meshes.railings.is_empty());
    }
}
