//! Softmax over the last axis, f32, forward and backward in one pass over each row.
//!
//! ```text
//! y_i = exp(x_i - max x) / sum_j exp(x_j - max x)        dx_i = y_i (dy_i - sum_j dy_j y_j)
//! ```
//!
//! The exponential is 2^n times a polynomial of the rest (Cephes' `expf`, relative error under 2e-7). Sums run
//! in lanes whose number only the instruction set decides, one row on one thread, so that results are
//! equal to the bit whatever the number of threads.

#[cfg(not(kernels_alone))]
mod burn_op;

use rayon::prelude::*;

use super::simd::{InstructionSet, Kernel, Simd};

#[cfg(not(kernels_alone))]
pub use burn_op::softmax_last;

/// Floats that make a task worth sending to another thread.
const FLOATS_PER_TASK: usize = 1 << 14;

/// # Shapes
/// - x, output: `[row, column]`
pub(super) fn forward(x: &[f32], n_columns: usize, set: InstructionSet) -> Vec<f32> {
    let mut y = vec![0f32; x.len()];
    let rows_per_task = FLOATS_PER_TASK.div_ceil(n_columns);
    y.par_chunks_mut(rows_per_task * n_columns)
        .zip(x.par_chunks(rows_per_task * n_columns))
        .for_each(|(y, x)| set.run(Forward { x, y, n_columns }));
    y
}

/// # Shapes
/// - y, dy, output: `[row, column]`
pub(super) fn gradient(y: &[f32], dy: &[f32], n_columns: usize, set: InstructionSet) -> Vec<f32> {
    assert_eq!(y.len(), dy.len());
    let mut dx = vec![0f32; y.len()];
    let rows_per_task = FLOATS_PER_TASK.div_ceil(n_columns);
    let size = rows_per_task * n_columns;
    dx.par_chunks_mut(size)
        .zip(y.par_chunks(size).zip(dy.par_chunks(size)))
        .for_each(|(dx, (y, dy))| set.run(Backward { y, dy, dx, n_columns }));
    dx
}

struct Forward<'a> {
    x: &'a [f32],
    y: &'a mut [f32],
    n_columns: usize,
}

impl Kernel for Forward<'_> {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const LANES: usize>(self) {
        let rows = self.x.chunks_exact(self.n_columns).zip(self.y.chunks_exact_mut(self.n_columns));
        for (x, y) in rows {
            let highest =
                fold::<LANES>(x, x, f32::NEG_INFINITY, |highest, x, _| if x > highest { x } else { highest });
            for (y, &x) in y.iter_mut().zip(x) {
                *y = exp_of_negative(x - highest);
            }
            let sum = fold::<LANES>(y, y, 0.0, |sum, y, _| sum + y);
            let share = 1.0 / sum;
            for y in y.iter_mut() {
                *y *= share;
            }
        }
    }
}

struct Backward<'a> {
    y: &'a [f32],
    dy: &'a [f32],
    dx: &'a mut [f32],
    n_columns: usize,
}

impl Kernel for Backward<'_> {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const LANES: usize>(self) {
        let n = self.n_columns;
        let rows = self.y.chunks_exact(n).zip(self.dy.chunks_exact(n)).zip(self.dx.chunks_exact_mut(n));
        for ((y, dy), dx) in rows {
            let mean = fold::<LANES>(y, dy, 0.0, |sum, y, dy| sum + y * dy);
            for ((dx, &y), &dy) in dx.iter_mut().zip(y).zip(dy) {
                *dx = y * (dy - mean);
            }
        }
    }
}

/// Folds two rows in `LANES` partial results, then these one after the other and the rest.
#[inline(always)]
fn fold<const LANES: usize>(a: &[f32], b: &[f32], start: f32, of: impl Fn(f32, f32, f32) -> f32) -> f32 {
    let mut lanes = [start; LANES];
    let (a_whole, a_rest) = a.as_chunks::<LANES>();
    let (b_whole, b_rest) = b.as_chunks::<LANES>();
    for (a, b) in a_whole.iter().zip(b_whole) {
        for lane in 0..LANES {
            lanes[lane] = of(lanes[lane], a[lane], b[lane]);
        }
    }
    // Partial results join by the same rule with one for the other factor: a sum's parts are summed, a
    // maximum's parts compared.
    let joined = lanes.iter().skip(1).fold(lanes[0], |joined, &part| of(joined, part, 1.0));
    a_rest.iter().zip(b_rest).fold(joined, |joined, (&a, &b)| of(joined, a, b))
}

/// `exp(x)` for x at most 0; values below -87 count as -87 (1.6e-38).
#[inline(always)]
fn exp_of_negative(x: f32) -> f32 {
    // Adding and taking away 1.5 x 2^23 rounds to an integer, which the sum then holds in its low bits.
    const ROUND: f32 = 12_582_912.0;
    // NaN stays NaN, so that a training that diverges is seen.
    let x = if x < -87.0 { -87.0 } else { x };
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    // ln 2 in two parts, so that the rest keeps all its digits.
    let r = (x - n * 0.693_359_4) + n * 2.121_944_4e-4;
    let p = 1.987_569_2e-4;
    let p = p * r + 1.398_2e-3;
    let p = p * r + 8.333_452e-3;
    let p = p * r + 4.166_579_6e-2;
    let p = p * r + 1.666_666_5e-1;
    let p = p * r + 0.5;
    let p = p * r * r + r + 1.0;
    p * f32::from_bits((shifted.to_bits() << 23).wrapping_add(0x3f80_0000))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_within_a_few_units_of_the_last_place() {
        for i in (0..=87_000).step_by(if cfg!(miri) { 997 } else { 1 }) {
            let x = -(i as f32) / 1000.0;
            let exact = f64::from(x).exp();
            assert!((f64::from(exp_of_negative(x)) - exact).abs() <= 3e-7 * exact, "{x}");
        }
        assert_eq!(exp_of_negative(0.0), 1.0);
        assert!(exp_of_negative(-1e30) < 2e-38);
    }

    #[test]
    fn every_instruction_set_equals_double_precision() {
        let n_of_many = if cfg!(miri) { 4 } else { 40 };
        for (n_rows, n_columns) in [(3, 5), (n_of_many, 700), (1, 1), (2, 33)] {
            let mut random = crate::random::stream(4, "softmax-test", n_columns as u64);
            let mut draw = || -> Vec<f32> {
                (0..n_rows * n_columns).map(|_| rand::RngExt::random_range(&mut random, -9.0..9.0)).collect()
            };
            let (x, dy) = (draw(), draw());
            for set in InstructionSet::available() {
                let y = forward(&x, n_columns, set);
                let dx = gradient(&y, &dy, n_columns, set);
                for row in 0..n_rows {
                    let of = |values: &[f32]| -> Vec<f64> {
                        values[row * n_columns..(row + 1) * n_columns].iter().map(|&v| f64::from(v)).collect()
                    };
                    let (x, dy, y, dx) = (of(&x), of(&dy), of(&y), of(&dx));
                    let sum: f64 = x.iter().map(|x| x.exp()).sum();
                    let exact: Vec<f64> = x.iter().map(|x| x.exp() / sum).collect();
                    let mean: f64 = exact.iter().zip(&dy).map(|(y, dy)| y * dy).sum();
                    for i in 0..n_columns {
                        assert!((y[i] - exact[i]).abs() < 1e-6, "{set:?}");
                        assert!((dx[i] - exact[i] * (dy[i] - mean)).abs() < 1e-5, "{set:?}");
                    }
                }
            }
        }
    }
}
