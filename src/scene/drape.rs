//! Flat shapes laid on the ground: on slopes they are cut into pieces that follow it.

use super::ground::{GRASS_M, Ground, PAVEMENT_M};
use super::mesh::TriangleMesh;
use super::path::Vec2;

/// Longest piece on slopes.
const PIECE_M: f64 = 3.0;
/// How deep kerbs reach into the ground.
const KERB_FOOT_M: f64 = 0.3;

/// Lays flat shapes on the ground.
pub struct Drape<'a> {
    pub ground: &'a Ground,
}

impl Drape<'_> {
    /// A quad, counter-clockwise from above; its first edge and the opposite one run along the way.
    pub fn add(&self, mesh: &mut TriangleMesh, quad: [Vec2; 4], over_m: f64, tile_m: f64) {
        if self.ground.is_flat() {
            mesh.add_flat(&quad.map(|point| [point.x, point.y]), over_m, tile_m);
            return;
        }
        let n = |a: Vec2, b: Vec2| ((b - a).norm() / PIECE_M).ceil().max(1.0);
        let (n_along, n_across) = (n(quad[0], quad[1]).max(n(quad[3], quad[2])), n(quad[0], quad[3]));
        let at = |i: usize, j: usize| {
            let (u, v) = (i as f64 / n_along, j as f64 / n_across);
            let point =
                (quad[0] * (1.0 - u) + quad[1] * u) * (1.0 - v) + (quad[3] * (1.0 - u) + quad[2] * u) * v;
            ([point.x, point.y, self.ground.height_m(point) + over_m], [point.x / tile_m, point.y / tile_m])
        };
        for i in 0..n_along as usize {
            for j in 0..n_across as usize {
                mesh.add_polygon(&[at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
    }

    /// A convex polygon at the ground's height.
    pub fn add_convex(&self, mesh: &mut TriangleMesh, corners: &[Vec2], tile_m: f64) {
        if self.ground.is_flat() {
            let corners: Vec<[f64; 2]> = corners.iter().map(|point| [point.x, point.y]).collect();
            mesh.add_flat(&corners, 0.0, tile_m);
            return;
        }
        let fold = |pick: fn(f64, f64) -> f64, axis: usize| {
            corners.iter().map(|corner| corner[axis]).fold(corners[0][axis], pick)
        };
        let (low, high) = ([fold(f64::min, 0), fold(f64::min, 1)], [fold(f64::max, 0), fold(f64::max, 1)]);
        let n = |axis: usize| ((high[axis] - low[axis]) / PIECE_M).ceil().max(1.0) as usize;
        for i in 0..n(0) {
            for j in 0..n(1) {
                let cell = [low[0] + PIECE_M * i as f64, low[1] + PIECE_M * j as f64];
                let mut piece = corners.to_vec();
                for (axis, from) in cell.into_iter().enumerate() {
                    piece = clip(&clip(&piece, axis, from, 1.0), axis, from + PIECE_M, -1.0);
                }
                let textured: Vec<_> = piece
                    .iter()
                    .map(|at| ([at.x, at.y, self.ground.height_m(*at)], [at.x / tile_m, at.y / tile_m]))
                    .collect();
                mesh.add_polygon(&textured);
            }
        }
    }

    /// A wall from the pavement's edge down into the ground, facing right of `from -> to`.
    pub fn add_kerb(&self, kerb: &mut TriangleMesh, from: Vec2, to: Vec2) {
        if self.ground.is_flat() {
            add_kerb(kerb, (from, 0.0), (to, 0.0), GRASS_M - 0.01);
            return;
        }
        let n = ((to - from).norm() / PIECE_M).ceil().max(1.0);
        let at = |i: f64| {
            let point = from + (to - from) * (i / n);
            (point, self.ground.height_m(point))
        };
        for i in 0..n as usize {
            add_kerb(kerb, at(i as f64), at(i as f64 + 1.0), -KERB_FOOT_M);
        }
    }
}

fn add_kerb(kerb: &mut TriangleMesh, (from, from_m): (Vec2, f64), (to, to_m): (Vec2, f64), foot_m: f64) {
    let length_m = (to - from).norm();
    kerb.add_polygon(&[
        ([from.x, from.y, from_m + foot_m], [0.0, 0.0]),
        ([to.x, to.y, to_m + foot_m], [length_m, 0.0]),
        ([to.x, to.y, to_m + PAVEMENT_M], [length_m, 0.2]),
        ([from.x, from.y, from_m + PAVEMENT_M], [0.0, 0.2]),
    ]);
}

/// The part of a convex polygon where `sign * (x[axis] - bound) >= 0` (Sutherland and Hodgman, 1974).
fn clip(corners: &[Vec2], axis: usize, bound: f64, sign: f64) -> Vec<Vec2> {
    let inside = |point: Vec2| sign * (point[axis] - bound);
    let mut kept = Vec::with_capacity(corners.len() + 1);
    for (i, &to) in corners.iter().enumerate() {
        let from = corners[(i + corners.len() - 1) % corners.len()];
        let (a, b) = (inside(from), inside(to));
        if a * b < 0.0 {
            kept.push(from + (to - from) * (a / (a - b)));
        }
        if b >= 0.0 {
            kept.push(to);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clipped_square_keeps_its_near_half() {
        let square = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)].map(|(x, y)| Vec2::new(x, y));
        let half = clip(&square, 0, 1.0, -1.0);
        assert_eq!(half.len(), 4);
        assert!(half.iter().all(|corner| corner.x <= 1.0));
        assert!(clip(&square, 1, 3.0, 1.0).is_empty());
    }
}
