//! 3x3 convolution with one pixel of zero padding, stride 1 or 2, f32: forward pass and both gradients.
//!
//! All tensors are dense: images `[batch, channel, y, x]`, kernels `[channel_out, channel_in, 3, 3]`.
//!
//! Forward pass and input gradient are one implicit matrix product (`tiles`): pixels lie in the vector lanes,
//! a register tile (`pass`) holds a few output channels by three vectors of pixels, and the input is packed, zeros
//! at the borders included, in bands of rows that fit the second-level cache (`band`). The weight gradient
//! has input channels in the lanes. Of stride 1 all three go by tiles of 2 by 2 outputs (`winograd`, `tile_gradient`), with 16 products for
//! 36, where channels and rows are many enough. Every sum runs in an order that the shape fixes, so that results are
//! equal to the bit whatever the number of threads.

mod band;
mod block_gradient;
mod blocks;
#[cfg(not(kernels_alone))]
mod burn_op;
mod forward;
mod gradient_tile;
mod input_gradient;
mod mix_gradient;
mod pair_rows;
mod pairs;
mod pass;
mod pointwise;
mod strip;
mod tile_gradient;
mod tiles;
mod weight_gradient;
mod winograd;

use super::simd::InstructionSet;
#[cfg(not(kernels_alone))]
pub use burn_op::{conv3x3, conv3x3_scale_shift_relu};
use forward::{ScaleShiftRelu, forward};
use input_gradient::input_gradient;
use pairs::uses_pairs;
pub(super) use pointwise::{Mix, Weight};
use weight_gradient::weight_gradient;

/// Bytes of packed input that a task works on at a time: they fit beside the weights in a second-level cache of 512 kB.
const BAND_BYTES: usize = 400 << 10;

/// Pixels that make a part worth its own sums and their addition.
const PART_PX: usize = 1024;
/// Most parts; each costs a copy of the kernel's size.
const MAX_PARTS: usize = 4;

/// Fewest input and output channels for the matrix unit, whose tiles have 32 of each: below, vectors are faster.
const MIN_UNIT_CHANNELS: usize = 16;

/// Whether the matrix unit takes a product of these numbers of channels.
pub(super) fn uses_matrix_unit(set: InstructionSet, channels: (usize, usize)) -> bool {
    set.has_matrix_unit() && channels.0.min(channels.1) >= MIN_UNIT_CHANNELS
}

/// Sizes of one convolution; all at least 1.
#[derive(Clone, Copy, Debug)]
struct Shape {
    pub batch: usize,
    pub channels_in: usize,
    pub channels_out: usize,
    pub height_px: usize,
    pub width_px: usize,
    /// 1 or 2.
    pub stride: usize,
}

impl Shape {
    pub fn out_height_px(&self) -> usize {
        (self.height_px - 1) / self.stride + 1
    }

    pub fn out_width_px(&self) -> usize {
        (self.width_px - 1) / self.stride + 1
    }

    pub fn n_inputs(&self) -> usize {
        self.batch * self.channels_in * self.height_px * self.width_px
    }

    pub fn n_outputs(&self) -> usize {
        self.batch * self.channels_out * self.out_height_px() * self.out_width_px()
    }

    pub fn n_weights(&self) -> usize {
        self.channels_out * self.channels_in * 9
    }

    /// Parts that the output rows of a batch are cut into for the sums of the weight gradient.
    fn n_parts(&self) -> usize {
        let total_rows = self.batch * self.out_height_px();
        let n_parts = (total_rows * self.out_width_px() / PART_PX).clamp(1, MAX_PARTS).min(total_rows);
        1 << n_parts.ilog2()
    }

    /// Panics unless the sizes are in range; the passes rely on it.
    fn check(&self) {
        assert!(matches!(self.stride, 1 | 2), "stride is 1 or 2: {self:?}");
        assert!(self.n_inputs() > 0 && self.channels_out > 0, "every size is at least 1: {self:?}");
    }
}

#[cfg(test)]
mod tests;
