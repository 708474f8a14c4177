//! The weight gradient by the tiles of [`super::winograd`], in pairs of bf16: 16 products where taps take 36.
//!
//! ```text
//! dg = G' [sum over tiles of (A dY A') * (B' d B)] G
//! ```
//!
//! For each of 16 elements that is a matrix product over tiles: a register tile holds a few output channels by three blocks of
//! input channels, pairs are of neighbouring tiles. Rows of tiles are cut into parts whose number only the shape decides.

use rayon::prelude::*;

use super::Shape;
use super::band::{Layout, Planes, pack};
use super::pair_gradient::{LANES, PairTile, ROWS, pair_neighbours};
use super::winograd::{ELEMENTS, turn_channel};
use crate::kernels::scratch::{Buffer, Scratch, with_scratch};
use crate::kernels::simd::{InstructionSet, Kernel, Scalar, Simd, Vector};
use crate::kernels::transpose::transpose;

/// Blocks of input channels in a register tile.
const TILE_BLOCKS: usize = 3;
/// Rows of tiles that a task turns at a time.
const BAND_ROWS: usize = 4;
/// Most parts: each has sums of 16 elements for each pair of channels.
const MAX_PARTS: usize = 2;
/// Floats of two vectors of tiles, turned; and of what they become, a vector of pairs.
const TWO: usize = 2 * LANES;
/// Floats of a block of channels in pairs of one step, all elements: `[element][LANES][LANES]`.
const STAGE: usize = ELEMENTS * LANES * LANES;

/// # Shapes
/// - x: `[batch, channel_in, y, x]`, dy: `[batch, channel_out, y, x]`
/// - output: `[channel_out, channel_in, 3, 3]`
///
/// # Panics
/// If the set has no pairs, or [`fits`](super::winograd::fits) says no.
pub(super) fn weight_gradient(shape: Shape, x: &[f32], dy: &[f32], set: InstructionSet) -> Vec<f32> {
    assert!(set.has_pairs() && super::winograd::fits(shape, set));
    assert!(x.len() == shape.n_inputs() && dy.len() == shape.n_outputs());
    let Shape { batch, channels_in, channels_out, height_px, .. } = shape;
    let (blocks_in, blocks_out) = (channels_in.div_ceil(LANES), channels_out.div_ceil(ROWS));
    let total_rows = batch * height_px / 2;
    let n_parts = shape.n_parts().min(MAX_PARTS);
    let element_len = blocks_in * blocks_out * ROWS * LANES;
    let part_len = ELEMENTS * element_len;
    let mut sums = vec![0.0; n_parts * part_len];
    sums.par_chunks_mut(part_len).enumerate().for_each(|(part, sums)| {
        let rows = part * total_rows / n_parts..(part + 1) * total_rows / n_parts;
        with_scratch(|scratch| set.run(Part { shape, x, dy, rows, sums, scratch }));
    });
    let mut gradient = vec![0.0; shape.n_weights()];
    gradient.par_chunks_exact_mut(9 * channels_in).enumerate().for_each(|(o, gradient)| {
        for (i, gradient) in gradient.chunks_exact_mut(9).enumerate() {
            let (block_in, group) = (i / LANES, i / LANES / TILE_BLOCKS);
            let vectors = (blocks_in - group * TILE_BLOCKS).min(TILE_BLOCKS);
            let tile = (group * TILE_BLOCKS * blocks_out + o / ROWS * vectors) * ROWS;
            let place = (tile + o % ROWS * vectors + block_in % TILE_BLOCKS) * LANES + i % LANES;
            let mut elements = [0.0; ELEMENTS];
            for part in sums.chunks_exact(part_len) {
                for (element, sum) in elements.iter_mut().zip(part.chunks_exact(element_len)) {
                    *element += sum[place];
                }
            }
            gradient.copy_from_slice(&turn_back(elements));
        }
    });
    gradient
}

/// `G' s G`
fn turn_back(s: [f32; ELEMENTS]) -> [f32; 9] {
    let turn = |[a, b, c, d]: [f32; 4]| [a + 0.5 * (b + c), 0.5 * (b - c), 0.5 * (b + c) + d];
    let columns: [[f32; 3]; 4] = std::array::from_fn(|x| turn([s[x], s[4 + x], s[8 + x], s[12 + x]]));
    let mut kernel = [0.0; 9];
    for y in 0..3 {
        let row = turn([columns[0][y], columns[1][y], columns[2][y], columns[3][y]]);
        kernel[3 * y..3 * y + 3].copy_from_slice(&row);
    }
    kernel
}

/// One task: some rows of tiles.
struct Part<'a> {
    shape: Shape,
    x: &'a [f32],
    dy: &'a [f32],
    /// Counted through the batch.
    rows: std::ops::Range<usize>,
    /// `[element][group of blocks in][block out][channel out in block][block in in group][channel in in block]`
    sums: &'a mut [f32],
    scratch: &'a mut Scratch,
}

impl Kernel for Part<'_> {
    #[inline(always)]
    fn run<S: Simd, const S_ROWS: usize, const S_LANES: usize>(self) {
        let Self { shape, x, dy, rows, sums, scratch } = self;
        let tile_rows = shape.height_px / 2;
        let row_vectors = shape.width_px / TWO;
        let mut row = rows.start;
        while row < rows.end {
            let (image, first_row) = (row / tile_rows, row % tile_rows);
            let n_rows = BAND_ROWS.min(tile_rows - first_row).min(rows.end - row);
            let n_vectors = n_rows * row_vectors;
            let Scratch { a, b, c } = &mut *scratch;
            let steps =
                Steps { shape, image, first_row, n_rows, row_vectors, n_steps: n_vectors.div_ceil(2) };
            steps.turn::<S, true>(x, shape.channels_in, a, b);
            steps.turn::<S, false>(dy, shape.channels_out, a, c);
            steps.add(b, c, sums);
            row += n_rows;
        }
    }
}

/// A band of tiles, in steps of two vectors, which are one of pairs.
#[derive(Clone, Copy)]
struct Steps {
    shape: Shape,
    image: usize,
    first_row: usize,
    n_rows: usize,
    /// Vectors of tiles in a row.
    row_vectors: usize,
    n_steps: usize,
}

impl Steps {
    /// Floats of one element of a block of LANES channels: `[pair][LANES]`.
    fn block_len(self) -> usize {
        self.n_steps * LANES * LANES
    }

    /// Turns the tiles of all channels to `[element][block of LANES channels][pair][LANES]`, zero beyond the last channel and tile.
    #[inline(always)]
    fn turn<S: Simd, const IS_INPUT: bool>(
        self,
        values: &[f32],
        channels: usize,
        buffer: &mut Buffer,
        turned: &mut Buffer,
    ) {
        let Shape { height_px, width_px, .. } = self.shape;
        let source = Planes { values, channels, height_px, width_px, split: 2, lead: 1 };
        let layout = Layout::new(false, &source, width_px / 2, self.n_rows);
        let (band, work) = buffer.get(layout.len + STAGE + ELEMENTS * TWO).split_at_mut(layout.len);
        let (stage, vectors) = work.split_at_mut(STAGE);
        pack(&source, &layout, self.image, self.first_row, band);
        let n_blocks = channels.div_ceil(LANES);
        let turned = turned.get(ELEMENTS * n_blocks * self.block_len());
        for block in 0..n_blocks {
            for step in 0..self.n_steps {
                for (lane, stage) in stage.chunks_exact_mut(ELEMENTS * LANES).enumerate() {
                    let channel = block * LANES + lane;
                    if channel >= channels {
                        stage.fill(0.0);
                        continue;
                    }
                    for half in 0..2 {
                        let at = 2 * step + half;
                        let (row, x) = (at / self.row_vectors, at % self.row_vectors * LANES);
                        let elements = if row >= self.n_rows {
                            [0f32.splat::<S>(); ELEMENTS]
                        } else if IS_INPUT {
                            turn_channel::<S, LANES>(band, &layout, [row, x], channel)
                        } else {
                            turn_outputs::<S>(band, &layout, [row, x], channel)
                        };
                        for (to, vector) in vectors.chunks_exact_mut(TWO).zip(elements) {
                            // SAFETY: LANES floats, half of the chunk, are a vector.
                            unsafe { f32::vstore_unaligned(to[half * LANES..].as_mut_ptr(), vector) };
                        }
                    }
                    // SAFETY: the set has pairs, in vectors of AVX-512; `[element][LANES]` are whole vectors.
                    unsafe { pair_neighbours::<1>(vectors, 0, stage) };
                }
                for element in 0..ELEMENTS {
                    let place = (element * n_blocks + block) * self.block_len() + step * LANES * LANES;
                    let to = &mut turned[place..][..LANES * LANES];
                    let from = &stage[element * LANES..];
                    assert!(from.len() >= (LANES - 1) * ELEMENTS * LANES + LANES);
                    // SAFETY: 16 rows of 16 words are readable by the assert, 256 are writable; the set has AVX-512.
                    unsafe { transpose(from.as_ptr().cast(), ELEMENTS * LANES, to.as_mut_ptr().cast()) };
                }
            }
        }
    }

    /// Adds the products of tiles that are turned.
    #[inline(always)]
    fn add(self, x: &mut Buffer, dy: &mut Buffer, sums: &mut [f32]) {
        let Shape { channels_in, channels_out, .. } = self.shape;
        let (blocks_in, blocks_out) = (channels_in.div_ceil(LANES), channels_out.div_ceil(ROWS));
        let (x_len, dy_len) = (blocks_in * self.block_len(), channels_out.div_ceil(LANES) * self.block_len());
        let (x, dy) = (x.get(ELEMENTS * x_len), dy.get(ELEMENTS * dy_len));
        let element_len = blocks_in * blocks_out * ROWS * LANES;
        assert!(sums.len() == ELEMENTS * element_len);
        let elements = x.chunks_exact(x_len).zip(dy.chunks_exact(dy_len));
        for ((x, dy), sums) in elements.zip(sums.chunks_exact_mut(element_len)) {
            for first in (0..blocks_in).step_by(TILE_BLOCKS) {
                let vectors = (blocks_in - first).min(TILE_BLOCKS);
                for block_out in 0..blocks_out {
                    // SAFETY: the set has pairs. x: the vectors of blocks `first..first + vectors`; dy: the half of a vector's lanes
                    // that block `block_out` has; sums: this tile's, of all tiles of `blocks_in * blocks_out` blocks.
                    unsafe {
                        let tile = PairTile {
                            n_rows: 1,
                            n_pairs: self.n_steps * LANES,
                            x: x.as_ptr().add(first * self.block_len()),
                            x_row: 0,
                            x_vector: self.block_len(),
                            dy: dy.as_ptr().add(block_out / 2 * self.block_len() + block_out % 2 * ROWS),
                            dy_row: 0,
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
    }
}

/// `A dY A'` of a vector of tiles, of one channel.
#[inline(always)]
fn turn_outputs<S: Simd>(
    band: &[f32],
    layout: &Layout,
    [row, x]: [usize; 2],
    channel: usize,
) -> [Vector<S, f32>; ELEMENTS] {
    // The band counts its rows and columns from the padding on: a tile's first ones are odd, its second ones even.
    let mut rows = [[0f32.splat::<S>(); 4]; 2];
    for (dy, rows) in rows.iter_mut().enumerate() {
        let y = channel * layout.channel + (1 - dy) * layout.row_parity + (row + dy) * layout.row;
        let (odd, even) = (&band[y + layout.column_parity + x..][..LANES], &band[y + x + 1..][..LANES]);
        // SAFETY: both slices are a vector long.
        let [a, b] = unsafe { [f32::vload_unaligned(odd.as_ptr()), f32::vload_unaligned(even.as_ptr())] };
        *rows = spread(a, b);
    }
    let mut elements = [0f32.splat::<S>(); ELEMENTS];
    for dx in 0..4 {
        let column = spread(rows[0][dx], rows[1][dx]);
        for dy in 0..4 {
            elements[4 * dy + dx] = column[dy];
        }
    }
    elements
}

/// `A` of two values.
#[inline(always)]
fn spread<S: Simd>(a: Vector<S, f32>, b: Vector<S, f32>) -> [Vector<S, f32>; 4] {
    [a, a + b, a - b, 0f32.splat() - b]
}
