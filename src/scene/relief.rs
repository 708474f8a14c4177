//! Relief between and beyond roads: hills, and terraces held by dry-stone walls.
//!
//! Roads, pavements and their verges keep their height. A terrace is a step of the land: the height `z` over the lowest
//! road becomes `step * (n + f)`, where `n` counts whole steps and `f` rises by [`TREAD_RISE`] over most of a step
//! and the rest of the way in its last part, behind the wall.

use super::ground::Grid;
use super::occupancy::StripGrid;
use super::path::{Path, Vec2};
use super::town_parts::HillConfig;

/// Part of a step's height that its tread rises by, and the part of its width that the tread takes.
const TREAD_RISE: f64 = 0.35;
const TREAD: f64 = 0.8;
/// Terraces begin this far from paving, and are whole from there on.
const TERRACES_FROM_M: f64 = 3.0;
const TERRACES_WHOLE_M: f64 = 7.0;
/// And end before this distance.
const TERRACES_TO_M: f64 = 45.0;
/// Hills rise between these distances from paving.
const HILLS_FROM_M: f64 = 12.0;
const HILLS_WHOLE_M: f64 = 70.0;
/// Land that climbs less than this has no terraces, and land that climbs more has no room for them.
const SLOPES: [f64; 2] = [0.05, 0.6];
/// Shorter walls are left out.
const LEAST_WALL_M: f64 = 14.0;

/// Distances of a grid's nodes from paving, metres; far away, by steps of a cell.
struct Distances(Vec<f64>);

impl Distances {
    fn of(grid: &Grid, paved: &StripGrid) -> Self {
        let mut far_m = vec![f64::INFINITY; grid.n_x * grid.n_y];
        for (at, half_m) in paved.discs() {
            let place = (at - grid.origin) / grid.cell_m;
            let reach = (half_m / grid.cell_m).ceil() + 1.0;
            let range = |middle: f64, n: usize| {
                let low = (middle - reach).max(0.0) as usize;
                low..((middle + reach).max(0.0) as usize + 1).min(n)
            };
            for j in range(place.y, grid.n_y) {
                for i in range(place.x, grid.n_x) {
                    let beside_m = ((grid.node(i, j) - at).norm() - half_m).max(0.0);
                    let node = &mut far_m[j * grid.n_x + i];
                    *node = node.min(beside_m);
                }
            }
        }
        // A chamfer: twice over the grid, each node from those before it.
        let (n_x, n_y, side_m) = (grid.n_x, grid.n_y, grid.cell_m);
        let diagonal_m = side_m * std::f64::consts::SQRT_2;
        let mut visit = |i: usize, j: usize, back: isize| {
            let mut best_m = far_m[j * n_x + i];
            for (di, dj, step_m) in
                [(-1, 0, side_m), (0, -1, side_m), (-1, -1, diagonal_m), (1, -1, diagonal_m)]
            {
                let near = (i.checked_add_signed(back * di), j.checked_add_signed(back * dj));
                if let (Some(x), Some(y)) = near
                    && x < n_x
                    && y < n_y
                {
                    best_m = best_m.min(far_m[y * n_x + x] + step_m);
                }
            }
            far_m[j * n_x + i] = best_m;
        };
        (0..n_y).for_each(|j| (0..n_x).for_each(|i| visit(i, j, 1)));
        (0..n_y).rev().for_each(|j| (0..n_x).rev().for_each(|i| visit(i, j, -1)));
        Self(far_m)
    }
}

/// 0 at `from`, 1 at `to`, smooth in between.
fn smooth(value: f64, from: f64, to: f64) -> f64 {
    let share = ((value - from) / (to - from)).clamp(0.0, 1.0);
    share * share * (3.0 - 2.0 * share)
}

/// The height in a terraced slope, in steps.
fn terraced(steps: f64) -> f64 {
    let (whole, share) = (steps.floor(), steps - steps.floor());
    let risen = if share < TREAD {
        TREAD_RISE * share / TREAD
    } else {
        TREAD_RISE + (1.0 - TREAD_RISE) * smooth(share, TREAD, 1.0)
    };
    whole + risen
}

/// Shapes a grid; returns the lines of the terraces' walls, with the land's higher side on their left.
pub fn shape(grid: &mut Grid, paved: &StripGrid, hills: &[HillConfig], terrace_m: f64) -> Vec<Path> {
    if hills.is_empty() && terrace_m <= 0.0 {
        return Vec::new();
    }
    let distances = Distances::of(grid, paved);
    for j in 0..grid.n_y {
        for i in 0..grid.n_x {
            let (at, node) = (grid.node(i, j), j * grid.n_x + i);
            let share = smooth(distances.0[node], HILLS_FROM_M, HILLS_WHOLE_M);
            let rise_m = hills.iter().map(|hill| {
                let from_m = (at - Vec2::new(hill.center_m[0], hill.center_m[1])).norm();
                hill.height_m * (1.0 - smooth(from_m, 0.0, hill.radius_m))
            });
            grid.z_m[node] += (share * rise_m.sum::<f64>()) as f32;
        }
    }
    if terrace_m <= 0.0 {
        return Vec::new();
    }
    let walls = contours(grid, &distances, terrace_m);
    let steep: Vec<f64> = (0..grid.z_m.len()).map(|node| slope(grid, node)).collect();
    for (node, z_m) in grid.z_m.iter_mut().enumerate() {
        let [gentle, sheer] = SLOPES;
        let is_slope =
            smooth(steep[node], gentle, 2.0 * gentle) * (1.0 - smooth(steep[node], sheer, 2.0 * sheer));
        let begin = smooth(distances.0[node], TERRACES_FROM_M, TERRACES_WHOLE_M);
        let end = 1.0 - smooth(distances.0[node], 0.9 * TERRACES_TO_M, TERRACES_TO_M);
        let share = is_slope * begin * end;
        let step_m = terrace_m * terraced(f64::from(*z_m) / terrace_m);
        *z_m += (share * (step_m - f64::from(*z_m))) as f32;
    }
    walls
}

/// How much the land climbs at a node.
fn slope(grid: &Grid, node: usize) -> f64 {
    let (i, j) = (node % grid.n_x, node / grid.n_x);
    if i == 0 || j == 0 || i + 1 == grid.n_x || j + 1 == grid.n_y {
        return 0.0;
    }
    let climb = |a: usize, b: usize| f64::from(grid.z_m[a] - grid.z_m[b]) / (2.0 * grid.cell_m);
    climb(node + 1, node - 1).hypot(climb(node + grid.n_x, node - grid.n_x))
}

/// Lines along which the land reaches whole steps, away from paving.
fn contours(grid: &Grid, distances: &Distances, step_m: f64) -> Vec<Path> {
    // Pieces from cells of several nodes: a wall has corners, not waves.
    let stride = (3.0 / grid.cell_m).round().max(1.0) as usize;
    let mut pieces = Vec::new();
    for j in (0..grid.n_y.saturating_sub(stride)).step_by(stride) {
        for i in (0..grid.n_x.saturating_sub(stride)).step_by(stride) {
            let nodes = [(i, j), (i + stride, j), (i + stride, j + stride), (i, j + stride)];
            let is_open = nodes.iter().all(|&(i, j)| {
                let node = j * grid.n_x + i;
                let [gentle, sheer] = SLOPES;
                (TERRACES_WHOLE_M..TERRACES_TO_M).contains(&distances.0[node])
                    && (gentle..sheer).contains(&slope(grid, node))
            });
            if is_open {
                pieces.extend(pieces_in(grid, nodes, step_m));
            }
        }
    }
    join(pieces)
}

/// Where contours cross a cell: the higher side is on the left of each piece.
fn pieces_in(grid: &Grid, nodes: [(usize, usize); 4], step_m: f64) -> Vec<[Vec2; 2]> {
    let z = nodes.map(|(i, j)| grid.z_at(i, j));
    let (low, high) = z.iter().fold((f64::MAX, f64::MIN), |(low, high), &z| (low.min(z), high.max(z)));
    let mut pieces = Vec::new();
    let mut level = (low / step_m).floor() + 1.0;
    while level * step_m <= high {
        let over = z.map(|z| z - level * step_m);
        // Counter-clockwise round the cell: where the land rises above the level, and where it falls below.
        let crossing = |rises: bool| {
            (0..4).filter(move |&k| (over[k] < 0.0) == rises && (over[(k + 1) % 4] < 0.0) != rises).map(|k| {
                let (a, b) = (nodes[k], nodes[(k + 1) % 4]);
                let share = over[k] / (over[k] - over[(k + 1) % 4]);
                grid.node(a.0, a.1) * (1.0 - share) + grid.node(b.0, b.1) * share
            })
        };
        let (rises, falls): (Vec<Vec2>, Vec<Vec2>) = (crossing(true).collect(), crossing(false).collect());
        if let ([rise], [fall]) = (&rises[..], &falls[..]) {
            pieces.push([*fall, *rise]);
        }
        level += 1.0;
    }
    pieces
}

/// Pieces that meet, as lines.
fn join(mut pieces: Vec<[Vec2; 2]>) -> Vec<Path> {
    let mut lines = Vec::new();
    while let Some([from, to]) = pieces.pop() {
        let mut line = std::collections::VecDeque::from([from, to]);
        loop {
            let (first, last) = (line[0], line[line.len() - 1]);
            let meets = |a: Vec2, b: Vec2| (a - b).norm() < 1e-6;
            let next = pieces.iter().position(|piece| meets(piece[0], last) || meets(piece[1], first));
            let Some(next) = next else { break };
            let [from, to] = pieces.swap_remove(next);
            if meets(from, last) {
                line.push_back(to);
            } else {
                line.push_front(from);
            }
        }
        lines.extend(Path::new(line).filter(|line| line.length_m() >= LEAST_WALL_M));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 60 m squared, climbing by 0.2 to the north from a road along its southern edge.
    fn slope_beside_a_road() -> (Grid, StripGrid) {
        let (n_x, n_y) = (61, 61);
        let z_m = (0..n_x * n_y).map(|node| 0.2 * (node / n_x) as f32).collect();
        let mut paved = StripGrid::default();
        paved.add(&(0..60).map(|x| Vec2::new(f64::from(x), 0.0)).collect::<Vec<_>>(), 3.0);
        (Grid { origin: Vec2::zeros(), cell_m: 1.0, n_x, n_y, z_m }, paved)
    }

    #[test]
    fn walls_stand_where_the_land_steps_and_the_road_keeps_its_height() {
        let (mut grid, paved) = slope_beside_a_road();
        let before = grid.clone();
        let walls = shape(&mut grid, &paved, &[], 2.0);
        // Whole steps lie at 10, 20, 30, 40 and 50 m north; the first is too near to the road.
        assert!((3..=5).contains(&walls.len()), "{}", walls.len());
        for wall in &walls {
            let middle = wall.at(wall.length_m() / 2.0);
            assert!((middle.y / 10.0 - (middle.y / 10.0).round()).abs() < 0.01, "{middle}");
            assert!(wall.direction(3.0).x > 0.99, "the higher side is on the left");
        }
        for i in 0..grid.n_x {
            assert!((grid.z_at(i, 4) - before.z_at(i, 4)).abs() < 1e-6);
        }
        // A tread is flatter than the slope was, and the land meets it again at the wall.
        assert!((grid.z_at(30, 36) - grid.z_at(30, 31) - 1.0).abs() > 0.5);
        assert!((grid.z_at(30, 40) - before.z_at(30, 40)).abs() < 0.05);
    }

    #[test]
    fn a_hill_rises_away_from_the_road_only() {
        let (mut grid, paved) = slope_beside_a_road();
        let before = grid.clone();
        let hill = HillConfig { center_m: [30.0, 60.0], radius_m: 50.0, height_m: 20.0 };
        assert!(shape(&mut grid, &paved, &[hill], 0.0).is_empty());
        assert!((grid.z_at(30, 10) - before.z_at(30, 10)).abs() < 1e-6);
        assert!(grid.z_at(30, 58) - before.z_at(30, 58) > 10.0);
    }
}
