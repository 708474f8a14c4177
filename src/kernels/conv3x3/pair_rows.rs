//! Rows of pixels in pairs of bf16 with channels in the lanes, as the weight gradient multiplies them.

use super::gradient_tile::LANES;
use crate::kernels::products::HALF;
use crate::kernels::scratch::Buffer;
use crate::kernels::transpose::transpose;

/// Pairs that a row of output pixels takes in memory: whole blocks of a transpose.
pub(super) fn padded_pairs(n_pixels: usize) -> usize {
    n_pixels.div_ceil(2).next_multiple_of(LANES)
}

/// Neighbouring rows of several channels of an image.
pub(super) struct ChannelRows<'a> {
    /// The floats of the first channel and all behind it.
    pub values: &'a [f32],
    pub channels: usize,
    pub height_px: usize,
    pub width_px: usize,
    /// The first row; those outside of the image are zero.
    pub first: isize,
    pub n_rows: usize,
}

impl ChannelRows<'_> {
    /// Row `row` of these; `None` outside of the image and beyond the last channel.
    #[inline(always)]
    pub fn of(&self, channel: usize, row: usize) -> Option<&[f32]> {
        let y = usize::try_from(self.first + row as isize).ok().filter(|&y| y < self.height_px)?;
        (channel < self.channels)
            .then(|| &self.values[(channel * self.height_px + y) * self.width_px..][..self.width_px])
    }

    /// Lays the channels out in pairs of the inputs of neighbouring output pixels, for each of some kernel columns:
    /// `[row][block of LANES channels][column][pair][LANES]`, pairs as in [`padded_pairs`], zero outside of the image and beyond
    /// the last channel.
    ///
    /// # Safety
    /// The CPU has AVX-512.
    #[inline(always)]
    pub unsafe fn pair<const COLUMNS: usize>(
        &self,
        lead: isize,
        [stride, n_pixels]: [usize; 2],
        buffer: &mut Buffer,
        pairs: &mut [f32],
    ) {
        let (n_pairs, n_rows) = (padded_pairs(n_pixels), self.n_rows);
        let row_len = COLUMNS * n_pairs;
        let (n_blocks, block_len) = (self.channels.div_ceil(LANES), row_len * LANES);
        assert_eq!(pairs.len(), n_rows * n_blocks * block_len);
        // A cache line more, so that the lanes of a pixel do not share one set of the cache.
        let lane_len = n_rows * row_len + LANES;
        let lanes = buffer.get(LANES * lane_len);
        for block in 0..n_blocks {
            // All rows of a channel in turn, as they lie in memory.
            for (lane, rows) in lanes.chunks_exact_mut(lane_len).enumerate() {
                for (row, words) in rows[..n_rows * row_len].chunks_exact_mut(row_len).enumerate() {
                    let Some(pixels) = self.of(block * LANES + lane, row) else {
                        words.fill(0.0);
                        continue;
                    };
                    for (column, words) in words.chunks_exact_mut(n_pairs).enumerate() {
                        let first = column as isize - lead;
                        // SAFETY: `padded_pairs` are whole vectors; the caller's promise.
                        unsafe {
                            match stride {
                                1 => pair_neighbours::<1>(pixels, first, words),
                                _ => pair_neighbours::<2>(pixels, first, words),
                            }
                        }
                    }
                }
            }
            for row in 0..n_rows {
                let to = &mut pairs[(row * n_blocks + block) * block_len..][..block_len];
                for (at, to) in to.chunks_exact_mut(LANES * LANES).enumerate() {
                    let from = &lanes[row * row_len + at * LANES..];
                    assert!(from.len() >= (LANES - 1) * lane_len + LANES);
                    // SAFETY: 16 rows of 16 words, `lane_len` apart, are readable by the assert; 256 are writable; the caller's
                    // promise.
                    unsafe { transpose(from.as_ptr().cast(), lane_len, to.as_mut_ptr().cast()) };
                }
            }
        }
    }
}

/// Pairs of pixels that lie a stride apart, as [`pair`](crate::kernels::products::pair) makes them, from pixel `first` on; zero
/// outside of the row. Vectors by name, as the compiler finds none.
///
/// # Safety
/// The CPU has AVX-512, and `pairs` are whole vectors.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw")]
pub(super) unsafe fn pair_neighbours<const STRIDE: usize>(pixels: &[f32], first: isize, pairs: &mut [f32]) {
    use std::arch::x86_64::{
        __m512i, _mm512_add_epi32, _mm512_castps_si512, _mm512_castsi512_ps, _mm512_loadu_si512,
        _mm512_maskz_loadu_ps, _mm512_permutex2var_epi16, _mm512_permutex2var_ps, _mm512_set1_epi32,
        _mm512_storeu_ps,
    };
    // Of two vectors, the upper half of each float; and every other float.
    const UPPER: [u16; 32] = {
        let mut places = [0; 32];
        let mut at = 0;
        while at < 32 {
            places[at] = 2 * at as u16 + 1;
            at += 1;
        }
        places
    };
    const EVEN: [u32; 16] = {
        let mut places = [0; 16];
        let mut at = 0;
        while at < 16 {
            places[at] = 2 * at as u32;
            at += 1;
        }
        places
    };
    let n_lanes = LANES as isize;
    let load = |at: isize| {
        let (below, above) = ((-at).clamp(0, n_lanes), (pixels.len() as isize - at).clamp(0, n_lanes));
        let mask = (((1u32 << above) - 1) & !((1u32 << below) - 1)) as u16;
        // SAFETY: lanes outside of the row are masked out, and not read.
        unsafe { _mm512_maskz_loadu_ps(mask, pixels.as_ptr().wrapping_offset(at)) }
    };
    // SAFETY: both constants are a vector long.
    let (upper, even) =
        unsafe { (_mm512_loadu_si512(UPPER.as_ptr().cast()), _mm512_loadu_si512(EVEN.as_ptr().cast())) };
    let half = _mm512_set1_epi32(HALF as i32);
    let rounded = |at: isize| -> __m512i {
        let floats = if STRIDE == 1 {
            load(first + at)
        } else {
            _mm512_permutex2var_ps(load(first + 2 * at), even, load(first + 2 * at + n_lanes))
        };
        _mm512_add_epi32(_mm512_castps_si512(floats), half)
    };
    for (at, pairs) in pairs.chunks_exact_mut(LANES).enumerate() {
        let at = 2 * (at * LANES) as isize;
        let halves = _mm512_permutex2var_epi16(rounded(at), upper, rounded(at + n_lanes));
        // SAFETY: a chunk is a vector long.
        unsafe { _mm512_storeu_ps(pairs.as_mut_ptr(), _mm512_castsi512_ps(halves)) };
    }
}

/// # Safety
/// Never called: other CPUs have no AVX-512.
#[cfg(not(target_arch = "x86_64"))]
pub(super) unsafe fn pair_neighbours<const STRIDE: usize>(_: &[f32], _: isize, _: &mut [f32]) {
    unreachable!("callers ask for AVX-512");
}
