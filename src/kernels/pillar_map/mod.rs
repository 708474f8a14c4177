//! The highest of each pillar's points, laid on a map: PointPillars' maximum and scatter (Lang et al. 2019) in one.
//!
//! ```text
//! map[m, c, cell] = max over the points p of the pillar in that cell of x[p, c]; 0 where there is no pillar
//! ```
//!
//! The gradient goes to the first of the highest points.

mod burn_op;

pub use burn_op::pillar_map;

/// Which points make which cell's pillar.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PillarPlan {
    n_points: usize,
    n_maps: usize,
    /// Of one map.
    n_cells: usize,
    max_points: usize,
    /// `[pillar, max_points]`
    points: Vec<u32>,
    /// `[pillar]`: `map * n_cells + cell`, each at most once.
    cells: Vec<u32>,
}

impl PillarPlan {
    /// Lists pillars: `points` is `[pillar, max_points]`, `cells` `[pillar]`, counted through all maps.
    ///
    /// # Panics
    /// If a point or a cell is out of range, or the lists do not fit each other.
    #[must_use]
    pub fn new(n_points: usize, [n_maps, n_cells]: [usize; 2], points: Vec<u32>, cells: Vec<u32>) -> Self {
        let max_points = points.len().checked_div(cells.len()).unwrap_or_default();
        assert!(points.len() == cells.len() * max_points, "each pillar lists as many points");
        assert!(max_points > 0 || cells.is_empty(), "a pillar has a point");
        assert!(points.iter().all(|&point| (point as usize) < n_points), "points are below {n_points}");
        assert!(cells.iter().all(|&cell| (cell as usize) < n_maps * n_cells), "cells are of the maps");
        Self { n_points, n_maps, n_cells, max_points, points, cells }
    }

    fn pillars(&self) -> impl Iterator<Item = (&[u32], usize)> {
        let places = self.cells.iter().map(|&cell| cell as usize);
        self.points.chunks_exact(self.max_points.max(1)).zip(places)
    }

    /// Index of a cell's first channel in a map `[map, channel, cell]`.
    fn place(&self, cell: usize, n_channels: usize) -> usize {
        cell / self.n_cells * n_channels * self.n_cells + cell % self.n_cells
    }

    /// # Shapes
    /// - x: `[point, channel]`
    /// - output: `[map, channel, cell]`, and the highest points, `[pillar, channel]`
    fn forward(&self, x: &[f32], n_channels: usize) -> (Vec<f32>, Vec<u32>) {
        let mut map = vec![0f32; self.n_maps * n_channels * self.n_cells];
        let mut highest_points = vec![0u32; self.cells.len() * n_channels];
        let mut highest = vec![0f32; n_channels];
        for ((points, cell), from) in self.pillars().zip(highest_points.chunks_exact_mut(n_channels)) {
            let row = |point: u32| &x[point as usize * n_channels..][..n_channels];
            highest.copy_from_slice(row(points[0]));
            from.fill(points[0]);
            for &point in &points[1..] {
                for ((highest, from), &value) in highest.iter_mut().zip(&mut *from).zip(row(point)) {
                    // NaN stays, or comes in.
                    let is_higher = value > *highest || value.is_nan();
                    *highest = if is_higher { value } else { *highest };
                    *from = if is_higher { point } else { *from };
                }
            }
            let channels = map[self.place(cell, n_channels)..].iter_mut().step_by(self.n_cells);
            for (value, highest) in channels.zip(&highest) {
                *value = *highest;
            }
        }
        (map, highest_points)
    }

    /// The gradient of x, `[point, channel]`.
    fn gradient(&self, d_map: &[f32], highest_points: &[u32], n_channels: usize) -> Vec<f32> {
        let mut dx = vec![0f32; self.n_points * n_channels];
        for ((_, cell), from) in self.pillars().zip(highest_points.chunks_exact(n_channels)) {
            let channels = d_map[self.place(cell, n_channels)..].iter().step_by(self.n_cells);
            for (channel, (d, &point)) in channels.zip(from).enumerate() {
                dx[point as usize * n_channels + channel] += d;
            }
        }
        dx
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pillar_keeps_its_highest_points_and_they_get_the_gradient() {
        // Two maps of two cells; a pillar in the last cell of the first map, one in the first of the second.
        let plan = PillarPlan::new(3, [2, 2], vec![0, 1, 2, 2], vec![1, 2]);
        let (map, from) = plan.forward(&[1.0, 5.0, 2.0, 4.0, -3.0, 7.0], 2);
        assert_eq!(map, [0.0, 2.0, 0.0, 5.0, -3.0, 0.0, 7.0, 0.0]);
        assert_eq!(from, [1, 0, 2, 2]);
        let dx = plan.gradient(&[9.0, 1.0, 9.0, 2.0, 3.0, 9.0, 4.0, 9.0], &from, 2);
        assert_eq!(dx, [0.0, 2.0, 1.0, 0.0, 3.0, 4.0]);
    }

    #[test]
    #[should_panic(expected = "cells are of the maps")]
    fn a_cell_beyond_the_maps_is_refused() {
        let _ = PillarPlan::new(1, [1, 4], vec![0], vec![4]);
    }
}
