//! The gradient of a matrix over channels in pairs of bf16: as the weight gradient of a 3x3 kernel, of one tap.
//!
//! A register tile holds a few output channels by up to three blocks of input channels. Rows of pixels are cut into parts whose
//! number only the shape decides.

use rayon::prelude::*;

use super::pair_gradient::{LANES, PairTile, ROWS, Rows, padded_pairs};
use super::{BAND_BYTES, Shape};
use crate::kernels::scratch::{Scratch, with_scratch};
use crate::kernels::simd::{InstructionSet, Kernel, Simd};

/// Blocks of input channels in a register tile.
const TILE_BLOCKS: usize = 3;

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
    let (blocks_in, blocks_out) = (channels_in.div_ceil(LANES), channels_out.div_ceil(ROWS));
    let (n_parts, total_rows) = (shape.n_parts(), batch * height_px);
    let part_len = blocks_in * blocks_out * ROWS * LANES;
    let mut sums = vec![0.0; n_parts * part_len];
    sums.par_chunks_mut(part_len).enumerate().for_each(|(part, sums)| {
        let rows = part * total_rows / n_parts..(part + 1) * total_rows / n_parts;
        with_scratch(|scratch| set.run(Part { shape, x, dy, rows, sums, scratch }));
    });
    let mut gradient = vec![0.0; channels_out * channels_in];
    for (at, gradient) in gradient.iter_mut().enumerate() {
        let (o, i) = (at / channels_in, at % channels_in);
        let (block_in, group) = (i / LANES, i / LANES / TILE_BLOCKS);
        let vectors = (blocks_in - group * TILE_BLOCKS).min(TILE_BLOCKS);
        let tile = (group * TILE_BLOCKS * blocks_out + o / ROWS * vectors) * ROWS;
        let place = (tile + o % ROWS * vectors + block_in % TILE_BLOCKS) * LANES + i % LANES;
        *gradient = sums.iter().skip(place).step_by(part_len).sum();
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
    /// `[group of blocks in][block out][channel out in block][block in in group][channel in in block]`
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
                    let rows = Rows { values, channels, height_px, width_px, first: y as isize, n_rows };
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
    let (blocks_in, blocks_out) = (shape.channels_in.div_ceil(LANES), shape.channels_out.div_ceil(ROWS));
    let vector = padded_pairs(shape.width_px) * LANES;
    let (x_row, dy_row) = (blocks_in * vector, shape.channels_out.div_ceil(LANES) * vector);
    assert!(x.len() == n_rows * x_row && dy.len() == n_rows * dy_row);
    assert!(sums.len() == blocks_in * blocks_out * ROWS * LANES);
    for first in (0..blocks_in).step_by(TILE_BLOCKS) {
        let vectors = (blocks_in - first).min(TILE_BLOCKS);
        for block_out in 0..blocks_out {
            // SAFETY: the set has pairs. x: in each row the vectors of blocks `first..first + vectors`; dy: in each row the half of
            // a vector's lanes that block `block_out` has; sums: this tile's, of all tiles of `blocks_in * blocks_out` blocks.
            unsafe {
                let tile = PairTile {
                    n_rows,
                    n_pairs: shape.width_px.div_ceil(2),
                    x: x.as_ptr().add(first * vector),
                    x_row,
                    x_vector: vector,
                    dy: dy.as_ptr().add(block_out / 2 * vector + block_out % 2 * ROWS),
                    dy_row,
                };
                let place = (first * blocks_out + block_out * vectors) * ROWS * LANES;
                let sums = sums.as_mut_ptr().add(place);
                match vectors {
                    3 => tile.add::<3>(sums),
                    2 => tile.add::<2>(sums),
                    _ => tile.add::<1>(sums),
                }
            }
        }
    }
}
