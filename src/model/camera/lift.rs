//! The lift from image features to the ground (lift-splat, Philion and Fidler 2020): each feature's context,
//! weighted by its distribution over depth, summed into the bird's-eye cells along its ray.

use std::sync::Arc;

use burn::tensor::Tensor;

use crate::kernels::{PoolPlan, lift_pool, softmax_last};

/// Lifts features and sums them into cells.
///
/// # Shapes
/// - lifted: `[batch, depth_bin + channel, feature_y, feature_x]`: depth before the softmax, then context
/// - cells: rows and columns of the ground's cells
/// - plans: for each sample, the cell of each feature's depth bins
/// - output: `[batch, channel, y, x]`
pub fn lift_and_pool(
    lifted: Tensor<4>,
    n_depth_bins: usize,
    cells: [usize; 2],
    plans: &[Arc<PoolPlan>],
) -> Tensor<4> {
    let [n_batch, n_lifted, n_y, n_x] = lifted.dims();
    let n_channels = n_lifted - n_depth_bins;
    let lifted = lifted.permute([0, 2, 3, 1]).reshape([n_batch, n_y * n_x, n_lifted]);
    let depth = softmax_last(lifted.clone().narrow(2, 0, n_depth_bins));
    let context = lifted.narrow(2, n_depth_bins, n_channels);
    lift_pool(depth, context, plans).reshape([n_batch, cells[0], cells[1], n_channels]).permute([0, 3, 1, 2])
}
