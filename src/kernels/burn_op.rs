//! The 3x3 convolution as a burn operation with gradients, for `Device::flex()` with or without autodiff.
//!
//! Every other device runs burn's own `conv2d`: the choice is made per call, from the device of the input.

use burn::backend::autodiff::NodeId;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::flex::FlexTensor;
use burn::backend::{
    Autodiff, Backend, Dispatch, Flex, TensorMetadata, backend_extension, tensor::FloatTensor,
};
use burn::tensor::{DType, Device, Tensor, TensorData, module::conv2d, ops::ConvOptions};

use super::conv3x3::{ScaleShiftRelu, Shape, forward, input_gradient, weight_gradient};
use super::norm_relu::scale_shift_relu;
use super::simd::InstructionSet;

/// Convolves with a 3x3 kernel, one pixel of zero padding on each side and no bias.
///
/// # Shapes
/// - x: `[batch, channel_in, y, x]`, y and x at least 1
/// - w: `[channel_out, channel_in, 3, 3]`
/// - output: `[batch, channel_out, (y - 1) / stride + 1, (x - 1) / stride + 1]`
///
/// # Panics
/// If `stride` is neither 1 nor 2, if the channels disagree, or if the kernel is not 3x3.
#[must_use]
pub fn conv3x3(x: Tensor<4>, w: Tensor<4>, stride: usize) -> Tensor<4> {
    if !is_own(&x, &w, stride) {
        return conv2d(x, w, None, ConvOptions::new([stride, stride], [1, 1], [1, 1], 1));
    }
    Tensor::from_dispatch(<Dispatch as Conv3x3Backend>::conv3x3(x.into_dispatch(), w.into_dispatch(), stride))
}

/// [`conv3x3`], then `max(0, scale y + shift)`, in one pass over the map: a block with batch norm at inference.
/// Without gradients.
///
/// # Shapes
/// - x, w, output: as for [`conv3x3`]
/// - scale, shift: `[channel_out]`
///
/// # Panics
/// As for [`conv3x3`].
#[must_use]
pub fn conv3x3_scale_shift_relu(
    x: Tensor<4>,
    w: Tensor<4>,
    scale: Tensor<1>,
    shift: Tensor<1>,
    stride: usize,
) -> Tensor<4> {
    if !is_own(&x, &w, stride) || x.device().is_autodiff() {
        return scale_shift_relu(conv3x3(x, w, stride), scale, shift);
    }
    let [x, w] = [x, w].map(Tensor::into_dispatch);
    let [scale, shift] = [scale, shift].map(Tensor::into_dispatch);
    Tensor::from_dispatch(<Dispatch as Conv3x3Backend>::conv3x3_scale_shift_relu(x, w, scale, shift, stride))
}

/// Whether the kernels here can convolve these; burn's operations serve the rest.
///
/// # Panics
/// As for [`conv3x3`].
fn is_own(x: &Tensor<4>, w: &Tensor<4>, stride: usize) -> bool {
    let [_, channels_in, ..] = x.dims();
    let [_, kernel_channels, kernel_y, kernel_x] = w.dims();
    assert!(matches!(stride, 1 | 2), "conv3x3: stride is 1 or 2, not {stride}");
    assert_eq!([kernel_y, kernel_x], [3, 3], "conv3x3: the kernel is 3x3");
    assert_eq!(kernel_channels, channels_in, "conv3x3: input channels of kernel and input");

    // `==` on devices compares the hardware and leaves autodiff aside.
    let is_flex = x.device() == Device::flex();
    let is_f32 = x.dtype() == DType::F32 && w.dtype() == DType::F32;
    is_flex && is_f32 && x.shape().num_elements() > 0 && w.shape().num_elements() > 0
}

/// The convolution and its two gradients on one backend.
#[backend_extension(Flex, Autodiff)]
pub trait Conv3x3Backend: Backend {
    /// The convolution itself.
    fn conv3x3(x: FloatTensor<Self>, w: FloatTensor<Self>, stride: usize) -> FloatTensor<Self>;
    /// With scale, shift and ReLU in the same pass.
    fn conv3x3_scale_shift_relu(
        x: FloatTensor<Self>,
        w: FloatTensor<Self>,
        scale: FloatTensor<Self>,
        shift: FloatTensor<Self>,
        stride: usize,
    ) -> FloatTensor<Self>;
    /// Gradient with respect to an input of `height_px` by `width_px`.
    fn conv3x3_input_gradient(
        dy: FloatTensor<Self>,
        w: FloatTensor<Self>,
        stride: usize,
        height_px: usize,
        width_px: usize,
    ) -> FloatTensor<Self>;
    /// Gradient with respect to the kernel.
    fn conv3x3_weight_gradient(
        x: FloatTensor<Self>,
        dy: FloatTensor<Self>,
        stride: usize,
    ) -> FloatTensor<Self>;
}

/// Sizes of a convolution of an input of `[batch, channel_in, y, x]`.
fn shape(input_dims: [usize; 4], channels_out: usize, stride: usize) -> Shape {
    let [batch, channels_in, height_px, width_px] = input_dims;
    Shape { batch, channels_in, channels_out, height_px, width_px, stride }
}

fn tensor(values: Vec<f32>, dims: [usize; 4]) -> FlexTensor {
    FlexTensor::from_data(TensorData::new(values, dims))
}

fn values(tensor: &FlexTensor) -> &[f32] {
    tensor.as_slice().expect("conv3x3 is only called with f32, made contiguous")
}

impl Conv3x3Backend for Flex {
    fn conv3x3(x: FlexTensor, w: FlexTensor, stride: usize) -> FlexTensor {
        let (x, w) = (x.to_contiguous(), w.to_contiguous());
        let (xs, ws) = (x.shape(), w.shape());
        let s = shape([xs[0], xs[1], xs[2], xs[3]], ws[0], stride);
        let y = forward(s, values(&x), values(&w), None, InstructionSet::best());
        tensor(y, [s.batch, s.channels_out, s.out_height_px(), s.out_width_px()])
    }

    fn conv3x3_scale_shift_relu(
        x: FlexTensor,
        w: FlexTensor,
        scale: FlexTensor,
        shift: FlexTensor,
        stride: usize,
    ) -> FlexTensor {
        let [x, w, scale, shift] = [x, w, scale, shift].map(|tensor| tensor.to_contiguous());
        let (xs, ws) = (x.shape(), w.shape());
        let s = shape([xs[0], xs[1], xs[2], xs[3]], ws[0], stride);
        let then = ScaleShiftRelu { scale: values(&scale), shift: values(&shift) };
        let y = forward(s, values(&x), values(&w), Some(then), InstructionSet::best());
        tensor(y, [s.batch, s.channels_out, s.out_height_px(), s.out_width_px()])
    }

    fn conv3x3_input_gradient(
        dy: FlexTensor,
        w: FlexTensor,
        stride: usize,
        height_px: usize,
        width_px: usize,
    ) -> FlexTensor {
        let (dy, w) = (dy.to_contiguous(), w.to_contiguous());
        let (batch, ws) = (dy.shape()[0], w.shape());
        let dims = [batch, ws[1], height_px, width_px];
        let s = shape(dims, ws[0], stride);
        tensor(input_gradient(s, values(&dy), values(&w), InstructionSet::best()), dims)
    }

    fn conv3x3_weight_gradient(x: FlexTensor, dy: FlexTensor, stride: usize) -> FlexTensor {
        let (x, dy) = (x.to_contiguous(), dy.to_contiguous());
        let xs = x.shape();
        let s = shape([xs[0], xs[1], xs[2], xs[3]], dy.shape()[1], stride);
        let dw = weight_gradient(s, values(&x), values(&dy), InstructionSet::best());
        tensor(dw, [s.channels_out, s.channels_in, 3, 3])
    }
}

/// The recorded operation; `stride` and the input's size are what its gradients need besides tensors.
#[derive(Debug)]
struct Conv3x3 {
    stride: usize,
    height_px: usize,
    width_px: usize,
}

impl<B: Backend + Conv3x3Backend> Backward<B, 2> for Conv3x3 {
    /// Nodes of x and w; each is kept only if the gradient of the other is wanted.
    type State = (Option<NodeId>, Option<NodeId>);

    fn backward(self, ops: Ops<Self::State, 2>, grads: &mut Gradients, checkpointer: &mut Checkpointer) {
        let [x_node, w_node] = ops.parents;
        let dy = grads.consume::<B>(&ops.node);
        let [x, w] = [ops.state.0, ops.state.1]
            .map(|id| id.map(|id| checkpointer.retrieve_node_output::<B::FloatTensorPrimitive>(id)));
        if let Some(node) = x_node {
            let w = w.expect("w is kept whenever x is tracked");
            let dx = B::conv3x3_input_gradient(dy.clone(), w, self.stride, self.height_px, self.width_px);
            grads.register::<B>(node.id, dx);
        }
        if let Some(node) = w_node {
            let x = x.expect("x is kept whenever w is tracked");
            grads.register::<B>(node.id, B::conv3x3_weight_gradient(x, dy, self.stride));
        }
    }
}

impl<B: Backend + Conv3x3Backend, C: CheckpointStrategy> Conv3x3Backend for Autodiff<B, C> {
    fn conv3x3(x: FloatTensor<Self>, w: FloatTensor<Self>, stride: usize) -> FloatTensor<Self> {
        let x_shape = x.shape();
        let op = Conv3x3 { stride, height_px: x_shape[2], width_px: x_shape[3] };
        let (input_tracked, kernel_tracked) = (x.is_tracked(), w.is_tracked());
        match op.prepare::<C>([x.node(), w.node()]).compute_bound().stateful() {
            OpsKind::Tracked(mut prep) => {
                let x_id = kernel_tracked.then(|| prep.checkpoint(&x));
                let w_id = input_tracked.then(|| prep.checkpoint(&w));
                prep.finish((x_id, w_id), B::conv3x3(x.into_primitive(), w.into_primitive(), stride))
            }
            OpsKind::UnTracked(prep) => {
                prep.finish(B::conv3x3(x.into_primitive(), w.into_primitive(), stride))
            }
        }
    }

    fn conv3x3_scale_shift_relu(
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: usize,
    ) -> FloatTensor<Self> {
        unreachable!("conv3x3_scale_shift_relu is for inference: with autodiff its parts run")
    }

    fn conv3x3_input_gradient(
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: usize,
        _: usize,
        _: usize,
    ) -> FloatTensor<Self> {
        unreachable!("conv3x3 has no second derivatives: its gradients run on the inner backend")
    }

    fn conv3x3_weight_gradient(_: FloatTensor<Self>, _: FloatTensor<Self>, _: usize) -> FloatTensor<Self> {
        unreachable!("conv3x3 has no second derivatives: its gradients run on the inner backend")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Distribution;

    fn max_difference(a: Tensor<4>, b: Tensor<4>) -> f32 {
        (a - b).abs().max().into_scalar()
    }

    #[test]
    fn values_and_gradients_equal_burns_conv2d() {
        let device = Device::flex().autodiff();
        device.seed(7);
        for (n, ic, oc, h, w, stride) in [
            (2, 3, 5, 9, 11, 1),
            (1, 32, 16, 20, 36, 1),
            (2, 3, 16, 25, 40, 2),
            (1, 20, 17, 10, 64, 2),
            (1, 1, 1, 1, 1, 1),
        ] {
            let random = |dims| Tensor::<4>::random(dims, Distribution::Uniform(-0.5, 0.5), &device);
            let (x0, w0) = (random([n, ic, h, w]), random([oc, ic, 3, 3]));
            let dy = random([n, oc, (h - 1) / stride + 1, (w - 1) / stride + 1]);
            let run = |is_own: bool| {
                let x = x0.clone().detach().require_grad();
                let w = w0.clone().detach().require_grad();
                let y = if is_own {
                    conv3x3(x.clone(), w.clone(), stride)
                } else {
                    let options = ConvOptions::new([stride, stride], [1, 1], [1, 1], 1);
                    conv2d(x.clone(), w.clone(), None, options)
                };
                let gradients = (y.clone() * dy.clone()).sum().backward();
                (y.inner(), x.grad(&gradients).unwrap(), w.grad(&gradients).unwrap())
            };
            let (own, burns) = (run(true), run(false));
            assert!(max_difference(own.0, burns.0) < 2e-5);
            assert!(max_difference(own.1, burns.1) < 2e-5);
            assert!(max_difference(own.2, burns.2) < 1e-4);
        }
    }

    #[test]
    fn in_one_pass_or_in_its_parts_a_block_is_the_same() {
        let device = Device::flex();
        device.seed(9);
        let random = |dims| Tensor::<4>::random(dims, Distribution::Uniform(-0.5, 0.5), &device);
        let (x, w) = (random([2, 6, 9, 20]), random([11, 6, 3, 3]));
        let [scale, shift] = [(); 2].map(|()| random([1, 11, 1, 1]).reshape([11]));
        let parts = scale_shift_relu(conv3x3(x.clone(), w.clone(), 2), scale.clone(), shift.clone());
        let with_autodiff = [scale.clone(), shift.clone()].map(Tensor::from_inner);
        let [x_tracked, w_tracked] = [x.clone(), w.clone()].map(Tensor::from_inner);
        let [scale_tracked, shift_tracked] = with_autodiff;
        let tracked = conv3x3_scale_shift_relu(x_tracked, w_tracked, scale_tracked, shift_tracked, 2);
        assert!(max_difference(tracked.inner(), parts.clone()) < 1e-6);
        assert!(max_difference(conv3x3_scale_shift_relu(x, w, scale, shift, 2), parts) < 1e-6);
    }

    #[test]
    fn works_without_autodiff() {
        let device = Device::flex();
        let x = Tensor::<4>::ones([1, 1, 3, 3], &device);
        let y = conv3x3(x, Tensor::ones([1, 1, 3, 3], &device), 2);
        assert_eq!(y.into_data(), TensorData::from([[[[4.0_f32, 4.0], [4.0, 4.0]]]]));
    }
}
