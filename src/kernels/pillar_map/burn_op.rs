//! The map of pillars as a burn operation with gradients.

use std::sync::Arc;

use burn::backend::flex::FlexTensor;
use burn::tensor::{IndexingUpdateOp, Int, Tensor, TensorData};

use super::PillarPlan;
use crate::kernels::operation::{Operation, dims, is_own, run, tensor, values};

/// Lays the highest of each pillar's points on a map.
///
/// # Shapes
/// - x: `[point, channel]`
/// - output: `[map, channel, cell]`, zero where there is no pillar
///
/// # Panics
/// If the plan is for another number of points.
#[must_use]
pub fn pillar_map(x: Tensor<2>, plan: &Arc<PillarPlan>) -> Tensor<3> {
    assert_eq!(x.dims()[0], plan.n_points, "pillar_map: points of the plan");
    if !is_own(&x) {
        return by_scatter(x, plan);
    }
    run(PillarMap { plan: Arc::clone(plan) }, [x.into()]).next()
}

/// The same in burn's own operations.
fn by_scatter(x: Tensor<2>, plan: &PillarPlan) -> Tensor<3> {
    let ([_, n_channels], device) = (x.dims(), x.device());
    let indices = |values: &[u32]| {
        let n = values.len();
        let values: Vec<i64> = values.iter().map(|&value| i64::from(value)).collect();
        Tensor::<1, Int>::from_data(TensorData::new(values, [n]), &device)
    };
    let mut map = Tensor::<2>::zeros([n_channels, plan.n_maps * plan.n_cells], &device);
    if !plan.cells.is_empty() {
        let n_pillars = plan.cells.len();
        let highest = x
            .select(0, indices(&plan.points))
            .reshape([n_pillars, plan.max_points, n_channels])
            .max_dim(1)
            .reshape([n_pillars, n_channels]);
        map = map.select_assign(1, indices(&plan.cells), highest.transpose(), IndexingUpdateOp::Add);
    }
    map.reshape([n_channels, plan.n_maps, plan.n_cells]).swap_dims(0, 1)
}

#[derive(Debug)]
struct PillarMap {
    plan: Arc<PillarPlan>,
}

impl Operation<1> for PillarMap {
    /// Number of channels, and the highest points.
    type Saved = (usize, Vec<u32>);

    fn forward(&self, [x]: [FlexTensor; 1]) -> (Vec<FlexTensor>, Self::Saved) {
        let [_, n_channels] = dims(&x);
        let (map, highest_points) = self.plan.forward(values(&x), n_channels);
        (vec![tensor(map, [self.plan.n_maps, n_channels, self.plan.n_cells])], (n_channels, highest_points))
    }

    fn gradients(
        &self,
        (n_channels, highest_points): Self::Saved,
        dy: &FlexTensor,
        _: [bool; 1],
    ) -> [Option<FlexTensor>; 1] {
        let dx = self.plan.gradient(values(dy), &highest_points, n_channels);
        [Some(tensor(dx, [self.plan.n_points, n_channels]))]
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
        let plan = Arc::new(PillarPlan::new(7, [2, 6], vec![0, 1, 2, 3, 4, 3, 5, 6, 5], vec![1, 4, 9]));
        let x0 = Tensor::<2>::random([7, 5], Distribution::Uniform(-1.0, 1.0), &device);
        let dy = Tensor::<3>::random([2, 5, 6], Distribution::Uniform(-1.0, 1.0), &device);
        let run = |is_own: bool| {
            let x = x0.clone().detach().require_grad();
            let map = if is_own { pillar_map(x.clone(), &plan) } else { by_scatter(x.clone(), &plan) };
            let gradients = (map.clone() * dy.clone()).sum().backward();
            (map.inner().into_data(), x.grad(&gradients).unwrap().into_data())
        };
        assert_eq!(run(true), run(false));
    }
}
