//! Bands and weights in pairs of bf16: two neighbouring channels in the place of one f32, so that the tiles of
//! [`super::tiles`] stay as they are and take half as many steps.

use rayon::prelude::*;

use super::band::{Layout, Planes, pack};
use crate::kernels::products::pair;
use crate::kernels::scratch::Buffer;
use crate::kernels::simd::InstructionSet;

/// Fewest input channels worth it.
const MIN_CHANNELS: usize = 8;

/// Whether products of these numbers of channels are of pairs.
pub(super) fn uses_pairs(set: InstructionSet, channels_in: usize) -> bool {
    set.has_pairs() && channels_in >= MIN_CHANNELS
}

/// Weights as `[block of channels_out][pair of channels_in][tap][channel_out in block]`, zero beyond the last channels. The
/// arguments are those of `tiles::pack_weights`.
pub(super) fn pack_weights(
    n_rows: usize,
    w: &[f32],
    channels: (usize, usize),
    strides: (usize, usize),
    taps: &[usize],
) -> Vec<f32> {
    let (n_pairs, n_taps) = (channels.1.div_ceil(2), taps.len());
    let mut packed = vec![0.0; channels.0.div_ceil(n_rows) * n_rows * n_pairs * n_taps];
    packed.par_chunks_exact_mut(n_pairs * n_taps * n_rows).enumerate().for_each(|(block, packed)| {
        let first = block * n_rows;
        for (i, packed) in packed.chunks_exact_mut(n_taps * n_rows).enumerate() {
            for o in 0..n_rows.min(channels.0 - first) {
                let kernel = &w[(first + o) * strides.0 + 2 * i * strides.1..];
                for (t, &tap) in taps.iter().enumerate() {
                    let second = if 2 * i + 1 < channels.1 { kernel[strides.1 + tap] } else { 0.0 };
                    packed[t * n_rows + o] = pair(kernel[tap], second);
                }
            }
        }
    });
    packed
}

/// Packs a band in pairs, as `band::pack` packs numbers; `buffer` holds what lies between.
#[inline(always)]
pub(super) fn pack_pairs(
    source: &Planes,
    [numbers, layout]: [&Layout; 2],
    image: usize,
    first_row: usize,
    buffer: &mut Buffer,
    pairs: &mut [f32],
) {
    let band = buffer.get(numbers.len);
    pack(source, numbers, image, first_row, band);
    let n_parts = source.split * source.split * layout.rows;
    for i in 0..source.channels.div_ceil(2) {
        let has_second = 2 * i + 1 < source.channels;
        for part in 0..n_parts {
            // Rows of all parities: those of a layout lie in the same order.
            let place = |of: &Layout, channel: usize| channel * of.channel + of.part(source.split, part);
            let target = &mut pairs[place(layout, i)..][..layout.width];
            let first = &band[place(numbers, 2 * i)..][..layout.width];
            if has_second {
                let second = &band[place(numbers, 2 * i + 1)..][..layout.width];
                for (target, (&a, &b)) in target.iter_mut().zip(first.iter().zip(second)) {
                    *target = pair(a, b);
                }
            } else {
                for (target, &a) in target.iter_mut().zip(first) {
                    *target = pair(a, 0.0);
                }
            }
        }
        if layout.is_flat {
            // As in a band of numbers: the right padding of the last row.
            pairs[(i + 1) * layout.channel - 1] = 0.0;
        }
    }
}
