//! Every pass against a plain loop in f64, for every instruction set of the machine.

use super::{ScaleShiftRelu, Shape, forward, input_gradient, weight_gradient, winograd};
use crate::kernels::products::Products;
use crate::kernels::simd::InstructionSet;

const fn shape(
    batch: usize,
    channels_in: usize,
    channels_out: usize,
    height_px: usize,
    width_px: usize,
    stride: usize,
) -> Shape {
    Shape { batch, channels_in, channels_out, height_px, width_px, stride }
}

/// One pixel, odd sizes, widths around the vector lengths and around the switch from flat to wide bands,
/// channel counts around the tile heights, several bands and several channel blocks; and of those that go by tiles of 2 by 2, the
/// least that two lanes do, vectors that are alone, two, three and more in a row, and channels beyond whole blocks.
const SHAPES: [Shape; 23] = [
    shape(1, 1, 1, 1, 1, 1),
    shape(2, 16, 8, 9, 16, 1),
    shape(1, 3, 13, 17, 37, 1),
    shape(1, 20, 10, 7, 5, 1),
    shape(3, 33, 17, 20, 20, 1),
    shape(1, 32, 32, 40, 160, 1),
    shape(2, 17, 9, 12, 130, 1),
    shape(2, 40, 17, 13, 96, 1),
    shape(1, 130, 20, 13, 65, 1),
    shape(1, 70, 9, 6, 32, 1),
    shape(1, 32, 32, 2, 4, 1),
    shape(2, 32, 40, 10, 32, 1),
    shape(1, 33, 37, 2, 64, 1),
    shape(1, 96, 48, 8, 96, 1),
    shape(1, 40, 33, 20, 128, 1),
    shape(1, 1, 1, 1, 1, 2),
    shape(1, 1, 1, 2, 1, 2),
    shape(2, 3, 16, 20, 36, 2),
    shape(1, 19, 16, 21, 37, 2),
    shape(1, 5, 9, 11, 101, 2),
    shape(2, 20, 17, 10, 128, 2),
    shape(1, 40, 24, 12, 64, 2),
    shape(1, 3, 16, 225, 400, 2),
];

/// The shapes to test; under Miri only the small ones: it takes about a second for a thousand products.
fn shapes() -> impl Iterator<Item = Shape> {
    let n_products = |shape: &Shape| shape.n_outputs() * shape.channels_in * 9;
    SHAPES.into_iter().filter(move |shape| !cfg!(miri) || n_products(shape) < 74_000)
}

/// Values in [-0.5, 0.5) by xorshift.
fn values(n: usize, seed: u64) -> Vec<f32> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f32 / (1_u64 << 24) as f32 - 0.5
    };
    (0..n).map(|_| next()).collect()
}

/// Calls `each` with the flat indices (input, weight, output) of every product of the convolution.
fn for_each_product(shape: Shape, mut each: impl FnMut(usize, usize, usize)) {
    let Shape { batch, channels_in, channels_out, height_px, width_px, stride } = shape;
    let (out_height_px, out_width_px) = (shape.out_height_px(), shape.out_width_px());
    for plane in 0..batch * channels_out * channels_in {
        let (image, o, i) =
            (plane / (channels_out * channels_in), plane / channels_in % channels_out, plane % channels_in);
        for pixel in 0..out_height_px * out_width_px {
            for tap in 0..9 {
                let y = (pixel / out_width_px * stride + tap / 3).wrapping_sub(1);
                let x = (pixel % out_width_px * stride + tap % 3).wrapping_sub(1);
                if y < height_px && x < width_px {
                    each(
                        ((image * channels_in + i) * height_px + y) * width_px + x,
                        (o * channels_in + i) * 9 + tap,
                        (image * channels_out + o) * out_height_px * out_width_px + pixel,
                    );
                }
            }
        }
    }
}

/// Inputs, weights and output gradients of a shape.
fn operands(shape: Shape) -> [Vec<f32>; 3] {
    [values(shape.n_inputs(), 1), values(shape.n_weights(), 2), values(shape.n_outputs(), 3)]
}

/// Output, input gradient and weight gradient.
fn passes(shape: Shape, set: InstructionSet) -> [Vec<f32>; 3] {
    let [x, w, dy] = operands(shape);
    [
        forward(shape, &x, &w, None, set),
        input_gradient(shape, &dy, &w, set),
        weight_gradient(shape, &x, &dy, set),
    ]
}

#[test]
fn all_passes_equal_a_plain_loop_on_every_instruction_set() {
    for shape in shapes() {
        let [x, w, dy] = operands(shape);
        let mut expected = [vec![0.0; dy.len()], vec![0.0; x.len()], vec![0.0; w.len()]];
        for_each_product(shape, |i, k, o| {
            expected[0][o] += f64::from(x[i]) * f64::from(w[k]);
            expected[1][i] += f64::from(dy[o]) * f64::from(w[k]);
            expected[2][k] += f64::from(x[i]) * f64::from(dy[o]);
        });
        for set in InstructionSet::available() {
            let names = ["forward", "input gradient", "weight gradient"];
            for ((name, own), expected) in names.iter().zip(passes(shape, set)).zip(&expected) {
                assert_eq!(own.len(), expected.len());
                let largest = expected.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
                for (own, expected) in own.iter().zip(expected) {
                    // 2e-5: f32 rounding of sums of up to 10^5 products; written so that NaN fails.
                    let is_close = (f64::from(*own) - expected).abs() <= 2e-5 * largest;
                    assert!(is_close, "{name}, {set:?}, {shape:?}: {own} is not {expected}");
                }
            }
        }
    }
}

/// Numbers that bf16 holds; by tiles, of so few bits that it holds sums of four inputs and quarters of sums of nine weights, too. So
/// pairs lose nothing of them.
#[test]
fn passes_in_pairs_equal_those_in_f32_on_numbers_that_pairs_hold() {
    let set = InstructionSet::for_products(Products::Bf16);
    for shape in shapes() {
        let is_tiled = winograd::fits(shape, set);
        let held = |v: f32| {
            if is_tiled { (v * 8.0).round() / 8.0 } else { f32::from_bits(v.to_bits() & 0xffff_0000) }
        };
        let [x, w, dy] = operands(shape).map(|values| values.into_iter().map(held).collect::<Vec<_>>());
        let of = |set| {
            [
                forward(shape, &x, &w, None, set),
                input_gradient(shape, &dy, &w, set),
                weight_gradient(shape, &x, &dy, set),
            ]
        };
        for (pairs, numbers) in of(set).iter().zip(of(InstructionSet::best().without_matrix_unit())) {
            let largest = numbers.iter().fold(0f32, |largest, y| largest.max(y.abs()));
            for (a, b) in pairs.iter().zip(&numbers) {
                assert!((a - b).abs() <= 2e-5 * largest, "{shape:?}: {a} is not {b}");
            }
        }
        let threads = |n| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("a pool");
            pool.install(|| of(set))
        };
        assert_eq!(threads(1), threads(3), "{shape:?}");
    }
}

fn sum_of_squares(values: impl Iterator<Item = f32>) -> f64 {
    values.map(|value| f64::from(value).powi(2)).sum()
}

/// Of any numbers, tiles in pairs lose up to a bit more than taps do: 0.4 % of a sum where it is 0.2 %.
#[test]
#[cfg_attr(miri, ignore = "Miri's CPU has no pairs")]
fn tiles_in_pairs_are_off_by_half_a_percent_at_most() {
    let set = InstructionSet::for_products(Products::Bf16);
    for shape in shapes().filter(|&shape| winograd::fits(shape, set)) {
        let exact = passes(shape, InstructionSet::best().without_matrix_unit());
        for (found, exact) in passes(shape, set).iter().zip(&exact) {
            let off = sum_of_squares(found.iter().zip(exact).map(|(a, b)| a - b));
            let share = (off / sum_of_squares(exact.iter().copied())).sqrt();
            assert!(share < 5e-3, "{shape:?}: {share}");
        }
    }
}

#[test]
fn scale_shift_and_relu_in_the_same_pass_equal_them_in_passes_of_their_own() {
    for shape in shapes() {
        let [x, w, _] = operands(shape);
        let (scale, shift) = (values(shape.channels_out, 4), values(shape.channels_out, 5));
        let pixels = shape.out_height_px() * shape.out_width_px();
        for set in InstructionSet::available() {
            let plain = forward(shape, &x, &w, None, set);
            let largest = plain.iter().fold(0f32, |largest, y| largest.max(y.abs()));
            let then = ScaleShiftRelu { scale: &scale, shift: &shift };
            let found = forward(shape, &x, &w, Some(then), set);
            assert!(found.contains(&0.0) || found.len() < 10, "ReLU cuts off something, {shape:?}");
            for (i, (found, y)) in found.iter().zip(plain).enumerate() {
                let c = i / pixels % shape.channels_out;
                let expected = (y * scale[c] + shift[c]).max(0.0);
                assert!((found - expected).abs() <= 2e-5 * largest.max(1.0), "{set:?}, {shape:?}");
            }
        }
    }
}

#[test]
#[cfg_attr(miri, ignore = "Miri takes minutes for a pool of threads")]
fn results_are_bit_identical_on_any_number_of_threads() {
    let bits = |passes: [Vec<f32>; 3]| passes.map(|v| v.into_iter().map(f32::to_bits).collect::<Vec<_>>());
    for shape in shapes() {
        for set in InstructionSet::available() {
            let [one, two, five] = [1, 2, 5].map(|n_threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().expect("a pool");
                bits(pool.install(|| passes(shape, set)))
            });
            assert!(one == two && one == five, "{set:?}, {shape:?}");
        }
    }
}

#[test]
fn ones_count_the_taps_inside_the_image() {
    let shape = shape(1, 1, 1, 3, 3, 1);
    for set in InstructionSet::available() {
        let y = forward(shape, &[1.0; 9], &[1.0; 9], None, set);
        assert_eq!(y, [4.0, 6.0, 4.0, 6.0, 9.0, 6.0, 4.0, 6.0, 4.0]);
    }
}

#[test]
#[should_panic(expected = "stride is 1 or 2")]
fn stride_3_is_refused() {
    forward(shape(1, 1, 1, 3, 3, 3), &[0.0; 9], &[0.0; 9], None, InstructionSet::best());
}
