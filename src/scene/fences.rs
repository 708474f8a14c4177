//! What stands between plots and streets, in full detail: fences whose openings are open, guard rails, walls with relief.

use nalgebra::Vector3;
use rand::RngExt;

use super::mesh::TriangleMesh;
use super::path::{Path, Vec2};
use crate::random::Rng;

/// Half of the height of a chain-link fence's wires along the fence, and their distance from each other: four
/// fifths of the fence are open. Real wires are thinner and closer; beams are wider than either.
const WIRE_M: f64 = 0.0145;
const MESH_M: f64 = 0.30;
const CHAIN_LINK_M: f64 = 1.8;

/// The steel section of a guard rail as distance from the posts and height (W-beam, EN 1317: 0.31 m high).
const BEAM_M: [(f64, f64); 5] = [(0.0, 0.44), (0.08, 0.51), (0.02, 0.595), (0.08, 0.68), (0.0, 0.75)];
/// Between its posts (EN 1317: 2 or 4 m).
const RAIL_POSTS_M: f64 = 4.0;

/// A line on the ground along which things are built.
pub(super) struct Course<'a> {
    pub line: &'a Path,
    pub height_m: &'a dyn Fn(Vec2) -> f64,
}

impl Course<'_> {
    fn length_m(&self) -> f64 {
        self.line.length_m()
    }

    fn at(&self, s_m: f64, up_m: f64) -> Vector3<f64> {
        let foot = self.line.at(s_m);
        Vector3::new(foot.x, foot.y, (self.height_m)(foot) + up_m)
    }

    fn along(&self, s_m: f64) -> Vector3<f64> {
        let along = self.line.direction(s_m);
        Vector3::new(along.x, along.y, 0.0)
    }

    fn right(&self, s_m: f64) -> Vector3<f64> {
        let along = self.line.direction(s_m);
        Vector3::new(along.y, -along.x, 0.0)
    }

    /// Stations at most `step_m` apart, both ends among them.
    fn stations(&self, step_m: f64) -> Vec<f64> {
        let n = (self.length_m() / step_m).ceil().max(1.0) as usize;
        (0..=n).map(|i| self.length_m() * i as f64 / n as f64).collect()
    }

    /// Upright boards or bars of a width, `step_m` apart, on two rails.
    pub(super) fn add_bars(
        &self,
        mesh: &mut TriangleMesh,
        step_m: f64,
        width_m: f64,
        top_m: f64,
        rng: &mut Rng,
    ) {
        for s_m in self.stations(step_m) {
            let lean_m = 0.04 * top_m * (rng.random::<f64>() - 0.5);
            let (foot, top) = (self.at(s_m, 0.03), self.at(s_m, top_m - 0.06 * rng.random::<f64>()));
            add_strip(mesh, foot, top + self.along(s_m) * lean_m, self.along(s_m) * (width_m / 2.0));
        }
        let posts = self.stations(2.4);
        for pair in posts.windows(2) {
            for share in [0.2, 0.85] {
                let shift = self.right(pair[0]) * 0.02;
                let (from, to) = (self.at(pair[0], share * top_m), self.at(pair[1], share * top_m));
                add_strip(mesh, from + shift, to + shift, Vector3::z() * 0.03);
            }
        }
        for s_m in posts {
            self.add_post(mesh, s_m, 0.08, top_m + 0.05);
        }
    }

    /// Steel wires that cross each other between posts.
    pub(super) fn add_chain_link(&self, mesh: &mut TriangleMesh) {
        let n = (self.length_m() / MESH_M).ceil() as i32;
        let reach = (CHAIN_LINK_M / MESH_M).ceil() as i32;
        for i in -reach..n + reach {
            let start_m = f64::from(i) * MESH_M;
            for way in [1.0, -1.0] {
                // Where the wire enters and leaves the fence, by the height that it has climbed.
                let (first_m, last_m) = if way > 0.0 {
                    ((-start_m).max(0.0), (self.length_m() - start_m).min(CHAIN_LINK_M))
                } else {
                    ((start_m - self.length_m()).max(0.0), start_m.min(CHAIN_LINK_M))
                };
                if last_m - first_m > 0.1 {
                    let at = |up_m: f64| self.at(start_m + way * up_m, 0.05 + up_m);
                    add_strip(mesh, at(first_m), at(last_m), self.along(start_m) * WIRE_M);
                }
            }
        }
        let posts = self.stations(2.6);
        for pair in posts.windows(2) {
            let (from, to) = (self.at(pair[0], CHAIN_LINK_M + 0.05), self.at(pair[1], CHAIN_LINK_M + 0.05));
            add_strip(mesh, from, to, Vector3::z() * 0.02);
        }
        for s_m in posts {
            self.add_post(mesh, s_m, 0.06, CHAIN_LINK_M + 0.12);
        }
    }

    /// A steel beam on posts, to the right of the line's direction and open behind.
    pub(super) fn add_guard_rail(&self, mesh: &mut TriangleMesh) {
        let stations = self.stations(RAIL_POSTS_M);
        for pair in stations.windows(2) {
            let point = |s_m: f64, (out_m, up_m): (f64, f64)| self.at(s_m, up_m) + self.right(s_m) * out_m;
            for edge in BEAM_M.windows(2) {
                let quad = [
                    point(pair[0], edge[0]),
                    point(pair[1], edge[0]),
                    point(pair[1], edge[1]),
                    point(pair[0], edge[1]),
                ];
                add_sheet(mesh, quad);
            }
        }
        for s_m in stations {
            self.add_post(mesh, s_m, 0.1, 0.72);
        }
    }

    /// A guard rail from far away: its beam alone, flat.
    pub(super) fn add_far_rail(&self, mesh: &mut TriangleMesh) {
        for pair in self.stations(2.0 * RAIL_POSTS_M).windows(2) {
            let [low, high] = [BEAM_M[0].1, BEAM_M[BEAM_M.len() - 1].1];
            let half = Vector3::z() * ((high - low) / 2.0);
            let middle_m = f64::midpoint(low, high);
            add_strip(mesh, self.at(pair[0], middle_m), self.at(pair[1], middle_m), half);
        }
    }

    /// What makes a wall uneven: a coping, pilasters, and stones that stand out of its faces.
    pub(super) fn add_relief(&self, mesh: &mut TriangleMesh, width_m: f64, wall_m: f64, rng: &mut Rng) {
        let stations = self.stations(3.0);
        for pair in stations.windows(2) {
            let (from, to) = (self.at(pair[0], wall_m), self.at(pair[1], wall_m));
            let (middle, way) = ((from + to) / 2.0, to - from);
            mesh.add_box(
                [middle.x, middle.y, middle.z.max(from.z.max(to.z)) + 0.04],
                way.y.atan2(way.x),
                [way.norm(), width_m + 0.1, 0.09],
            );
        }
        for &s_m in &stations {
            let foot = self.at(s_m, wall_m / 2.0);
            let along = self.along(s_m);
            mesh.add_box(foot.into(), along.y.atan2(along.x), [0.36, width_m + 0.14, wall_m + 0.4]);
        }
        for _ in 0..(self.length_m() * 2.5) as u32 {
            let s_m = self.length_m() * rng.random::<f64>();
            let side = if rng.random::<bool>() { 1.0 } else { -1.0 };
            let out_m = side * (width_m / 2.0 + 0.03 * rng.random::<f64>());
            let at = self.at(s_m, 0.1 + (wall_m - 0.25) * rng.random::<f64>()) + self.right(s_m) * out_m;
            let along = self.along(s_m);
            let size = [0.2 + 0.25 * rng.random::<f64>(), 0.06, 0.12 + 0.12 * rng.random::<f64>()];
            mesh.add_box(at.into(), along.y.atan2(along.x), size);
        }
    }

    fn add_post(&self, mesh: &mut TriangleMesh, s_m: f64, width_m: f64, top_m: f64) {
        for half in [self.along(s_m), self.right(s_m)] {
            add_strip(mesh, self.at(s_m, -0.1), self.at(s_m, top_m), half * (width_m / 2.0));
        }
    }
}

/// A flat strip between two points, seen from both sides.
pub(super) fn add_strip(mesh: &mut TriangleMesh, from: Vector3<f64>, to: Vector3<f64>, half: Vector3<f64>) {
    add_sheet(mesh, [from - half, to - half, to + half, from + half]);
}

/// A flat quad, seen from both sides.
pub(super) fn add_sheet(mesh: &mut TriangleMesh, corners: [Vector3<f64>; 4]) {
    let (length_m, width_m) = ((corners[1] - corners[0]).norm(), (corners[3] - corners[0]).norm());
    let uv = [[0.0, 0.0], [length_m, 0.0], [length_m, width_m], [0.0, width_m]];
    let mut face = [0, 1, 2, 3].map(|k| (corners[k].into(), uv[k]));
    mesh.add_polygon(&face);
    // Both sides are split along one diagonal, lest they part where the quad is not flat.
    face[1..].reverse();
    mesh.add_polygon(&face);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_fifths_of_a_chain_link_fence_are_open() {
        let line = Path::new([Vec2::zeros(), Vec2::new(12.0, 0.0)]).unwrap();
        let mut mesh = TriangleMesh::default();
        Course { line: &line, height_m: &|_| 0.0 }.add_chain_link(&mut mesh);
        let triangles = mesh.corners();
        let is_hit = |x: f32, z: f32| {
            triangles.iter().any(|[a, b, c]| {
                let side = |p: &nalgebra::Point3<f32>, q: &nalgebra::Point3<f32>| {
                    (q.x - p.x) * (z - p.z) - (q.z - p.z) * (x - p.x)
                };
                let (u, v, w) = (side(a, b), side(b, c), side(c, a));
                (u > 0.0 && v > 0.0 && w > 0.0) || (u < 0.0 && v < 0.0 && w < 0.0)
            })
        };
        let places =
            (0..60).flat_map(|i| (0..30).map(move |k| (2.0 + 0.13 * i as f32, 0.1 + 0.055 * k as f32)));
        let n_hit = places.clone().filter(|&(x, z)| is_hit(x, z)).count();
        let open = 1.0 - n_hit as f64 / places.count() as f64;
        assert!((0.7..0.9).contains(&open), "{open}");
    }

    #[test]
    fn a_guard_rail_has_a_beam_below_the_bumper_and_posts_to_the_ground() {
        let line = Path::new([Vec2::zeros(), Vec2::new(8.0, 0.0)]).unwrap();
        let mut mesh = TriangleMesh::default();
        Course { line: &line, height_m: &|_| 1.0 }.add_guard_rail(&mut mesh);
        let heights = mesh.corners().into_iter().flatten().map(|at| at.z - 1.0);
        let (low, high) = heights.fold((f32::MAX, f32::MIN), |(low, high), z| (low.min(z), high.max(z)));
        assert!(low < 0.0 && (0.74..0.8).contains(&high), "{low} {high}");
    }
}
