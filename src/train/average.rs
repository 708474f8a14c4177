//! Exponential moving average of a detector's weights and running statistics (Polyak and Juditsky 1992):
//! a run's noise averages out, and the average scores better than any single step.
//!
//! `average <- d average + (1 - d) latest`, with `d = min(decay, (1 + n) / (10 + n))` at update `n`, so that
//! the random start is soon forgotten.

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::Tensor;

use crate::model::Detector;

/// The average of a run.
#[derive(Debug, Clone)]
pub struct Average {
    detector: Detector,
    decay: f64,
}

impl Average {
    /// Starts from a detector in inference mode (`valid()`).
    #[must_use]
    pub fn new(detector: Detector, decay: f64) -> Self {
        Self { detector, decay }
    }

    /// The averaged detector.
    #[must_use]
    pub fn detector(&self) -> &Detector {
        &self.detector
    }

    /// Moves towards the weights after update `n` (0 for the first); `latest` is in inference mode.
    pub fn update(&mut self, latest: &Detector, n: usize) {
        let decay = self.decay.min((1.0 + n as f64) / (10.0 + n as f64));
        let mut collected = Collected { values: Vec::new() };
        latest.visit(&mut collected);
        let mut mix = Mix { latest: collected.values.into_iter(), decay };
        self.detector = self.detector.clone().map(&mut mix);
    }
}

/// All parameters in the order of the module, each flattened to a row, on their device.
struct Collected {
    values: Vec<Tensor<1>>,
}

impl ModuleVisitor for Collected {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let values = param.val();
        let n_values = values.shape().num_elements();
        self.values.push(values.reshape([n_values]));
    }
}

struct Mix {
    latest: std::vec::IntoIter<Tensor<1>>,
    decay: f64,
}

impl ModuleMapper for Mix {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let latest = self.latest.next().expect("two detectors of one config have as many parameters");
        let (id, tensor, mapper) = param.consume();
        let latest = latest.reshape(tensor.dims());
        let mixed = tensor.mul_scalar(self.decay) + latest.mul_scalar(1.0 - self.decay);
        Param::from_mapped_value(id, mixed, mapper)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ModelConfig;
    use burn::tensor::Device;

    fn values(detector: &Detector) -> Vec<f32> {
        let mut collected = Collected { values: Vec::new() };
        detector.visit(&mut collected);
        collected.values.into_iter().flat_map(|row| row.into_data().try_to_vec::<f32>().unwrap()).collect()
    }

    #[test]
    fn it_moves_by_the_share_that_the_decay_leaves() {
        let device = Device::flex();
        let config = ModelConfig::default();
        let (from, to) = (Detector::init(&config, 0, &device), Detector::init(&config, 1, &device));
        let mut average = Average::new(from.clone(), 0.5);
        // Update 98: (1 + 98) / (10 + 98) is above the decay.
        average.update(&to, 98);
        for ((mixed, a), b) in values(average.detector()).iter().zip(values(&from)).zip(values(&to)) {
            assert!((mixed - 0.5 * (a + b)).abs() < 1e-6);
        }
        // The first update nearly forgets the start.
        let mut early = Average::new(from.clone(), 0.999);
        early.update(&to, 0);
        let far = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f32>();
        assert!(far(&values(early.detector()), &values(&to)) < 0.2 * far(&values(&from), &values(&to)));
    }
}
