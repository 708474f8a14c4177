//! Mixing channels as a burn operation with gradients.

use burn::backend::flex::FlexTensor;
use burn::tensor::Tensor;

use super::{bias_gradient, weight_gradient};
use crate::kernels::conv3x3::{Mix, Weight};
use crate::kernels::operation::{Operation, dims, is_own, run, tensor, values};
use crate::kernels::products::Products;
use crate::kernels::simd::InstructionSet;

/// Mixes the channels of a map.
///
/// # Shapes
/// - x: `[batch, channel_in, cell]`
/// - w: `[channel_out, channel_in]`
/// - bias: `[channel_out]`
/// - output: `[batch, channel_out, cell]`
#[must_use]
pub fn mix_channels(x: Tensor<3>, w: Tensor<2>, bias: Tensor<1>) -> Tensor<3> {
    if !is_own(&x) || !is_own(&w) {
        return w.unsqueeze::<3>().matmul(x) + bias.reshape([1, -1, 1]);
    }
    let products = if x.device().is_autodiff() { Products::current() } else { Products::F32 };
    run(MixChannels { products }, [x.into(), w.into(), bias.into()]).next()
}

#[derive(Debug)]
struct MixChannels {
    products: Products,
}

fn mix_of(x: &FlexTensor, w: &FlexTensor) -> Mix {
    let ([batch, channels_in, pixels], [channels_out, _]) = (dims(x), dims::<2>(w));
    Mix { batch, channels_in, channels_out, pixels }
}

impl Operation<3> for MixChannels {
    /// x and w.
    type Saved = [FlexTensor; 2];

    fn forward(&self, [x, w, bias]: [FlexTensor; 3]) -> (Vec<FlexTensor>, Self::Saved) {
        let mix = mix_of(&x, &w);
        let weight = Weight { values: values(&w), is_transposed: false };
        let y =
            mix.forward(values(&x), weight, Some(values(&bias)), InstructionSet::for_products(self.products));
        (vec![tensor(y, [mix.batch, mix.channels_out, mix.pixels])], [x, w])
    }

    fn gradients(&self, [x, w]: Self::Saved, dy: &FlexTensor, wanted: [bool; 3]) -> [Option<FlexTensor>; 3] {
        let (mix, set) = (mix_of(&x, &w), InstructionSet::for_products(self.products));
        let weight = Weight { values: values(&w), is_transposed: false };
        let dx = || tensor(mix.input_gradient(values(dy), weight, set), dims::<3>(&x));
        let dw = || tensor(weight_gradient(mix, values(&x), values(dy), set), dims::<2>(&w));
        let d_bias = || tensor(bias_gradient(mix, values(dy)), [mix.channels_out]);
        [wanted[0].then(dx), wanted[1].then(dw), wanted[2].then(d_bias)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, Distribution};

    #[test]
    fn values_and_gradients_equal_burns() {
        let device = Device::flex().autodiff();
        device.seed(7);
        for (batch, channels_in, channels_out, cells) in [(2, 3, 5, 7), (1, 64, 48, 320)] {
            let random = |dims| Tensor::<3>::random(dims, Distribution::Uniform(-0.5, 0.5), &device);
            let (x0, dy) = (random([batch, channels_in, cells]), random([batch, channels_out, cells]));
            let w0 = random([1, channels_out, channels_in]).reshape([channels_out, channels_in]);
            let bias0 = random([1, 1, channels_out]).reshape([channels_out]);
            let run = |is_own: bool| {
                let x = x0.clone().detach().require_grad();
                let w = w0.clone().detach().require_grad();
                let bias = bias0.clone().detach().require_grad();
                let y = if is_own {
                    mix_channels(x.clone(), w.clone(), bias.clone())
                } else {
                    w.clone().unsqueeze::<3>().matmul(x.clone()) + bias.clone().reshape([1, -1, 1])
                };
                let gradients = (y.clone() * dy.clone()).sum().backward();
                let flat = |x: Tensor<3>| -> Vec<f32> { x.into_data().try_to_vec().unwrap() };
                [
                    flat(y.inner()),
                    flat(x.grad(&gradients).unwrap()),
                    flat(w.grad(&gradients).unwrap().unsqueeze()),
                    flat(bias.grad(&gradients).unwrap().unsqueeze()),
                ]
            };
            for (part, (own, burns)) in run(true).into_iter().zip(run(false)).enumerate() {
                let largest = burns.iter().fold(0f32, |largest, value| largest.max(value.abs()));
                for (a, b) in own.iter().zip(&burns) {
                    assert!((a - b).abs() <= 2e-5 * largest, "part {part}: {a} against {b}");
                }
            }
        }
    }
}
