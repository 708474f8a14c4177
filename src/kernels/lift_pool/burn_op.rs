//! Lifted pooling as a burn operation with gradients.
//!
//! Devices other than `Device::flex()` gather and scatter the weighted points a chunk at a time.

use std::sync::Arc;

use burn::backend::flex::FlexTensor;
use burn::tensor::{IndexingUpdateOp, Int, Tensor, TensorData};

use super::PoolPlan;
use crate::kernels::operation::{Operation, dims, is_own, run, tensor, values};

/// Points that `by_scatter` weighs at a time: 21 MB at 80 channels.
const POINTS_PER_CHUNK: usize = 1 << 16;

/// Pools each sample's lifted features into bird's-eye cells.
///
/// # Shapes
/// - depth: `[batch, pixel, bin]`
/// - context: `[batch, pixel, channel]`
/// - plans: one for each sample, all of one size
/// - output: `[batch, cell, channel]`, zero where no point falls
///
/// # Panics
/// If the plans do not fit the tensors.
#[must_use]
pub fn lift_pool(depth: Tensor<3>, context: Tensor<3>, plans: &[Arc<PoolPlan>]) -> Tensor<3> {
    let [n_batch, n_pixels, n_bins] = depth.dims();
    let [context_batch, context_pixels, _] = context.dims();
    assert_eq!([n_batch, n_pixels], [context_batch, context_pixels], "lift_pool: depth and context");
    assert_eq!(plans.len(), n_batch, "lift_pool: one plan for each sample");
    let n_cells = plans.first().map_or(0, |plan| plan.n_cells());
    for plan in plans {
        let found = [plan.n_pixels(), plan.n_bins(), plan.n_cells()];
        assert_eq!(found, [n_pixels, n_bins, n_cells], "lift_pool: pixels, bins and cells of a plan");
    }
    if !is_own(&depth) || !is_own(&context) || n_cells == 0 {
        return by_scatter(depth, context, plans, n_cells);
    }
    run(LiftPool { plans: plans.into() }, [depth.into(), context.into()]).next()
}

/// Pools by gathering and scattering, on any device.
fn by_scatter(depth: Tensor<3>, context: Tensor<3>, plans: &[Arc<PoolPlan>], n_cells: usize) -> Tensor<3> {
    let [n_batch, n_pixels, n_bins] = depth.dims();
    let [_, _, n_channels] = context.dims();
    let device = depth.device();
    let depth = depth.reshape([n_batch * n_pixels * n_bins, 1]);
    let context = context.reshape([n_batch * n_pixels, n_channels]);
    let mut out = Tensor::<2>::zeros([n_batch * n_cells, n_channels], &device);
    let indices = |values: Vec<i64>| {
        let n = values.len();
        Tensor::<1, Int>::from_data(TensorData::new(values, [n]), &device)
    };
    for (sample, plan) in plans.iter().enumerate() {
        for points in plan.points().chunks(POINTS_PER_CHUNK) {
            let of_sample = |n: usize, i: usize| (sample * n + i) as i64;
            let list = |index: &dyn Fn(usize) -> i64| -> Tensor<1, Int> {
                indices(points.iter().map(|&point| index(point as usize)).collect())
            };
            let rows = list(&|point| of_sample(n_pixels, point / n_bins));
            let weights = list(&|point| of_sample(n_pixels * n_bins, point));
            let cells = list(&|point| of_sample(n_cells, plan.cell_of_point()[point] as usize));
            let weighted = context.clone().select(0, rows) * depth.clone().select(0, weights);
            out = out.select_assign(0, cells, weighted, IndexingUpdateOp::Add);
        }
    }
    out.reshape([n_batch, n_cells, n_channels])
}

#[derive(Debug)]
struct LiftPool {
    /// One for each sample of the batch.
    plans: Vec<Arc<PoolPlan>>,
}

impl Operation<2> for LiftPool {
    /// Depth and context.
    type Saved = [FlexTensor; 2];

    fn forward(&self, [depth, context]: [FlexTensor; 2]) -> (Vec<FlexTensor>, Self::Saved) {
        let ([n_batch, n_pixels, n_bins], [.., n_channels]) = (dims(&depth), dims::<3>(&context));
        let n_cells = self.plans[0].n_cells();
        let mut out = vec![0f32; n_batch * n_cells * n_channels];
        let depths = values(&depth).chunks(n_pixels * n_bins);
        let contexts = values(&context).chunks(n_pixels * n_channels);
        let outs = out.chunks_mut(n_cells * n_channels);
        for (((plan, depth), context), out) in self.plans.iter().zip(depths).zip(contexts).zip(outs) {
            plan.pool(depth, context, n_channels, out);
        }
        (vec![tensor(out, [n_batch, n_cells, n_channels])], [depth, context])
    }

    fn gradients(&self, saved: Self::Saved, d_out: &FlexTensor, _: [bool; 2]) -> [Option<FlexTensor>; 2] {
        let [[n_batch, n_pixels, n_bins], [.., n_channels]] = saved.each_ref().map(dims::<3>);
        let [depth, context] = saved.each_ref().map(values);
        let (mut d_depth, mut d_context) = (vec![0f32; depth.len()], vec![0f32; context.len()]);
        for (sample, plan) in self.plans.iter().enumerate() {
            let part = |n: usize| sample * n..(sample + 1) * n;
            plan.gradients(
                &depth[part(n_pixels * n_bins)],
                &context[part(n_pixels * n_channels)],
                &values(d_out)[part(plan.n_cells() * n_channels)],
                &mut d_depth[part(n_pixels * n_bins)],
                &mut d_context[part(n_pixels * n_channels)],
            );
        }
        let d_context = tensor(d_context, [n_batch, n_pixels, n_channels]);
        [Some(tensor(d_depth, [n_batch, n_pixels, n_bins])), Some(d_context)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, Distribution};
    use rand::RngExt;

    const N_PIXELS: usize = 30;
    const N_BINS: usize = 7;
    const N_CELLS: usize = 20;
    const N_CHANNELS: usize = 19;

    fn plans() -> Vec<Arc<PoolPlan>> {
        let mut random = crate::random::stream(5, "lift-pool-test", 0);
        let mut plan = || {
            let cells = (0..N_PIXELS * N_BINS).map(|_| match random.random_range(0..=N_CELLS as u32) {
                cell if cell == N_CELLS as u32 => PoolPlan::OUTSIDE,
                cell => cell,
            });
            Arc::new(PoolPlan::new(N_BINS, N_CELLS, cells.collect()))
        };
        vec![plan(), plan()]
    }

    fn inputs(device: &Device) -> (Tensor<3>, Tensor<3>, Tensor<3>) {
        let random = |dims| Tensor::<3>::random(dims, Distribution::Uniform(-0.5, 0.5), device);
        (random([2, N_PIXELS, N_BINS]), random([2, N_PIXELS, N_CHANNELS]), random([2, N_CELLS, N_CHANNELS]))
    }

    #[test]
    fn values_and_gradients_equal_gathering_and_scattering() {
        let device = Device::flex().autodiff();
        device.seed(7);
        let (depth, context, d_out) = inputs(&device);
        let run = |is_own: bool| {
            let depth = depth.clone().detach().require_grad();
            let context = context.clone().detach().require_grad();
            let out = if is_own {
                lift_pool(depth.clone(), context.clone(), &plans())
            } else {
                by_scatter(depth.clone(), context.clone(), &plans(), N_CELLS)
            };
            let gradients = (out.clone() * d_out.clone()).sum().backward();
            [out.inner(), depth.grad(&gradients).unwrap(), context.grad(&gradients).unwrap()]
        };
        for (own, generic) in run(true).into_iter().zip(run(false)) {
            assert!((own - generic).abs().max().into_scalar::<f32>() < 1e-5);
        }
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        let device = Device::flex().autodiff();
        device.seed(8);
        let (depth, context, d_out) = inputs(&device);
        let (depth, context) = (depth.require_grad(), context.require_grad());
        let loss = |depth: Tensor<3>, context: Tensor<3>| -> f64 {
            let out = lift_pool(depth, context, &plans()) * d_out.clone();
            let values: Vec<f32> = out.into_data().try_to_vec().unwrap();
            values.into_iter().map(f64::from).sum()
        };
        let gradients =
            (lift_pool(depth.clone(), context.clone(), &plans()) * d_out.clone()).sum().backward();
        let of = |tensor: &Tensor<3>| -> Vec<f32> {
            tensor.grad(&gradients).unwrap().into_data().try_to_vec().unwrap()
        };
        let (d_depth, d_context) = (of(&depth), of(&context));
        // The pooling is linear in either input, so that a wide step has no truncation error.
        let step = 0.5;
        let shift = |tensor: &Tensor<3>, at: usize, by: f32| {
            let mut data: Vec<f32> = tensor.clone().into_data().try_to_vec().unwrap();
            data[at] += by;
            Tensor::<3>::from_data(TensorData::new(data, tensor.dims()), &device)
        };
        for at in (0..d_depth.len()).step_by(37) {
            let difference = loss(shift(&depth, at, step), context.clone())
                - loss(shift(&depth, at, -step), context.clone());
            assert!((difference - f64::from(d_depth[at])).abs() < 1e-4, "depth {at}");
        }
        for at in (0..d_context.len()).step_by(61) {
            let difference = loss(depth.clone(), shift(&context, at, step))
                - loss(depth.clone(), shift(&context, at, -step));
            assert!((difference - f64::from(d_context[at])).abs() < 1e-4, "context {at}");
        }
    }

    #[test]
    fn nothing_in_the_grid_pools_to_zero_with_or_without_autodiff() {
        for device in [Device::flex(), Device::flex().autodiff()] {
            let plan = Arc::new(PoolPlan::new(2, 3, vec![PoolPlan::OUTSIDE; 4]));
            let out = lift_pool(Tensor::ones([1, 2, 2], &device), Tensor::ones([1, 2, 5], &device), &[plan]);
            assert_eq!(out.into_data(), TensorData::zeros::<f32, _>([1, 3, 5]));
        }
    }
}
