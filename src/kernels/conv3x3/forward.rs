//! The forward pass: nine taps, one phase; at inference with batch norm and ReLU in the same pass.

use super::Shape;
use super::band::Planes;
use super::strip::{Convolution, Phase};
use super::tiles::pack_weights;
use super::winograd::{self, Tiled};
use crate::kernels::simd::InstructionSet;

/// The step after a convolution: `max(0, scale y + shift)`, a scale and a shift for each output channel.
#[derive(Clone, Copy)]
pub(in crate::kernels) struct ScaleShiftRelu<'a> {
    pub scale: &'a [f32],
    pub shift: &'a [f32],
}

/// # Shapes
/// - x: `[batch, channel_in, y, x]`, w: `[channel_out, channel_in, 3, 3]`
/// - output: `[batch, channel_out, out_y, out_x]`
pub(in crate::kernels) fn forward(
    shape: Shape,
    x: &[f32],
    w: &[f32],
    then: Option<ScaleShiftRelu>,
    set: InstructionSet,
) -> Vec<f32> {
    shape.check();
    assert!(x.len() == shape.n_inputs() && w.len() == shape.n_weights());
    if winograd::fits(shape, set) {
        let tiled = Tiled {
            x,
            batch: shape.batch,
            channels: (shape.channels_in, shape.channels_out),
            height_px: shape.height_px,
            width_px: shape.width_px,
            shift: then.map(|then| then.shift),
            has_relu: then.is_some(),
        };
        return tiled.run(set, |o, i, tap| {
            w[(o * shape.channels_in + i) * 9 + tap] * then.map_or(1.0, |then| then.scale[o])
        });
    }
    let convolution = Convolution {
        source: Planes {
            values: x,
            channels: shape.channels_in,
            height_px: shape.height_px,
            width_px: shape.width_px,
            split: shape.stride,
            lead: 1,
        },
        batch: shape.batch,
        channels_out: shape.channels_out,
        rows: shape.out_height_px(),
        columns: shape.out_width_px(),
        upscale: 1,
        out_height_px: shape.out_height_px(),
        out_width_px: shape.out_width_px(),
        shift: then.map(|then| then.shift),
        has_relu: then.is_some(),
    };
    convolution.run(set, |layout| {
        let taps: Vec<usize> = (0..9).collect();
        let strides = (shape.channels_in * 9, 9);
        vec![Phase {
            offsets: taps.iter().map(|t| layout.tap(shape.stride, t / 3, t % 3)).collect(),
            weights: pack_weights(
                set,
                w,
                (shape.channels_out, shape.channels_in),
                strides,
                &taps,
                then.map(|then| then.scale),
            ),
            y: 0,
            x: 0,
        }]
    })
}
