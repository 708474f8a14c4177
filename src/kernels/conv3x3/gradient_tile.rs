//! Register tiles of the weight gradient, in f32 and in pairs of bf16: a few output channels by vectors of input channels; and
//! where their sums lie.

use crate::kernels::simd::{Scalar, Simd, lanes};

/// Rows of a tile, and lanes of a vector: those of AVX-512.
pub(super) const ROWS: usize = 8;
pub(super) const LANES: usize = 16;
/// Most vectors of a tile.
const VECTORS: usize = 3;

/// Sums for each pair of an output and an input channel, as tiles of [`ROWS`] by up to three vectors of [`LANES`] hold them:
/// `[group of blocks in][block out][channel out in block][block in in group][channel in in block]`.
#[derive(Clone, Copy)]
pub(super) struct PairSums {
    /// Blocks of LANES input channels.
    pub blocks_in: usize,
    /// Blocks of ROWS output channels.
    pub blocks_out: usize,
}

/// One tile of such sums.
pub(super) struct SumTile {
    /// The first block of input channels, and how many there are.
    pub first_in: usize,
    pub n_in: usize,
    pub block_out: usize,
    /// Where its sums begin.
    pub start: usize,
}

impl SumTile {
    pub fn len(&self) -> usize {
        ROWS * self.n_in * LANES
    }
}

impl PairSums {
    pub fn of(channels_in: usize, channels_out: usize) -> Self {
        Self { blocks_in: channels_in.div_ceil(LANES), blocks_out: channels_out.div_ceil(ROWS) }
    }

    pub fn len(self) -> usize {
        self.blocks_in * self.blocks_out * ROWS * LANES
    }

    fn tile(self, first_in: usize, block_out: usize) -> SumTile {
        let n_in = (self.blocks_in - first_in).min(VECTORS);
        let start = (first_in * self.blocks_out + block_out * n_in) * ROWS * LANES;
        SumTile { first_in, n_in, block_out, start }
    }

    /// All tiles, output channels innermost.
    pub fn tiles(self) -> impl Iterator<Item = SumTile> {
        let groups = (0..self.blocks_in).step_by(VECTORS);
        groups.flat_map(move |first_in| (0..self.blocks_out).map(move |out| self.tile(first_in, out)))
    }

    /// Where the sum of an output and an input channel lies.
    pub fn place(self, channel_out: usize, channel_in: usize) -> usize {
        let block_in = channel_in / LANES;
        let tile = self.tile(block_in / VECTORS * VECTORS, channel_out / ROWS);
        let vector = channel_out % ROWS * tile.n_in + block_in - tile.first_in;
        tile.start + vector * LANES + channel_in % LANES
    }
}

/// Operands of one register tile: strides in floats.
pub(super) struct Tile {
    pub n_rows: usize,
    pub n_pixels: usize,
    pub x: *const f32,
    pub x_row: usize,
    pub x_pixel: usize,
    /// From a vector of the tile to the next one's.
    pub x_vector: usize,
    pub dy: *const f32,
    pub dy_row: usize,
    pub dy_pixel: usize,
}

impl Tile {
    /// Adds the products of all pixels to `sums`, `[ROWS][VECTORS][LANES]`.
    ///
    /// # Safety
    /// In each row, VECTORS vectors of x are readable at each pixel, and ROWS floats of dy; `sums` is readable and writable.
    #[inline(always)]
    pub unsafe fn add<S: Simd, const ROWS: usize, const VECTORS: usize>(self, sums: *mut f32) {
        // SAFETY: every access is one of those listed above.
        unsafe {
            let mut tile = [[0f32.splat::<S>(); VECTORS]; ROWS];
            for (row, tile) in tile.iter_mut().enumerate() {
                for (k, sum) in tile.iter_mut().enumerate() {
                    *sum = f32::vload_unaligned::<S>(sums.add((row * VECTORS + k) * lanes::<S>()));
                }
            }
            for row in 0..self.n_rows {
                let (mut x, mut dy) = (self.x.add(row * self.x_row), self.dy.add(row * self.dy_row));
                for _ in 0..self.n_pixels {
                    let mut vectors = [0f32.splat::<S>(); VECTORS];
                    for (k, vector) in vectors.iter_mut().enumerate() {
                        *vector = f32::vload_unaligned::<S>(x.add(k * self.x_vector));
                    }
                    for (row, tile) in tile.iter_mut().enumerate() {
                        let dy = (*dy.add(row)).splat::<S>();
                        for (sum, x) in tile.iter_mut().zip(vectors) {
                            *sum = dy.mul_add(x, *sum);
                        }
                    }
                    x = x.wrapping_add(self.x_pixel);
                    dy = dy.wrapping_add(self.dy_pixel);
                }
            }
            for (row, tile) in tile.iter().enumerate() {
                for (k, sum) in tile.iter().enumerate() {
                    f32::vstore_unaligned::<S>(sums.add((row * VECTORS + k) * lanes::<S>()), *sum);
                }
            }
        }
    }
}

/// As [`Tile`], in pairs of bf16.
#[cfg_attr(not(target_arch = "x86_64"), allow(dead_code, reason = "other CPUs have no pairs"))]
pub(super) struct PairTile {
    pub n_rows: usize,
    pub n_pairs: usize,
    pub x: *const f32,
    pub x_row: usize,
    /// From a vector of the tile to the next one's.
    pub x_vector: usize,
    pub dy: *const f32,
    pub dy_row: usize,
}

#[cfg(target_arch = "x86_64")]
impl PairTile {
    /// Adds the products of all pixels to `sums`, `[ROWS][VECTORS][LANES]`.
    ///
    /// # Safety
    /// The CPU has AVX512-BF16. In each row a vector of x is readable for each pair and each of VECTORS, and ROWS floats of dy for
    /// each pair, LANES apart; `sums` is readable and writable.
    #[target_feature(enable = "avx512f,avx512bf16")]
    pub unsafe fn add<const VECTORS: usize>(self, sums: *mut f32) {
        use std::arch::x86_64::{
            __m512, __m512bh, _mm512_dpbf16_ps, _mm512_loadu_ps, _mm512_set1_ps, _mm512_storeu_ps,
        };
        use std::mem::transmute;

        // SAFETY: every access is one of those listed above; the vectors' types have one size, and any bits are valid.
        unsafe {
            let mut tile = [[_mm512_set1_ps(0.0); VECTORS]; ROWS];
            for (row, tile) in tile.iter_mut().enumerate() {
                for (k, sum) in tile.iter_mut().enumerate() {
                    *sum = _mm512_loadu_ps(sums.add((row * VECTORS + k) * LANES));
                }
            }
            for row in 0..self.n_rows {
                let (mut x, mut dy) = (self.x.add(row * self.x_row), self.dy.add(row * self.dy_row));
                for _ in 0..self.n_pairs {
                    let vectors: [_; VECTORS] = std::array::from_fn(|k| {
                        transmute::<__m512, __m512bh>(_mm512_loadu_ps(x.add(k * self.x_vector)))
                    });
                    for (row, tile) in tile.iter_mut().enumerate() {
                        let dy = transmute::<__m512, __m512bh>(_mm512_set1_ps(*dy.add(row)));
                        for (sum, &x) in tile.iter_mut().zip(&vectors) {
                            *sum = _mm512_dpbf16_ps(*sum, dy, x);
                        }
                    }
                    x = x.wrapping_add(LANES);
                    dy = dy.wrapping_add(LANES);
                }
            }
            for (row, tile) in tile.iter().enumerate() {
                for (k, sum) in tile.iter().enumerate() {
                    _mm512_storeu_ps(sums.add((row * VECTORS + k) * LANES), *sum);
                }
            }
        }
    }
}

#[cfg(not(target_arch = "x86_64"))]
impl PairTile {
    /// # Safety
    /// Never called: other CPUs have no pairs.
    pub unsafe fn add<const VECTORS: usize>(self, _: *mut f32) {
        unreachable!("`has_pairs` is false");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pair_of_channels_has_a_sum_of_its_own_and_tiles_hold_them_all() {
        for (channels_in, channels_out) in [(1, 1), (16, 8), (33, 9), (64, 20), (96, 96), (120, 17)] {
            let sums = PairSums::of(channels_in, channels_out);
            let mut in_tiles = vec![0; sums.len()];
            for tile in sums.tiles() {
                in_tiles[tile.start..][..tile.len()].iter_mut().for_each(|n| *n += 1);
            }
            assert!(in_tiles.iter().all(|&n| n == 1));
            let mut places: Vec<usize> = (0..channels_in * channels_out)
                .map(|at| sums.place(at / channels_in, at % channels_in))
                .collect();
            places.sort_unstable();
            places.dedup();
            assert_eq!(places.len(), channels_in * channels_out);
            assert!(places.last().is_some_and(|&last| last < sums.len()));
        }
    }
}
