//! Batch norm and a ReLU over maps, as they follow every convolution of the bird's-eye and image nets.

use std::cell::Cell;

use burn::nn::{BatchNorm, BatchNormConfig};
use burn::tensor::{Device, Tensor};

use crate::kernels::{conv3x3, conv3x3_scale_shift_relu, norm_relu, scale_shift_relu};

/// What batch norms go by in training.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NormStatistics {
    /// Those of the batch, which the running ones follow.
    OfBatch,
    /// The running ones, which stay as they are, as at inference.
    Running,
}

thread_local! {
    static CURRENT: Cell<NormStatistics> = const { Cell::new(NormStatistics::OfBatch) };
}

impl NormStatistics {
    /// Runs work whose batch norms go by these. It holds for this thread: the one that calls the operations.
    pub fn during<R>(self, work: impl FnOnce() -> R) -> R {
        struct Restore(NormStatistics);
        impl Drop for Restore {
            fn drop(&mut self) {
                CURRENT.set(self.0);
            }
        }
        let _restore = Restore(CURRENT.replace(self));
        work()
    }
}

/// Whether a norm learns from this batch.
fn follows(norm: &BatchNorm, device: &Device) -> bool {
    device.is_autodiff() && norm.training.is_enabled() && CURRENT.get() == NormStatistics::OfBatch
}

/// A batch norm over rows, by what [`NormStatistics`] says.
///
/// # Shapes
/// - x and output: `[row, channel]`
#[must_use]
pub fn batch_norm(norm: &BatchNorm, x: Tensor<2>) -> Tensor<2> {
    let device = x.device();
    if follows(norm, &device) || !device.is_autodiff() {
        return norm.forward(x);
    }
    let [scale, shift] = scale_and_shift(norm, &device);
    x * scale.unsqueeze() + shift.unsqueeze()
}

/// The batch norm of the published LiDAR branch.
pub fn lidar_norm(n_channels: usize, device: &Device) -> BatchNorm {
    BatchNormConfig::new(n_channels).with_epsilon(1e-3).with_momentum(0.01).init(device)
}

/// burn's batch norm, then a ReLU, in one pass. Training uses the batch's statistics and updates the running ones;
/// inference and frozen layers use the running statistics.
///
/// # Shapes
/// - x: `[batch, channel, y, x]`
#[must_use]
pub fn batch_norm_relu(norm: &BatchNorm, x: Tensor<4>) -> Tensor<4> {
    let device = x.device();
    if follows(norm, &device) {
        let normed = norm_relu(x, norm.gamma.val(), norm.beta.val(), norm.epsilon);
        for (running, latest) in [(&norm.running_mean, normed.mean), (&norm.running_var, normed.variance)] {
            let kept = running.value_sync().to_device(&device).mul_scalar(1.0 - norm.momentum);
            running.update((kept + latest.mul_scalar(norm.momentum)).detach());
        }
        return normed.output;
    }
    let [scale, shift] = scale_and_shift(norm, &device);
    scale_shift_relu(x, scale, shift)
}

/// A 3x3 convolution, batch norm and a ReLU; one pass over the map at inference.
///
/// # Shapes
/// - x: `[batch, channel_in, y, x]`
/// - weight: `[channel_out, channel_in, 3, 3]`
/// - output: `[batch, channel_out, ceil(y / stride), ceil(x / stride)]`
#[must_use]
pub fn conv3x3_norm_relu(weight: Tensor<4>, norm: &BatchNorm, x: Tensor<4>, stride: usize) -> Tensor<4> {
    let device = x.device();
    if device.is_autodiff() {
        return batch_norm_relu(norm, conv3x3(x, weight, stride));
    }
    let [scale, shift] = scale_and_shift(norm, &device);
    conv3x3_scale_shift_relu(x, weight, scale, shift, stride)
}

/// A norm's scale and shift by its running statistics, each `[channel]`.
fn scale_and_shift(norm: &BatchNorm, device: &Device) -> [Tensor<1>; 2] {
    let [mean, variance] = [&norm.running_mean, &norm.running_var].map(|of| of.value().to_device(device));
    let scale = norm.gamma.val() / variance.add_scalar(norm.epsilon).sqrt();
    let shift = norm.beta.val() - mean * scale.clone();
    [scale, shift]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::test_device;
    use burn::module::Module;
    use burn::tensor::Distribution;
    use burn::tensor::activation::relu;

    fn largest(a: Tensor<4>, b: Tensor<4>) -> f32 {
        (a - b).abs().max().into_scalar()
    }

    /// In training, after it, and with the layer frozen.
    #[test]
    fn it_is_burns_batch_norm_and_a_relu() {
        let device = test_device().autodiff();
        device.seed(5);
        let [own, burns] = [0, 1].map(|_| BatchNormConfig::new(3).with_momentum(0.3).init(&device));
        for _ in 0..3 {
            let x = Tensor::<4>::random([2, 3, 4, 5], Distribution::Normal(0.7, 2.0), &device);
            let (a, b) = (batch_norm_relu(&own, x.clone()), relu(burns.forward(x)));
            assert!(largest(a.inner(), b.inner()) < 1e-5);
        }
        let x = Tensor::<4>::random([1, 3, 4, 5], Distribution::Normal(0.7, 2.0), &device);
        let (a, b) = (own.valid(), burns.valid());
        let inner = x.clone().inner();
        assert!(largest(batch_norm_relu(&a, inner.clone()), relu(b.forward(inner))) < 1e-5);
        // In training by the running statistics: what inference says, and they stay.
        let x_rows = Tensor::<2>::random([6, 3], Distribution::Normal(0.7, 2.0), &device);
        let [on_map, on_rows] = NormStatistics::Running.during(|| {
            let on_rows = batch_norm(&own, x_rows.clone());
            [batch_norm_relu(&own, x.clone()).reshape([-1]), on_rows.reshape([-1])]
        });
        let at_inference = [
            batch_norm_relu(&own.valid(), x.clone().inner()).reshape([-1]),
            own.valid().forward(x_rows.inner()).reshape([-1]),
        ];
        for (found, wanted) in [on_map, on_rows].into_iter().zip(at_inference) {
            let wanted: Tensor<1> = wanted;
            assert!((found.inner() - wanted).abs().max().into_scalar::<f32>() < 1e-5);
        }
        let frozen = own.clone().freeze();
        let still = largest(batch_norm_relu(&frozen, x.clone()).inner(), relu(frozen.forward(x)).inner());
        assert!(still < 1e-5);
    }
}
