//! A convolution of kernel 1 by the products of the larger kernels: one tap, and maps of any shape.

use super::band::Planes;
use super::strip::{Convolution, Phase};
use super::tiles::pack_weights;
use super::{Shape, block_gradient, mix_gradient, uses_matrix_unit, uses_pairs};
use crate::kernels::simd::InstructionSet;

/// Widths that a row of pixels may have: wide enough for whole tiles, narrow enough for several rows in a band.
const WIDTHS: std::ops::RangeInclusive<usize> = 24..=256;

/// Sizes of one; all at least 1.
#[derive(Clone, Copy, Debug)]
pub(in crate::kernels) struct Mix {
    pub batch: usize,
    pub channels_in: usize,
    pub channels_out: usize,
    /// Pixels of an image.
    pub pixels: usize,
}

/// A matrix `[channel_out, channel_in]`, or its transpose.
#[derive(Clone, Copy)]
pub(in crate::kernels) struct Weight<'a> {
    pub values: &'a [f32],
    pub is_transposed: bool,
}

impl Mix {
    /// # Shapes
    /// - x: `[batch, channel_in, pixel]`, bias: `[channel_out]`
    /// - output: `[batch, channel_out, pixel]`
    pub fn forward(self, x: &[f32], w: Weight, bias: Option<&[f32]>, set: InstructionSet) -> Vec<f32> {
        let Self { batch, channels_in, channels_out, pixels } = self;
        assert!(x.len() == batch * channels_in * pixels && w.values.len() == channels_in * channels_out);
        let [height_px, width_px] = map_of(pixels);
        let convolution = Convolution {
            source: Planes { values: x, channels: channels_in, height_px, width_px, split: 1, lead: 0 },
            batch,
            channels_out,
            rows: height_px,
            columns: width_px,
            upscale: 1,
            out_height_px: height_px,
            out_width_px: width_px,
            shift: bias,
            has_relu: false,
        };
        let strides = if w.is_transposed { (1, channels_out) } else { (channels_in, 1) };
        convolution.run(set, |_| {
            let weights = pack_weights(set, w.values, (channels_out, channels_in), strides, &[0], None);
            vec![Phase { offsets: vec![0], weights, y: 0, x: 0 }]
        })
    }

    /// The gradient of x: the same with the matrix transposed.
    pub fn input_gradient(self, dy: &[f32], w: Weight, set: InstructionSet) -> Vec<f32> {
        let turned = Self { channels_in: self.channels_out, channels_out: self.channels_in, ..self };
        turned.forward(dy, Weight { is_transposed: !w.is_transposed, ..w }, None, set)
    }

    /// The gradient of the matrix, `[channel_out, channel_in]`, in pairs of bf16 or on the matrix unit; `None` where the set has
    /// neither for so many channels.
    pub fn weight_gradient(self, x: &[f32], dy: &[f32], set: InstructionSet) -> Option<Vec<f32>> {
        let [height_px, width_px] = map_of(self.pixels);
        let Self { batch, channels_in, channels_out, .. } = self;
        let shape = Shape { batch, channels_in, channels_out, height_px, width_px, stride: 1 };
        if uses_pairs(set, channels_in) {
            return Some(mix_gradient::weight_gradient(shape, x, dy, set));
        }
        uses_matrix_unit(set, (channels_out, channels_in))
            .then(|| block_gradient::weight_gradient(shape, 1, x, dy, set))
    }
}

/// Rows and columns of a map with a number of pixels: rows of whole tiles if there are such, else of any fitting width.
fn map_of(pixels: usize) -> [usize; 2] {
    let fits = |&width: &usize| pixels.is_multiple_of(width);
    let whole = WIDTHS.rev().filter(|width| width.is_multiple_of(32)).find(fits);
    let width = whole.or_else(|| WIDTHS.rev().find(fits)).unwrap_or(pixels);
    [pixels / width, width]
}
