//! The 3x3 convolution as a burn operation with gradients.

use burn::backend::flex::FlexTensor;
use burn::tensor::{Tensor, module::conv2d, ops::ConvOptions};

use super::{ScaleShiftRelu, Shape, forward, input_gradient, weight_gradient};
use crate::kernels::norm_relu::scale_shift_relu;
use crate::kernels::operation::{Operation, dims, is_own, run, tensor, values};
use crate::kernels::products::Products;
use crate::kernels::simd::InstructionSet;

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
    if !can_run(&x, &w, stride) {
        return conv2d(x, w, None, ConvOptions::new([stride, stride], [1, 1], [1, 1], 1));
    }
    let products = if x.device().is_autodiff() { Products::current() } else { Products::F32 };
    run(Conv3x3 { stride, products }, [x.into(), w.into()]).next()
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
    if !can_run(&x, &w, stride) || x.device().is_autodiff() {
        return scale_shift_relu(conv3x3(x, w, stride), scale, shift);
    }
    run(Conv3x3ScaleShiftRelu { stride }, [x.into(), w.into(), scale.into(), shift.into()]).next()
}

/// Whether the kernels here can convolve these; burn's operations do the rest.
///
/// # Panics
/// As for [`conv3x3`].
fn can_run(x: &Tensor<4>, w: &Tensor<4>, stride: usize) -> bool {
    let [_, channels_in, ..] = x.dims();
    let [_, kernel_channels, kernel_y, kernel_x] = w.dims();
    assert!(matches!(stride, 1 | 2), "conv3x3: stride is 1 or 2, not {stride}");
    assert_eq!([kernel_y, kernel_x], [3, 3], "conv3x3: the kernel is 3x3");
    assert_eq!(kernel_channels, channels_in, "conv3x3: input channels of kernel and input");
    is_own(x) && is_own(w)
}

/// Sizes of the convolution of `x` with the kernel `w`.
fn shape(x: &FlexTensor, w: &FlexTensor, stride: usize) -> Shape {
    let ([batch, channels_in, height_px, width_px], [channels_out, ..]) = (dims::<4>(x), dims::<4>(w));
    Shape { batch, channels_in, channels_out, height_px, width_px, stride }
}

/// Convolves on slices.
fn convolve(
    x: &FlexTensor,
    w: &FlexTensor,
    stride: usize,
    then: Option<ScaleShiftRelu>,
    set: InstructionSet,
) -> FlexTensor {
    let shape = shape(x, w, stride);
    let y = forward(shape, values(x), values(w), then, set);
    tensor(y, [shape.batch, shape.channels_out, shape.out_height_px(), shape.out_width_px()])
}

#[derive(Debug)]
struct Conv3x3 {
    stride: usize,
    products: Products,
}

impl Operation<2> for Conv3x3 {
    /// x and w.
    type Saved = [FlexTensor; 2];

    fn forward(&self, [x, w]: [FlexTensor; 2]) -> (Vec<FlexTensor>, Self::Saved) {
        let set = InstructionSet::for_products(self.products);
        (vec![convolve(&x, &w, self.stride, None, set)], [x, w])
    }

    fn gradients(&self, [x, w]: Self::Saved, dy: &FlexTensor, wanted: [bool; 2]) -> [Option<FlexTensor>; 2] {
        let (shape, set) = (shape(&x, &w, self.stride), InstructionSet::for_products(self.products));
        let dx = || tensor(input_gradient(shape, values(dy), values(&w), set), dims::<4>(&x));
        let dw = || tensor(weight_gradient(shape, values(&x), values(dy), set), dims::<4>(&w));
        [wanted[0].then(dx), wanted[1].then(dw)]
    }
}

#[derive(Debug)]
struct Conv3x3ScaleShiftRelu {
    stride: usize,
}

impl Operation<4> for Conv3x3ScaleShiftRelu {
    type Saved = ();

    fn forward(&self, [x, w, scale, shift]: [FlexTensor; 4]) -> (Vec<FlexTensor>, ()) {
        let then = ScaleShiftRelu { scale: values(&scale), shift: values(&shift) };
        (vec![convolve(&x, &w, self.stride, Some(then), InstructionSet::best())], ())
    }

    fn gradients(&self, (): (), _: &FlexTensor, _: [bool; 4]) -> [Option<FlexTensor>; 4] {
        unreachable!("for inference: with autodiff its parts run")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, Distribution, TensorData};

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
