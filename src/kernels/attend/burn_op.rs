//! Attention as a burn operation with gradients.

use std::sync::Arc;

use burn::backend::flex::FlexTensor;
use burn::tensor::Tensor;

use super::Sizes;
use crate::kernels::operation::{Operation, dims, is_own, run, tensor, values};
use crate::kernels::simd::InstructionSet;
use crate::kernels::softmax_last;

/// Attends with each head's queries to its keys.
///
/// # Shapes
/// - q: `[batch, head, query, channel]`, already scaled
/// - k, v: `[batch, head, channel, key]`
/// - output: `[batch, head, query, channel]`
#[must_use]
pub fn attend(q: Tensor<4>, k: Tensor<4>, v: Tensor<4>) -> Tensor<4> {
    if !is_own(&q) || !is_own(&k) || !is_own(&v) {
        return softmax_last(q.matmul(k)).matmul(v.swap_dims(2, 3));
    }
    run(Attend, [q.into(), k.into(), v.into()]).next()
}

#[derive(Debug)]
struct Attend;

fn sizes(q: &FlexTensor, k: &FlexTensor) -> Sizes {
    let ([n_batch, n_heads, queries, channels], [.., keys]) = (dims(q), dims::<4>(k));
    Sizes { rows: n_batch * n_heads, queries, channels, keys }
}

/// Inputs, and each row's shares.
#[derive(Debug, Clone)]
struct Saved {
    qkv: [FlexTensor; 3],
    shares: Arc<Vec<Vec<f32>>>,
}

impl Operation<3> for Attend {
    type Saved = Saved;

    fn forward(&self, qkv: [FlexTensor; 3]) -> (Vec<FlexTensor>, Saved) {
        let sizes = sizes(&qkv[0], &qkv[1]);
        let rows = sizes.forward(qkv.each_ref().map(values), InstructionSet::best());
        let (out, shares): (Vec<_>, Vec<_>) = rows.into_iter().map(|[out, shares]| (out, shares)).unzip();
        let out = tensor(out.concat(), dims::<4>(&qkv[0]));
        (vec![out], Saved { qkv, shares: Arc::new(shares) })
    }

    fn gradients(&self, saved: Saved, dy: &FlexTensor, _: [bool; 3]) -> [Option<FlexTensor>; 3] {
        let Saved { qkv, shares } = saved;
        let sizes = sizes(&qkv[0], &qkv[1]);
        let rows = sizes.gradients(qkv.each_ref().map(values), &shares, values(dy), InstructionSet::best());
        std::array::from_fn(|part| {
            let parts: Vec<&[f32]> = rows.iter().map(|row| row[part].as_slice()).collect();
            Some(tensor(parts.concat(), dims::<4>(&qkv[part])))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, Distribution};

    #[test]
    fn values_and_gradients_equal_those_of_burns_operations() {
        let device = Device::flex().autodiff();
        device.seed(7);
        for (n_queries, n_channels, n_keys) in [(5, 3, 7), (64, 16, 64), (40, 16, 640)] {
            let random = |rows, columns| {
                Tensor::<4>::random([2, 3, rows, columns], Distribution::Uniform(-1.5, 1.5), &device)
            };
            let inputs =
                [random(n_queries, n_channels), random(n_channels, n_keys), random(n_channels, n_keys)];
            let d_out = random(n_queries, n_channels);
            let run = |is_own: bool| {
                let [q, k, v] = inputs.each_ref().map(|input| input.clone().detach().require_grad());
                let out = if is_own {
                    attend(q.clone(), k.clone(), v.clone())
                } else {
                    softmax_last(q.clone().matmul(k.clone())).matmul(v.clone().swap_dims(2, 3))
                };
                let gradients = (out.clone() * d_out.clone()).sum().backward();
                let [q, k, v] = [q, k, v].map(|input| input.grad(&gradients).unwrap());
                [out.inner(), q, k, v]
            };
            for (part, (own, burns)) in run(true).into_iter().zip(run(false)).enumerate() {
                let largest = burns.clone().abs().max().into_scalar::<f32>();
                let error = (own - burns).abs().max().into_scalar::<f32>();
                assert!(error <= 2e-5 * largest, "part {part}: {error} of {largest}");
            }
        }
    }
}
