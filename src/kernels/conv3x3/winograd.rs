//! The 3x3 convolution of stride 1 with 16 products where taps take 36: F(2x2, 3x3) of Lavin and Gray 2016, after Winograd 1980.
//!
//! ```text
//! Y = A' [sum over channels of (G g G') * (B' d B)] A
//! ```
//!
//! for a tile of 2 by 2 outputs Y, its 4 by 4 inputs d and a kernel g; `*` is by element. So for each of 16 elements there is a
//! matrix product of channels, that of [`super::pass`], over tiles in place of pixels. A, B and G hold 0, 1, -1 and 1/2; sums of
//! four inputs are rounded once more than inputs are, in f32 as in bf16.

use rayon::prelude::*;

use super::band::{Layout, Planes, pack};
use super::pairs::uses_pairs;
use super::pass::{Pass, Start, TILE_VECTORS};
use super::strip::SharedOutput;
use super::{Shape, uses_matrix_unit};
use crate::kernels::products::{HALF, pair};
use crate::kernels::scratch::{Scratch, with_scratch};
use crate::kernels::simd::{InstructionSet, Kernel, Scalar, Simd, Vector};

/// Elements of a tile.
pub(super) const ELEMENTS: usize = 16;
/// Rows of tiles that a task takes: with 16 or 32 tiles a row, whole register tiles.
const BAND_ROWS: usize = 3;
/// Fewest channels on either side: below, turning tiles costs more than it saves.
const MIN_CHANNELS: usize = 32;

/// A convolution by tiles.
pub(super) struct Tiled<'a> {
    /// `[batch, channel_in, y, x]`
    pub x: &'a [f32],
    pub batch: usize,
    /// Of input and output.
    pub channels: (usize, usize),
    pub height_px: usize,
    pub width_px: usize,
    /// A shift of each output channel, `[channel_out]`, that is added to the sums.
    pub shift: Option<&'a [f32]>,
    /// Whether negative sums become zero, after the shift.
    pub has_relu: bool,
}

/// Whether a convolution goes by tiles: whole vectors of them in a row, and products in vectors.
pub(super) fn fits(shape: Shape, set: InstructionSet) -> bool {
    let Shape { channels_in, channels_out, height_px, width_px, stride, .. } = shape;
    let is_whole = stride == 1 && height_px.is_multiple_of(2) && width_px.is_multiple_of(2 * set.lanes());
    is_whole
        && channels_in.min(channels_out) >= MIN_CHANNELS
        && !uses_matrix_unit(set, (channels_out, channels_in))
}

/// Turned kernels as `[block of channels_out][element][plane in][channel_out in block]`, where a plane is a channel or a pair of
/// them; zero beyond the last channels. `value` is that of an output channel, an input channel and a tap.
fn turn_weights(
    set: InstructionSet,
    (channels_in, channels_out): (usize, usize),
    value: impl Fn(usize, usize, usize) -> f32 + Sync,
) -> Vec<f32> {
    let n_rows = set.rows();
    let is_paired = uses_pairs(set, channels_in);
    let n_planes = if is_paired { channels_in.div_ceil(2) } else { channels_in };
    let mut turned = vec![0.0; channels_out.div_ceil(n_rows) * n_rows * ELEMENTS * n_planes];
    turned.par_chunks_exact_mut(ELEMENTS * n_planes * n_rows).enumerate().for_each(|(block, turned)| {
        let first = block * n_rows;
        for plane in 0..n_planes {
            for row in 0..n_rows.min(channels_out - first) {
                let of = |channel: usize| {
                    if channel < channels_in {
                        turn_kernel(std::array::from_fn(|tap| value(first + row, channel, tap)))
                    } else {
                        [0.0; ELEMENTS]
                    }
                };
                let values = if is_paired {
                    let (even, odd) = (of(2 * plane), of(2 * plane + 1));
                    std::array::from_fn(|element| pair(even[element], odd[element]))
                } else {
                    of(plane)
                };
                for (element, value) in values.into_iter().enumerate() {
                    turned[(element * n_planes + plane) * n_rows + row] = value;
                }
            }
        }
    });
    turned
}

/// `G g G'`
fn turn_kernel(g: [f32; 9]) -> [f32; ELEMENTS] {
    let turn = |[a, b, c]: [f32; 3]| [a, 0.5 * (a + b + c), 0.5 * (a - b + c), c];
    let columns: [[f32; 4]; 3] = std::array::from_fn(|x| turn([g[x], g[3 + x], g[6 + x]]));
    let mut turned = [0.0; ELEMENTS];
    for y in 0..4 {
        let row = turn([columns[0][y], columns[1][y], columns[2][y]]);
        turned[4 * y..4 * y + 4].copy_from_slice(&row);
    }
    turned
}

impl Tiled<'_> {
    /// Convolves; `value` is the weight of an output channel, an input channel and a tap.
    pub fn run(&self, set: InstructionSet, value: impl Fn(usize, usize, usize) -> f32 + Sync) -> Vec<f32> {
        let (channels_in, channels_out) = self.channels;
        let weights = turn_weights(set, self.channels, value);
        let n_padded = channels_out.next_multiple_of(set.rows());
        let shift = self.shift.map(|shift| {
            assert_eq!(shift.len(), channels_out, "a shift for each output channel");
            let mut padded = shift.to_vec();
            padded.resize(n_padded, 0.0);
            padded
        });
        let is_paired = uses_pairs(set, channels_in);
        let tile_rows = self.height_px / 2;
        let n_bands = tile_rows.div_ceil(BAND_ROWS);
        let len = self.batch * channels_out * self.height_px * self.width_px;
        let mut out: Vec<f32> = Vec::with_capacity(len);
        if cfg!(test) {
            out.resize(len, f32::NAN); // a pixel that no tile writes then fails the tests
        }
        let output = SharedOutput { start: out.as_mut_ptr(), len };
        (0..self.batch * n_bands).into_par_iter().for_each(|task| {
            let first_row = (task % n_bands) * BAND_ROWS;
            with_scratch(|scratch| {
                set.run(Band {
                    tiled: self,
                    weights: &weights,
                    shift: shift.as_deref(),
                    is_paired,
                    output,
                    image: task / n_bands,
                    first_row,
                    n_rows: BAND_ROWS.min(tile_rows - first_row),
                    scratch,
                });
            });
        });
        // SAFETY: the capacity is `len`, and the tasks wrote every float: bands cover all rows of tiles, vectors all tiles of a
        // row, and blocks all channels.
        unsafe { out.set_len(len) };
        out
    }
}

/// One task: some rows of tiles of one image.
struct Band<'a> {
    tiled: &'a Tiled<'a>,
    weights: &'a [f32],
    /// As long as all blocks' rows.
    shift: Option<&'a [f32]>,
    is_paired: bool,
    output: SharedOutput,
    image: usize,
    first_row: usize,
    n_rows: usize,
    scratch: &'a mut Scratch,
}

impl Kernel for Band<'_> {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const LANES: usize>(self) {
        let Self { tiled, weights, is_paired, image, first_row, n_rows, .. } = self;
        let (channels_in, channels_out) = tiled.channels;
        let row_vectors = tiled.width_px / (2 * LANES);
        let source = Planes {
            values: tiled.x,
            channels: channels_in,
            height_px: tiled.height_px,
            width_px: tiled.width_px,
            split: 2,
            lead: 1,
        };
        let layout = Layout::new(false, &source, tiled.width_px / 2, n_rows);
        let n_planes = if is_paired { channels_in.div_ceil(2) } else { channels_in };
        let n_blocks = channels_out.div_ceil(ROWS);
        let tile_len = TILE_VECTORS * LANES;
        let Scratch { a, b, c } = &mut *self.scratch;
        let band = a.get(layout.len);
        pack(&source, &layout, image, first_row, band);
        let turned = b.get(ELEMENTS * n_planes * tile_len);
        let sums = c.get(ELEMENTS * ROWS * tile_len);
        // The unsafe blocks below rely on these bounds.
        assert!(weights.len() == n_blocks * ELEMENTS * n_planes * ROWS);
        assert!(self.shift.is_none_or(|shift| shift.len() == n_blocks * ROWS));
        assert!((image + 1) * channels_out * tiled.height_px * tiled.width_px <= self.output.len);
        assert!(2 * (first_row + n_rows) <= tiled.height_px && row_vectors * 2 * LANES == tiled.width_px);

        let n_vectors = n_rows * row_vectors;
        let mut first = 0;
        while first < n_vectors {
            let n_left = n_vectors - first;
            // Four left are faster as two and two than as three and one.
            let n = if n_left >= TILE_VECTORS && n_left != 4 { TILE_VECTORS } else { n_left.min(2) };
            for at in 0..n {
                let (row, x) = ((first + at) / row_vectors, (first + at) % row_vectors * LANES);
                turn_inputs::<S, LANES>(band, &layout, [row, x], channels_in, is_paired, at * LANES, turned);
            }
            for block in 0..n_blocks {
                for element in 0..ELEMENTS {
                    // SAFETY: by the asserts above, pixels: `n_planes` rows of `tile_len`, of which the first `n` vectors are read;
                    // weights: `n_planes * ROWS` of this block's and element's; target: ROWS rows of `tile_len` of the element.
                    unsafe {
                        let sums = sums.as_mut_ptr().add(element * ROWS * tile_len);
                        let pass = Pass {
                            n_channels: n_planes,
                            pixels: turned.as_ptr().add(element * n_planes * tile_len),
                            channel_stride: tile_len,
                            offsets: &[0],
                            weights: weights.as_ptr().add((block * ELEMENTS + element) * n_planes * ROWS),
                            start: Start::Zero,
                            has_relu: false,
                            tile: sums,
                            target: sums,
                            target_stride: tile_len,
                        };
                        match n {
                            _ if is_paired => pass.run_pairs(n),
                            3 => pass.run::<S, ROWS, 3>(),
                            2 => pass.run::<S, ROWS, 2>(),
                            _ => pass.run::<S, ROWS, 1>(),
                        }
                    }
                }
                for row in 0..ROWS.min(channels_out - block * ROWS) {
                    let channel = block * ROWS + row;
                    let shift = self.shift.map_or(0.0, |shift| shift[channel]);
                    for at in 0..n {
                        let (tile_row, x) = ((first + at) / row_vectors, (first + at) % row_vectors * LANES);
                        let y = 2 * (first_row + tile_row);
                        let place =
                            ((image * channels_out + channel) * tiled.height_px + y) * tiled.width_px + 2 * x;
                        // SAFETY: sums of all elements are there; two rows of `2 * LANES` pixels are this task's to write.
                        unsafe {
                            write_outputs::<S, LANES>(
                                sums.as_ptr().add(row * tile_len + at * LANES),
                                ROWS * tile_len,
                                shift,
                                tiled.has_relu,
                                self.output.start.add(place),
                                tiled.width_px,
                            );
                        }
                    }
                }
            }
            first += n;
        }
    }
}

/// `B' d` of four values.
#[inline(always)]
fn turn<S: Simd>([a, b, c, d]: [Vector<S, f32>; 4]) -> [Vector<S, f32>; 4] {
    [a - c, b + c, c - b, b - d]
}

/// `B' d B` of a vector of tiles, of one channel. Loops, not `array::from_fn`, here and below: its closures are compiled outside of
/// the function that enables the instruction set.
#[inline(always)]
pub(super) fn turn_channel<S: Simd, const LANES: usize>(
    band: &[f32],
    layout: &Layout,
    [row, x]: [usize; 2],
    channel: usize,
) -> [Vector<S, f32>; ELEMENTS] {
    let mut rows = [[0f32.splat::<S>(); 4]; 4];
    for (dy, rows) in rows.iter_mut().enumerate() {
        let start = channel * layout.channel + dy % 2 * layout.row_parity + (row + dy / 2) * layout.row + x;
        for (dx, pixels) in rows.iter_mut().enumerate() {
            let from = &band[start + dx % 2 * layout.column_parity + dx / 2..][..LANES];
            // SAFETY: the slice is a vector long.
            *pixels = unsafe { f32::vload_unaligned(from.as_ptr()) };
        }
        *rows = turn(*rows);
    }
    let mut elements = [0f32.splat::<S>(); ELEMENTS];
    for dx in 0..4 {
        let column = turn([rows[0][dx], rows[1][dx], rows[2][dx], rows[3][dx]]);
        for dy in 0..4 {
            elements[4 * dy + dx] = column[dy];
        }
    }
    elements
}

/// Turns a vector of tiles, all channels, to `[element][plane][TILE_VECTORS * LANES]`, from place `at` in a plane on.
#[inline(always)]
fn turn_inputs<S: Simd, const LANES: usize>(
    band: &[f32],
    layout: &Layout,
    place: [usize; 2],
    channels_in: usize,
    is_paired: bool,
    at: usize,
    turned: &mut [f32],
) {
    let tile_len = TILE_VECTORS * LANES;
    let n_planes = if is_paired { channels_in.div_ceil(2) } else { channels_in };
    for plane in 0..n_planes {
        let elements = if is_paired {
            let mut elements = turn_channel::<S, LANES>(band, layout, place, 2 * plane);
            let second = if 2 * plane + 1 < channels_in {
                turn_channel::<S, LANES>(band, layout, place, 2 * plane + 1)
            } else {
                [0f32.splat(); ELEMENTS]
            };
            for element in 0..ELEMENTS {
                elements[element] = pair_vectors(elements[element], second[element]);
            }
            elements
        } else {
            turn_channel::<S, LANES>(band, layout, place, plane)
        };
        for (element, vector) in elements.into_iter().enumerate() {
            let to = &mut turned[(element * n_planes + plane) * tile_len + at..][..LANES];
            // SAFETY: the slice is a vector long.
            unsafe { f32::vstore_unaligned(to.as_mut_ptr(), vector) };
        }
    }
}

/// Both numbers of each lane rounded to bf16, as [`pair`] does it.
#[inline(always)]
fn pair_vectors<S: Simd>(first: Vector<S, f32>, second: Vector<S, f32>) -> Vector<S, f32> {
    let half = HALF.splat::<S>();
    let (first, second) = (first.reinterpret::<u32>() + half, second.reinterpret::<u32>() + half);
    ((first >> 16) | (second & 0xffff_0000u32.splat())).reinterpret()
}

/// `A' m` of four values.
#[inline(always)]
fn join<S: Simd>([a, b, c, d]: [Vector<S, f32>; 4]) -> [Vector<S, f32>; 2] {
    [a + b + c, b - c - d]
}

/// `A' m A` of a vector of tiles, shifted, and above zero if there is a ReLU: two rows of pixels.
///
/// # Safety
/// A vector is readable at each element, `stride` apart; two vectors are writable at `to` and a row below.
#[inline(always)]
unsafe fn write_outputs<S: Simd, const LANES: usize>(
    sums: *const f32,
    stride: usize,
    shift: f32,
    has_relu: bool,
    to: *mut f32,
    width_px: usize,
) {
    let mut columns = [[0f32.splat::<S>(); 2]; 4];
    for (dx, column) in columns.iter_mut().enumerate() {
        let mut elements = [0f32.splat::<S>(); 4];
        for (dy, element) in elements.iter_mut().enumerate() {
            // SAFETY: the caller's promise.
            *element = unsafe { f32::vload_unaligned::<S>(sums.add((4 * dy + dx) * stride)) };
        }
        *column = join(elements);
    }
    let [a, b, c, d] = columns;
    for dy in 0..2 {
        let [even, odd] = join([a[dy], b[dy], c[dy], d[dy]]);
        let mut lanes = [[0f32; LANES]; 2];
        for (lanes, pixels) in lanes.iter_mut().zip([even, odd]) {
            let pixels = pixels + shift.splat();
            // Only then: a maximum makes a number of what is none.
            let pixels = if has_relu { pixels.max(0f32.splat()) } else { pixels };
            // SAFETY: LANES floats are a vector.
            unsafe { f32::vstore_unaligned(lanes.as_mut_ptr(), pixels) };
        }
        // SAFETY: the caller's promise.
        let to = unsafe { std::slice::from_raw_parts_mut(to.add(dy * width_px), 2 * LANES) };
        for lane in 0..LANES {
            to[2 * lane] = lanes[0][lane];
            to[2 * lane + 1] = lanes[1][lane];
        }
    }
}
