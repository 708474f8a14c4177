//! One register tile: adds up the products of some input channels and stores the sums.

use crate::kernels::simd::{Scalar, Simd, lanes};

/// Vectors of pixels in a register tile.
pub(super) const TILE_VECTORS: usize = 3;

/// Start values of the sums.
#[derive(Clone, Copy)]
pub(super) enum Start {
    Zero,
    /// A value for each row.
    Shift(*const f32),
    /// The sums of the pass before.
    Tile,
}

/// Some input channels of one tile.
pub(super) struct Pass<'a, const TAPS: usize> {
    pub n_channels: usize,
    pub pixels: *const f32,
    pub channel_stride: usize,
    pub offsets: &'a [usize; TAPS],
    pub weights: *const f32,
    pub start: Start,
    /// Whether negative sums become zero.
    pub has_relu: bool,
    pub tile: *const f32,
    pub target: *mut f32,
    pub target_stride: usize,
}

impl<const TAPS: usize> Pass<'_, TAPS> {
    /// Adds the products to the sums of ROWS output channels by VECTORS vectors of pixels.
    ///
    /// # Safety
    /// These are readable: VECTORS vectors of pixels at each tap of each channel, `n_channels * TAPS * ROWS` weights, and,
    /// if sums start there, ROWS shifts or the tile (rows TILE_VECTORS vectors apart). VECTORS vectors are
    /// writable in each of ROWS rows of `target`.
    #[inline(always)]
    pub unsafe fn run<S: Simd, const ROWS: usize, const VECTORS: usize>(self) {
        // SAFETY: every access is one of those listed above.
        unsafe {
            let mut sums = [[0f32.splat::<S>(); VECTORS]; ROWS];
            for (row, sums) in sums.iter_mut().enumerate() {
                for (j, sum) in sums.iter_mut().enumerate() {
                    let in_tile = (row * TILE_VECTORS + j) * lanes::<S>();
                    match self.start {
                        Start::Zero => {}
                        Start::Shift(shift) => *sum = (*shift.add(row)).splat(),
                        Start::Tile => *sum = f32::vload_unaligned(self.tile.add(in_tile)),
                    }
                }
            }
            let (mut pixels, mut weights) = (self.pixels, self.weights);
            for _ in 0..self.n_channels {
                for t in 0..TAPS {
                    let tap = pixels.add(self.offsets[t]);
                    let mut x = [0f32.splat::<S>(); VECTORS];
                    for (j, x) in x.iter_mut().enumerate() {
                        *x = f32::vload_unaligned(tap.add(j * lanes::<S>()));
                    }
                    for (row, sums) in sums.iter_mut().enumerate() {
                        let weight = (*weights.add(row)).splat::<S>();
                        for (sum, x) in sums.iter_mut().zip(x) {
                            *sum = weight.mul_add(x, *sum);
                        }
                    }
                    weights = weights.add(ROWS);
                }
                pixels = pixels.wrapping_add(self.channel_stride);
            }
            for (row, sums) in sums.iter().enumerate() {
                for (j, &sum) in sums.iter().enumerate() {
                    let sum = if self.has_relu { sum.max(0f32.splat()) } else { sum };
                    f32::vstore_unaligned(self.target.add(row * self.target_stride + j * lanes::<S>()), sum);
                }
            }
        }
    }
}

/// Rows of a tile of pairs, and lanes of its vectors: those of AVX-512.
const PAIR_ROWS: usize = 8;
const PAIR_LANES: usize = 16;

impl<const TAPS: usize> Pass<'_, TAPS> {
    /// As [`Self::run`] on AVX-512, of pairs of bf16 in place of f32: `n_channels` counts pairs of channels.
    ///
    /// # Safety
    /// As for [`Self::run`], and the CPU has AVX512-BF16.
    #[inline(always)]
    pub unsafe fn run_pairs(self, n_vectors: usize) {
        debug_assert!(!self.has_relu, "inference multiplies f32");
        // SAFETY: the caller's.
        unsafe {
            match n_vectors {
                3 => self.pairs::<3>(),
                2 => self.pairs::<2>(),
                _ => self.pairs::<1>(),
            }
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512bf16")]
    unsafe fn pairs<const VECTORS: usize>(self) {
        use std::arch::x86_64::{
            __m512, __m512bh, _mm512_dpbf16_ps, _mm512_loadu_ps, _mm512_set1_ps, _mm512_storeu_ps,
        };
        use std::mem::transmute;

        // SAFETY: every access is one of those of `run`; the vectors' types have one size, and any bits are valid.
        unsafe {
            let mut sums = [[_mm512_set1_ps(0.0); VECTORS]; PAIR_ROWS];
            for (row, sums) in sums.iter_mut().enumerate() {
                for (j, sum) in sums.iter_mut().enumerate() {
                    match self.start {
                        Start::Zero => {}
                        Start::Shift(shift) => *sum = _mm512_set1_ps(*shift.add(row)),
                        Start::Tile => {
                            *sum = _mm512_loadu_ps(self.tile.add((row * TILE_VECTORS + j) * PAIR_LANES));
                        }
                    }
                }
            }
            let (mut pixels, mut weights) = (self.pixels, self.weights);
            for _ in 0..self.n_channels {
                for t in 0..TAPS {
                    let tap = pixels.add(self.offsets[t]);
                    let x: [_; VECTORS] = std::array::from_fn(|j| {
                        transmute::<__m512, __m512bh>(_mm512_loadu_ps(tap.add(j * PAIR_LANES)))
                    });
                    for (row, sums) in sums.iter_mut().enumerate() {
                        let weight = transmute::<__m512, __m512bh>(_mm512_set1_ps(*weights.add(row)));
                        for (sum, &x) in sums.iter_mut().zip(&x) {
                            *sum = _mm512_dpbf16_ps(*sum, weight, x);
                        }
                    }
                    weights = weights.add(PAIR_ROWS);
                }
                pixels = pixels.wrapping_add(self.channel_stride);
            }
            for (row, sums) in sums.iter().enumerate() {
                for (j, &sum) in sums.iter().enumerate() {
                    _mm512_storeu_ps(self.target.add(row * self.target_stride + j * PAIR_LANES), sum);
                }
            }
        }
    }

    #[cfg(not(target_arch = "x86_64"))]
    unsafe fn pairs<const VECTORS: usize>(self) {
        unreachable!("other CPUs have no pairs");
    }
}

/// Copies `len` floats to every `upscale`-th float; whole vectors where they are dense, the last overlapping.
///
/// # Safety
/// `len` floats are readable, `(len - 1) * upscale + 1` writable, no overlap.
#[inline(always)]
pub(super) unsafe fn copy_piece<S: Simd>(from: *const f32, to: *mut f32, len: usize, upscale: usize) {
    // SAFETY: every index is below `len`; a vector ends at `i + LANES <= len` or at `len`.
    unsafe {
        if upscale != 1 || len < lanes::<S>() {
            for i in 0..len {
                *to.add(i * upscale) = *from.add(i);
            }
            return;
        }
        let mut i = 0;
        while i + lanes::<S>() <= len {
            f32::vstore_unaligned::<S>(to.add(i), f32::vload_unaligned::<S>(from.add(i)));
            i += lanes::<S>();
        }
        if i < len {
            f32::vstore_unaligned(
                to.add(len - lanes::<S>()),
                f32::vload_unaligned::<S>(from.add(len - lanes::<S>())),
            );
        }
    }
}
