//! Own CPU operations plugged into burn, and the only `unsafe` code of the crate.

mod burn_op;
mod conv3x3;

pub use burn_op::conv3x3;
