//! The gradient of the kernel: for each tap, output gradients times shifted inputs, summed over all pixels.
//!
//! Input channels lie in the vector lanes; a register tile holds a few output channels by the three
//! columns of one kernel row. Pixels are cut into parts whose number only the shape decides, so that
//! sums do not depend on the threads; further threads share the blocks of input channels.

use rayon::prelude::*;

use super::pair_gradient::{self, PairTile, pair_columns};
use super::pairs::uses_pairs;
use super::{BAND_BYTES, Shape, block_gradient, uses_matrix_unit};
use crate::kernels::scratch::{Scratch, with_scratch};
use crate::kernels::simd::{InstructionSet, Kernel, Scalar, Simd, lanes};

/// # Shapes
/// - x: `[batch, channel_in, y, x]`, dy: `[batch, channel_out, out_y, out_x]`
/// - output: `[channel_out, channel_in, 3, 3]`
pub(in crate::kernels) fn weight_gradient(
    shape: Shape,
    x: &[f32],
    dy: &[f32],
    set: InstructionSet,
) -> Vec<f32> {
    shape.check();
    assert!(x.len() == shape.n_inputs() && dy.len() == shape.n_outputs());
    if uses_matrix_unit(set, (shape.channels_out, shape.channels_in)) {
        return block_gradient::weight_gradient(shape, 3, x, dy, set);
    }
    let (n_lanes, n_rows) = (set.lanes(), set.rows());
    let blocks_in = shape.channels_in.div_ceil(n_lanes);
    let blocks_out = shape.channels_out.div_ceil(n_rows);
    let block_len = blocks_out * 9 * n_rows * n_lanes;

    let total_rows = shape.batch * shape.out_height_px();
    let n_parts = shape.n_parts();
    let n_groups = rayon::current_num_threads().div_ceil(n_parts).min(blocks_in);
    let group_blocks = blocks_in.div_ceil(n_groups);

    let part_len = blocks_in * block_len;
    let mut sums = vec![0.0; n_parts * part_len];
    sums.par_chunks_mut(part_len).enumerate().for_each(|(part, sums)| {
        let rows = part * total_rows / n_parts..(part + 1) * total_rows / n_parts;
        sums.par_chunks_mut(group_blocks * block_len).enumerate().for_each(|(group, sums)| {
            let first_channel = group * group_blocks * n_lanes;
            with_scratch(|scratch| {
                let is_paired = uses_pairs(set, shape.channels_in);
                set.run(Part { shape, x, dy, first_channel, rows: rows.clone(), sums, is_paired, scratch });
            });
        });
    });

    let mut gradient = vec![0.0; shape.n_weights()];
    gradient.par_chunks_mut(shape.channels_in * 9).enumerate().for_each(|(o, gradient)| {
        let (block_out, row) = (o / n_rows, o % n_rows);
        for (i, gradient) in gradient.chunks_exact_mut(9).enumerate() {
            // Divisions stay out of the loop over taps: they would cost as much as the products on small maps.
            let (block_in, lane) = (i / n_lanes, i % n_lanes);
            for kernel_row in 0..3 {
                let block = (block_in * 3 + kernel_row) * blocks_out + block_out;
                let place = (block * n_rows + row) * 3 * n_lanes + lane;
                for kernel_column in 0..3 {
                    let place = place + kernel_column * n_lanes;
                    gradient[kernel_row * 3 + kernel_column] =
                        (0..n_parts).fold(0.0, |sum, part| sum + sums[part * part_len + place]);
                }
            }
        }
    });
    gradient
}

/// One task: some rows of pixels, some blocks of input channels.
struct Part<'a> {
    shape: Shape,
    x: &'a [f32],
    dy: &'a [f32],
    first_channel: usize,
    /// Output rows, counted through the batch.
    rows: std::ops::Range<usize>,
    /// `[block in][kernel row][block out][channel out in block][kernel column][channel in in block]`
    sums: &'a mut [f32],
    /// Whether pairs of bf16 are multiplied.
    is_paired: bool,
    scratch: &'a mut Scratch,
}

impl Kernel for Part<'_> {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const LANES: usize>(mut self) {
        let (height, width) = (self.shape.out_height_px(), self.shape.out_width_px());
        let blocks_out = self.shape.channels_out.div_ceil(ROWS);
        let blocks_in = self.sums.len() / (blocks_out * 9 * ROWS * LANES);
        let row_floats =
            blocks_in * LANES * (self.shape.width_px + 3) * self.shape.stride + blocks_out * ROWS * width;
        let chunk_rows = (BAND_BYTES / (4 * row_floats)).saturating_sub(1).clamp(1, height);
        let mut row = self.rows.start;
        while row < self.rows.end {
            let (image, y) = (row / height, row % height);
            let n_rows = chunk_rows.min(height - y).min(self.rows.end - row);
            self.add_rows::<S, ROWS, LANES>(image, y, n_rows, blocks_in);
            row += n_rows;
        }
    }
}

impl Part<'_> {
    /// Adds the products of output rows `y..y + n_rows` of one image.
    #[inline(always)]
    fn add_rows<S: Simd, const ROWS: usize, const LANES: usize>(
        &mut self,
        image: usize,
        y: usize,
        n_rows: usize,
        blocks_in: usize,
    ) {
        let Shape { channels_in, channels_out, height_px, width_px, stride, .. } = self.shape;
        let (out_height_px, out_width_px) = (self.shape.out_height_px(), self.shape.out_width_px());
        let blocks_out = channels_out.div_ceil(ROWS);
        let n_channels = (channels_in - self.first_channel).min(blocks_in * LANES);

        let padded_width = width_px + 3;
        let x_row = blocks_in * padded_width * LANES;
        let n_x_rows = (n_rows - 1) * stride + 3;
        let x = self.scratch.a.get(n_x_rows * x_row);
        for (row, packed) in x.chunks_exact_mut(x_row).enumerate() {
            // Wraps around above the image, and so lands outside, as rows below the image do.
            let source_y = (y * stride + row).wrapping_sub(1);
            if source_y < height_px {
                let first = ((image * channels_in + self.first_channel) * height_px + source_y) * width_px;
                let planes = Rows {
                    values: &self.x[first..],
                    plane: height_px * width_px,
                    channels: n_channels,
                    width: width_px,
                };
                planes.interleave::<LANES>(packed, 1, padded_width);
            } else {
                packed.fill(0.0);
            }
        }

        let dy_row = blocks_out * out_width_px * ROWS;
        let dy = self.scratch.b.get(n_rows * dy_row);
        for (row, packed) in dy.chunks_exact_mut(dy_row).enumerate() {
            let first = (image * channels_out * out_height_px + y + row) * out_width_px;
            let planes = Rows {
                values: &self.dy[first..],
                plane: out_height_px * out_width_px,
                channels: channels_out,
                width: out_width_px,
            };
            planes.interleave::<ROWS>(packed, 0, out_width_px);
        }

        if self.is_paired {
            self.add_pairs([blocks_in, blocks_out], n_rows, padded_width);
            return;
        }
        // The unsafe block relies on these bounds: the last pixel's third column, and the sums.
        assert!((out_width_px - 1) * stride + 3 <= padded_width);
        assert!(self.sums.len() == blocks_in * 9 * blocks_out * ROWS * LANES);
        for block_in in 0..blocks_in {
            for kernel_row in 0..3 {
                for block_out in 0..blocks_out {
                    // SAFETY: x: rows `kernel_row + r * stride < n_x_rows`, in each the `padded_width * LANES`
                    // floats of block `block_in`, of which pixel p reads columns `p * stride..p * stride + 3`;
                    // dy: `out_width_px * ROWS` floats of block `block_out` in each of `n_rows` rows;
                    // sums: tile `.. < blocks_in * 3 * blocks_out`, each of `ROWS * 3 * LANES` floats.
                    unsafe {
                        let tile = Tile {
                            n_rows,
                            n_pixels: out_width_px,
                            x: x.as_ptr().add(kernel_row * x_row + block_in * padded_width * LANES),
                            x_row: x_row * stride,
                            x_pixel: stride * LANES,
                            dy: dy.as_ptr().add(block_out * out_width_px * ROWS),
                            dy_row,
                        };
                        let place = (block_in * 3 + kernel_row) * blocks_out + block_out;
                        tile.add::<S, ROWS>(self.sums.as_mut_ptr().add(place * ROWS * 3 * LANES));
                    }
                }
            }
        }
    }
}

impl Part<'_> {
    /// Adds the products of the rows that `add_rows` has laid out, in pairs of pixels.
    #[inline(always)]
    fn add_pairs(&mut self, [blocks_in, blocks_out]: [usize; 2], n_rows: usize, padded_width: usize) {
        use pair_gradient::{LANES, ROWS};
        let (stride, n_pixels) = (self.shape.stride, self.shape.out_width_px());
        let n_pairs = n_pixels.div_ceil(2);
        let n_x_rows = (n_rows - 1) * stride + 3;
        let (x_len, dy_len) = (3 * n_pairs * LANES, n_pairs * ROWS);
        let (x_row, dy_row) = (blocks_in * x_len, blocks_out * dy_len);
        assert!((n_pixels - 1) * stride + 3 <= padded_width);
        let Scratch { a, b, c } = &mut *self.scratch;
        let x = a.get(n_x_rows * blocks_in * padded_width * LANES);
        let dy = b.get(n_rows * blocks_out * n_pixels * ROWS);
        let (x_pairs, dy_pairs) = c.get(n_x_rows * x_row + n_rows * dy_row).split_at_mut(n_x_rows * x_row);
        for (pixels, pairs) in x.chunks_exact(padded_width * LANES).zip(x_pairs.chunks_exact_mut(x_len)) {
            pair_columns::<LANES>(pixels, n_pixels, stride, pairs);
        }
        for (pixels, pairs) in dy.chunks_exact(n_pixels * ROWS).zip(dy_pairs.chunks_exact_mut(dy_len)) {
            pair_columns::<ROWS>(pixels, n_pixels, 1, pairs);
        }
        assert!(self.sums.len() == blocks_in * 9 * blocks_out * ROWS * LANES);
        for block_in in 0..blocks_in {
            for kernel_row in 0..3 {
                for block_out in 0..blocks_out {
                    // SAFETY: `is_paired` says that the CPU has pairs. x: rows `kernel_row + r * stride < n_x_rows`, in
                    // each the `x_len` floats of block `block_in`; dy: `dy_len` floats of block `block_out` in each of
                    // `n_rows` rows; sums: tile `.. < blocks_in * 3 * blocks_out`, each of `ROWS * 3 * LANES` floats.
                    unsafe {
                        let tile = PairTile {
                            n_rows,
                            n_pairs,
                            x: x_pairs.as_ptr().add(kernel_row * x_row + block_in * x_len),
                            x_row: x_row * stride,
                            x_column: n_pairs * LANES,
                            dy: dy_pairs.as_ptr().add(block_out * dy_len),
                            dy_row,
                        };
                        let place = (block_in * 3 + kernel_row) * blocks_out + block_out;
                        tile.add(self.sums.as_mut_ptr().add(place * ROWS * 3 * LANES));
                    }
                }
            }
        }
    }
}

/// Operands of one register tile: strides in floats.
struct Tile {
    n_rows: usize,
    n_pixels: usize,
    x: *const f32,
    x_row: usize,
    x_pixel: usize,
    dy: *const f32,
    dy_row: usize,
}

impl Tile {
    /// Adds the products of all pixels to `sums`, `[ROWS][3][LANES]`.
    ///
    /// # Safety
    /// In each row, three vectors of x are readable at each pixel, and ROWS floats of dy; `sums` is readable and writable.
    #[inline(always)]
    unsafe fn add<S: Simd, const ROWS: usize>(self, sums: *mut f32) {
        // SAFETY: every access is one of those listed above.
        unsafe {
            let mut tile = [[0f32.splat::<S>(); 3]; ROWS];
            for (row, tile) in tile.iter_mut().enumerate() {
                for (k, sum) in tile.iter_mut().enumerate() {
                    *sum = f32::vload_unaligned::<S>(sums.add((row * 3 + k) * lanes::<S>()));
                }
            }
            for row in 0..self.n_rows {
                let (mut x, mut dy) = (self.x.add(row * self.x_row), self.dy.add(row * self.dy_row));
                for _ in 0..self.n_pixels {
                    let columns = [
                        f32::vload_unaligned::<S>(x),
                        f32::vload_unaligned::<S>(x.add(lanes::<S>())),
                        f32::vload_unaligned::<S>(x.add(2 * lanes::<S>())),
                    ];
                    for (row, tile) in tile.iter_mut().enumerate() {
                        let dy = (*dy.add(row)).splat::<S>();
                        for (sum, x) in tile.iter_mut().zip(columns) {
                            *sum = dy.mul_add(x, *sum);
                        }
                    }
                    x = x.wrapping_add(self.x_pixel);
                    dy = dy.add(ROWS);
                }
            }
            for (row, tile) in tile.iter().enumerate() {
                for (k, sum) in tile.iter().enumerate() {
                    f32::vstore_unaligned::<S>(sums.add((row * 3 + k) * lanes::<S>()), *sum);
                }
            }
        }
    }
}

/// The same row of several channels.
struct Rows<'a> {
    /// The floats from the row of the first channel on.
    values: &'a [f32],
    /// Stride from a channel to the next.
    plane: usize,
    channels: usize,
    width: usize,
}

impl Rows<'_> {
    /// Turns channels innermost: `[block][padded_width][B]`, zero in the `lead` columns before the row, after
    /// it, and beyond the last channel.
    #[inline(always)]
    fn interleave<const B: usize>(&self, packed: &mut [f32], lead: usize, padded_width: usize) {
        for (block, packed) in packed.chunks_exact_mut(padded_width * B).enumerate() {
            packed[..lead * B].fill(0.0);
            packed[(lead + self.width) * B..].fill(0.0);
            let packed = &mut packed[lead * B..(lead + self.width) * B];
            let first = block * B;
            if first + B <= self.channels {
                let rows: [&[f32]; B] =
                    std::array::from_fn(|i| &self.values[(first + i) * self.plane..][..self.width]);
                for (x, pixel) in packed.chunks_exact_mut(B).enumerate() {
                    for (value, row) in pixel.iter_mut().zip(rows) {
                        *value = row[x];
                    }
                }
            } else {
                for (x, pixel) in packed.chunks_exact_mut(B).enumerate() {
                    for (i, value) in pixel.iter_mut().enumerate() {
                        let channel = first + i;
                        *value =
                            if channel < self.channels { self.values[channel * self.plane + x] } else { 0.0 };
                    }
                }
            }
        }
    }
}
