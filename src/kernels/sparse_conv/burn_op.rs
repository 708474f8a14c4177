//! The sparse convolution as a burn operation with gradients.
//!
//! For the backward pass it keeps only input and matrices, and gathers rows anew. Devices other than `Device::flex()`
//! run burn's own operations on the rulebook's index tensors, whose graph keeps the gathered rows.

use std::sync::Arc;

use burn::backend::flex::FlexTensor;
use burn::tensor::{IndexingUpdateOp, Tensor};

use super::products::{apply, weight_gradient};
use super::rulebook::{Direction, Rulebook};
use crate::kernels::operation::{Operation, dims, is_own, run, tensor, values};

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
    let ([n_inputs, channels_in], [n_offsets, kernel_channels, _]) = (x.dims(), w.dims());
    assert_eq!(n_inputs, rulebook.n_inputs(), "sparse_conv: rows of input and rulebook");
    assert_eq!(n_offsets, rulebook.offsets().len(), "sparse_conv: offsets of kernel and rulebook");
    assert_eq!(kernel_channels, channels_in, "sparse_conv: input channels of kernel and input");

    if !is_own(&x) || !is_own(&w) || rulebook.n_pairs() == 0 {
        return offset_by_offset(x, w, rulebook);
    }
    run(SparseConv { rulebook: Arc::clone(rulebook) }, [x.into(), w.into()]).next()
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

#[derive(Debug)]
struct SparseConv {
    rulebook: Arc<Rulebook>,
}

impl Operation<2> for SparseConv {
    /// x and w.
    type Saved = [FlexTensor; 2];

    fn forward(&self, [x, w]: [FlexTensor; 2]) -> (Vec<FlexTensor>, Self::Saved) {
        let [_, channels_in, channels_out] = dims(&w);
        let channels = [channels_in, channels_out];
        let y = apply(&self.rulebook, Direction::Forward, values(&x), values(&w), channels);
        (vec![tensor(y, [self.rulebook.n_outputs(), channels_out])], [x, w])
    }

    fn gradients(&self, [x, w]: Self::Saved, dy: &FlexTensor, wanted: [bool; 2]) -> [Option<FlexTensor>; 2] {
        let [n_offsets, channels_in, channels_out] = dims(&w);
        let channels = [channels_in, channels_out];
        let dx = || {
            let dx = apply(&self.rulebook, Direction::Backward, values(dy), values(&w), channels);
            tensor(dx, [self.rulebook.n_inputs(), channels_in])
        };
        let dw = || {
            let dw = weight_gradient(&self.rulebook, values(&x), values(dy), channels);
            tensor(dw, [n_offsets, channels_in, channels_out])
        };
        [wanted[0].then(dx), wanted[1].then(dw)]
    }
}

#[cfg(test)]
mod tests {
    use super::super::OffsetPairs;
    use super::*;
    use burn::tensor::{Device, Distribution, TensorData};

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
