//! Dry-stone walls: along terraces, and along roads and pavements where the land beside them rises or falls.

use rand::RngExt;

use super::ground::Ground;
use super::mesh::TriangleMesh;
use super::occupancy::{Footprint, Occupied, StripGrid};
use super::path::{Path, Vec2};
use super::surface::{Strip, StripKind, Surface};
use crate::random;

/// Courses end here and there: the top is a stone higher or lower.
const UNEVEN_M: f64 = 0.09;
/// Length of a piece with one height.
const PIECE_M: f64 = 1.6;
/// Below the lower side's ground.
const FOOT_M: f64 = 0.5;
const TOP_WIDTH_M: f64 = 0.4;
/// Walls lean back: half of the width that they have more at the foot, for each metre of height.
const BATTER: f64 = 0.08;
/// From the edge of what is paved.
const BESIDE_M: f64 = 0.55;
/// The land's height counts this far from the edge.
const LAND_M: f64 = 6.5;
/// A wall's height over the land behind it.
const OVER_M: f64 = 0.25;
/// Where the land falls by more than this, a low wall keeps from the edge.
const PARAPET_FALL_M: f64 = 0.9;
/// Gaps where steps or doors lead through, and the length of walls between them.
const GAP_M: f64 = 2.2;
const RUN_M: [f64; 2] = [9.0, 26.0];

/// A wall of stones without mortar.
#[derive(Debug, Clone)]
pub struct DryWall {
    pub line: Path,
    /// Of its top over the ground under it.
    pub height_m: f64,
}

/// Walls along the outer edges of roads and pavements: `[least, most]` high. Each keeps off what stands there already.
pub fn along_roads(surface: &Surface, height_m: [f64; 2], occupied: &mut Occupied) -> Vec<DryWall> {
    let mut walls = Vec::new();
    if height_m[1] <= 0.0 {
        return walls;
    }
    let mut rng = random::stream(0, "dry-walls", 0);
    let strips = || surface.strips.iter().filter(|strip| !strip.is_in_junction());
    for strip in strips().filter(|strip| matches!(strip.kind, StripKind::Road | StripKind::Pavement)) {
        for side in [-1.0, 1.0] {
            let (mut station_m, length_m) = (1.0, strip.center.length_m());
            while station_m < length_m - 3.0 {
                let run_m = RUN_M[0] + (RUN_M[1] - RUN_M[0]) * rng.random::<f64>();
                let end_m = (station_m + run_m).min(length_m - 1.0);
                walls.extend(run_along(surface, strip, side, [station_m, end_m], height_m, occupied));
                station_m = end_m + GAP_M;
            }
        }
    }
    walls
}

/// The longest piece of a run on which a wall is wanted and possible.
fn run_along(
    surface: &Surface,
    strip: &Strip,
    side: f64,
    [from_m, to_m]: [f64; 2],
    [least_m, most_m]: [f64; 2],
    occupied: &mut Occupied,
) -> Option<DryWall> {
    let n = ((to_m - from_m) / 2.0).ceil() as usize;
    let out = |s_m: f64, out_m: f64| strip.center.beside(s_m, side * (strip.width_at_m(s_m) / 2.0 + out_m));
    let ground = &surface.ground;
    let is_free = |at: Vec2, occupied: &Occupied| {
        surface.paved_grid.clearance_m(at) > BESIDE_M - 0.2
            && occupied.is_free(&Footprint::square(at, 0.7), 0.0)
    };
    let stations = (0..=n).map(|k| from_m + (to_m - from_m) * k as f64 / n as f64);
    let mut best: Vec<f64> = Vec::new();
    let mut run: Vec<f64> = Vec::new();
    for s_m in stations {
        if is_free(out(s_m, BESIDE_M), occupied) && is_free(out(s_m, LAND_M), &Occupied::default()) {
            run.push(s_m);
        } else {
            run.clear();
        }
        if run.len() > best.len() {
            best.clone_from(&run);
        }
    }
    if best.len() < 3 {
        return None;
    }
    let middle_m = best[best.len() / 2];
    let rise_m = ground.height_m(out(middle_m, LAND_M)) - ground.height_m(out(middle_m, 0.0));
    let high_m = if rise_m > least_m - OVER_M {
        (rise_m + OVER_M).clamp(least_m, most_m)
    } else if rise_m < -PARAPET_FALL_M {
        least_m
    } else {
        return None;
    };
    let line = Path::new(best.iter().map(|&s_m| out(s_m, BESIDE_M)))?;
    for pair in line.points().windows(2) {
        occupied.take(Footprint::between(pair[0], pair[1], 0.6));
    }
    Some(DryWall { line, height_m: high_m })
}

/// Parts of terraces' walls that keep off what stands there.
pub fn on_terraces(lines: &[Path], step_m: f64, occupied: &mut Occupied, paved: &StripGrid) -> Vec<DryWall> {
    let mut walls = Vec::new();
    for line in lines {
        let points = line.points_every(4.0);
        let is_free = |pair: &[Vec2]| {
            let spot = Footprint::between(pair[0], pair[1], 1.0);
            occupied.is_free(&spot, 0.3) && paved.clearance_m(pair[0]) > 2.0
        };
        for run in points.windows(2).collect::<Vec<_>>().chunk_by(|a, b| is_free(a) == is_free(b)) {
            if is_free(run[0]) && run.len() > 1 {
                let line = Path::new(run.iter().map(|pair| pair[0]).chain([run[run.len() - 1][1]]));
                walls.extend(line.map(|line| DryWall { line, height_m: 0.3 * step_m.min(1.5) }));
            }
        }
    }
    for wall in &walls {
        for pair in wall.line.points().windows(2) {
            occupied.take(Footprint::between(pair[0], pair[1], 0.8));
        }
    }
    walls
}

/// The mesh of the walls that `is_near` keeps; a tile is a metre.
pub fn mesh(walls: &[DryWall], ground: &Ground, is_near: impl Fn(Vec2) -> bool) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for (n, wall) in walls.iter().enumerate() {
        if is_near(wall.line.at(wall.line.length_m() / 2.0)) {
            add_wall(&mut mesh, wall, ground, n as u64);
        }
    }
    mesh
}

fn add_wall(mesh: &mut TriangleMesh, wall: &DryWall, ground: &Ground, seed: u64) {
    let mut rng = random::stream(seed, "dry-wall-tops", 0);
    let line = &wall.line;
    let n = (line.length_m() / PIECE_M).ceil().max(1.0) as usize;
    // Across the wall at each rib: foot and top on the right, top and foot on the left.
    let ribs: Vec<[[f64; 3]; 4]> = (0..=n)
        .map(|k| {
            let s_m = line.length_m() * k as f64 / n as f64;
            let beside = |left_m: f64| line.beside(s_m, left_m);
            let under_m = [-0.8, 0.0, 0.8].map(|left_m| ground.height_m(beside(left_m)));
            let low_m = under_m.into_iter().fold(f64::MAX, f64::min) - FOOT_M;
            let top_m = under_m[1] + wall.height_m + 2.0 * UNEVEN_M * (rng.random::<f64>() - 0.5);
            let half_m = TOP_WIDTH_M / 2.0;
            let lean_m = half_m + BATTER * (top_m - low_m);
            let at = |left_m: f64, z_m: f64| {
                let place = beside(left_m);
                [place.x, place.y, z_m]
            };
            [at(-lean_m, low_m), at(-half_m, top_m), at(half_m, top_m), at(lean_m, low_m)]
        })
        .collect();
    for (k, pair) in ribs.windows(2).enumerate() {
        let u = [k, k + 1].map(|k| k as f64 * line.length_m() / n as f64);
        for face in 0..3 {
            let v =
                |rib: &[[f64; 3]; 4], at: usize| if face == 1 { at as f64 * TOP_WIDTH_M } else { rib[at][2] };
            mesh.add_polygon(&[
                (pair[0][face], [u[0], v(&pair[0], face)]),
                (pair[1][face], [u[1], v(&pair[1], face)]),
                (pair[1][face + 1], [u[1], v(&pair[1], face + 1)]),
                (pair[0][face + 1], [u[0], v(&pair[0], face + 1)]),
            ]);
        }
    }
    let across = [-0.35, -0.2, 0.2, 0.35];
    let end =
        |rib: &[[f64; 3]; 4]| -> Vec<_> { (0..4).map(|at| (rib[at], [across[at], rib[at][2]])).collect() };
    mesh.add_polygon(&end(&ribs[0]));
    let mut last = end(&ribs[n]);
    last.reverse();
    mesh.add_polygon(&last);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dry_wall_faces_outwards_and_its_top_is_uneven() {
        let line = Path::new([Vec2::zeros(), Vec2::new(9.0, 0.0)]).unwrap();
        let walls = [DryWall { line, height_m: 1.2 }];
        let mesh = mesh(&walls, &Ground::default(), |_| true);
        let mut tops: Vec<f32> = Vec::new();
        for [a, b, c] in mesh.corners() {
            let middle = (a.coords + b.coords + c.coords) / 3.0;
            let out = middle - nalgebra::Vector3::new(4.5, 0.0, 0.3);
            let normal = (b - a).cross(&(c - a));
            assert!(normal.x * out.x + normal.y * out.y > 0.0 || normal.z > 0.1, "{a} {b} {c}");
            tops.extend([a, b, c].iter().map(|at| at.z).filter(|z| *z > 0.8));
        }
        let (low, high) = tops.iter().fold((f32::MAX, f32::MIN), |(l, h), &z| (l.min(z), h.max(z)));
        assert!(high < 1.3 && low > 1.1 && high - low > 0.03, "{low} {high}");
    }
}
