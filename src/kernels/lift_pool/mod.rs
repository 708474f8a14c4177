//! Sum pooling of lifted image features: every frustum point (a pixel at a depth bin) adds its pixel's context,
//! weighted by the probability of its bin, to the bird's-eye cell it falls into.
//!
//! `out[cell] = sum over points p of the cell: depth[pixel(p), bin(p)] * context[pixel(p)]`
//!
//! The weighted points, `[point, channel]`, are never built: with a plan made once from the calibration, each
//! cell gathers its points in order of their index, and each pixel gathers its gradients in order of its
//! bins. Sums thus do not depend on the number of threads.

mod burn_op;

use std::ops::Range;

use rayon::prelude::*;

pub use burn_op::lift_pool;

/// Cells that a task works on at a time.
const CELLS_PER_TASK: usize = 256;
/// Partial sums of a dot product, for the compiler to keep in vectors.
const LANES: usize = 16;

/// The cell of each frustum point.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PoolPlan {
    n_bins: usize,
    /// `[pixel, bin]`: cell of the point, or [`PoolPlan::OUTSIDE`].
    cell_of_point: Vec<u32>,
    /// `[cell + 1]`: where each cell's points begin in `points`.
    first_of_cell: Vec<u32>,
    /// Points inside, `pixel * n_bins + bin`, by cell and within it by index.
    points: Vec<u32>,
}

impl PoolPlan {
    /// The cell of a point that falls into none.
    pub const OUTSIDE: u32 = u32::MAX;

    /// Groups points by cell; `cell_of_point` is `[pixel, bin]`.
    ///
    /// # Panics
    /// If a cell is neither below `n_cells` nor [`Self::OUTSIDE`], or points do not fill whole pixels.
    #[must_use]
    pub fn new(n_bins: usize, n_cells: usize, cell_of_point: Vec<u32>) -> Self {
        assert!(cell_of_point.len().is_multiple_of(n_bins), "every pixel has {n_bins} bins");
        let mut first_of_cell = vec![0; n_cells + 1];
        for &cell in cell_of_point.iter().filter(|&&cell| cell != Self::OUTSIDE) {
            first_of_cell[cell as usize + 1] += 1;
        }
        for cell in 0..n_cells {
            first_of_cell[cell + 1] += first_of_cell[cell];
        }
        let mut next = first_of_cell.clone();
        let mut points = vec![0; first_of_cell[n_cells] as usize];
        for (point, &cell) in cell_of_point.iter().enumerate().filter(|&(_, &cell)| cell != Self::OUTSIDE) {
            points[next[cell as usize] as usize] = point as u32;
            next[cell as usize] += 1;
        }
        Self { n_bins, cell_of_point, first_of_cell, points }
    }

    #[must_use]
    pub fn n_pixels(&self) -> usize {
        self.cell_of_point.len() / self.n_bins
    }

    #[must_use]
    pub fn n_bins(&self) -> usize {
        self.n_bins
    }

    /// Memory that the lists take.
    #[must_use]
    pub fn n_bytes(&self) -> usize {
        let lists = [&self.cell_of_point, &self.first_of_cell, &self.points];
        lists.map(|list| size_of_val(list.as_slice())).iter().sum()
    }

    #[must_use]
    pub fn n_cells(&self) -> usize {
        self.first_of_cell.len() - 1
    }

    /// Points that fall into a cell, `pixel * n_bins + bin`, by cell and within it by index.
    #[must_use]
    pub fn points(&self) -> &[u32] {
        &self.points
    }

    /// Cell of each point, `[pixel, bin]`, or [`Self::OUTSIDE`].
    #[must_use]
    pub fn cell_of_point(&self) -> &[u32] {
        &self.cell_of_point
    }

    fn points_of(&self, cell: usize) -> &[u32] {
        let range: Range<usize> = self.first_of_cell[cell] as usize..self.first_of_cell[cell + 1] as usize;
        &self.points[range]
    }

    /// Pools one sample.
    ///
    /// # Shapes
    /// - depth: `[pixel, bin]`
    /// - context: `[pixel, channel]`
    /// - out: `[cell, channel]`, zero at first
    fn pool(&self, depth: &[f32], context: &[f32], n_channels: usize, out: &mut [f32]) {
        out.par_chunks_mut(CELLS_PER_TASK * n_channels).enumerate().for_each(|(task, cells)| {
            for (i, sum) in cells.chunks_mut(n_channels).enumerate() {
                for &point in self.points_of(task * CELLS_PER_TASK + i) {
                    let pixel = point as usize / self.n_bins;
                    let row = &context[pixel * n_channels..][..n_channels];
                    add_scaled(sum, depth[point as usize], row);
                }
            }
        });
    }

    /// Gradients of one sample with respect to depth and context.
    ///
    /// # Shapes
    /// - depth, d_depth: `[pixel, bin]`
    /// - context, d_context: `[pixel, channel]`; both gradients zero at first
    /// - d_out: `[cell, channel]`
    fn gradients(
        &self,
        depth: &[f32],
        context: &[f32],
        d_out: &[f32],
        d_depth: &mut [f32],
        d_context: &mut [f32],
    ) {
        let n_channels = context.len() / self.n_pixels();
        let of_pixels = d_depth.par_chunks_mut(self.n_bins).zip(d_context.par_chunks_mut(n_channels));
        of_pixels.enumerate().for_each(|(pixel, (d_depth, d_context))| {
            let row = &context[pixel * n_channels..][..n_channels];
            for (bin, d_probability) in d_depth.iter_mut().enumerate() {
                let point = pixel * self.n_bins + bin;
                let cell = self.cell_of_point[point];
                if cell != Self::OUTSIDE {
                    let d_cell = &d_out[cell as usize * n_channels..][..n_channels];
                    *d_probability = dot(row, d_cell);
                    add_scaled(d_context, depth[point], d_cell);
                }
            }
        });
    }
}

/// `sum += scale * row`
fn add_scaled(sum: &mut [f32], scale: f32, row: &[f32]) {
    for (sum, &value) in sum.iter_mut().zip(row) {
        *sum += scale * value;
    }
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0f32; LANES];
    let (a_whole, b_whole) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest: f32 = a_whole.remainder().iter().zip(b_whole.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a_whole.zip(b_whole) {
        for lane in 0..LANES {
            sums[lane] += a[lane] * b[lane];
        }
    }
    sums.iter().sum::<f32>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_grouped_by_cell_and_those_outside_left_out() {
        let plan = PoolPlan::new(2, 3, vec![2, PoolPlan::OUTSIDE, 0, 2]);
        assert_eq!((plan.n_pixels(), plan.n_cells()), (2, 3));
        assert_eq!(plan.points(), [2, 0, 3]);
        assert_eq!(
            (plan.points_of(0), plan.points_of(1), plan.points_of(2)),
            (&[2][..], &[][..], &[0, 3][..])
        );
    }

    #[test]
    fn a_cell_holds_the_weighted_sum_of_its_points() {
        // Pixel 0 has context (1, 10), pixel 1 (2, 20).
        let plan = PoolPlan::new(2, 2, vec![1, PoolPlan::OUTSIDE, 1, 0]);
        let mut out = vec![0.0; 4];
        plan.pool(&[0.5, 0.25, 0.125, 2.0], &[1.0, 10.0, 2.0, 20.0], 2, &mut out);
        assert_eq!(out, [4.0, 40.0, 0.75, 7.5]);
    }

    #[test]
    #[should_panic(expected = "index out of bounds")]
    fn a_cell_beyond_the_grid_is_refused() {
        let _ = PoolPlan::new(1, 2, vec![2]);
    }
}
