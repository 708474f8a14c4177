//! Softmax as a burn operation with gradients, for `Device::flex()` with or without autodiff.
//!
//! Every other device runs burn's own softmax.

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::flex::FlexTensor;
use burn::backend::{
    Autodiff, Backend, Dispatch, Flex, TensorMetadata, backend_extension, tensor::FloatTensor,
};
use burn::tensor::activation::softmax;
use burn::tensor::{DType, Device, Tensor, TensorData};

use super::{forward, gradient};
use crate::kernels::simd::InstructionSet;

/// Softmax over the last axis.
///
/// # Shapes
/// - x, output: `[.., column]`
#[must_use]
pub fn softmax_last<const D: usize>(x: Tensor<D>) -> Tensor<D> {
    if x.device() != Device::flex() || x.dtype() != DType::F32 || x.shape().num_elements() == 0 {
        return softmax(x, D - 1);
    }
    Tensor::from_dispatch(<Dispatch as SoftmaxBackend>::softmax_last(x.into_dispatch()))
}

/// The softmax and its gradient on one backend.
#[backend_extension(Flex, Autodiff)]
pub trait SoftmaxBackend: Backend {
    /// The softmax itself.
    fn softmax_last(x: FloatTensor<Self>) -> FloatTensor<Self>;
    /// Gradient with respect to x, from the softmax `y`.
    fn softmax_last_gradient(y: FloatTensor<Self>, dy: FloatTensor<Self>) -> FloatTensor<Self>;
}

fn values(tensor: &FlexTensor) -> &[f32] {
    tensor.as_slice().expect("softmax is only called with f32, made contiguous")
}

impl SoftmaxBackend for Flex {
    fn softmax_last(x: FlexTensor) -> FlexTensor {
        let x = x.to_contiguous();
        let shape = x.shape();
        let n_columns = shape[shape.num_dims() - 1];
        FlexTensor::from_data(TensorData::new(forward(values(&x), n_columns, InstructionSet::best()), shape))
    }

    fn softmax_last_gradient(y: FlexTensor, dy: FlexTensor) -> FlexTensor {
        let (y, dy) = (y.to_contiguous(), dy.to_contiguous());
        let shape = y.shape();
        let n_columns = shape[shape.num_dims() - 1];
        let dx = gradient(values(&y), values(&dy), n_columns, InstructionSet::best());
        FlexTensor::from_data(TensorData::new(dx, shape))
    }
}

/// The recorded operation.
#[derive(Debug)]
struct Softmax;

impl<B: Backend + SoftmaxBackend> Backward<B, 1> for Softmax {
    /// The output.
    type State = FloatTensor<B>;

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _checkpointer: &mut Checkpointer) {
        let [node] = ops.parents;
        let dy = grads.consume::<B>(&ops.node);
        if let Some(node) = node {
            grads.register::<B>(node.id, B::softmax_last_gradient(ops.state, dy));
        }
    }
}

impl<B: Backend + SoftmaxBackend, C: CheckpointStrategy> SoftmaxBackend for Autodiff<B, C> {
    fn softmax_last(x: FloatTensor<Self>) -> FloatTensor<Self> {
        match Softmax.prepare::<C>([x.node()]).compute_bound().stateful() {
            OpsKind::Tracked(prep) => {
                let y = B::softmax_last(x.into_primitive());
                prep.finish(y.clone(), y)
            }
            OpsKind::UnTracked(prep) => prep.finish(B::softmax_last(x.into_primitive())),
        }
    }

    fn softmax_last_gradient(_: FloatTensor<Self>, _: FloatTensor<Self>) -> FloatTensor<Self> {
        unreachable!("softmax has no second derivatives: its gradients run on the inner backend")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Distribution;

    #[test]
    fn values_and_gradients_equal_burns() {
        let device = Device::flex().autodiff();
        device.seed(7);
        for dims in [[2, 3, 5, 70], [1, 4, 8, 1]] {
            let random = || Tensor::<4>::random(dims, Distribution::Uniform(-4.0, 4.0), &device);
            let (x0, dy) = (random(), random());
            let run = |is_own: bool| {
                let x = x0.clone().detach().require_grad();
                // A view that is not contiguous, as the heads of attention make it.
                let view = x.clone().swap_dims(1, 2);
                let y = if is_own { softmax_last(view) } else { softmax(view, 3) };
                let gradients = (y.clone().swap_dims(1, 2) * dy.clone()).sum().backward();
                [y.inner(), x.grad(&gradients).unwrap()]
            };
            for (own, burns) in run(true).into_iter().zip(run(false)) {
                assert!((own - burns).abs().max().into_scalar::<f32>() < 1e-6);
            }
        }
    }
}
