//! Mixes the channels of a map, a linear layer over each pixel: forward pass and gradients, f32.
//!
//! ```text
//! y[b, o, p] = sum_i w[o, i] x[b, i, p] + bias[o]
//! ```
//!
//! The products are those of [`mod@super::conv3x3`] with one tap, in f32 or in pairs of bf16; the gradient of w is one of the
//! crate `gemm` where there is neither a matrix unit nor pairs. Every sum runs in an order that the shape fixes.

mod burn_op;

use rayon::prelude::*;

use super::conv3x3::Mix;
use super::product::{Matrix, multiply};
use super::simd::InstructionSet;

pub use burn_op::mix_channels;

/// Output channels of a task.
const CHANNELS_PER_TASK: usize = 16;

/// The gradient of w, `[channel_out, channel_in]`.
pub(super) fn weight_gradient(mix: Mix, x: &[f32], dy: &[f32], set: InstructionSet) -> Vec<f32> {
    let Mix { batch, channels_in, channels_out, pixels } = mix;
    if let Some(gradient) = mix.weight_gradient(x, dy, set) {
        return gradient;
    }
    let mut gradient = vec![0.0; channels_out * channels_in];
    gradient.par_chunks_mut(CHANNELS_PER_TASK * channels_in).enumerate().for_each(|(task, gradient)| {
        for image in 0..batch {
            let first = image * channels_out + task * CHANNELS_PER_TASK;
            let n_rows = gradient.len() / channels_in;
            let of_channels = Matrix::new(&dy[first * pixels..][..n_rows * pixels], n_rows, pixels);
            let x = &x[image * channels_in * pixels..][..channels_in * pixels];
            multiply(of_channels, Matrix::new(x, channels_in, pixels).transposed(), gradient, true);
        }
    });
    gradient
}

/// The gradient of the bias, `[channel_out]`: sums over pixels, each in f64 over images.
fn bias_gradient(mix: Mix, dy: &[f32]) -> Vec<f32> {
    let mut gradient = vec![0.0; mix.channels_out];
    gradient.par_iter_mut().enumerate().for_each(|(o, gradient)| {
        let planes = dy.chunks_exact(mix.pixels).skip(o).step_by(mix.channels_out);
        *gradient = planes.map(|plane| f64::from(sum(plane))).sum::<f64>() as f32;
    });
    gradient
}

/// Sums in lanes, then these one after the other.
fn sum(values: &[f32]) -> f32 {
    const LANES: usize = 16;
    let (whole, rest) = values.as_chunks::<LANES>();
    let mut lanes = [0f32; LANES];
    for values in whole {
        for (lane, value) in lanes.iter_mut().zip(values) {
            *lane += value;
        }
    }
    lanes.iter().chain(rest).sum()
}

#[cfg(test)]
mod tests {
    use super::super::conv3x3::Weight;
    use super::super::products::Products;
    use super::*;

    /// Pixels that fill rows of whole tiles, rows of another width, and one row; channels beyond and below whole tiles.
    #[test]
    fn every_pass_equals_plain_sums_on_every_instruction_set() {
        for (batch, channels_in, channels_out, pixels) in [
            (2, 64, 48, 320),
            (1, 20, 33, 58),
            (2, 3, 64, 96),
            (1, 33, 2, 31),
            (2, 65, 80, 1450),
            (1, 1, 1, 1),
        ] {
            let mix = Mix { batch, channels_in, channels_out, pixels };
            let mut random = crate::random::stream(5, "channel-mix-test", pixels as u64);
            let mut draw = |n: usize| -> Vec<f32> {
                (0..n).map(|_| rand::RngExt::random_range(&mut random, -0.5..0.5)).collect()
            };
            let (x, dy) = (draw(batch * channels_in * pixels), draw(batch * channels_out * pixels));
            let (w, bias) = (draw(channels_out * channels_in), draw(channels_out));
            let turned: Vec<f32> =
                (0..w.len()).map(|at| w[at % channels_out * channels_in + at / channels_out]).collect();
            let mut expected = [vec![0f64; dy.len()], vec![0f64; x.len()], vec![0f64; w.len()]];
            for (at, y) in expected[0].iter_mut().enumerate() {
                *y = f64::from(bias[at / pixels % channels_out]);
            }
            for plane in 0..batch * channels_out * channels_in {
                let (o, i) = (plane / channels_in % channels_out, plane % channels_in);
                let image = plane / channels_in / channels_out;
                for pixel in 0..pixels {
                    let (from, to) = (
                        (image * channels_in + i) * pixels + pixel,
                        (image * channels_out + o) * pixels + pixel,
                    );
                    let (w_value, x, dy) =
                        (f64::from(w[o * channels_in + i]), f64::from(x[from]), f64::from(dy[to]));
                    expected[0][to] += w_value * x;
                    expected[1][from] += w_value * dy;
                    expected[2][o * channels_in + i] += x * dy;
                }
            }
            for set in InstructionSet::available() {
                let of = |values, is_transposed| Weight { values, is_transposed };
                let found = [
                    [
                        mix.forward(&x, of(&w, false), Some(&bias), set),
                        mix.forward(&x, of(&turned, true), Some(&bias), set),
                    ],
                    [
                        mix.input_gradient(&dy, of(&w, false), set),
                        mix.input_gradient(&dy, of(&turned, true), set),
                    ],
                    [weight_gradient(mix, &x, &dy, set), weight_gradient(mix, &x, &dy, set)],
                ];
                for (found, expected) in found.iter().zip(&expected) {
                    let largest = expected.iter().fold(0f64, |largest, value| largest.max(value.abs()));
                    for found in found {
                        assert_eq!(found.len(), expected.len());
                        for (a, b) in found.iter().zip(expected) {
                            assert!(
                                (f64::from(*a) - b).abs() <= 2e-5 * largest,
                                "{set:?}, {mix:?}: {a} is not {b}"
                            );
                        }
                    }
                }
            }
            let sums = bias_gradient(mix, &dy);
            for (o, sum) in sums.iter().enumerate() {
                let planes = dy.chunks_exact(pixels).skip(o).step_by(channels_out);
                let exact: f64 = planes.flatten().map(|&value| f64::from(value)).sum();
                assert!((f64::from(*sum) - exact).abs() < 1e-4);
            }
        }
    }

    /// Numbers that bf16 holds, so that pairs lose nothing of them; channels around and between whole tiles.
    #[test]
    fn passes_in_pairs_equal_those_in_f32_on_numbers_of_eight_bits() {
        let pairs = InstructionSet::for_products(Products::Bf16);
        for (batch, channels_in, channels_out, pixels) in
            [(2, 96, 112, 320), (1, 70, 33, 58), (2, 17, 64, 5120), (1, 33, 2, 31), (3, 8, 80, 1450)]
        {
            let mix = Mix { batch, channels_in, channels_out, pixels };
            let mut random = crate::random::stream(6, "channel-mix-test", pixels as u64);
            let mut draw = |n: usize| -> Vec<f32> {
                let mut draw = || rand::RngExt::random_range(&mut random, -0.5..0.5f32);
                (0..n).map(|_| f32::from_bits(draw().to_bits() & 0xffff_0000)).collect()
            };
            let (x, dy) = (draw(batch * channels_in * pixels), draw(batch * channels_out * pixels));
            let (w, bias) = (draw(channels_out * channels_in), draw(channels_out));
            let weight = Weight { values: &w, is_transposed: false };
            let of = |set: InstructionSet| {
                [
                    mix.forward(&x, weight, Some(&bias), set),
                    mix.input_gradient(&dy, weight, set),
                    weight_gradient(mix, &x, &dy, set),
                ]
            };
            for (found, expected) in of(pairs).iter().zip(of(InstructionSet::best().without_matrix_unit())) {
                assert_eq!(found.len(), expected.len());
                let largest = expected.iter().fold(0f32, |largest, y| largest.max(y.abs()));
                for (a, b) in found.iter().zip(&expected) {
                    assert!((a - b).abs() <= 2e-5 * largest, "{mix:?}: {a} is not {b}");
                }
            }
            let threads = |n| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("a pool");
                pool.install(|| of(pairs))
            };
            assert_eq!(threads(1), threads(3), "{mix:?}");
        }
    }
}
