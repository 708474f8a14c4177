//! Batch norm with ReLU as a burn operation with gradients, for `Device::flex()` with or without autodiff.
//!
//! Every other device runs burn's own operations.

use burn::backend::autodiff::NodeId;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::flex::FlexTensor;
use burn::backend::{
    Autodiff, AutodiffBackend, Backend, Dispatch, Flex, TensorMetadata, backend_extension,
    tensor::FloatTensor,
};
use burn::tensor::activation::relu;
use burn::tensor::module::batch_norm_train;
use burn::tensor::{DType, Device, Tensor, TensorData};

use super::{Forward, Shape, forward, gradients, scale_shift};
use crate::kernels::simd::InstructionSet;

/// A normed batch and its statistics.
pub struct Normed {
    /// As the input.
    pub output: Tensor<4>,
    /// `[channel]`, apart from autodiff.
    pub mean: Tensor<1>,
    /// `[channel]`, biased, apart from autodiff.
    pub variance: Tensor<1>,
}

fn is_own(x: &Tensor<4>) -> bool {
    x.device() == Device::flex() && x.dtype() == DType::F32 && x.shape().num_elements() > 0
}

/// Norms a batch by its own statistics, then cuts off what is negative.
///
/// # Shapes
/// - x: `[batch, channel, y, x]`
/// - gamma, beta: `[channel]`
#[must_use]
pub fn norm_relu(x: Tensor<4>, gamma: Tensor<1>, beta: Tensor<1>, epsilon: f64) -> Normed {
    if !is_own(&x) {
        let normed = batch_norm_train(x, gamma, beta, epsilon);
        let [mean, variance] = [normed.mean, normed.variance].map(Tensor::detach);
        return Normed { output: relu(normed.output), mean, variance };
    }
    let [x, gamma, beta] = [x.into_dispatch(), gamma.into_dispatch(), beta.into_dispatch()];
    let (output, mean, variance) = <Dispatch as NormReluBackend>::norm_relu(x, gamma, beta, epsilon);
    Normed {
        output: Tensor::from_dispatch(output),
        mean: Tensor::from_dispatch(mean),
        variance: Tensor::from_dispatch(variance),
    }
}

/// Scales and shifts each channel, then cuts off what is negative: batch norm at inference. Without gradients.
///
/// # Shapes
/// - x: `[batch, channel, y, x]`
/// - scale, shift: `[channel]`
#[must_use]
pub fn scale_shift_relu(x: Tensor<4>, scale: Tensor<1>, shift: Tensor<1>) -> Tensor<4> {
    if !is_own(&x) || x.device().is_autodiff() {
        let n_channels = x.dims()[1];
        let [scale, shift] = [scale, shift].map(|values| values.reshape([1, n_channels, 1, 1]));
        return relu(x * scale + shift);
    }
    let [x, scale, shift] = [x.into_dispatch(), scale.into_dispatch(), shift.into_dispatch()];
    Tensor::from_dispatch(<Dispatch as NormReluBackend>::scale_shift_relu(x, scale, shift))
}

type Floats<B> = FloatTensor<B>;

/// The operations on one backend.
#[backend_extension(Flex, Autodiff)]
pub trait NormReluBackend: Backend {
    /// Output, mean and variance.
    fn norm_relu(
        x: FloatTensor<Self>,
        gamma: FloatTensor<Self>,
        beta: FloatTensor<Self>,
        epsilon: f64,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>);
    /// Gradients with respect to x, gamma and beta; `affine` are gamma and beta, `statistics` mean and
    /// variance, each as `[2, channel]`.
    fn norm_relu_gradients(
        x: FloatTensor<Self>,
        dy: FloatTensor<Self>,
        gamma: FloatTensor<Self>,
        beta: FloatTensor<Self>,
        mean: FloatTensor<Self>,
        variance: FloatTensor<Self>,
        epsilon: f64,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>);
    /// Given statistics.
    fn scale_shift_relu(
        x: FloatTensor<Self>,
        scale: FloatTensor<Self>,
        shift: FloatTensor<Self>,
    ) -> FloatTensor<Self>;
}

fn shape_of(x: &FlexTensor) -> Shape {
    let dims = x.shape();
    Shape { batch: dims[0], channels: dims[1], pixels: dims[2] * dims[3] }
}

fn tensor<const D: usize>(values: Vec<f32>, dims: [usize; D]) -> FlexTensor {
    FlexTensor::from_data(TensorData::new(values, dims))
}

fn values(tensor: &FlexTensor) -> &[f32] {
    tensor.as_slice().expect("norm_relu is only called with f32, made contiguous")
}

impl NormReluBackend for Flex {
    fn norm_relu(
        x: FlexTensor,
        gamma: FlexTensor,
        beta: FlexTensor,
        epsilon: f64,
    ) -> (FlexTensor, FlexTensor, FlexTensor) {
        let [x, gamma, beta] = [x, gamma, beta].map(|tensor| tensor.to_contiguous());
        let shape = shape_of(&x);
        let dims = [x.shape()[0], x.shape()[1], x.shape()[2], x.shape()[3]];
        let Forward { y, mean, variance } =
            forward(shape, values(&x), values(&gamma), values(&beta), epsilon, InstructionSet::best());
        (tensor(y, dims), tensor(mean, [shape.channels]), tensor(variance, [shape.channels]))
    }

    fn norm_relu_gradients(
        x: FlexTensor,
        dy: FlexTensor,
        gamma: FlexTensor,
        beta: FlexTensor,
        mean: FlexTensor,
        variance: FlexTensor,
        epsilon: f64,
    ) -> (FlexTensor, FlexTensor, FlexTensor) {
        let [x, dy, gamma, beta] = [x, dy, gamma, beta].map(|tensor| tensor.to_contiguous());
        let shape = shape_of(&x);
        let dims = [x.shape()[0], x.shape()[1], x.shape()[2], x.shape()[3]];
        let found = gradients(
            shape,
            values(&x),
            values(&dy),
            [values(&gamma), values(&beta)],
            [values(&mean), values(&variance)],
            epsilon,
            InstructionSet::best(),
        );
        (
            tensor(found.dx, dims),
            tensor(found.d_gamma, [shape.channels]),
            tensor(found.d_beta, [shape.channels]),
        )
    }

    fn scale_shift_relu(x: FlexTensor, scale: FlexTensor, shift: FlexTensor) -> FlexTensor {
        let [x, scale, shift] = [x, scale, shift].map(|tensor| tensor.to_contiguous());
        let dims = [x.shape()[0], x.shape()[1], x.shape()[2], x.shape()[3]];
        let set = InstructionSet::best();
        tensor(scale_shift(shape_of(&x), values(&x), values(&scale), values(&shift), set), dims)
    }
}

/// The recorded operation.
#[derive(Debug)]
struct NormRelu {
    epsilon: f64,
}

impl<B: Backend + NormReluBackend> Backward<B, 3> for NormRelu {
    /// Nodes of x, gamma and beta; mean and variance.
    type State = ([NodeId; 3], [Floats<B>; 2]);

    fn backward(self, ops: Ops<Self::State, 3>, grads: &mut Gradients, checkpointer: &mut Checkpointer) {
        let dy = grads.consume::<B>(&ops.node);
        let (ids, [mean, variance]) = ops.state;
        let [x, gamma, beta] = ids.map(|id| checkpointer.retrieve_node_output::<B::FloatTensorPrimitive>(id));
        let (dx, d_gamma, d_beta) = B::norm_relu_gradients(x, dy, gamma, beta, mean, variance, self.epsilon);
        for (node, gradient) in ops.parents.into_iter().zip([dx, d_gamma, d_beta]) {
            if let Some(node) = node {
                grads.register::<B>(node.id, gradient);
            }
        }
    }
}

impl<B: Backend + NormReluBackend, C: CheckpointStrategy> NormReluBackend for Autodiff<B, C> {
    fn norm_relu(
        x: FloatTensor<Self>,
        gamma: FloatTensor<Self>,
        beta: FloatTensor<Self>,
        epsilon: f64,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>) {
        let op = NormRelu { epsilon };
        let nodes = [x.node(), gamma.node(), beta.node()];
        let (output, mean, variance) = match op.prepare::<C>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(mut prep) => {
                let ids = [prep.checkpoint(&x), prep.checkpoint(&gamma), prep.checkpoint(&beta)];
                let (output, mean, variance) =
                    B::norm_relu(x.into_primitive(), gamma.into_primitive(), beta.into_primitive(), epsilon);
                let state = (ids, [mean.clone(), variance.clone()]);
                (prep.finish(state, output), mean, variance)
            }
            OpsKind::UnTracked(prep) => {
                let (output, mean, variance) =
                    B::norm_relu(x.into_primitive(), gamma.into_primitive(), beta.into_primitive(), epsilon);
                (prep.finish(output), mean, variance)
            }
        };
        (output, Self::from_inner(mean), Self::from_inner(variance))
    }

    fn norm_relu_gradients(
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: f64,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>) {
        unreachable!("norm_relu has no second derivatives: its gradients run on the inner backend")
    }

    fn scale_shift_relu(
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
    ) -> FloatTensor<Self> {
        unreachable!("scale_shift_relu is for inference: with autodiff burn's own operations run")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Distribution;

    #[test]
    fn values_statistics_and_gradients_equal_burns() {
        let device = Device::flex().autodiff();
        device.seed(7);
        for dims in [[2, 3, 5, 7], [1, 4, 8, 16], [3, 1, 1, 2]] {
            let random = |dims| Tensor::<4>::random(dims, Distribution::Uniform(-1.0, 1.0), &device);
            let (x0, dy) = (random(dims), random(dims));
            let channel = || random([1, dims[1], 1, 1]).reshape([dims[1]]);
            let (gamma0, beta0) = (channel(), channel());
            let run = |is_own: bool| {
                let x = x0.clone().detach().require_grad();
                let [gamma, beta] = [&gamma0, &beta0].map(|of| of.clone().detach().require_grad());
                let normed = if is_own {
                    norm_relu(x.clone(), gamma.clone(), beta.clone(), 1e-3)
                } else {
                    let normed = batch_norm_train(x.clone(), gamma.clone(), beta.clone(), 1e-3);
                    Normed { output: relu(normed.output), mean: normed.mean, variance: normed.variance }
                };
                let gradients = (normed.output.clone() * dy.clone()).sum().backward();
                let flat = |x: Tensor<4>| -> Vec<f32> { x.into_data().try_to_vec().unwrap() };
                let row = |x: Tensor<1>| -> Vec<f32> { x.into_data().try_to_vec().unwrap() };
                [
                    flat(normed.output.inner()),
                    row(normed.mean.inner()),
                    row(normed.variance.inner()),
                    flat(x.grad(&gradients).unwrap()),
                    row(gamma.grad(&gradients).unwrap()),
                    row(beta.grad(&gradients).unwrap()),
                ]
            };
            for (part, (own, burns)) in run(true).into_iter().zip(run(false)).enumerate() {
                for (a, b) in own.iter().zip(&burns) {
                    assert!((a - b).abs() < 2e-5, "{dims:?}, part {part}: {a} against {b}");
                }
            }
        }
    }

    #[test]
    fn given_statistics_scale_and_shift() {
        for device in [Device::flex(), Device::flex().autodiff()] {
            let x = Tensor::<4>::from_data([[[[1.0f32, -1.0]], [[2.0, 3.0]]]], &device);
            let [scale, shift] = [[2.0f32, -1.0], [0.5, 2.5]].map(|of| Tensor::<1>::from_data(of, &device));
            let y = scale_shift_relu(x, scale, shift).into_data();
            assert_eq!(y, TensorData::from([[[[2.5f32, 0.0]], [[0.5, 0.0]]]]));
        }
    }
}
