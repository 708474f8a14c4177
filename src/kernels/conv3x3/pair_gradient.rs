//! The register tile of the weight gradient in pairs of bf16: of two neighbouring output pixels, for each of the three
//! columns of a kernel row.

use crate::kernels::products::pair;

/// Pairs the input for each kernel column: `[column][pair of pixels][LANES]` from `[pixel][LANES]`, zero for a pixel
/// beyond the last.
#[inline(always)]
pub(super) fn pair_columns<const LANES: usize>(
    pixels: &[f32],
    n_pixels: usize,
    stride: usize,
    pairs: &mut [f32],
) {
    let n_pairs = n_pixels.div_ceil(2);
    for (column, pairs) in pairs.chunks_exact_mut(n_pairs * LANES).enumerate() {
        for (i, pairs) in pairs.chunks_exact_mut(LANES).enumerate() {
            let first = &pixels[(2 * i * stride + column) * LANES..][..LANES];
            if 2 * i + 1 < n_pixels {
                let second = &pixels[((2 * i + 1) * stride + column) * LANES..][..LANES];
                for (pair_of, (&a, &b)) in pairs.iter_mut().zip(first.iter().zip(second)) {
                    *pair_of = pair(a, b);
                }
            } else {
                for (pair_of, &a) in pairs.iter_mut().zip(first) {
                    *pair_of = pair(a, 0.0);
                }
            }
        }
    }
}

/// Operands of one register tile: strides in pairs.
#[cfg_attr(not(target_arch = "x86_64"), allow(dead_code, reason = "other CPUs have no pairs"))]
pub(super) struct PairTile {
    pub n_rows: usize,
    pub n_pairs: usize,
    pub x: *const f32,
    pub x_row: usize,
    /// From a kernel column's pairs to the next one's.
    pub x_column: usize,
    pub dy: *const f32,
    pub dy_row: usize,
}

/// Rows of a tile, and lanes of a vector: those of AVX-512.
pub(super) const ROWS: usize = 8;
pub(super) const LANES: usize = 16;

#[cfg(target_arch = "x86_64")]
impl PairTile {
    /// Adds the products of all pixels to `sums`, `[ROWS][3][LANES]`.
    ///
    /// # Safety
    /// The CPU has AVX512-BF16. In each row a vector of x is readable for each pair and column, and ROWS floats of dy for each
    /// pair; `sums` is readable and writable.
    #[target_feature(enable = "avx512f,avx512bf16")]
    pub unsafe fn add(self, sums: *mut f32) {
        use std::arch::x86_64::{
            __m512, __m512bh, _mm512_dpbf16_ps, _mm512_loadu_ps, _mm512_set1_ps, _mm512_storeu_ps,
        };
        use std::mem::transmute;

        // SAFETY: every access is one of those listed above; the vectors' types have one size, and any bits are valid.
        unsafe {
            let mut tile = [[_mm512_set1_ps(0.0); 3]; ROWS];
            for (row, tile) in tile.iter_mut().enumerate() {
                for (k, sum) in tile.iter_mut().enumerate() {
                    *sum = _mm512_loadu_ps(sums.add((row * 3 + k) * LANES));
                }
            }
            for row in 0..self.n_rows {
                let (mut x, mut dy) = (self.x.add(row * self.x_row), self.dy.add(row * self.dy_row));
                for _ in 0..self.n_pairs {
                    let columns = [0, 1, 2]
                        .map(|k| transmute::<__m512, __m512bh>(_mm512_loadu_ps(x.add(k * self.x_column))));
                    for (row, tile) in tile.iter_mut().enumerate() {
                        let dy = transmute::<__m512, __m512bh>(_mm512_set1_ps(*dy.add(row)));
                        for (sum, &x) in tile.iter_mut().zip(&columns) {
                            *sum = _mm512_dpbf16_ps(*sum, dy, x);
                        }
                    }
                    x = x.wrapping_add(LANES);
                    dy = dy.wrapping_add(ROWS);
                }
            }
            for (row, tile) in tile.iter().enumerate() {
                for (k, sum) in tile.iter().enumerate() {
                    _mm512_storeu_ps(sums.add((row * 3 + k) * LANES), *sum);
                }
            }
        }
    }
}

#[cfg(not(target_arch = "x86_64"))]
impl PairTile {
    /// # Safety
    /// Never called: other CPUs have no pairs.
    pub unsafe fn add(self, _: *mut f32) {
        unreachable!("`has_pairs` is false");
    }
}
