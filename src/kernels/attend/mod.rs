//! Scaled dot-product attention (Vaswani et al. 2017), f32: forward pass and gradients.
//!
//! ```text
//! out[q, c] = sum_k share[q, k] v[c, k]        share[q, :] = softmax(sum_c q[q, c] k[c, :])
//! ```
//!
//! Keys and values lie as maps, `[channel, key]`, so that every product is one of [`super::channel_mix`]. Scores are summed in
//! vectors: an error of theirs grows in the exponent.

mod burn_op;

use rayon::prelude::*;

use super::channel_mix::weight_gradient;
use super::conv3x3::{Mix, Weight};
use super::simd::InstructionSet;
use super::softmax;

pub use burn_op::attend;

/// Sizes; all at least 1.
#[derive(Clone, Copy, Debug)]
struct Sizes {
    /// Samples times heads.
    rows: usize,
    queries: usize,
    channels: usize,
    keys: usize,
}

/// The tensors of one row.
#[derive(Clone, Copy)]
struct Row<'a> {
    /// `[query, channel]`, already scaled.
    q: &'a [f32],
    /// `[channel, key]`
    k: &'a [f32],
    /// `[channel, key]`
    v: &'a [f32],
}

/// Gradients of one row's q, k and v.
type RowGradients = [Vec<f32>; 3];

impl Sizes {
    /// The products of a row, with keys as pixels and queries as output channels.
    fn mix(self) -> Mix {
        Mix { batch: 1, channels_in: self.channels, channels_out: self.queries, pixels: self.keys }
    }

    fn row<'a>(self, [q, k, v]: [&'a [f32]; 3], row: usize) -> Row<'a> {
        let part = |values: &'a [f32]| {
            let len = values.len() / self.rows;
            &values[row * len..(row + 1) * len]
        };
        Row { q: part(q), k: part(k), v: part(v) }
    }

    /// Output of each row, `[query, channel]`, and its shares, `[query, key]`.
    fn forward(self, qkv: [&[f32]; 3], set: InstructionSet) -> Vec<[Vec<f32>; 2]> {
        self.for_rows(|row| {
            let Row { q, k, v } = self.row(qkv, row);
            let weight = Weight { values: q, is_transposed: false };
            let scores = self.mix().forward(k, weight, None, set.without_matrix_unit());
            let shares = softmax::forward(&scores, self.keys, set);
            [weight_gradient(self.mix(), v, &shares, set), shares]
        })
    }

    /// `shares` are those of the forward pass.
    fn gradients(
        self,
        qkv: [&[f32]; 3],
        shares: &[Vec<f32>],
        d_out: &[f32],
        set: InstructionSet,
    ) -> Vec<RowGradients> {
        let len = self.queries * self.channels;
        self.for_rows(|row| {
            let (Row { q, k, v }, shares) = (self.row(qkv, row), &shares[row]);
            let d_out = Weight { values: &d_out[row * len..(row + 1) * len], is_transposed: false };
            let dv = self.mix().input_gradient(shares, d_out, set);
            let d_shares = self.mix().forward(v, d_out, None, set);
            let d_scores = softmax::gradient(shares, &d_shares, self.keys, set);
            let dk = self.mix().input_gradient(&d_scores, Weight { values: q, is_transposed: false }, set);
            [weight_gradient(self.mix(), k, &d_scores, set), dk, dv]
        })
    }

    fn for_rows<T: Send>(self, work: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
        (0..self.rows).into_par_iter().map(work).collect()
    }
}
