//! One step of AdamW (Loshchilov and Hutter 2019) in one pass over a parameter, f32.
//!
//! ```text
//! m <- b1 m + (1 - b1) g      v <- b2 v + (1 - b2) g^2
//! w <- (1 - rate decay) w - rate (m / (1 - b1^t)) / (sqrt(v / (1 - b2^t)) + epsilon)
//! ```
//!
//! The operations and their order are those of burn's own, which makes a pass of each.

use burn::backend::flex::FlexTensor;
use burn::tensor::Tensor;
use rayon::prelude::*;

use super::operation::{Operation, is_own, run, tensor, values};
use super::simd::{InstructionSet, Kernel, Simd};

/// Values of a task.
const TASK: usize = 1 << 14;

/// The numbers of one step.
#[derive(Debug, Clone, Copy)]
pub struct AdamwStep {
    pub learning_rate: f64,
    pub weight_decay: f64,
    pub beta_1: f32,
    pub beta_2: f32,
    pub epsilon: f32,
    /// Counted from 1.
    pub time: i32,
}

impl AdamwStep {
    /// The parameter and its two moments after the step; `None` if the tensors are not of the CPU.
    ///
    /// # Arguments
    /// - `inputs`: parameter, gradient and both moments, all of one shape and without autodiff
    pub fn apply<const D: usize>(self, inputs: [&Tensor<D>; 4]) -> Option<[Tensor<D>; 3]> {
        if inputs.iter().any(|input| !is_own(input) || input.device().is_autodiff()) {
            return None;
        }
        let mut outputs = run(self, inputs.map(|input| input.clone().into()));
        Some([outputs.next(), outputs.next(), outputs.next()])
    }
}

impl Operation<4> for AdamwStep {
    type Saved = ();

    fn forward(&self, inputs: [FlexTensor; 4]) -> (Vec<FlexTensor>, ()) {
        let [w, g, m, v] = inputs.each_ref().map(values);
        let mut out = [w, m, v].map(<[f32]>::to_vec);
        let [w, m, v] = &mut out;
        let tasks = w.par_chunks_mut(TASK).zip(g.par_chunks(TASK));
        let moments = m.par_chunks_mut(TASK).zip(v.par_chunks_mut(TASK));
        let set = InstructionSet::best();
        tasks.zip(moments).for_each(|((w, g), (m, v))| set.run(Part { step: *self, w, g, m, v }));
        let shape = burn::backend::TensorMetadata::shape(&inputs[0]);
        (out.map(|values| tensor(values, shape.clone())).into(), ())
    }

    fn gradients(&self, (): (), _: &FlexTensor, _: [bool; 4]) -> [Option<FlexTensor>; 4] {
        unreachable!("`apply` takes no tensors with autodiff")
    }
}

struct Part<'a> {
    step: AdamwStep,
    w: &'a mut [f32],
    g: &'a [f32],
    m: &'a mut [f32],
    v: &'a mut [f32],
}

impl Kernel for Part<'_> {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const LANES: usize>(self) {
        let AdamwStep { learning_rate, weight_decay, beta_1, beta_2, epsilon, time } = self.step;
        let kept = (1.0 - learning_rate * weight_decay) as f32;
        let rate = learning_rate as f32;
        let (factor_1, factor_2) = (1.0 - beta_1, 1.0 - beta_2);
        let (share_1, share_2) = (1.0 - beta_1.powi(time), 1.0 - beta_2.powi(time));
        let rows = self.w.iter_mut().zip(self.g).zip(self.m.iter_mut().zip(self.v));
        for ((w, &g), (m, v)) in rows {
            *m = *m * beta_1 + g * factor_1;
            *v = *v * beta_2 + g * g * factor_2;
            let delta = *m / share_1 / ((*v / share_2).sqrt() + epsilon);
            *w = *w * kept - delta * rate;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::optim::{AdamWConfig, Optimizer};
    use burn::tensor::{Device, Distribution};

    #[test]
    fn three_steps_equal_burns_to_the_bit() {
        let device = Device::flex();
        device.seed(7);
        let random = || Tensor::<2>::random([7, 31], Distribution::Uniform(-1.0, 1.0), &device);
        let config = AdamWConfig::new().with_epsilon(1e-8).with_weight_decay(0.01);
        let start = random();
        let (mut own, mut burns, mut state) = (start.clone(), start.clone(), None);
        let mut moments = [start.zeros_like(), start.zeros_like()];
        for time in 1..=3 {
            let (gradient, beta_1) = (random(), [0.9f32, 0.85, 0.8][time - 1]);
            let step = AdamwStep {
                learning_rate: 1e-3,
                weight_decay: f64::from(0.01f32),
                beta_1,
                beta_2: 0.999,
                epsilon: 1e-8,
                time: time as i32,
            };
            let [m, v] = &moments;
            let [w, m, v] = step.apply([&own, &gradient, m, v]).unwrap();
            (own, moments) = (w, [m, v]);
            (burns, state) = config.clone().with_beta_1(beta_1).build().step(1e-3, burns, gradient, state);
            assert_eq!(own.to_data(), burns.to_data(), "step {time}");
        }
        assert_ne!(own.to_data(), start.to_data());
    }
}
