//! The matrix product of `tiles` on the matrix unit: blocks of 32 output channels by 32 tile positions.
//!
//! Weights are the left operand, pixels the right one, both split into halves; pairs are of neighbouring input channels.
//! A band of halves is laid out as the band of numbers, with the planes of all high pairs before those of all low pairs.

use rayon::prelude::*;

use super::band::{Layout, Planes, pack};
use super::pass::copy_piece;
use super::strip::{TileStrip, Weights};
use crate::kernels::matrix_unit::{BLOCK, Blocks, Left, Right, TILE, TILE_PAIRS, split_pairs};
use crate::kernels::scratch::Buffer;
use crate::kernels::simd::{InstructionSet, Kernel, Simd};

/// Planes of halves: two for each pair of channels, whole tiles of pairs.
pub(super) fn half_planes(channels: usize) -> usize {
    2 * n_steps(channels) * TILE
}

/// Steps of a sum over the channels at one tap.
fn n_steps(channels: usize) -> usize {
    channels.div_ceil(2 * TILE)
}

/// Weights as `[tile of channels_out][step][tap][high, low][channel_out in tile][pair of channels_in]`, zero beyond the last
/// channels; the number of tiles is even. The arguments are those of `tiles::pack_weights`.
pub(super) fn pack_weights(
    set: InstructionSet,
    w: &[f32],
    channels: (usize, usize),
    strides: (usize, usize),
    taps: &[usize],
    scale: Option<&[f32]>,
) -> Vec<u32> {
    let tile_len = n_steps(channels.1) * taps.len() * 2 * TILE_PAIRS;
    let mut packed = vec![0; channels.0.div_ceil(BLOCK) * 2 * tile_len];
    packed.par_chunks_exact_mut(tile_len).enumerate().for_each(|(tile, packed)| {
        set.run(WeightTile { w, channels, strides, taps, scale, first: tile * TILE, packed });
    });
    packed
}

/// The weights of one tile of output channels.
struct WeightTile<'a> {
    w: &'a [f32],
    channels: (usize, usize),
    strides: (usize, usize),
    taps: &'a [usize],
    scale: Option<&'a [f32]>,
    /// First output channel.
    first: usize,
    packed: &'a mut [u32],
}

impl Kernel for WeightTile<'_> {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const LANES: usize>(self) {
        let Self { w, channels, strides, taps, scale, first, packed } = self;
        for (step_and_tap, packed) in packed.chunks_exact_mut(2 * TILE_PAIRS).enumerate() {
            let (step, tap) = (step_and_tap / taps.len(), taps[step_and_tap % taps.len()]);
            let n_channels = (channels.1 - step * 2 * TILE).min(2 * TILE);
            let (high, low) = packed.split_at_mut(TILE_PAIRS);
            let rows = high.chunks_exact_mut(TILE).zip(low.chunks_exact_mut(TILE));
            for (o, (high, low)) in (first..channels.0).zip(rows) {
                let scale = scale.map_or(1.0, |scale| scale[o]);
                let w = &w[o * strides.0 + step * 2 * TILE * strides.1 + tap..];
                let mut pairs = [[0f32; TILE]; 2];
                if n_channels == 2 * TILE {
                    // One check for all, so that the loop becomes a few gathers.
                    let w = &w[..=(2 * TILE - 1) * strides.1];
                    for (pair, place) in (0..TILE).map(|pair| (pair, 2 * pair * strides.1)) {
                        // SAFETY: `(2 * pair + 1) * stride` is at most the last index of the slice above.
                        let [a, b] =
                            unsafe { [*w.get_unchecked(place), *w.get_unchecked(place + strides.1)] };
                        (pairs[0][pair], pairs[1][pair]) = (a * scale, b * scale);
                    }
                } else {
                    for i in 0..n_channels {
                        pairs[i % 2][i / 2] = w[i * strides.1] * scale;
                    }
                }
                split_pairs(&pairs[0], &pairs[1], high, low);
            }
        }
    }
}

/// Packs a band of halves, as `band::pack` packs numbers; `buffer` holds what lies between.
#[inline(always)]
pub(super) fn pack_halves(
    source: &Planes,
    [numbers, layout]: [&Layout; 2],
    image: usize,
    first_row: usize,
    buffer: &mut Buffer,
    halves: &mut [u32],
) {
    if source.split == 1 {
        let zeros = buffer.get(source.width_px);
        zeros.fill(0.0);
        pack_rows(source, layout, image, first_row, zeros, halves);
    } else {
        let packed = buffer.get(numbers.len);
        pack(source, numbers, image, first_row, packed);
        split_band(source, numbers, packed, halves);
    }
}

/// Packs and splits rows in one go.
#[inline(always)]
fn pack_rows(
    source: &Planes,
    layout: &Layout,
    image: usize,
    first_row: usize,
    zeros: &[f32],
    halves: &mut [u32],
) {
    let Planes { values, channels, height_px, width_px, lead, .. } = *source;
    let n_pairs = half_planes(channels) / 2;
    for row in 0..layout.rows {
        // Wraps around above the image, and so lands outside, as rows below the image do.
        let y = (first_row + row).wrapping_sub(lead);
        let pixels = |channel: usize| {
            if y < height_px && channel < channels {
                &values[((image * channels + channel) * height_px + y) * width_px..][..width_px]
            } else {
                zeros
            }
        };
        for pair in 0..n_pairs {
            let start = row * layout.row + pair * layout.channel;
            let (head, tail) = halves.split_at_mut(start + n_pairs * layout.channel);
            let [high, low] = [&mut head[start..start + layout.width], &mut tail[..layout.width]];
            split_pairs(pixels(2 * pair), pixels(2 * pair + 1), &mut high[lead..], &mut low[lead..]);
            for half in [high, low] {
                half[..lead].fill(0);
                half[lead + width_px..].fill(0);
            }
        }
    }
    if layout.is_flat {
        // The word between two planes is the right padding of the first one's last row.
        for plane in 1..=2 * n_pairs {
            halves[plane * layout.channel - 1] = 0;
        }
    }
}

/// Splits a packed band of numbers into one of halves.
#[inline(always)]
fn split_band(source: &Planes, layout: &Layout, packed: &[f32], halves: &mut [u32]) {
    let n_pairs = half_planes(source.channels) / 2;
    let n_groups = if layout.is_flat { 1 } else { layout.rows * source.split };
    let zeros = [0f32; 64];
    let groups = packed.chunks_exact(source.channels * layout.channel);
    let halves = halves.chunks_exact_mut(2 * n_pairs * layout.channel);
    for (group, halves) in groups.zip(halves).take(n_groups) {
        let (high, low) = halves.split_at_mut(n_pairs * layout.channel);
        let mut channels = group.chunks_exact(layout.channel);
        let rows = high.chunks_exact_mut(layout.channel).zip(low.chunks_exact_mut(layout.channel));
        for (high, low) in rows {
            match (channels.next(), channels.next()) {
                (Some(first), Some(second)) => split_pairs(first, second, high, low),
                (Some(first), None) => {
                    let pieces = high.chunks_mut(zeros.len()).zip(low.chunks_mut(zeros.len()));
                    for (first, (high, low)) in first.chunks(zeros.len()).zip(pieces) {
                        split_pairs(first, &zeros[..first.len()], high, low);
                    }
                }
                _ => {
                    high.fill(0);
                    low.fill(0);
                }
            }
        }
    }
}

impl TileStrip<'_> {
    /// As `run`, of a band of halves; `sums` has room for one block.
    #[inline(always)]
    pub fn run_blocks<S: Simd>(&self, packed: &[u32], sums: &mut [f32], unit: &mut Blocks) {
        let Weights::Blocks(weights) = &self.phase.weights else {
            unreachable!("`Band::run` chose by the set")
        };
        let (c, layout, offsets) = (self.convolution, self.layout, self.phase.offsets.as_slice());
        let (n_steps, n_taps) = (n_steps(c.source.channels), offsets.len());
        let last_offset = *offsets.iter().max().expect("at least one tap");
        let plane = c.out_height_px * c.out_width_px;
        let n_blocks = c.channels_out.div_ceil(BLOCK);
        let end = if layout.is_flat { self.n_rows * layout.width } else { c.columns };
        let step_len = n_taps * 2 * TILE_PAIRS;
        let low = n_steps * TILE * layout.channel * size_of::<u32>();

        // The unsafe blocks below rely on these bounds.
        assert!(weights.len() == n_blocks * 2 * n_steps * step_len);
        assert!(sums.len() >= BLOCK * BLOCK);
        assert!((self.image + 1) * c.channels_out * plane <= self.output.len);

        for start in (0..end).step_by(BLOCK) {
            let stop = start + BLOCK;
            assert!((2 * n_steps * TILE - 1) * layout.channel + last_offset + stop <= packed.len());
            let (pieces, n_pieces) = self.pieces(start, stop.min(end));
            let pieces = &pieces[..n_pieces];
            for piece in pieces {
                assert!(piece.in_tile + piece.len <= BLOCK);
                assert!(piece.in_plane + (piece.len - 1) * c.upscale < plane);
            }
            for block in 0..n_blocks {
                unit.clear();
                for step in 0..n_steps {
                    for (tap, offset) in offsets.iter().enumerate() {
                        // SAFETY: by the asserts above, weights: both tiles, high and low, of this block's steps;
                        // pixels: the last read ends at `last plane + last tap + stop`.
                        unsafe {
                            let weights = weights
                                .as_ptr()
                                .add((block * 2 * n_steps + step) * step_len + tap * 2 * TILE_PAIRS);
                            let pixels = packed.as_ptr().add(step * TILE * layout.channel + offset + start);
                            let left = Left {
                                rows: [weights, weights.add(n_steps * step_len)].map(<*const u32>::cast),
                                stride: TILE * size_of::<u32>(),
                                low: TILE_PAIRS * size_of::<u32>(),
                            };
                            let right = Right {
                                columns: [pixels, pixels.add(TILE)].map(<*const u32>::cast),
                                stride: layout.channel * size_of::<u32>(),
                                low,
                            };
                            unit.add(left, right);
                        }
                    }
                }
                // SAFETY: `sums` is a block.
                unsafe { unit.store(sums.as_mut_ptr()) };
                let first = block * BLOCK;
                for (row, sums) in
                    sums.chunks_exact_mut(BLOCK).take(c.channels_out - first).take(BLOCK).enumerate()
                {
                    if let Some(shift) = self.shift {
                        let shift = shift[first + row];
                        for sum in sums.iter_mut() {
                            *sum += shift;
                        }
                    }
                    if c.has_relu {
                        for sum in sums.iter_mut() {
                            *sum = sum.max(0.0);
                        }
                    }
                    for piece in pieces {
                        // SAFETY: the asserts above hold each piece inside its row and its plane.
                        unsafe {
                            let channel = self.image * c.channels_out + first + row;
                            let to = self.output.start.add(channel * plane + piece.in_plane);
                            copy_piece::<S>(sums.as_ptr().add(piece.in_tile), to, piece.len, c.upscale);
                        }
                    }
                }
            }
        }
    }
}
