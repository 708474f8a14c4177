//! A band of input rows, packed with its zero padding so that a tap is a constant offset.
//!
//! `split` 1 keeps the rows as they are; `split` 2 (stride 2) sorts pixels by the parity of y and x into
//! four planes, so that neighbouring outputs read neighbouring inputs. Wide images are packed
//! `[row][channel][x]`; narrow ones (`flat`) `[channel][row][x]`, where a tile may run on into the next row.

/// The planes that are packed.
#[derive(Clone, Copy)]
pub(super) struct Planes<'a> {
    /// `[batch, channel, y, x]`
    pub values: &'a [f32],
    pub channels: usize,
    pub height_px: usize,
    pub width_px: usize,
    /// 1, or 2 for planes sorted by parity.
    pub split: usize,
    /// Columns and rows of padding before the first pixel: 0 or 1.
    pub lead: usize,
}

/// Strides of a packed band, in floats.
#[derive(Clone, Copy)]
pub(super) struct Layout {
    /// Whether tiles run across rows.
    pub is_flat: bool,
    /// Width of a packed row.
    pub width: usize,
    /// Packed rows of one parity.
    pub rows: usize,
    /// Stride from a channel to the next.
    pub channel: usize,
    /// Stride from a row to the next of the same parity.
    pub row: usize,
    /// Stride from even to odd rows (of padded input), if `split` is 2.
    pub row_parity: usize,
    /// Stride from even to odd columns (of padded input), if `split` is 2.
    pub column_parity: usize,
    /// Floats of the band.
    pub len: usize,
}

impl Layout {
    /// The layout for bands of `band_rows` rows of `width` tile positions each.
    pub fn new(is_flat: bool, source: &Planes, width: usize, band_rows: usize) -> Self {
        let Planes { channels, split, lead, .. } = *source;
        // A flat row shares its right padding with the left padding of the next.
        let width = width + if is_flat { 1 } else { 2 };
        let rows = if split == 2 { band_rows + 1 } else { band_rows + 1 + lead };
        let len = channels * split * split * (rows * width + 1);
        let plane = rows * width;
        if is_flat {
            Self {
                is_flat,
                width,
                rows,
                channel: split * split * plane + 1,
                row: width,
                row_parity: 2 * plane,
                column_parity: plane,
                len,
            }
        } else {
            let one_row = channels * width * split;
            Self {
                is_flat,
                width,
                rows,
                channel: width * split,
                row: one_row * split,
                row_parity: one_row,
                column_parity: width,
                len,
            }
        }
    }

    /// Offset of packed row `part` of a channel, counted through the parities of y and x.
    pub fn part(&self, split: usize, part: usize) -> usize {
        let (parity, row) = (part / self.rows, part % self.rows);
        let of_parity =
            if split == 1 { 0 } else { parity / 2 * self.row_parity + parity % 2 * self.column_parity };
        of_parity + row * self.row
    }

    /// Offset of kernel tap (`y`, `x`) in a forward pass.
    pub fn tap(&self, split: usize, y: usize, x: usize) -> usize {
        if split == 1 {
            y * self.row + x
        } else {
            (y % 2) * self.row_parity + (y / 2) * self.row + (x % 2) * self.column_parity + x / 2
        }
    }
}

/// Packs the rows of image `image` that the output rows from `first_row` on read; rows outside are zero.
#[inline(always)]
pub(super) fn pack(source: &Planes, layout: &Layout, image: usize, first_row: usize, packed: &mut [f32]) {
    let Planes { values, channels, height_px, width_px, split, lead } = *source;
    // Row after row of a channel, as they lie in memory.
    for channel in 0..channels {
        let start = channel * layout.channel;
        for row in 0..layout.rows * split {
            // Wraps around above the image, and so lands outside, as rows below the image do.
            let y = (first_row * split + row).wrapping_sub(lead);
            let pixels = if y < height_px {
                &values[((image * channels + channel) * height_px + y) * width_px..][..width_px]
            } else {
                &[]
            };
            if split == 1 {
                let start = start + row * layout.row;
                let packed = &mut packed[start..start + layout.width];
                packed[..lead].fill(0.0);
                packed[lead..lead + pixels.len()].copy_from_slice(pixels);
                packed[lead + pixels.len()..].fill(0.0);
            } else {
                let start = start + (row % 2) * layout.row_parity + (row / 2) * layout.row;
                let (head, tail) = packed.split_at_mut(start + layout.column_parity);
                split_columns(pixels, &mut head[start..start + layout.width], &mut tail[..layout.width]);
            }
        }
        if layout.is_flat {
            // The float between two channels is the right padding of the first one's last row.
            packed[(channel + 1) * layout.channel - 1] = 0.0;
        }
    }
}

/// Copies pixels 1, 3, 5.. to `even` (after a zero) and 0, 2, 4.. to `odd`: parities count the padding.
#[inline(always)]
fn split_columns(pixels: &[f32], even: &mut [f32], odd: &mut [f32]) {
    even[0] = 0.0;
    let n_split = split_vectors(pixels, &mut even[1..], odd);
    for (at, pair) in pixels.chunks_exact(2).enumerate().skip(n_split) {
        odd[at] = pair[0];
        even[at + 1] = pair[1];
    }
    let half = pixels.len() / 2;
    if pixels.len() % 2 == 1 {
        odd[half] = pixels[pixels.len() - 1];
    }
    odd[pixels.len().div_ceil(2)..].fill(0.0);
    even[half + 1..].fill(0.0);
}

/// Copies pixels by turns to `first` and `second` as far as whole vectors go, where the CPU has such; returns how many it gave to
/// each.
#[inline(always)]
fn split_vectors(pixels: &[f32], second: &mut [f32], first: &mut [f32]) -> usize {
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    if std::arch::is_x86_feature_detected!("avx512f") {
        let blocks = pixels.as_chunks::<32>().0;
        let (first, second) = (first.as_chunks_mut::<16>().0, second.as_chunks_mut::<16>().0);
        // SAFETY: the CPU has AVX-512.
        unsafe { split_blocks(blocks, second, first) };
        return 16 * blocks.len().min(first.len()).min(second.len());
    }
    0
}

/// Vectors by name, as the compiler finds none.
///
/// # Safety
/// The CPU has AVX-512.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
unsafe fn split_blocks(blocks: &[[f32; 32]], second: &mut [[f32; 16]], first: &mut [[f32; 16]]) {
    use std::arch::x86_64::{_mm512_loadu_ps, _mm512_permutex2var_ps, _mm512_set_epi32, _mm512_storeu_ps};
    let even = _mm512_set_epi32(30, 28, 26, 24, 22, 20, 18, 16, 14, 12, 10, 8, 6, 4, 2, 0);
    let odd = _mm512_set_epi32(31, 29, 27, 25, 23, 21, 19, 17, 15, 13, 11, 9, 7, 5, 3, 1);
    for (block, (first, second)) in blocks.iter().zip(first.iter_mut().zip(second)) {
        // SAFETY: a block is two vectors long, a part of it one.
        unsafe {
            let (a, b) = (_mm512_loadu_ps(block.as_ptr()), _mm512_loadu_ps(block.as_ptr().add(16)));
            _mm512_storeu_ps(first.as_mut_ptr(), _mm512_permutex2var_ps(a, even, b));
            _mm512_storeu_ps(second.as_mut_ptr(), _mm512_permutex2var_ps(a, odd, b));
        }
    }
}
