//! The gradient of the kernel: for each tap, output gradients times shifted inputs, summed over all pixels.
//!
//! Input channels lie in the vector lanes; a register tile holds a few output channels by the three
//! columns of one kernel row. Pixels are cut into parts whose number only the shape decides, so that
//! sums do not depend on the threads; further threads share the blocks of input channels.

use rayon::prelude::*;

use super::gradient_tile::{self, PairTile, Tile};
use super::pair_rows::{ChannelRows, padded_pairs};
use super::{BAND_BYTES, Shape, block_gradient, tile_gradient, uses_matrix_unit, uses_pairs};
use crate::kernels::scratch::{Scratch, with_scratch};
use crate::kernels::simd::{InstructionSet, Kernel, Simd};

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
    if tile_gradient::fits(shape, set) {
        return tile_gradient::weight_gradient(shape, x, dy, set);
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
        let Shape { channels_out, stride, width_px, .. } = self.shape;
        let out_width_px = self.shape.out_width_px();
        let blocks_out = channels_out.div_ceil(ROWS);
        if self.is_paired {
            self.add_pairs(image, y, n_rows, [blocks_in, blocks_out]);
            return;
        }

        let padded_width = width_px + 3;
        let x_row = blocks_in * padded_width * LANES;
        let n_x_rows = (n_rows - 1) * stride + 3;
        let (inputs, outputs) = self.rows(image, y, n_rows);
        let x = self.scratch.a.get(n_x_rows * x_row);
        for (row, packed) in x.chunks_exact_mut(x_row).enumerate() {
            inputs.interleave::<LANES>(row, packed, 1, padded_width);
        }
        let dy_row = blocks_out * out_width_px * ROWS;
        let dy = self.scratch.b.get(n_rows * dy_row);
        for (row, packed) in dy.chunks_exact_mut(dy_row).enumerate() {
            outputs.interleave::<ROWS>(row, packed, 0, out_width_px);
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
                            x_vector: LANES,
                            dy: dy.as_ptr().add(block_out * out_width_px * ROWS),
                            dy_row,
                            dy_pixel: ROWS,
                        };
                        let place = (block_in * 3 + kernel_row) * blocks_out + block_out;
                        tile.add::<S, ROWS, 3>(self.sums.as_mut_ptr().add(place * ROWS * 3 * LANES));
                    }
                }
            }
        }
    }
}

impl<'a> Part<'a> {
    /// The rows that output rows `y..y + n_rows` of one image read, of the task's input channels; and these.
    #[inline(always)]
    fn rows(&self, image: usize, y: usize, n_rows: usize) -> (ChannelRows<'a>, ChannelRows<'a>) {
        let Shape { channels_in, channels_out, height_px, width_px, stride, .. } = self.shape;
        let (out_height_px, out_width_px) = (self.shape.out_height_px(), self.shape.out_width_px());
        let inputs = ChannelRows {
            values: &self.x[(image * channels_in + self.first_channel) * height_px * width_px..],
            channels: channels_in - self.first_channel,
            height_px,
            width_px,
            first: (y * stride) as isize - 1,
            n_rows: (n_rows - 1) * stride + 3,
        };
        let outputs = ChannelRows {
            values: &self.dy[image * channels_out * out_height_px * out_width_px..],
            channels: channels_out,
            height_px: out_height_px,
            width_px: out_width_px,
            first: y as isize,
            n_rows,
        };
        (inputs, outputs)
    }

    /// As `add_rows`, in pairs of pixels.
    #[inline(always)]
    fn add_pairs(&mut self, image: usize, y: usize, n_rows: usize, [blocks_in, blocks_out]: [usize; 2]) {
        use gradient_tile::{LANES, ROWS};
        let (shape, stride) = (self.shape, self.shape.stride);
        let n_pixels = shape.out_width_px();
        let n_x_rows = (n_rows - 1) * stride + 3;
        let vector = padded_pairs(n_pixels) * LANES;
        let (x_row, dy_row) = (blocks_in * 3 * vector, shape.channels_out.div_ceil(LANES) * vector);
        let (inputs, outputs) = self.rows(image, y, n_rows);
        // The last task may have fewer channels than blocks.
        let inputs = ChannelRows { channels: inputs.channels.min(blocks_in * LANES), ..inputs };
        let Scratch { a, b, c } = &mut *self.scratch;
        let (x, dy) = (b.get(n_x_rows * x_row), c.get(n_rows * dy_row));
        // SAFETY: `is_paired` says that the CPU has pairs, in vectors of AVX-512.
        unsafe {
            inputs.pair::<3>(1, [stride, n_pixels], a, x);
            outputs.pair::<1>(0, [1, n_pixels], a, dy);
        }
        assert!(self.sums.len() == blocks_in * 9 * blocks_out * ROWS * LANES);
        for block_in in 0..blocks_in {
            for kernel_row in 0..3 {
                for block_out in 0..blocks_out {
                    // SAFETY: the CPU has pairs, as above. x: rows `kernel_row + r * stride < n_x_rows`, in each three vectors of
                    // block `block_in`; dy: in each of `n_rows` rows the half of a vector's lanes that block `block_out` has;
                    // sums: tile `.. < blocks_in * 3 * blocks_out`, each of `ROWS * 3 * LANES` floats.
                    unsafe {
                        let tile = PairTile {
                            n_rows,
                            n_pairs: n_pixels.div_ceil(2),
                            x: x.as_ptr().add(kernel_row * x_row + block_in * 3 * vector),
                            x_row: x_row * stride,
                            x_vector: vector,
                            dy: dy.as_ptr().add(block_out / 2 * vector + block_out % 2 * ROWS),
                            dy_row,
                        };
                        let place = (block_in * 3 + kernel_row) * blocks_out + block_out;
                        tile.add::<3>(self.sums.as_mut_ptr().add(place * ROWS * 3 * LANES));
                    }
                }
            }
        }
    }
}

impl ChannelRows<'_> {
    /// Turns channels of one row innermost: `[block][padded_width][B]`, zero in the `lead` columns before the row, after
    /// it, outside of the image, and beyond the last channel.
    #[inline(always)]
    fn interleave<const B: usize>(&self, row: usize, packed: &mut [f32], lead: usize, padded_width: usize) {
        if self.of(0, row).is_none() {
            packed.fill(0.0);
            return;
        }
        for (block, packed) in packed.chunks_exact_mut(padded_width * B).enumerate() {
            packed[..lead * B].fill(0.0);
            packed[(lead + self.width_px) * B..].fill(0.0);
            let packed = &mut packed[lead * B..(lead + self.width_px) * B];
            let rows: [Option<&[f32]>; B] = std::array::from_fn(|i| self.of(block * B + i, row));
            if block * B + B <= self.channels {
                let rows =
                    rows.map(|row| row.expect("the row is in the image, and so many channels are there"));
                for (x, pixel) in packed.chunks_exact_mut(B).enumerate() {
                    for (value, row) in pixel.iter_mut().zip(rows) {
                        *value = row[x];
                    }
                }
            } else {
                for (x, pixel) in packed.chunks_exact_mut(B).enumerate() {
                    for (value, row) in pixel.iter_mut().zip(rows) {
                        *value = row.map_or(0.0, |row| row[x]);
                    }
                }
            }
        }
    }
}
