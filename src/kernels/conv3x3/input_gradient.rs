//! The gradient of the input: a convolution of the output's gradient.
//!
//! Stride 1: with the kernel turned by 180 degrees. Stride 2: each parity of input row and column is
//! reached by its own few taps, which gives four phases of 1, 2, 2 and 4 taps.

use super::Shape;
use super::band::{Layout, Planes};
use super::strip::{Convolution, Phase, Weights};
use super::tiles::pack_weights;
use super::winograd::{self, Tiled};
use crate::kernels::simd::InstructionSet;

/// # Shapes
/// - dy: `[batch, channel_out, out_y, out_x]`, w: `[channel_out, channel_in, 3, 3]`
/// - output: `[batch, channel_in, y, x]`
pub(in crate::kernels) fn input_gradient(
    shape: Shape,
    dy: &[f32],
    w: &[f32],
    set: InstructionSet,
) -> Vec<f32> {
    shape.check();
    assert!(dy.len() == shape.n_outputs() && w.len() == shape.n_weights());
    // The convolution of the output's gradient.
    let turned = Shape { channels_in: shape.channels_out, channels_out: shape.channels_in, ..shape };
    if winograd::fits(turned, set) {
        let tiled = Tiled {
            x: dy,
            batch: shape.batch,
            channels: (turned.channels_in, turned.channels_out),
            height_px: shape.height_px,
            width_px: shape.width_px,
            shift: None,
            has_relu: false,
        };
        return tiled.run(set, |i, o, tap| w[(o * shape.channels_in + i) * 9 + 8 - tap]);
    }
    let convolution = Convolution {
        source: Planes {
            values: dy,
            channels: shape.channels_out,
            height_px: shape.out_height_px(),
            width_px: shape.out_width_px(),
            split: 1,
            lead: usize::from(shape.stride == 1),
        },
        batch: shape.batch,
        channels_out: shape.channels_in,
        rows: shape.out_height_px(),
        columns: shape.out_width_px(),
        upscale: shape.stride,
        out_height_px: shape.height_px,
        out_width_px: shape.width_px,
        shift: None,
        has_relu: false,
    };
    let weights = |taps: &[usize]| {
        let strides = (9, shape.channels_in * 9);
        pack_weights(set, w, (shape.channels_in, shape.channels_out), strides, taps, None)
    };
    convolution.run(set, |layout| {
        if shape.stride == 1 {
            let turned: Vec<usize> = (0..9).rev().collect();
            let offsets = (0..9).map(|t| layout.tap(1, t / 3, t % 3)).collect();
            vec![Phase { offsets, weights: weights(&turned), y: 0, x: 0 }]
        } else {
            (0..4).map(|parity| stride_2_phase(parity / 2, parity % 2, layout, weights)).collect()
        }
    })
}

/// The taps that reach input pixels of one parity.
fn stride_2_phase(y: usize, x: usize, layout: &Layout, weights: impl Fn(&[usize]) -> Weights) -> Phase {
    // Output q reads input 2 q - 1 + k at kernel index k. So input 2 p is read by output p at k = 1, and
    // input 2 p + 1 by output p + 1 at k = 0 and by output p at k = 2: (kernel index, output shift).
    const REACH: [&[(usize, usize)]; 2] = [&[(1, 0)], &[(0, 1), (2, 0)]];
    let (mut taps, mut offsets) = (Vec::new(), Vec::new());
    for &(kernel_y, shift_y) in REACH[y] {
        for &(kernel_x, shift_x) in REACH[x] {
            taps.push(kernel_y * 3 + kernel_x);
            offsets.push(layout.tap(1, shift_y, shift_x));
        }
    }
    Phase { offsets, weights: weights(&taps), y, x }
}
