//! Leaves as loose triangles over a core: hedges, ivy on walls, tufts of grass, on which beams scatter.
//!
//! A triangle stands for a tuft of leaves. Hedges and ivy hide what is behind them, so their leaves need an outer
//! side alone; blades of grass have two.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use rand::RngExt;

use super::buildings::Building;
use super::mesh::TriangleMesh;
use super::path::{Path, Vec2};
use crate::random::Rng;

/// Leaves on a square metre, and how large they are.
const LEAVES_PER_M2: f64 = 5.0;
const LEAF_M: f64 = 0.40;
/// Ribs of a hedge's core.
const RIB_M: f64 = 1.5;

/// Foliage by its tones.
#[derive(Debug, Clone, Default)]
pub(super) struct Foliage {
    pub core: TriangleMesh,
    pub dark: TriangleMesh,
    pub light: TriangleMesh,
}

/// The form of a hedge.
#[derive(Debug, Clone, Copy)]
pub(super) struct HedgeShape {
    pub width_m: f64,
    pub height_m: f64,
    /// Grown as it likes, with gaps.
    pub is_wild: bool,
}

fn shake(rng: &mut Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| 2.0 * rng.random::<f64>() - 1.0)
}

fn add_leaf(
    mesh: &mut TriangleMesh,
    at: Vector3<f64>,
    facing: Vector3<f64>,
    size_m: f64,
    rng: &mut Rng,
    sides: u8,
) {
    let normal = facing.try_normalize(1e-6).unwrap_or_else(Vector3::z);
    let other = if normal.z.abs() < 0.9 { Vector3::z() } else { Vector3::x() };
    let side = normal.cross(&other).normalize();
    let up = normal.cross(&side);
    let start = TAU * rng.random::<f64>();
    let size_m = size_m * (0.7 + 0.6 * rng.random::<f64>());
    let mut corners = [0.0, 1.0, 2.0].map(|k| {
        let (sin, cos) = (start + TAU * k / 3.0).sin_cos();
        let corner = at + (side * cos + up * sin) * (0.62 * size_m);
        (corner.into(), [0.0, 0.0])
    });
    mesh.add_polygon(&corners);
    if sides == 2 {
        corners.reverse();
        mesh.add_polygon(&corners);
    }
}

impl Foliage {
    fn add_leaf(&mut self, at: Vector3<f64>, facing: Vector3<f64>, rng: &mut Rng) {
        let mesh = if rng.random::<f64>() < 0.6 { &mut self.dark } else { &mut self.light };
        add_leaf(mesh, at, facing, LEAF_M, rng, 1);
    }

    /// A hedge along a line: an uneven core with leaves that stand out of it.
    pub(super) fn add_hedge(
        &mut self,
        line: &Path,
        shape: HedgeShape,
        height_m: &dyn Fn(Vec2) -> f64,
        rng: &mut Rng,
    ) {
        let n = (line.length_m() / RIB_M).ceil().max(1.0) as usize;
        let swing = if shape.is_wild { 0.35 } else { 0.03 };
        let mut before = None;
        for i in 0..=n {
            let s_m = line.length_m() * i as f64 / n as f64;
            let scale = 1.0 + swing * (2.0 * rng.random::<f64>() - 1.0);
            let rib = Rib {
                s_m,
                half_m: shape.width_m / 2.0 * (1.0 + 0.6 * swing * (2.0 * rng.random::<f64>() - 1.0)),
                top_m: shape.height_m * scale,
            };
            let is_gap = shape.is_wild && rng.random::<f64>() < 0.12;
            if let (Some(before), false) = (before, is_gap) {
                self.add_piece(line, &before, &rib, height_m, rng);
            }
            before = Some(rib);
        }
    }

    /// The core between two ribs with both ends, and its leaves.
    fn add_piece(
        &mut self,
        line: &Path,
        from: &Rib,
        to: &Rib,
        height_m: &dyn Fn(Vec2) -> f64,
        rng: &mut Rng,
    ) {
        let at = |s_m: f64, right_m: f64, up_m: f64| {
            let foot = line.at(s_m);
            let place = line.beside(s_m, -right_m);
            Vector3::new(place.x, place.y, height_m(foot) + up_m)
        };
        // Leaves reach over the core's edges, which therefore lies a little deeper.
        let section = |rib: &Rib| {
            let (half_m, top_m) = (rib.half_m - 0.06, rib.top_m - 0.06);
            [(half_m, -0.2), (half_m, top_m), (-half_m, top_m), (-half_m, -0.2)]
                .map(|(right_m, up_m)| at(rib.s_m, right_m, up_m))
        };
        let (a, b) = (section(from), section(to));
        let length_m = to.s_m - from.s_m;
        for k in 0..3 {
            let (low, high) = (k as f64, k as f64 + 1.0);
            self.core.add_polygon(&[
                (a[k].into(), [0.0, low]),
                (b[k].into(), [length_m, low]),
                (b[k + 1].into(), [length_m, high]),
                (a[k + 1].into(), [0.0, high]),
            ]);
        }
        let corners = [[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]];
        let mut face: Vec<_> = a.iter().zip(corners).map(|(corner, uv)| ((*corner).into(), uv)).collect();
        self.core.add_polygon(&face);
        face = b.iter().zip(corners).map(|(corner, uv)| ((*corner).into(), uv)).rev().collect();
        self.core.add_polygon(&face);

        let along = line.direction(from.s_m);
        let right = Vector3::new(along.y, -along.x, 0.0);
        self.add_end(from, -along, &at, rng);
        self.add_end(to, along, &at, rng);
        let around_m = from.top_m + to.top_m + 2.0 * from.half_m;
        let n = (LEAVES_PER_M2 * length_m * around_m).round() as u32;
        for _ in 0..n {
            let share = rng.random::<f64>();
            let (half_m, top_m) = (
                from.half_m + (to.half_m - from.half_m) * share,
                from.top_m + (to.top_m - from.top_m) * share,
            );
            let way_m = rng.random::<f64>() * (2.0 * top_m + 2.0 * half_m);
            let depth_m = 0.14 * rng.random::<f64>() - 0.08;
            let (right_m, up_m, out) = if way_m < top_m {
                (half_m + depth_m, way_m, right)
            } else if way_m < top_m + 2.0 * half_m {
                (way_m - top_m - half_m, top_m + depth_m, Vector3::z())
            } else {
                (-half_m - depth_m, way_m - top_m - 2.0 * half_m, -right)
            };
            let facing = out + Vector3::z() * 0.3 + shake(rng);
            self.add_leaf(at(from.s_m + length_m * share, right_m, up_m.max(0.05)), facing, rng);
        }
    }

    /// Leaves on the end of a piece, of which every hedge shows some.
    fn add_end(&mut self, rib: &Rib, out: Vec2, at: &dyn Fn(f64, f64, f64) -> Vector3<f64>, rng: &mut Rng) {
        let out = Vector3::new(out.x, out.y, 0.0);
        for _ in 0..(0.3 * LEAVES_PER_M2 * 2.0 * rib.half_m * rib.top_m).round() as u32 {
            let right_m = rib.half_m * (2.0 * rng.random::<f64>() - 1.0);
            let place =
                at(rib.s_m, right_m, rib.top_m * rng.random::<f64>()) + out * (0.1 * rng.random::<f64>());
            let facing = out + shake(rng);
            self.add_leaf(place, facing, rng);
        }
    }

    /// Ivy on the front of a building: a patch that grows from the ground, narrower above.
    pub(super) fn add_ivy(&mut self, building: &Building, base_m: f64, rng: &mut Rng) {
        let half_m = building.footprint.length_m / 2.0;
        // At a corner, where there is wall between the windows.
        let side = if rng.random::<bool>() { 1.0 } else { -1.0 };
        let (width_m, top_m) = (1.2 + 1.6 * rng.random::<f64>(), 1.5 + 4.5 * rng.random::<f64>());
        let middle_m = side * (half_m - 0.4 * width_m);
        let top_m = top_m.min(building.height_m() - 0.5);
        let out = building.before(0.0, 1.0) - building.before(0.0, 0.0);
        let out = Vector3::new(out.x, out.y, 0.0);
        for _ in 0..(2.2 * LEAVES_PER_M2 * width_m * top_m).round() as u32 {
            let up_m = top_m * rng.random::<f64>() * (0.6 + 0.4 * rng.random::<f64>());
            let reach_m = width_m / 2.0 * (1.0 - 0.6 * up_m / top_m);
            let along_m = middle_m + reach_m * (2.0 * rng.random::<f64>() - 1.0);
            if along_m.abs() > half_m - 0.1 {
                continue;
            }
            let at = building.before(along_m, 0.03 + 0.14 * rng.random::<f64>());
            let facing = out * 1.6 + shake(rng);
            self.add_leaf(Vector3::new(at.x, at.y, base_m + up_m), facing, rng);
        }
    }

    /// A tuft of grass or weeds.
    pub(super) fn add_tuft(&mut self, foot: Vec2, ground_m: f64, rng: &mut Rng) {
        let tall_m = 0.08 + 0.3 * rng.random::<f64>() * rng.random::<f64>();
        for _ in 0..2 {
            let lean = shake(rng);
            let at = Vector3::new(
                foot.x + 0.12 * lean.x,
                foot.y + 0.12 * lean.y,
                ground_m + tall_m * (0.2 + 0.4 * rng.random::<f64>()),
            );
            let facing = Vector3::new(lean.y, -lean.x, 0.35 * lean.z);
            let mesh = if rng.random::<f64>() < 0.5 { &mut self.dark } else { &mut self.light };
            add_leaf(mesh, at, facing, 1.1 * tall_m, rng, 2);
        }
    }
}

/// Where a hedge's core is measured.
#[allow(clippy::struct_field_names, reason = "all are lengths, and names carry their unit")]
struct Rib {
    s_m: f64,
    half_m: f64,
    top_m: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random;

    #[test]
    fn leaves_of_a_hedge_face_outwards_and_stay_near_it() {
        let line = Path::new([Vec2::zeros(), Vec2::new(10.0, 0.0)]).unwrap();
        let mut foliage = Foliage::default();
        let shape = HedgeShape { width_m: 0.6, height_m: 1.3, is_wild: false };
        foliage.add_hedge(&line, shape, &|_| 0.0, &mut random::stream(1, "hedge", 0));
        let leaves: Vec<_> = foliage.dark.corners().into_iter().chain(foliage.light.corners()).collect();
        assert!(leaves.len() > 150, "{}", leaves.len());
        let middle = Vector3::new(5.0, 0.0, 0.6);
        let mut n_out = 0;
        for [a, b, c] in &leaves {
            let at = ((a.coords + b.coords + c.coords) / 3.0).cast::<f64>();
            assert!(at.y.abs() < 0.45 && (0.0..1.45).contains(&at.z) && (-0.2..10.2).contains(&at.x), "{at}");
            let mut out = at - middle;
            out.x = 0.0;
            n_out += u32::from((b - a).cross(&(c - a)).cast::<f64>().dot(&out) > 0.0);
        }
        assert!(n_out as usize > leaves.len() * 3 / 4, "{n_out} of {}", leaves.len());
    }
}
