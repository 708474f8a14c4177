//! The sparse convolution as a burn operation with gradients, for `Device::flex()` with or without autodiff.
//!
//! For the backward pass it keeps input and matrices alone: rows are gathered anew. Every other device runs
//! burn's own operations on the rulebook's index tensors, whose graph keeps the gathered rows.

use std::sync::Arc;

use burn::backend::autodiff::NodeId;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::flex::FlexTensor;
use burn::backend::{
    Autodiff, Backend, Dispatch, Flex, TensorMetadata, backend_extension, tensor::FloatTensor,
};
use burn::tensor::{DType, Device, IndexingUpdateOp, Tensor, TensorData};

use super::products::{apply, weight_gradient};
use super::rulebook::{Direction, Rulebook};

/// Convolves the rows of `x` by the pairs of a rulebook.
///
/// # Shapes
/// - x: `[input, channel_in]`
/// - w: `[offset, channel_in, channel_out]`
/// - output: `[output, channel_out]`, zero where an output row meets no input
///
/// # Panics
/// If the rulebook's offsets, its inputs or the channels disagree with the tensors.
#[must_use]
pub fn sparse_conv(x: Tensor<2>, w: Tensor<3>, rulebook: &Arc<Rulebook>) -> Tensor<2> {
    let ([n_inputs, channels_in], [n_offsets, kernel_channels, channels_out]) = (x.dims(), w.dims());
    assert_eq!(n_inputs, rulebook.n_inputs(), "sparse_conv: rows of input and rulebook");
    assert_eq!(n_offsets, rulebook.offsets().len(), "sparse_conv: offsets of kernel and rulebook");
    assert_eq!(kernel_channels, channels_in, "sparse_conv: input channels of kernel and input");

    // `==` on devices compares the hardware and leaves autodiff aside.
    let is_flex = x.device() == Device::flex();
    let is_f32 = x.dtype() == DType::F32 && w.dtype() == DType::F32;
    if !is_flex || !is_f32 || rulebook.n_pairs() == 0 || channels_in * channels_out == 0 {
        return offset_by_offset(x, w, rulebook);
    }
    let (x, w) = (x.into_dispatch(), w.into_dispatch());
    Tensor::from_dispatch(<Dispatch as SparseConvBackend>::sparse_conv(x, w, Arc::clone(rulebook)))
}

/// The convolution in burn's own operations.
fn offset_by_offset(x: Tensor<2>, w: Tensor<3>, rulebook: &Rulebook) -> Tensor<2> {
    let [_, channels_in, channels_out] = w.dims();
    let device = x.device();
    let out = Tensor::zeros([rulebook.n_outputs(), channels_out], &device);
    rulebook.indices(&device).into_iter().enumerate().fold(out, |out, (offset_idx, indices)| {
        let Some((inputs, outputs)) = indices else { return out };
        let w = w.clone().narrow(0, offset_idx, 1).reshape([channels_in, channels_out]);
        out.select_assign(0, outputs, x.clone().select(0, inputs).matmul(w), IndexingUpdateOp::Add)
    })
}

/// The convolution and its two gradients on one backend.
#[backend_extension(Flex, Autodiff)]
pub trait SparseConvBackend: Backend {
    /// The convolution itself.
    fn sparse_conv(x: FloatTensor<Self>, w: FloatTensor<Self>, rulebook: Arc<Rulebook>) -> FloatTensor<Self>;
    /// Gradient with respect to the input rows.
    fn sparse_conv_input_gradient(
        dy: FloatTensor<Self>,
        w: FloatTensor<Self>,
        rulebook: Arc<Rulebook>,
    ) -> FloatTensor<Self>;
    /// Gradient with respect to the matrices.
    fn sparse_conv_weight_gradient(
        x: FloatTensor<Self>,
        dy: FloatTensor<Self>,
        rulebook: Arc<Rulebook>,
    ) -> FloatTensor<Self>;
}

fn values(tensor: &FlexTensor) -> &[f32] {
    tensor.as_slice().expect("sparse_conv is only called with f32, made contiguous")
}

impl SparseConvBackend for Flex {
    fn sparse_conv(x: FlexTensor, w: FlexTensor, rulebook: Arc<Rulebook>) -> FlexTensor {
        let (x, w) = (x.to_contiguous(), w.to_contiguous());
        let channels = [w.shape()[1], w.shape()[2]];
        let y = apply(&rulebook, Direction::Forward, values(&x), values(&w), channels);
        FlexTensor::from_data(TensorData::new(y, [rulebook.n_outputs(), channels[1]]))
    }

    fn sparse_conv_input_gradient(dy: FlexTensor, w: FlexTensor, rulebook: Arc<Rulebook>) -> FlexTensor {
        let (dy, w) = (dy.to_contiguous(), w.to_contiguous());
        let channels = [w.shape()[1], w.shape()[2]];
        let dx = apply(&rulebook, Direction::Backward, values(&dy), values(&w), channels);
        FlexTensor::from_data(TensorData::new(dx, [rulebook.n_inputs(), channels[0]]))
    }

    fn sparse_conv_weight_gradient(x: FlexTensor, dy: FlexTensor, rulebook: Arc<Rulebook>) -> FlexTensor {
        let (x, dy) = (x.to_contiguous(), dy.to_contiguous());
        let channels = [x.shape()[1], dy.shape()[1]];
        let dw = weight_gradient(&rulebook, values(&x), values(&dy), channels);
        FlexTensor::from_data(TensorData::new(dw, [rulebook.offsets().len(), channels[0], channels[1]]))
    }
}

/// The recorded operation.
#[derive(Debug)]
struct SparseConv {
    rulebook: Arc<Rulebook>,
}

impl<B: Backend + SparseConvBackend> Backward<B, 2> for SparseConv {
    /// Nodes of x and w; each is kept only if the gradient of the other is wanted.
    type State = (Option<NodeId>, Option<NodeId>);

    fn backward(self, ops: Ops<Self::State, 2>, grads: &mut Gradients, checkpointer: &mut Checkpointer) {
        let [x_node, w_node] = ops.parents;
        let dy = grads.consume::<B>(&ops.node);
        let [x, w] = [ops.state.0, ops.state.1]
            .map(|id| id.map(|id| checkpointer.retrieve_node_output::<B::FloatTensorPrimitive>(id)));
        if let Some(node) = x_node {
            let w = w.expect("w is kept whenever x is tracked");
            let dx = B::sparse_conv_input_gradient(dy.clone(), w, Arc::clone(&self.rulebook));
            grads.register::<B>(node.id, dx);
        }
        if let Some(node) = w_node {
            let x = x.expect("x is kept whenever w is tracked");
            grads.register::<B>(node.id, B::sparse_conv_weight_gradient(x, dy, self.rulebook));
        }
    }
}

impl<B: Backend + SparseConvBackend, C: CheckpointStrategy> SparseConvBackend for Autodiff<B, C> {
    fn sparse_conv(x: FloatTensor<Self>, w: FloatTensor<Self>, rulebook: Arc<Rulebook>) -> FloatTensor<Self> {
        let op = SparseConv { rulebook: Arc::clone(&rulebook) };
        let (input_tracked, kernel_tracked) = (x.is_tracked(), w.is_tracked());
        match op.prepare::<C>([x.node(), w.node()]).compute_bound().stateful() {
            OpsKind::Tracked(mut prep) => {
                let x_id = kernel_tracked.then(|| prep.checkpoint(&x));
                let w_id = input_tracked.then(|| prep.checkpoint(&w));
                prep.finish((x_id, w_id), B::sparse_conv(x.into_primitive(), w.into_primitive(), rulebook))
            }
            OpsKind::UnTracked(prep) => {
                prep.finish(B::sparse_conv(x.into_primitive(), w.into_primitive(), rulebook))
            }
        }
    }

    fn sparse_conv_input_gradient(
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: Arc<Rulebook>,
    ) -> FloatTensor<Self> {
        unreachable!("sparse_conv has no second derivatives: its gradients run on the inner backend")
    }

    fn sparse_conv_weight_gradient(
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: Arc<Rulebook>,
    ) -> FloatTensor<Self> {
        unreachable!("sparse_conv has no second derivatives: its gradients run on the inner backend")
    }
}

#[cfg(test)]
mod tests {
    use super::super::OffsetPairs;
    use super::*;
    use burn::tensor::Distribution;

    /// Three offsets, one of them empty, over more rows than one block holds.
    fn rulebook(n_inputs: usize, n_outputs: usize) -> Arc<Rulebook> {
        let pairs = |step_in: usize, step_out: usize| {
            let n = n_inputs.div_ceil(step_in).min(n_outputs.div_ceil(step_out));
            let rows = |step: usize| (0..n).map(|i| (i * step) as u32).collect();
            OffsetPairs { inputs: rows(step_in), outputs: rows(step_out) }
        };
        Arc::new(Rulebook::new(n_inputs, n_outputs, vec![pairs(1, 3), OffsetPairs::default(), pairs(2, 1)]))
    }

    fn max_difference<const D: usize>(a: Tensor<D>, b: Tensor<D>) -> f32 {
        (a - b).abs().max().into_scalar()
    }

    #[test]
    fn values_and_gradients_equal_those_of_burns_operations() {
        let device = Device::flex().autodiff();
        device.seed(7);
        for (n_inputs, n_outputs, channels_in, channels_out) in
            [(5, 4, 1, 1), (40, 25, 3, 17), (9000, 5000, 16, 8), (700, 900, 65, 130)]
        {
            let rulebook = rulebook(n_inputs, n_outputs);
            let random = Distribution::Uniform(-0.5, 0.5);
            let x0 = Tensor::<2>::random([n_inputs, channels_in], random, &device);
            let w0 = Tensor::<3>::random([3, channels_in, channels_out], random, &device);
            let dy = Tensor::<2>::random([n_outputs, channels_out], random, &device);
            let run = |conv: fn(Tensor<2>, Tensor<3>, &Arc<Rulebook>) -> Tensor<2>| {
                let x = x0.clone().detach().require_grad();
                let w = w0.clone().detach().require_grad();
                let y = conv(x.clone(), w.clone(), &rulebook);
                let gradients = (y.clone() * dy.clone()).sum().backward();
                (y.inner(), x.grad(&gradients).unwrap(), w.grad(&gradients).unwrap())
            };
            let own = run(sparse_conv);
            let burns = run(|x, w, rulebook| offset_by_offset(x, w, rulebook));
            assert!(max_difference(own.0, burns.0) < 1e-5);
            assert!(max_difference(own.1, burns.1) < 1e-5);
            assert!(max_difference(own.2, burns.2) < 1e-3, "sums of thousands of products");
        }
    }

    #[test]
    fn works_without_autodiff_and_without_pairs() {
        let device = Device::flex();
        let pairs = OffsetPairs { inputs: vec![0, 1], outputs: vec![1, 2] };
        let rulebook = Arc::new(Rulebook::new(2, 3, vec![pairs]));
        let x = Tensor::<2>::from_data([[1.0_f32], [2.0]], &device);
        let y = sparse_conv(x.clone(), Tensor::from_data([[[3.0_f32]]], &device), &rulebook);
        assert_eq!(y.into_data(), TensorData::from([[0.0_f32], [3.0], [6.0]]));
        let empty = Arc::new(Rulebook::new(2, 3, vec![OffsetPairs::default()]));
        let y = sparse_conv(x, Tensor::from_data([[[3.0_f32]]], &device), &empty);
        assert_eq!(y.into_data(), TensorData::from([[0.0_f32], [0.0], [0.0]]));
    }
}
