//! How points lie to each other: the distance to the nearest one, and whether they lie on flat walls.

use std::collections::HashMap;

use nalgebra::{Matrix3, Point3, Vector3};

use super::quantity::{N_RANGE_BINS, RANGE_BIN_M};
use super::{Quantity, Tallies};

/// Cells in which points are judged together.
const CELL_M: f64 = 1.0;
/// Fewer points in a cell say nothing of it.
const MIN_CELL_POINTS: usize = 8;
/// Points that spread less about a plane are flat: twice the noise of a range and more.
pub const FLAT_M: f64 = 0.05;
/// Points that spread less about a line are one ring's, of which no plane is known.
const LINE_M: f64 = 0.1;
/// A neighbour farther than this share of the far end of a bin of range counts as so far.
const REACH_SHARE: f64 = 0.03;

type Cell = [i32; 3];

fn cell_of(point: &Point3<f64>, size_m: f64) -> Cell {
    [point.x, point.y, point.z].map(|at| (at / size_m).floor() as i32)
}

fn sort_into_cells<'a>(
    points: impl Iterator<Item = &'a Point3<f64>>,
    size_m: f64,
) -> HashMap<Cell, Vec<&'a Point3<f64>>> {
    let mut cells: HashMap<Cell, Vec<&Point3<f64>>> = HashMap::new();
    for point in points {
        cells.entry(cell_of(point, size_m)).or_default().push(point);
    }
    cells
}

/// Counts the distance of each point in the ego frame to its nearest neighbour, by range.
pub(super) fn add_spacing(tallies: &mut Tallies, points: &[Point3<f64>]) {
    for bin in 0..N_RANGE_BINS {
        let [near_m, far_m] = [bin, bin + 1].map(|edge| f64::from(edge) * RANGE_BIN_M);
        let reach_m = REACH_SHARE * far_m;
        let is_within = |point: &&Point3<f64>, margin_m: f64| {
            (near_m - margin_m..far_m + margin_m).contains(&point.coords.xy().norm())
        };
        let cells = sort_into_cells(points.iter().filter(|point| is_within(point, reach_m)), reach_m);
        let nearest = |point: &Point3<f64>| {
            let [x, y, z] = cell_of(point, reach_m);
            let around =
                (0..27).filter_map(|i| cells.get(&[x + i % 3 - 1, y + i / 3 % 3 - 1, z + i / 9 - 1]));
            let others = around.flatten().filter(|other| !std::ptr::eq(**other, point));
            let square =
                others.map(|other| (*other - point).norm_squared()).fold(reach_m * reach_m, f64::min);
            square.sqrt()
        };
        let own = points.iter().filter(|point| is_within(point, 0.0));
        tallies.add_all(Quantity::PointSpacing(bin), own.map(nearest));
    }
}

/// Counts the share of a sample's points that lie neither on flat walls nor where nothing can be said; `points` are neither
/// of the ground nor of objects.
pub(super) fn add_irregular(tallies: &mut Tallies, points: &[Point3<f64>], n_all: usize) {
    let cells = sort_into_cells(points.iter(), CELL_M);
    let n_irregular: usize = cells.values().filter(|of_cell| is_irregular(of_cell)).map(Vec::len).sum();
    if n_all > 0 {
        tallies.add(Quantity::IrregularShare, n_irregular as f64 / n_all as f64);
    }
}

/// Whether the points of a cell spread about every plane.
fn is_irregular(points: &[&Point3<f64>]) -> bool {
    if points.len() < MIN_CELL_POINTS {
        return false;
    }
    let n = points.len() as f64;
    let mean = points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / n;
    let spread: Matrix3<f64> = points
        .iter()
        .map(|point| {
            let off = point.coords - mean;
            off * off.transpose() / n
        })
        .sum();
    let mut variances: [f64; 3] = spread.symmetric_eigenvalues().into();
    variances.sort_by(f64::total_cmp);
    variances[0].max(0.0).sqrt() > FLAT_M && variances[1].max(0.0).sqrt() > LINE_M
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;
    use crate::random;

    fn mean(tallies: &Tallies, quantity: Quantity) -> f64 {
        tallies.get(quantity).expect("it was measured").mean()
    }

    #[test]
    fn a_grid_is_as_far_apart_as_its_step_and_lone_points_as_far_as_is_looked() {
        let grid = (0..20).flat_map(|x| (0..20).map(move |y| (x, y)));
        let mut points: Vec<Point3<f64>> =
            grid.map(|(x, y)| Point3::new(4.0 + 0.1 * f64::from(x), 0.1 * f64::from(y), 0.0)).collect();
        points.push(Point3::new(25.0, 0.0, 0.0));
        let mut tallies = Tallies::default();
        add_spacing(&mut tallies, &points);
        assert!((mean(&tallies, Quantity::PointSpacing(0)) - 0.1).abs() < 1e-9);
        assert!((mean(&tallies, Quantity::PointSpacing(2)) - 0.9).abs() < 1e-9, "3 % of 30 m");
        assert!(tallies.get(Quantity::PointSpacing(1)).is_none());
    }

    #[test]
    fn leaves_are_irregular_and_walls_and_single_rings_are_not() {
        let mut rng = random::stream(1, "structure", 0);
        let mut draw = |size: [f64; 3]| {
            let [x, y, z] = size.map(|size| size * rng.random::<f64>());
            Point3::new(10.0 + x, 10.0 + y, 1.0 + z)
        };
        let mut share = |size: [f64; 3]| {
            let mut tallies = Tallies::default();
            let points: Vec<Point3<f64>> = (0..400).map(|_| draw(size)).collect();
            add_irregular(&mut tallies, &points, 800);
            mean(&tallies, Quantity::IrregularShare)
        };
        assert_eq!(share([0.99, 0.99, 0.99]), 0.5);
        assert_eq!(share([0.99, 0.02, 0.99]), 0.0);
        assert_eq!(share([0.99, 0.1, 0.02]), 0.0);
    }
}
