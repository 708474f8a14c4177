//! Softmax as a burn operation with gradients.

use burn::backend::TensorMetadata;
use burn::backend::flex::FlexTensor;
use burn::tensor::Tensor;
use burn::tensor::activation::softmax;

use super::{forward, gradient};
use crate::kernels::operation::{Operation, is_own, run, tensor, values};
use crate::kernels::simd::InstructionSet;

/// Softmax over the last axis.
///
/// # Shapes
/// - x, output: `[.., column]`
#[must_use]
pub fn softmax_last<const D: usize>(x: Tensor<D>) -> Tensor<D> {
    if !is_own(&x) {
        return softmax(x, D - 1);
    }
    let n_columns = x.dims()[D - 1];
    run(Softmax { n_columns }, [x.into()]).next()
}

#[derive(Debug)]
struct Softmax {
    n_columns: usize,
}

impl Operation<1> for Softmax {
    /// The output.
    type Saved = FlexTensor;

    fn forward(&self, [x]: [FlexTensor; 1]) -> (Vec<FlexTensor>, FlexTensor) {
        let y = tensor(forward(values(&x), self.n_columns, InstructionSet::best()), x.shape());
        (vec![y.clone()], y)
    }

    fn gradients(&self, y: FlexTensor, dy: &FlexTensor, _: [bool; 1]) -> [Option<FlexTensor>; 1] {
        let dx = gradient(values(&y), values(dy), self.n_columns, InstructionSet::best());
        [Some(tensor(dx, y.shape()))]
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
        for dims in [[2, 3, 5, 70], [1, 4, 8, 1]] {
            let random = || Tensor::<4>::random(dims, Distribution::Uniform(-4.0, 4.0), &device);
            let (x0, dy) = (random(), random());
            let run = |is_own: bool| {
                let x = x0.clone().detach().require_grad();
                // A view that is not contiguous, as attention heads make it.
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
