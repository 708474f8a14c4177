//! The gradient of a matrix over channels in pairs of bf16: as the weight gradient of a 3x3 kernel, of one tap.
//!
//! A register tile holds a few output channels by up to three blocks of input channels. Rows of pixels are cut into parts whose
//! number only the shape decides.

use rayon::prelude::*;

use super::gradient_tile::{LANES, PairSums, PairTile, ROWS};
use super::pair_rows::{ChannelRows, padded_pairs};
use super::{BAND_BYTES, Shape};
use crate::kernels::scratch::{Scratch, with_scratch};
use crate::kernels::simd::{InstructionSet, Kernel, Simd};

/// # Shapes
/// - x: `[batch, channel_in, y, x]`, dy: `[batch, channel_out, y, x]`
/// - output: `[channel_out, channel_in]`
///
/// # Panics
/// If the set has no pairs, or the stride is not 1.
pub(super) fn weight_gradient(shape: Shape, x: &[f32], dy: &[f32], set: InstructionSet) -> Vec<f32> {
    assert!(set.has_pairs() && shape.stride == 1);
    assert!(x.len() == shape.n_inputs() && dy.len() == shape.n_outputs());
    let Shape { batch, channels_in, channels_out, height_px, .. } = shape;
    let of_part = PairSums::of(channels_in, channels_out);
    let (n_parts, total_rows) = (shape.n_parts(), batch * height_px);
    let mut sums = vec![0.0; n_parts * of_part.len()];
    sums.par_chunks_mut(of_part.len()).enumerate().for_each(|(part, sums)| {
        let rows = part * total_rows / n_parts..(part + 1) * total_rows / n_parts;
        with_scratch(|scratch| set.run(Part { shape, x, dy, rows, sums, scratch }));
    });
    let mut gradient = vec![0.0; channels_out * channels_in];
    for (at, gradient) in gradient.iter_mut().enumerate() {
        let place = of_part.place(at / channels_in, at % channels_in);
        *gradient = sums.iter().skip(place).step_by(of_part.len()).sum();
    }
    gradient
}

/// One task: some rows of pixels.
struct Part<'a> {
    shape: Shape,
    x: &'a [f32],
    dy: &'a [f32],
    /// Counted through the batch.
    rows: std::ops::Range<usize>,
    /// As [`PairSums`].
    sums: &'a mut [f32],
    scratch: &'a mut Scratch,
}

impl Kernel for Part<'_> {
    #[inline(always)]
    fn run<S: Simd, const S_ROWS: usize, const S_LANES: usize>(self) {
        let Self { shape, x, dy, rows, sums, scratch } = self;
        let Shape { channels_in, channels_out, height_px, width_px, .. } = shape;
        let vector = padded_pairs(width_px) * LANES;
        let x_row = channels_in.div_ceil(LANES) * vector;
        let dy_row = channels_out.div_ceil(LANES) * vector;
        let chunk_rows = (BAND_BYTES / (4 * (x_row + dy_row))).clamp(1, height_px);
        let mut row = rows.start;
        while row < rows.end {
            let (image, y) = (row / height_px, row % height_px);
            let n_rows = chunk_rows.min(height_px - y).min(rows.end - row);
            let Scratch { a, b, c } = &mut *scratch;
            let (x_pairs, dy_pairs) = (b.get(n_rows * x_row), c.get(n_rows * dy_row));
            // SAFETY: the set has pairs, in vectors of AVX-512.
            unsafe {
                for (values, channels, pairs) in [(x, channels_in, x_pairs), (dy, channels_out, dy_pairs)] {
                    let values = &values[image * channels * height_px * width_px..];
                    let rows =
                        ChannelRows { values, channels, height_px, width_px, first: y as isize, n_rows };
                    rows.pair::<1>(0, [1, width_px], a, pairs);
                }
            }
            add(shape, n_rows, [b.get(n_rows * x_row), c.get(n_rows * dy_row)], sums);
            row += n_rows;
        }
    }
}

/// Adds the products of some rows that are laid out in pairs.
#[inline(always)]
fn add(shape: Shape, n_rows: usize, [x, dy]: [&[f32]; 2], sums: &mut [f32]) {
    let of_part = PairSums::of(shape.channels_in, shape.channels_out);
    let vector = padded_pairs(shape.width_px) * LANES;
    let (x_row, dy_row) = (of_part.blocks_in * vector, shape.channels_out.div_ceil(LANES) * vector);
    assert!(x.len() == n_rows * x_row && dy.len() == n_rows * dy_row);
    for tile in of_part.tiles() {
        let sums = sums[tile.start..][..tile.len()].as_mut_ptr();
        // SAFETY: the set has pairs. x: in each row the vectors of the tile's blocks; dy: in each row the half of a vector's
        // lanes that its block of output channels has; sums: this tile's.
        unsafe {
            let operands = PairTile {
                n_rows,
                n_pairs: shape.width_px.div_ceil(2),
                x: x.as_ptr().add(tile.first_in * vector),
                x_row,
                x_vector: vector,
                dy: dy.as_ptr().add(tile.block_out / 2 * vector + tile.block_out % 2 * ROWS),
                dy_row,
            };
            match tile.n_in {
                3 => operands.add::<3>(sums),
                2 => operands.add::<2>(sums),
                _ => operands.add::<1>(sums),
            }
        }
    }
}
