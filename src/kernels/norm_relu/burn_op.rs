//! Batch norm with ReLU as a burn operation with gradients.

use burn::backend::flex::FlexTensor;
use burn::tensor::Tensor;
use burn::tensor::activation::relu;
use burn::tensor::module::batch_norm_train;

use super::{Forward, Shape, forward, gradients, scale_shift};
use crate::kernels::operation::{Operation, dims, is_own, run, tensor, values};
use crate::kernels::simd::InstructionSet;

/// A normalized batch and its statistics.
pub struct Normed {
    /// As the input.
    pub output: Tensor<4>,
    /// `[channel]`, apart from autodiff.
    pub mean: Tensor<1>,
    /// `[channel]`, biased, apart from autodiff.
    pub variance: Tensor<1>,
}

/// Normalizes a batch by its own statistics, then sets negative values to zero.
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
    let mut outputs = run(NormRelu { epsilon }, [x.into(), gamma.into(), beta.into()]);
    Normed { output: outputs.next(), mean: outputs.next(), variance: outputs.next() }
}

/// Scales and shifts each channel, then sets negative values to zero: batch norm at inference. Without gradients.
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
    run(ScaleShiftRelu, [x.into(), scale.into(), shift.into()]).next()
}

fn shape_of(x: &FlexTensor) -> Shape {
    let [batch, channels, height_px, width_px] = dims(x);
    Shape { batch, channels, pixels: height_px * width_px }
}

#[derive(Debug)]
struct NormRelu {
    epsilon: f64,
}

impl Operation<3> for NormRelu {
    /// x, gamma, beta, mean and variance.
    type Saved = [FlexTensor; 5];

    fn forward(&self, [x, gamma, beta]: [FlexTensor; 3]) -> (Vec<FlexTensor>, Self::Saved) {
        let (shape, set) = (shape_of(&x), InstructionSet::best());
        let found = forward(shape, values(&x), values(&gamma), values(&beta), self.epsilon, set);
        let Forward { y, mean, variance } = found;
        let [mean, variance] = [mean, variance].map(|row| tensor(row, [shape.channels]));
        let outputs = vec![tensor(y, dims::<4>(&x)), mean.clone(), variance.clone()];
        (outputs, [x, gamma, beta, mean, variance])
    }

    fn gradients(&self, saved: Self::Saved, dy: &FlexTensor, _: [bool; 3]) -> [Option<FlexTensor>; 3] {
        let (shape, set) = (shape_of(&saved[0]), InstructionSet::best());
        let [x, gamma, beta, mean, variance] = saved.each_ref().map(values);
        let found = gradients(shape, x, values(dy), [gamma, beta], [mean, variance], self.epsilon, set);
        let row = |values| tensor(values, [shape.channels]);
        [tensor(found.dx, dims::<4>(dy)), row(found.d_gamma), row(found.d_beta)].map(Some)
    }
}

#[derive(Debug)]
struct ScaleShiftRelu;

impl Operation<3> for ScaleShiftRelu {
    type Saved = ();

    fn forward(&self, inputs: [FlexTensor; 3]) -> (Vec<FlexTensor>, ()) {
        let shape = shape_of(&inputs[0]);
        let [x, scale, shift] = inputs.each_ref().map(values);
        let y = scale_shift(shape, x, scale, shift, InstructionSet::best());
        (vec![tensor(y, dims::<4>(&inputs[0]))], ())
    }

    fn gradients(&self, (): (), _: &FlexTensor, _: [bool; 3]) -> [Option<FlexTensor>; 3] {
        unreachable!("for inference: with autodiff burn's own operations run")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, Distribution, TensorData};

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
