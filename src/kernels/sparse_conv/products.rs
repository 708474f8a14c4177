//! The products of a sparse convolution on slices, block by block so that gathered rows stay in cache.
//!
//! Blocks do not depend on the number of threads, and each is summed in the order of the offsets: results
//! repeat bit by bit.

use rayon::prelude::*;

use super::rulebook::{Direction, Rulebook, positions};
use crate::kernels::product::{Matrix, multiply};
use crate::kernels::scratch::with_scratch;

/// Floats gathered at once: half of a common L2 cache together with the product.
const BLOCK_FLOATS: usize = 32 * 1024;

/// Copies `rows` of `x`, rows of `n_channels`, one after the other.
fn gather(x: &[f32], n_channels: usize, rows: &[u32], into: &mut [f32]) {
    for (&row, into) in rows.iter().zip(into.chunks_exact_mut(n_channels)) {
        let at = row as usize * n_channels;
        into.copy_from_slice(&x[at..at + n_channels]);
    }
}

/// The convolution (forward), or the gradient of its input from that of its output (backward).
///
/// # Shapes
/// - x: `[row read, channel read]`
/// - w: `[offset, channel_in, channel_out]`; backward uses each matrix's transpose
/// - output: `[row written, channel written]`
pub(super) fn apply(
    rulebook: &Rulebook,
    direction: Direction,
    x: &[f32],
    w: &[f32],
    [channels_in, channels_out]: [usize; 2],
) -> Vec<f32> {
    let (n_read, n_written) = match direction {
        Direction::Forward => (channels_in, channels_out),
        Direction::Backward => (channels_out, channels_in),
    };
    let block_rows = (BLOCK_FLOATS / n_read.max(n_written)).max(1);
    let mut out = vec![0.0; direction.n_written(rulebook) * n_written];
    out.par_chunks_mut(block_rows * n_written).enumerate().for_each(|(block_idx, out)| {
        let first = block_idx * block_rows;
        with_scratch(|scratch| {
            for (pairs, w) in rulebook.offsets().iter().zip(w.chunks_exact(channels_in * channels_out)) {
                let (read, written) = direction.rows(pairs);
                let here = positions(written, first..first + out.len() / n_written);
                if here.is_empty() {
                    continue;
                }
                let gathered = scratch.a.get(here.len() * n_read);
                gather(x, n_read, &read[here.clone()], gathered);
                let w = Matrix::new(w, channels_in, channels_out);
                let w = if matches!(direction, Direction::Forward) { w } else { w.transposed() };
                let product = scratch.b.get(here.len() * n_written);
                multiply(Matrix::new(gathered, here.len(), n_read), w, product, false);
                for (&row, product) in written[here].iter().zip(product.chunks_exact(n_written)) {
                    let at = (row as usize - first) * n_written;
                    out[at..at + n_written].iter_mut().zip(product).for_each(|(sum, term)| *sum += term);
                }
            }
        });
    });
    out
}

/// Gradient of the matrices: `dw[k] = sum over pairs (i, o) of k: x[i]^T dy[o]`.
///
/// # Shapes
/// - x: `[input, channel_in]`
/// - dy: `[output, channel_out]`
/// - output: `[offset, channel_in, channel_out]`
pub(super) fn weight_gradient(
    rulebook: &Rulebook,
    x: &[f32],
    dy: &[f32],
    [channels_in, channels_out]: [usize; 2],
) -> Vec<f32> {
    let block_rows = (BLOCK_FLOATS / channels_in.max(channels_out)).max(1);
    let mut dw = vec![0.0; rulebook.offsets().len() * channels_in * channels_out];
    dw.par_chunks_exact_mut(channels_in * channels_out).zip(rulebook.offsets()).for_each(|(dw, pairs)| {
        with_scratch(|scratch| {
            for (inputs, outputs) in pairs.inputs.chunks(block_rows).zip(pairs.outputs.chunks(block_rows)) {
                let n = inputs.len();
                let (x_rows, dy_rows) = (scratch.a.get(n * channels_in), scratch.b.get(n * channels_out));
                gather(x, channels_in, inputs, x_rows);
                gather(dy, channels_out, outputs, dy_rows);
                let (a, b) = (Matrix::new(x_rows, n, channels_in), Matrix::new(dy_rows, n, channels_out));
                multiply(a.transposed(), b, dw, true);
            }
        });
    });
    dw
}

#[cfg(test)]
mod tests {
    use super::super::OffsetPairs;
    use super::*;

    #[test]
    fn results_do_not_depend_on_the_number_of_threads() {
        let n = 3 * BLOCK_FLOATS as u32 / 4;
        let pairs =
            |shift: u32| OffsetPairs { inputs: (0..n - shift).collect(), outputs: (shift..n).collect() };
        let rulebook = Rulebook::new(n as usize, n as usize, vec![pairs(1), pairs(0), pairs(700)]);
        let values = |n: usize| (0..n).map(|i| (i * 7919 % 1000) as f32 / 500.0 - 1.0).collect::<Vec<f32>>();
        let (x, w) = (values(n as usize * 4), values(3 * 4 * 4));
        let run = |n_threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            pool.install(|| {
                let out = apply(&rulebook, Direction::Forward, &x, &w, [4, 4]);
                let dw = weight_gradient(&rulebook, &x, &out, [4, 4]);
                [out, dw].concat().into_iter().map(f32::to_bits).collect::<Vec<u32>>()
            })
        };
        assert_eq!(run(1), run(3));
    }
}
