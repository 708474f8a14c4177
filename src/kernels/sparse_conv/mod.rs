//! Sparse convolution: gather rows, multiply by one offset's matrix, add to the output's rows.
//!
//! `out[o] = sum over offsets k, over pairs (i, o) of k: x[i] w[k]`, where a [`Rulebook`] lists the pairs of
//! input and output rows that meet at each kernel offset (Graham et al. 2018).

mod burn_op;
mod products;
mod rulebook;

pub use burn_op::sparse_conv;
pub use rulebook::{OffsetPairs, Rulebook};
