//! The gradient of the kernel on the matrix unit: blocks of 32 input by 32 output channels, pixels summed.
//!
//! Inputs are the left operand: rows of halves, in which a tap is an offset. Output gradients are the right one, turned
//! so that pairs of neighbouring pixels hold all channels; pixels lie as in a flat band, zero between rows.

use rayon::prelude::*;

use super::band::{Layout, Planes, pack};
use super::{BAND_BYTES, Shape};
use crate::kernels::matrix_unit::{BLOCK, Blocks, Left, Right, TILE, TILE_PAIRS, split};
use crate::kernels::scratch::{Scratch, with_scratch};
use crate::kernels::simd::{InstructionSet, Kernel, Simd};
use crate::kernels::transpose::transpose;

/// Sums of one block at one tap.
const BLOCK_SUMS: usize = BLOCK * BLOCK;
/// Pixels of one step of a sum.
const STEP: usize = 2 * TILE;

/// As `weight_gradient::weight_gradient`, of a square kernel: `[channel_out, channel_in, kernel, kernel]`.
///
/// # Panics
/// If the kernel is neither 1, with stride 1, nor 3.
pub(super) fn weight_gradient(
    shape: Shape,
    kernel: usize,
    x: &[f32],
    dy: &[f32],
    set: InstructionSet,
) -> Vec<f32> {
    assert!(kernel == 3 || (kernel == 1 && shape.stride == 1));
    let n_taps = kernel * kernel;
    let (blocks_in, blocks_out) = (shape.channels_in.div_ceil(BLOCK), shape.channels_out.div_ceil(BLOCK));
    let block_len = blocks_out * n_taps * BLOCK_SUMS;
    let (total_rows, n_parts) = (shape.batch * shape.out_height_px(), shape.n_parts());
    let n_groups = rayon::current_num_threads().div_ceil(n_parts).min(blocks_in);
    let group_blocks = blocks_in.div_ceil(n_groups);

    let part_len = blocks_in * block_len;
    let mut sums = vec![0.0; n_parts * part_len];
    sums.par_chunks_mut(part_len).enumerate().for_each(|(part, sums)| {
        let rows = part * total_rows / n_parts..(part + 1) * total_rows / n_parts;
        sums.par_chunks_mut(group_blocks * block_len).enumerate().for_each(|(group, sums)| {
            let first_channel = group * group_blocks * BLOCK;
            with_scratch(|scratch| {
                set.run(Part { shape, kernel, x, dy, first_channel, rows: rows.clone(), sums, scratch });
            });
        });
    });

    let mut gradient = vec![0.0; shape.channels_out * shape.channels_in * n_taps];
    gradient.par_chunks_mut(shape.channels_in * n_taps).enumerate().for_each(|(o, gradient)| {
        for (i, gradient) in gradient.chunks_exact_mut(n_taps).enumerate() {
            let block = (i / BLOCK * blocks_out + o / BLOCK) * n_taps * BLOCK_SUMS;
            let place = block + i % BLOCK * BLOCK + o % BLOCK;
            for (tap, gradient) in gradient.iter_mut().enumerate() {
                let place = place + tap * BLOCK_SUMS;
                *gradient = (0..n_parts).fold(0.0, |sum, part| sum + sums[part * part_len + place]);
            }
        }
    });
    gradient
}

/// One task: some rows of pixels, some blocks of input channels.
struct Part<'a> {
    shape: Shape,
    kernel: usize,
    x: &'a [f32],
    dy: &'a [f32],
    first_channel: usize,
    /// Output rows, counted through the batch.
    rows: std::ops::Range<usize>,
    /// `[block in][block out][tap][channel in in block][channel out in block]`
    sums: &'a mut [f32],
    scratch: &'a mut Scratch,
}

impl Kernel for Part<'_> {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const LANES: usize>(mut self) {
        let (height, width) = (self.shape.out_height_px(), self.shape.out_width_px());
        let row_floats = self.shape.channels_in * (self.shape.width_px + 3) * self.shape.stride
            + self.shape.channels_out * width;
        let chunk_rows = (BAND_BYTES / (4 * row_floats)).saturating_sub(1).clamp(1, height);
        // SAFETY: `weight_gradient` is called where `uses_matrix_unit`; the thread has one unit, for this part.
        let mut unit = unsafe { Blocks::begin() };
        let mut row = self.rows.start;
        while row < self.rows.end {
            let (image, y) = (row / height, row % height);
            let n_rows = chunk_rows.min(height - y).min(self.rows.end - row);
            self.add_rows(image, y, n_rows, &mut unit);
            row += n_rows;
        }
    }
}

/// Packs the rows of a flat band of halves, as `band::pack` packs numbers.
#[inline(always)]
fn split_rows(source: &Planes, layout: &Layout, first_row: usize, high: &mut [u16], low: &mut [u16]) {
    let Planes { values, channels, height_px, width_px, lead, .. } = *source;
    for channel in 0..channels {
        let start = channel * layout.channel;
        let rows = start..start + layout.channel;
        let (high, low) = (&mut high[rows.clone()], &mut low[rows]);
        for row in 0..layout.rows {
            let columns = row * layout.width..(row + 1) * layout.width;
            let (high, low) = (&mut high[columns.clone()], &mut low[columns]);
            // Wraps around above the image, and so lands outside, as rows below the image do.
            let y = (first_row + row).wrapping_sub(lead);
            let n_pixels = if y < height_px { width_px } else { 0 };
            if n_pixels > 0 {
                let pixels = &values[(channel * height_px + y) * width_px..][..width_px];
                split(pixels, &mut high[lead..], &mut low[lead..]);
            }
            for half in [high, low] {
                half[..lead].fill(0);
                half[lead + n_pixels..].fill(0);
            }
        }
        for half in [high, low] {
            half[layout.channel - 1] = 0;
        }
    }
}

impl Part<'_> {
    /// Adds the products of output rows `y..y + n_rows` of one image.
    #[inline(always)]
    fn add_rows(&mut self, image: usize, y: usize, n_rows: usize, unit: &mut Blocks) {
        let Shape { channels_in, channels_out, height_px, width_px, stride, .. } = self.shape;
        let out_width_px = self.shape.out_width_px();
        let blocks_out = channels_out.div_ceil(BLOCK);
        let n_taps = self.kernel * self.kernel;
        let blocks_in = self.sums.len() / (blocks_out * n_taps * BLOCK_SUMS);
        let channels = (channels_in - self.first_channel).min(blocks_in * BLOCK);

        let plane = height_px * width_px;
        let source = Planes {
            values: &self.x[(image * channels_in + self.first_channel) * plane..][..channels * plane],
            channels,
            height_px,
            width_px,
            split: stride,
            lead: self.kernel / 2,
        };
        let layout = Layout::new(true, &source, out_width_px, n_rows);
        let n_steps = (n_rows * layout.width).div_ceil(STEP);
        // Of kernel 1 only the first counts.
        let offsets: [usize; 9] =
            std::array::from_fn(|tap| layout.tap(stride, tap / self.kernel, tap % self.kernel));
        let offsets = &offsets[..n_taps];

        // Behind the last channel a step reads on, up to a step after the last tap.
        let rows_len = blocks_in * BLOCK * layout.channel;
        let behind = offsets.iter().max().expect("one tap or nine") + n_steps * STEP;
        let halves = self.scratch.b.half_words(2 * rows_len + behind);
        halves[2 * rows_len..].fill(0);
        let (high, low) = halves.split_at_mut(rows_len);
        // Rows of high halves run on into other channels and, the last ones, into low halves: all are numbers.
        let used = channels * layout.channel;
        high[used..].fill(0);
        low[used..rows_len].fill(0);
        if stride == 1 {
            split_rows(&source, &layout, y, high, low);
        } else {
            let packed = self.scratch.a.get(layout.len);
            pack(&source, &layout, 0, y, packed);
            split(&packed[..used], high, low);
        }

        let dy_rows = self.turn(image, y, n_rows, layout.width, n_steps);
        let x_rows = self.scratch.b.half_words(2 * rows_len + behind);
        for block_in in 0..blocks_in {
            for block_out in 0..blocks_out {
                for (tap, offset) in offsets.iter().enumerate() {
                    let place = ((block_in * blocks_out + block_out) * n_taps + tap) * BLOCK_SUMS;
                    let sums = self.sums[place..place + BLOCK_SUMS].as_mut_ptr();
                    // SAFETY: sums: a block. x: rows of channels below `blocks_in * BLOCK`, each read from a tap's offset on, up to
                    // `behind`; dy: `n_steps` steps of `blocks_out` blocks.
                    unsafe {
                        unit.load(sums);
                        for step in 0..n_steps {
                            let row = block_in * BLOCK * layout.channel + offset + step * STEP;
                            let x = x_rows.as_ptr().add(row);
                            let dy = dy_rows.add(((step * blocks_out) + block_out) * 4 * TILE_PAIRS);
                            let left = Left {
                                rows: [x, x.add(TILE * layout.channel)].map(<*const u16>::cast),
                                stride: layout.channel * size_of::<u16>(),
                                low: rows_len * size_of::<u16>(),
                            };
                            let right = Right {
                                columns: [dy, dy.add(2 * TILE_PAIRS)].map(<*const u32>::cast),
                                stride: TILE * size_of::<u32>(),
                                low: TILE_PAIRS * size_of::<u32>(),
                            };
                            unit.add(left, right);
                        }
                        unit.store(sums);
                    }
                }
            }
        }
    }

    /// Splits output gradients and turns them: `[step][tile of channels][high, low][pair of pixels][channel in tile]`.
    #[allow(clippy::cast_ptr_alignment, reason = "`transpose` needs no alignment")]
    #[inline(always)]
    fn turn(&mut self, image: usize, y: usize, n_rows: usize, width: usize, n_steps: usize) -> *const u32 {
        let (channels, out_width_px) = (self.shape.channels_out, self.shape.out_width_px());
        let n_tiles = channels.div_ceil(BLOCK) * 2;
        let len = n_steps * STEP;
        let turned = self.scratch.c.words(n_steps * n_tiles * 2 * TILE_PAIRS);
        // A row of halves, twice: high and low.
        let rows = self.scratch.a.half_words(2 * TILE * len);
        for tile in 0..n_tiles {
            for (row, halves) in rows.chunks_exact_mut(2 * len).enumerate() {
                let (high, low) = halves.split_at_mut(len);
                let channel = tile * TILE + row;
                if channel >= channels {
                    high.fill(0);
                    low.fill(0);
                    continue;
                }
                let first = (image * channels + channel) * self.shape.out_height_px() + y;
                for row in 0..n_rows {
                    let dy = &self.dy[(first + row) * out_width_px..][..out_width_px];
                    let [high, low] =
                        [&mut *high, &mut *low].map(|halves| &mut halves[row * width..(row + 1) * width]);
                    split(dy, high, low);
                    high[out_width_px..].fill(0);
                    low[out_width_px..].fill(0);
                }
                high[n_rows * width..].fill(0);
                low[n_rows * width..].fill(0);
            }
            for step in 0..n_steps {
                for half in 0..2 {
                    let to = &mut turned[((step * n_tiles + tile) * 2 + half) * TILE_PAIRS..][..TILE_PAIRS];
                    // SAFETY: `rows` holds TILE rows of `2 * len` half words, of which this reads one step, TILE words; `to`
                    // is a tile; the unit comes with AVX-512.
                    unsafe {
                        transpose(rows.as_ptr().add(half * len + step * STEP).cast(), len, to.as_mut_ptr());
                    }
                }
            }
        }
        turned.as_ptr()
    }
}
