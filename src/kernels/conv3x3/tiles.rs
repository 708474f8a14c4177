//! The matrix product behind forward pass and input gradient, over packed bands, in register tiles.
//!
//! Tile positions ("rows" by "columns") are source pixels; a position and a phase make an output pixel:
//! `out = position * upscale + phase`.

use rayon::prelude::*;

use super::band::{Layout, Planes, pack};
use super::pairs::{self, pack_pairs, uses_pairs};
use super::pass::{Pass, Start, TILE_VECTORS, copy_piece};
use super::strip::{Convolution, Phase, SharedOutput, TileStrip, Weights};
use super::{BAND_BYTES, blocks, uses_matrix_unit};
use crate::kernels::matrix_unit::{BLOCK, Blocks};
use crate::kernels::scratch::{Scratch, with_scratch};
use crate::kernels::simd::{InstructionSet, Kernel, Simd, lanes};

/// Floats a tile may read past the band: less than one tile.
const OVERREAD: usize = 256;

/// Packs weights for a set. `channels` and `strides` (in `w`) are of output and input; `scale`, `[channel_out]`, multiplies
/// the weights.
pub(super) fn pack_weights(
    set: InstructionSet,
    w: &[f32],
    channels: (usize, usize),
    strides: (usize, usize),
    taps: &[usize],
    scale: Option<&[f32]>,
) -> Weights {
    if uses_matrix_unit(set, channels) {
        return Weights::Blocks(blocks::pack_weights(set, w, channels, strides, taps, scale));
    }
    if uses_pairs(set, channels.1) {
        assert!(scale.is_none(), "inference, which scales weights, multiplies f32");
        return Weights::Rows(pairs::pack_weights(set.rows(), w, channels, strides, taps));
    }
    let (n_rows, n_taps) = (set.rows(), taps.len());
    let mut packed = vec![0.0; channels.0.div_ceil(n_rows) * n_rows * channels.1 * n_taps];
    packed.par_chunks_exact_mut(channels.1 * n_taps * n_rows).enumerate().for_each(|(block, packed)| {
        let first = block * n_rows;
        for (i, packed) in packed.chunks_exact_mut(n_taps * n_rows).enumerate() {
            for o in 0..n_rows.min(channels.0 - first) {
                let kernel = &w[(first + o) * strides.0 + i * strides.1..];
                let scale = scale.map_or(1.0, |scale| scale[first + o]);
                for (t, &tap) in taps.iter().enumerate() {
                    packed[t * n_rows + o] = kernel[tap] * scale;
                }
            }
        }
    });
    Weights::Rows(packed)
}

impl Convolution<'_> {
    /// Runs the phases that `phases` makes for the chosen layout; together they reach every output pixel.
    pub fn run(&self, set: InstructionSet, phases: impl FnOnce(&Layout) -> Vec<Phase>) -> Vec<f32> {
        let source = &self.source;
        let n_threads = rayon::current_num_threads();
        let has_unit = uses_matrix_unit(set, (self.channels_out, source.channels));
        let is_flat = if has_unit {
            !self.columns.is_multiple_of(BLOCK)
        } else {
            // Below three AVX-512 vectors, rows leave tiles half empty, unless they are two vectors exactly.
            self.columns < 48 && self.columns != 32
        };
        let row_bytes = source.channels * source.split * source.split * (self.columns + 2) * 4;
        let band_rows = (BAND_BYTES / row_bytes).saturating_sub(2).clamp(1, self.rows);
        let mut n_bands = self.rows.div_ceil(band_rows);
        if n_bands + n_threads <= self.rows {
            n_bands = (self.batch * n_bands).next_multiple_of(n_threads).div_ceil(self.batch);
        }
        let band_rows = self.rows.div_ceil(n_bands);
        let n_bands = self.rows.div_ceil(band_rows);
        let layout = Layout::new(is_flat, source, self.columns, band_rows);
        // As `layout`, of the halves that the matrix unit multiplies.
        let halves = has_unit.then(|| {
            let source = Planes { channels: blocks::half_planes(source.channels), ..*source };
            Layout::new(is_flat, &source, self.columns, band_rows)
        });
        let pairs = uses_pairs(set, source.channels).then(|| {
            let source = Planes { channels: source.channels.div_ceil(2), ..*source };
            Layout::new(is_flat, &source, self.columns, band_rows)
        });
        let phases = phases(halves.as_ref().or(pairs.as_ref()).unwrap_or(&layout));
        let n_blocks = self.channels_out.div_ceil(set.rows());
        let shift = self.shift.map(|shift| {
            assert_eq!(shift.len(), self.channels_out, "a shift for each output channel");
            let mut padded = shift.to_vec();
            padded.resize(n_blocks * set.rows(), 0.0);
            padded
        });

        let len = self.batch * self.channels_out * self.out_height_px * self.out_width_px;
        let mut out: Vec<f32> = Vec::with_capacity(len);
        if cfg!(test) {
            out.resize(len, f32::NAN); // a pixel that no tile writes then fails the tests
        }
        let output = SharedOutput { start: out.as_mut_ptr(), len };
        (0..self.batch * n_bands).into_par_iter().for_each(|task| {
            let first_row = (task % n_bands) * band_rows;
            with_scratch(|scratch| {
                set.run(Band {
                    convolution: self,
                    layout: &layout,
                    halves: halves.as_ref(),
                    pairs: pairs.as_ref(),
                    phases: &phases,
                    shift: shift.as_deref(),
                    output,
                    image: task / n_bands,
                    first_row,
                    n_rows: band_rows.min(self.rows - first_row),
                    scratch,
                });
            });
        });
        // SAFETY: the capacity is `len`, and the tasks wrote every float: bands cover all rows, tiles all
        // columns of a row, blocks all channels, and phases all parities.
        unsafe { out.set_len(len) };
        out
    }
}

/// One task: some rows of one image.
struct Band<'a> {
    convolution: &'a Convolution<'a>,
    layout: &'a Layout,
    /// Of what the matrix unit reads, if it multiplies.
    halves: Option<&'a Layout>,
    /// Of pairs of bf16, if they are multiplied.
    pairs: Option<&'a Layout>,
    phases: &'a [Phase],
    /// As long as all blocks' rows.
    shift: Option<&'a [f32]>,
    output: SharedOutput,
    image: usize,
    first_row: usize,
    n_rows: usize,
    scratch: &'a mut Scratch,
}

impl Kernel for Band<'_> {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const LANES: usize>(self) {
        let Self { convolution, layout, halves, pairs, phases, shift, output, image, first_row, .. } = self;
        let (n_rows, scratch) = (self.n_rows, self.scratch);
        // Tiles run along a strip: all rows if flat, else one.
        let n_strips = if layout.is_flat { 1 } else { n_rows };
        let strips = (0..n_strips).flat_map(|y| phases.iter().map(move |phase| (y, phase)));
        let strip = |layout, y, phase| TileStrip {
            convolution,
            layout,
            is_paired: pairs.is_some(),
            phase,
            shift,
            output,
            image,
            first_row: first_row + y,
            n_rows: n_rows / n_strips,
        };
        if let Some(halves) = halves {
            let split = scratch.c.words(halves.len + OVERREAD);
            let layouts = [layout, halves];
            blocks::pack_halves(&convolution.source, layouts, image, first_row, &mut scratch.a, split);
            let sums = scratch.b.get(BLOCK * BLOCK);
            // SAFETY: `halves` is there because `uses_matrix_unit`; the thread has one unit, for this band.
            let mut unit = unsafe { Blocks::begin() };
            for (y, phase) in strips {
                strip(halves, y, phase).run_blocks::<S>(&split[y * halves.row..], sums, &mut unit);
            }
            return;
        }
        let packed = scratch.a.get(pairs.unwrap_or(layout).len + OVERREAD);
        if let Some(pairs) = pairs {
            pack_pairs(&convolution.source, [layout, pairs], image, first_row, &mut scratch.c, packed);
        } else {
            pack(&convolution.source, layout, image, first_row, packed);
        }
        let layout = pairs.unwrap_or(layout);
        let n_blocks = convolution.channels_out.div_ceil(ROWS);
        let tiles = scratch.b.get(n_blocks * ROWS * TILE_VECTORS * LANES);
        for (y, phase) in strips {
            let (strip, packed) = (strip(layout, y, phase), &packed[y * layout.row..]);
            match phase.offsets.len() {
                9 => strip.run::<S, ROWS, 9>(packed, tiles),
                4 => strip.run::<S, ROWS, 4>(packed, tiles),
                2 => strip.run::<S, ROWS, 2>(packed, tiles),
                _ => strip.run::<S, ROWS, 1>(packed, tiles),
            }
        }
    }
}

impl TileStrip<'_> {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const TAPS: usize>(&self, packed: &[f32], tiles: &mut [f32]) {
        let Weights::Rows(weights) = &self.phase.weights else {
            unreachable!("`Band::run` chose by the set")
        };
        let (c, layout) = (self.convolution, self.layout);
        // Planes of the band: a pair of channels is one.
        let channels_in = if self.is_paired { c.source.channels.div_ceil(2) } else { c.source.channels };
        let offsets: &[usize; TAPS] =
            self.phase.offsets.as_slice().try_into().expect("`Band::run` chose TAPS by this length");
        let last_offset = *offsets.iter().max().expect("at least one tap");
        let tile_len = TILE_VECTORS * lanes::<S>();
        let plane = c.out_height_px * c.out_width_px;
        let n_blocks = c.channels_out.div_ceil(ROWS);
        // Input channels per pass, so that the pixels of a tile stay in the first-level cache.
        let pass_channels = (144 / TAPS).min(64).min(channels_in);
        let end = if layout.is_flat { self.n_rows * layout.width } else { c.columns };

        // The unsafe blocks below rely on these bounds.
        assert!(weights.len() == n_blocks * channels_in * TAPS * ROWS);
        assert!(tiles.len() >= n_blocks * ROWS * tile_len);
        assert!((self.image + 1) * c.channels_out * plane <= self.output.len);
        assert!(self.shift.is_none_or(|shift| shift.len() == n_blocks * ROWS));

        let mut start = 0;
        while start < end {
            let n_left = (end - start).div_ceil(lanes::<S>());
            // Four left are faster as two and two than as three and one.
            let n_vectors = if n_left >= 3 && n_left != 4 { 3 } else { n_left.min(2) };
            let stop = start + n_vectors * lanes::<S>();
            assert!((channels_in - 1) * layout.channel + last_offset + stop <= packed.len());
            let (pieces, n_pieces) = self.pieces(start, stop.min(end));
            let pieces = &pieces[..n_pieces];
            for piece in pieces {
                assert!(piece.in_tile + piece.len <= tile_len);
                assert!(piece.in_plane + (piece.len - 1) * c.upscale < plane);
            }
            // A tile that is one whole run of pixels goes straight to the output.
            let is_direct = c.upscale == 1 && n_pieces == 1 && pieces[0].len == n_vectors * lanes::<S>();

            let mut first = 0;
            while first < channels_in {
                let n_channels = pass_channels.min(channels_in - first);
                for block in 0..n_blocks {
                    let is_last = first + n_channels == channels_in;
                    let to_output = is_direct && is_last && (block + 1) * ROWS <= c.channels_out;
                    // SAFETY: by the asserts above, pixels: the last read ends at `last channel + last tap +
                    // stop`; weights: `n_channels * TAPS * ROWS` of this block's `channels_in * TAPS * ROWS`;
                    // tile and shift: block `block` of `n_blocks`; output: ROWS planes of this image, in each a
                    // piece as long as the tile, written by this task alone.
                    unsafe {
                        let tile = tiles.as_mut_ptr().add(block * ROWS * tile_len);
                        let (target, target_stride) = if to_output {
                            let channel = self.image * c.channels_out + block * ROWS;
                            (self.output.start.add(channel * plane + pieces[0].in_plane), plane)
                        } else {
                            (tile, tile_len)
                        };
                        let pass = Pass {
                            n_channels,
                            pixels: packed.as_ptr().add(first * layout.channel + start),
                            channel_stride: layout.channel,
                            offsets,
                            weights: weights.as_ptr().add((block * channels_in + first) * TAPS * ROWS),
                            start: match self.shift {
                                _ if first > 0 => Start::Tile,
                                Some(shift) => Start::Shift(shift.as_ptr().add(block * ROWS)),
                                None => Start::Zero,
                            },
                            has_relu: is_last && c.has_relu,
                            tile,
                            target,
                            target_stride,
                        };
                        if self.is_paired {
                            pass.run_pairs(n_vectors);
                            continue;
                        }
                        match n_vectors {
                            3 => pass.run::<S, ROWS, 3>(),
                            2 => pass.run::<S, ROWS, 2>(),
                            _ => pass.run::<S, ROWS, 1>(),
                        }
                    }
                }
                first += n_channels;
            }

            let first_copied = if is_direct { c.channels_out / ROWS * ROWS } else { 0 };
            for channel in first_copied..c.channels_out {
                for piece in pieces {
                    // SAFETY: the asserts above hold each piece inside its tile and its plane.
                    unsafe {
                        let from = tiles.as_ptr().add(channel * tile_len + piece.in_tile);
                        let image_channel = self.image * c.channels_out + channel;
                        let to = self.output.start.add(image_channel * plane + piece.in_plane);
                        copy_piece::<S>(from, to, piece.len, c.upscale);
                    }
                }
            }
            start = stop;
        }
    }
}
