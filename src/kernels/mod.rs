//! Our own CPU operations for burn, and the only `unsafe` code of the crate.
//!
//! burn's flex backend spends four times `PyTorch`'s time on a dense 3x3 convolution; [`conv3x3()`] is on par.
//! [`lift_pool()`] pools lifted image features without building the list of weighted points.

#![allow(
    clippy::inline_always,
    reason = "a kernel must be inlined into the function that enables its instruction set"
)]

mod adamw;
mod attend;
mod channel_mix;
mod conv3x3;
mod lift_pool;
mod matrix_unit;
mod memory;
mod norm_relu;
mod operation;
mod pillar_map;
mod product;
mod products;
mod scratch;
mod simd;
mod softmax;
mod sparse_conv;
mod transpose;

pub use adamw::AdamwStep;
pub use attend::attend;
pub use channel_mix::mix_channels;
pub use conv3x3::{conv3x3, conv3x3_scale_shift_relu};
pub use lift_pool::{PoolPlan, lift_pool};
#[cfg(test)]
pub use matrix_unit::is_available as has_matrix_unit;
pub use memory::keep_freed_memory;
pub use norm_relu::{Normed, norm_relu, scale_shift_relu};
pub use pillar_map::{PillarPlan, pillar_map};
pub use products::Products;
pub use softmax::softmax_last;
pub use sparse_conv::{OffsetPairs, Rulebook, sparse_conv};
