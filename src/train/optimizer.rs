//! AdamW over a module: the first beta may change from step to step, gradients are clipped by their common norm, and the
//! state can be saved and loaded bit by bit.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param, ParamId};
use burn::optim::{
    AdamWConfig, AdamWState, AdaptiveMomentumState, GradientsParams, LearningRate, ModuleOptimizer,
    RecordState, StateSink, StateSource,
};
use burn::tensor::{Bytes, Device, Tensor};

use super::config::TrainConfig;
use super::schedule::{BETA_1, Pace};
use crate::device::is_cpu;
use crate::kernels::AdamwStep;

const BETA_2: f32 = 0.999;
/// PyTorch's; burn's default is 1e-5.
const EPSILON: f32 = 1e-8;

/// Gives parameters the ids 1, 2, ... in the order of the module, so that an optimizer state fits the
/// same module in another process.
#[must_use]
pub fn number_parameters<M: Module>(module: M) -> M {
    struct Number {
        next: u64,
    }
    impl ModuleMapper for Number {
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            let (_, tensor, mapper) = param.consume();
            self.next += 1;
            Param::from_mapped_value(ParamId::from(self.next), tensor, mapper)
        }
    }
    module.map(&mut Number { next: 0 })
}

/// burn's AdamW with the beta1 of the step under way.
#[derive(Clone)]
struct PacedAdamW {
    config: AdamWConfig,
    weight_decay: f32,
    /// An f32's bits; [`Optimizer`] sets it before each step.
    beta_1: Arc<AtomicU32>,
}

impl burn::optim::Optimizer for PacedAdamW {
    type State<const D: usize> = State<D>;

    fn step<const D: usize>(
        &self,
        learning_rate: LearningRate,
        tensor: Tensor<D>,
        grad: Tensor<D>,
        state: Option<Self::State<D>>,
    ) -> (Tensor<D>, Option<Self::State<D>>) {
        let beta_1 = f32::from_bits(self.beta_1.load(Ordering::Relaxed));
        if let Some((tensor, state)) =
            self.step_in_one_pass(learning_rate, beta_1, &tensor, &grad, state.as_ref())
        {
            return (tensor, Some(state));
        }
        let adamw = self.config.clone().with_beta_1(beta_1).build();
        let (tensor, state) = adamw.step(learning_rate, tensor, grad, state.map(|State(state)| state));
        (tensor, state.map(State))
    }

    fn to_device<const D: usize>(state: Self::State<D>, device: &Device) -> Self::State<D> {
        State(burn::optim::AdamW::to_device(state.0, device))
    }
}

impl PacedAdamW {
    /// The step by our own kernel, where it runs.
    fn step_in_one_pass<const D: usize>(
        &self,
        learning_rate: LearningRate,
        beta_1: f32,
        tensor: &Tensor<D>,
        grad: &Tensor<D>,
        state: Option<&State<D>>,
    ) -> Option<(Tensor<D>, State<D>)> {
        let momentum = state.map(|State(state)| state.momentum.clone());
        let momentum =
            momentum.unwrap_or_else(|| AdaptiveMomentumState::new(0, grad.zeros_like(), grad.zeros_like()));
        let step = AdamwStep {
            learning_rate,
            weight_decay: f64::from(self.weight_decay),
            beta_1,
            beta_2: BETA_2,
            epsilon: EPSILON,
            time: momentum.time as i32 + 1,
        };
        let [tensor, moment_1, moment_2] =
            step.apply([tensor, grad, &momentum.moment_1, &momentum.moment_2])?;
        let momentum = AdaptiveMomentumState::new(momentum.time + 1, moment_1, moment_2);
        Some((tensor, State(AdamWState::new(momentum))))
    }
}

/// The state of AdamW. It is loaded on the CPU, and the next step moves it to its parameter: burn would load it on its
/// default device, which in a build with a GPU backend is a GPU that may not be there.
#[derive(Clone)]
struct State<const D: usize>(AdamWState<D>);

impl<const D: usize> RecordState for State<D> {
    fn state_flatten(&self, prefix: &str, out: &mut StateSink) {
        self.0.state_flatten(prefix, out);
    }

    fn state_unflatten(prefix: &str, source: &mut StateSource, _default: &Device) -> Option<Self> {
        AdamWState::state_unflatten(prefix, source, &Device::flex()).map(Self)
    }
}

/// The optimizer of a run.
pub struct Optimizer {
    adamw: ModuleOptimizer,
    beta_1: Arc<AtomicU32>,
    clip_norm: f32,
}

impl Optimizer {
    #[must_use]
    pub fn new(config: &TrainConfig) -> Self {
        let beta_1 = Arc::new(AtomicU32::new((BETA_1 as f32).to_bits()));
        let adamw = AdamWConfig::new().with_beta_2(BETA_2).with_epsilon(EPSILON);
        let adamw = PacedAdamW {
            config: adamw.with_weight_decay(config.weight_decay),
            weight_decay: config.weight_decay,
            beta_1: beta_1.clone(),
        };
        Self { adamw: ModuleOptimizer::from(adamw), beta_1, clip_norm: config.clip_norm }
    }

    /// Takes one step; returns the module and the norm of the gradients before clipping.
    pub fn step<M: Module>(&mut self, module: M, grads: GradientsParams, pace: Pace) -> (M, f32) {
        let norm = norm(&module, &grads) as f32;
        let mut grads = grads;
        if norm > self.clip_norm {
            module.visit(&mut Scale { grads: &mut grads, by: self.clip_norm / norm });
        }
        self.beta_1.store((pace.beta_1 as f32).to_bits(), Ordering::Relaxed);
        (self.adamw.step(pace.learning_rate, module, grads), norm)
    }

    /// Packs the state into bytes.
    ///
    /// # Errors
    /// burn cannot pack it; the text says why.
    pub fn to_bytes(&self) -> Result<Vec<u8>, String> {
        Ok(self.adamw.into_bytes().map_err(|error| error.to_string())?.to_vec())
    }

    /// Loads a state of [`Optimizer::to_bytes`].
    ///
    /// # Errors
    /// The bytes are not such a state; the text says why.
    pub fn load_bytes(self, bytes: Vec<u8>) -> Result<Self, String> {
        let Self { adamw, beta_1, clip_norm } = self;
        let adamw = adamw.from_bytes(Bytes::from_bytes_vec(bytes)).map_err(|error| error.to_string())?;
        Ok(Self { adamw, beta_1, clip_norm })
    }
}

/// The norm of all gradients together.
fn norm<M: Module>(module: &M, grads: &GradientsParams) -> f64 {
    let mut squares = Squares { grads, of_cpu: 0.0, of_gpu: Vec::new() };
    module.visit(&mut squares);
    let Squares { of_cpu, of_gpu, .. } = squares;
    let of_gpu = if of_gpu.is_empty() { 0.0 } else { sum(Tensor::cat(of_gpu, 0), |value| value) };
    (of_cpu + of_gpu).sqrt()
}

/// Sums of squared gradients: exact on the CPU; on a GPU one number for each parameter, all read at once.
struct Squares<'a> {
    grads: &'a GradientsParams,
    of_cpu: f64,
    of_gpu: Vec<Tensor<1>>,
}

impl ModuleVisitor for Squares<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let Some(grad) = self.grads.get::<D>(param.id) else { return };
        if is_cpu(&grad.device()) {
            self.of_cpu += sum(grad, |value| value * value);
        } else {
            self.of_gpu.push((grad.clone() * grad).sum());
        }
    }
}

/// Sums `of` each value.
fn sum<const D: usize>(tensor: Tensor<D>, of: impl Fn(f64) -> f64) -> f64 {
    let values: Vec<f32> = tensor.into_data().try_to_vec().expect("gradients are f32");
    values.into_iter().map(|value| of(f64::from(value))).sum()
}

struct Scale<'a> {
    grads: &'a mut GradientsParams,
    by: f32,
}

impl ModuleVisitor for Scale<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if let Some(grad) = self.grads.remove::<D>(param.id) {
            self.grads.register::<D>(param.id, grad.mul_scalar(self.by));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::test_device;
    use burn::nn::{Linear, LinearConfig};
    use burn::tensor::{Device, TensorData};

    fn weights(linear: &Linear) -> Vec<f32> {
        linear.weight.val().into_data().try_to_vec().unwrap()
    }

    fn train(mut linear: Linear, optimizer: &mut Optimizer, n_steps: usize, device: &Device) -> Linear {
        for step in 0..n_steps {
            let x = Tensor::<2>::from_data(TensorData::new(vec![1.0f32, step as f32], [1, 2]), device);
            let loss = linear.forward(x).powf_scalar(2.0).sum();
            let grads = GradientsParams::from_grads(loss.backward(), &linear);
            linear = optimizer.step(linear, grads, Pace { learning_rate: 0.01, beta_1: BETA_1 }).0;
        }
        linear
    }

    #[test]
    fn a_state_saved_and_loaded_goes_on_as_if_never_stopped() {
        let device = test_device().autodiff();
        let config = TrainConfig::default();
        let start = number_parameters(LinearConfig::new(2, 3).init(&device));
        let mut whole = Optimizer::new(&config);
        let unbroken = train(train(start.clone(), &mut whole, 3, &device), &mut whole, 3, &device);

        let mut first = Optimizer::new(&config);
        let half = train(start, &mut first, 3, &device);
        let mut second = Optimizer::new(&config).load_bytes(first.to_bytes().unwrap()).unwrap();
        let resumed = train(half, &mut second, 3, &device);
        assert_eq!(weights(&unbroken), weights(&resumed));

        // The state matters: a fresh optimizer ends elsewhere.
        let mut fresh = Optimizer::new(&config);
        let half = train(number_parameters(unbroken.clone()), &mut fresh, 3, &device);
        assert_ne!(weights(&half), weights(&unbroken));
    }

    /// PyTorch, first beta b: m = b m + (1 - b) g and m / (1 - b^t) with the beta of the step.
    #[test]
    fn beta_1_is_that_of_each_step() {
        let device = Device::flex().autodiff();
        let config = TrainConfig { weight_decay: 0.0, clip_norm: f32::MAX, ..TrainConfig::default() };
        let mut linear: Linear = number_parameters(LinearConfig::new(1, 1).with_bias(false).init(&device));
        let mut optimizer = Optimizer::new(&config);
        let mut expected = f64::from(weights(&linear)[0]);
        let (mut first, mut second) = (0.0, 0.0);
        for (t, (gradient, beta_1)) in
            [(1.0, 0.9), (-0.5, 0.85), (2.0, 0.81), (0.25, 0.9)].into_iter().enumerate()
        {
            let x = Tensor::<2>::from_data(TensorData::new(vec![gradient as f32], [1, 1]), &device);
            let grads = GradientsParams::from_grads(linear.forward(x).sum().backward(), &linear);
            linear = optimizer.step(linear, grads, Pace { learning_rate: 0.1, beta_1 }).0;
            first = beta_1 * first + (1.0 - beta_1) * gradient;
            second = 0.999 * second + 0.001 * gradient * gradient;
            let n = t as i32 + 1;
            let (mean, spread) = (first / (1.0 - beta_1.powi(n)), second / (1.0 - 0.999f64.powi(n)));
            expected -= 0.1 * mean / (spread.sqrt() + 1e-8);
            assert!((f64::from(weights(&linear)[0]) - expected).abs() < 1e-5, "step {t}");
        }
    }

    #[test]
    fn gradients_over_the_norm_are_scaled_together() {
        let device = test_device().autodiff();
        let linear: Linear = number_parameters(LinearConfig::new(2, 1).init(&device));
        let x = Tensor::<2>::from_data(TensorData::new(vec![300.0f32, 400.0], [1, 2]), &device);
        let mut grads = GradientsParams::from_grads(linear.forward(x).sum().backward(), &linear);
        linear.visit(&mut Scale { grads: &mut grads, by: 0.01 });
        assert!((norm(&linear, &grads) - (25.0f64 + 1e-4).sqrt()).abs() < 1e-3);
    }
}
