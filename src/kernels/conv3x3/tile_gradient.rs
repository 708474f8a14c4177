//! The weight gradient by the tiles of [`super::winograd`], on AVX-512: 16 products where taps take 36, in f32 or pairs of bf16.
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
use super::gradient_tile::{LANES, PairSums, PairTile, ROWS, Tile};
use super::pair_rows::pair_neighbours;
use super::uses_pairs;
use super::winograd::{self, ELEMENTS, turn_channel};
use crate::kernels::scratch::{Buffer, Scratch, with_scratch};
use crate::kernels::simd::{InstructionSet, Kernel, Scalar, Simd, Vector, lanes};
use crate::kernels::transpose::transpose;

/// Rows of tiles that a task turns at a time.
const BAND_ROWS: usize = 4;
/// Most parts: each has sums of 16 elements for each pair of channels.
const MAX_PARTS: usize = 2;
/// Floats of two vectors of tiles, which one step turns.
const TWO: usize = 2 * LANES;

/// Whether a weight gradient goes by tiles.
pub(super) fn fits(shape: Shape, set: InstructionSet) -> bool {
    set.lanes() == LANES && winograd::fits(shape, set)
}

/// # Shapes
/// - x: `[batch, channel_in, y, x]`, dy: `[batch, channel_out, y, x]`
/// - output: `[channel_out, channel_in, 3, 3]`
///
/// # Panics
/// If [`fits`] says no.
pub(super) fn weight_gradient(shape: Shape, x: &[f32], dy: &[f32], set: InstructionSet) -> Vec<f32> {
    assert!(fits(shape, set));
    assert!(x.len() == shape.n_inputs() && dy.len() == shape.n_outputs());
    let Shape { batch, channels_in, channels_out, height_px, .. } = shape;
    let of_element = PairSums::of(channels_in, channels_out);
    let total_rows = batch * height_px / 2;
    let n_parts = shape.n_parts().min(MAX_PARTS);
    let part_len = ELEMENTS * of_element.len();
    let mut sums = vec![0.0; n_parts * part_len];
    sums.par_chunks_mut(part_len).enumerate().for_each(|(part, sums)| {
        let rows = part * total_rows / n_parts..(part + 1) * total_rows / n_parts;
        let is_paired = uses_pairs(set, channels_in);
        with_scratch(|scratch| set.run(Part { shape, x, dy, rows, sums, is_paired, scratch }));
    });
    let mut gradient = vec![0.0; shape.n_weights()];
    gradient.par_chunks_exact_mut(9 * channels_in).enumerate().for_each(|(o, gradient)| {
        for (i, gradient) in gradient.chunks_exact_mut(9).enumerate() {
            let place = of_element.place(o, i);
            let mut elements = [0.0; ELEMENTS];
            for part in sums.chunks_exact(part_len) {
                for (element, sum) in elements.iter_mut().zip(part.chunks_exact(of_element.len())) {
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
    /// `[element]`, then as [`PairSums`].
    sums: &'a mut [f32],
    /// Whether pairs of bf16 are multiplied.
    is_paired: bool,
    scratch: &'a mut Scratch,
}

impl Kernel for Part<'_> {
    #[inline(always)]
    fn run<S: Simd, const S_ROWS: usize, const S_LANES: usize>(self) {
        // Only AVX-512 comes here, by `fits`; for other sets nothing is compiled.
        if const { lanes::<S>() == LANES } {
            self.run_wide::<S>();
        }
    }
}

impl Part<'_> {
    #[inline(always)]
    fn run_wide<S: Simd>(self) {
        let Self { shape, x, dy, rows, sums, is_paired, scratch } = self;
        let tile_rows = shape.height_px / 2;
        let row_vectors = shape.width_px / TWO;
        let mut row = rows.start;
        while row < rows.end {
            let (image, first_row) = (row / tile_rows, row % tile_rows);
            let n_rows = BAND_ROWS.min(tile_rows - first_row).min(rows.end - row);
            let n_vectors = n_rows * row_vectors;
            let Scratch { a, b, c } = &mut *scratch;
            let n_steps = n_vectors.div_ceil(2);
            let band = TileBand { shape, image, first_row, n_rows, row_vectors, n_steps, is_paired };
            band.turn::<S, true>(x, shape.channels_in, a, b);
            band.turn::<S, false>(dy, shape.channels_out, a, c);
            band.add::<S>(b, c, sums);
            row += n_rows;
        }
    }
}

/// A band of tiles, in steps of two vectors, which are one of pairs.
#[derive(Clone, Copy)]
struct TileBand {
    shape: Shape,
    image: usize,
    first_row: usize,
    n_rows: usize,
    /// Vectors of tiles in a row.
    row_vectors: usize,
    n_steps: usize,
    is_paired: bool,
}

impl TileBand {
    /// Words that a step makes of a channel: tiles, or pairs of them.
    fn step_len(self) -> usize {
        if self.is_paired { LANES } else { TWO }
    }

    /// Floats of one element of a block of LANES channels: `[word][LANES]`.
    fn block_len(self) -> usize {
        self.n_steps * self.step_len() * LANES
    }

    /// Turns the tiles of all channels to `[element][block of LANES channels][word][LANES]`, zero beyond the last channel and tile.
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
        // Of a block of channels: `[lane][element][word]`.
        let lane_len = ELEMENTS * self.step_len();
        let n_work = LANES * lane_len + ELEMENTS * TWO;
        let (band, work) = buffer.get(layout.len + n_work).split_at_mut(layout.len);
        let (stage, vectors) = work.split_at_mut(LANES * lane_len);
        pack(&source, &layout, self.image, self.first_row, band);
        let n_blocks = channels.div_ceil(LANES);
        let turned = turned.get(ELEMENTS * n_blocks * self.block_len());
        for block in 0..n_blocks {
            for step in 0..self.n_steps {
                for (lane, stage) in stage.chunks_exact_mut(lane_len).enumerate() {
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
                    if self.is_paired {
                        // SAFETY: the set has pairs, in vectors of AVX-512; `[element][LANES]` are whole vectors.
                        unsafe { pair_neighbours::<1>(vectors, 0, stage) };
                    } else {
                        stage.copy_from_slice(vectors);
                    }
                }
                for element in 0..ELEMENTS {
                    let place =
                        (element * n_blocks + block) * self.block_len() + step * self.step_len() * LANES;
                    let to = &mut turned[place..][..self.step_len() * LANES];
                    for (words, to) in to.chunks_exact_mut(LANES * LANES).enumerate() {
                        let from = &stage[element * self.step_len() + words * LANES..];
                        assert!(from.len() >= (LANES - 1) * lane_len + LANES);
                        // SAFETY: 16 rows of 16 words are readable by the assert, 256 are writable; the set has AVX-512.
                        unsafe { transpose(from.as_ptr().cast(), lane_len, to.as_mut_ptr().cast()) };
                    }
                }
            }
        }
    }

    /// Adds the products of tiles that are turned.
    #[inline(always)]
    fn add<S: Simd>(self, x: &mut Buffer, dy: &mut Buffer, sums: &mut [f32]) {
        let Shape { channels_in, channels_out, .. } = self.shape;
        let (of_element, block_len) = (PairSums::of(channels_in, channels_out), self.block_len());
        let (x_len, dy_len) = (of_element.blocks_in * block_len, channels_out.div_ceil(LANES) * block_len);
        let (x, dy) = (x.get(ELEMENTS * x_len), dy.get(ELEMENTS * dy_len));
        assert!(sums.len() == ELEMENTS * of_element.len());
        let elements = x.chunks_exact(x_len).zip(dy.chunks_exact(dy_len));
        for ((x, dy), sums) in elements.zip(sums.chunks_exact_mut(of_element.len())) {
            for tile in of_element.tiles() {
                let x = &x[tile.first_in * block_len..][..tile.n_in * block_len];
                let dy = &dy[tile.block_out / 2 * block_len..][..block_len];
                // The half of a vector's lanes that this block of output channels has.
                let dy = dy[tile.block_out % 2 * ROWS..].as_ptr();
                let sums = sums[tile.start..][..tile.len()].as_mut_ptr();
                // SAFETY: each of the slices holds what a tile of so many vectors reads and writes.
                unsafe {
                    match tile.n_in {
                        3 => self.multiply::<S, 3>(x.as_ptr(), dy, sums),
                        2 => self.multiply::<S, 2>(x.as_ptr(), dy, sums),
                        _ => self.multiply::<S, 1>(x.as_ptr(), dy, sums),
                    }
                }
            }
        }
    }

    /// Adds the products of one register tile.
    ///
    /// # Safety
    /// VECTORS blocks of x are readable, ROWS floats of dy at each word, and `[ROWS][VECTORS][LANES]` sums are writable.
    #[inline(always)]
    unsafe fn multiply<S: Simd, const VECTORS: usize>(self, x: *const f32, dy: *const f32, sums: *mut f32) {
        let (n_words, x_vector) = (self.n_steps * self.step_len(), self.block_len());
        // SAFETY: the caller's promise; where there are pairs, the set has them.
        unsafe {
            if self.is_paired {
                PairTile { n_rows: 1, n_pairs: n_words, x, x_row: 0, x_vector, dy, dy_row: 0 }
                    .add::<VECTORS>(sums);
                return;
            }
            let tile = Tile {
                n_rows: 1,
                n_pixels: n_words,
                x,
                x_row: 0,
                x_pixel: LANES,
                x_vector,
                dy,
                dy_row: 0,
                dy_pixel: LANES,
            };
            tile.add::<S, ROWS, VECTORS>(sums);
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
