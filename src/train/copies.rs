//! Copies of a detector, one for each batch of a step, and the mean of their running statistics.
//!
//! A copy shares the weights' values and the parameters' ids, has an autodiff graph of its own, and gathers
//! running statistics of its own: a step's statistics are the mean over its batches.

use std::collections::{HashMap, HashSet};

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param, ParamId};
use burn::tensor::{Device, Tensor};

use crate::model::Detector;

/// Copies a detector for one batch.
#[must_use]
pub fn copy_detector(detector: &Detector) -> Detector {
    detector.valid().train()
}

/// Copies a detector for the batches of another device.
#[must_use]
pub fn copy_to_device(detector: &Detector, device: &Device) -> Detector {
    detector.valid().to_device(&device.clone().without_autodiff()).train()
}

/// Gives the detector the mean of its copies' running statistics; those of a single copy stay as they are.
#[must_use]
pub fn average_statistics(detector: Detector, copies: &[Detector]) -> Detector {
    let mut statistics = Statistics { ids: HashSet::new() };
    detector.visit(&mut statistics);
    let share = 1.0 / copies.len() as f32;
    let mut means = Means { ids: statistics.ids, share, by_id: HashMap::new() };
    for copy in copies {
        // Only the copy for inference holds the statistics of the latest forward pass.
        copy.valid().visit(&mut means);
    }
    detector.map(&mut SetStatistics { means: means.by_id })
}

/// Ids of the numbers that are not trained.
struct Statistics {
    ids: HashSet<ParamId>,
}

impl ModuleVisitor for Statistics {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if !param.val().is_require_grad() {
            self.ids.insert(param.id);
        }
    }
}

/// Means over copies, as the first copy's values and the mean difference from them: equal values stay equal to the bit.
/// They stay on the device, the first copy's, each flattened to a row.
struct Means {
    ids: HashSet<ParamId>,
    share: f32,
    by_id: HashMap<ParamId, Mean>,
}

struct Mean {
    first: Tensor<1>,
    difference: Tensor<1>,
}

impl ModuleVisitor for Means {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if !self.ids.contains(&param.id) {
            return;
        }
        let values = param.val();
        let n_values = values.shape().num_elements();
        let values = values.reshape([n_values]);
        let mean = self.by_id.remove(&param.id).map_or_else(
            || Mean { first: values.clone(), difference: values.zeros_like() },
            |Mean { first, difference }| {
                let apart =
                    (values.clone().to_device(&first.device()) - first.clone()).mul_scalar(self.share);
                Mean { first, difference: difference + apart }
            },
        );
        self.by_id.insert(param.id, mean);
    }
}

/// Sets the numbers that are not trained.
struct SetStatistics {
    means: HashMap<ParamId, Mean>,
}

impl ModuleMapper for SetStatistics {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let (id, tensor, mapper) = param.consume();
        let tensor = match self.means.remove(&id) {
            Some(mean) => {
                let mean = (mean.first + mean.difference).reshape(tensor.dims());
                if tensor.is_autodiff() { mean.autodiff() } else { mean }
            }
            None => tensor,
        };
        Param::from_mapped_value(id, tensor, mapper)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;
    use crate::model::{Batch, Input, ModelConfig};

    struct Collected(Vec<(bool, Vec<f32>)>);

    impl ModuleVisitor for Collected {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let tensor = param.val();
            let is_trained = tensor.is_require_grad();
            self.0.push((is_trained, tensor.into_data().try_to_vec().unwrap()));
        }
    }

    fn values(detector: &Detector) -> Vec<(bool, Vec<f32>)> {
        let mut collected = Collected(Vec::new());
        detector.visit(&mut collected);
        collected.0
    }

    #[test]
    fn running_statistics_become_the_mean_over_copies_and_weights_stay() {
        let mut config = ModelConfig::default();
        (config.grid.cell_size_m, config.use_camera) = (3.2, false);
        let device = Device::flex().autodiff();
        let detector = Detector::init(&config, 0, &device);
        let before = values(&detector);
        let data = test_data::dataset(2);
        let alone = |samples: &[usize]| {
            let copies: Vec<Detector> = samples
                .iter()
                .map(|&i| {
                    let input = Input::prepare(&data.samples()[i].measured, &config, i == 1, false).unwrap();
                    let copy = copy_detector(&detector);
                    let _seen = copy.forward(&Batch::stack(&[&input], &config, false, &device));
                    copy
                })
                .collect();
            values(&average_statistics(copy_detector(&detector), &copies))
        };
        let (first, second, both) = (alone(&[0]), alone(&[1]), alone(&[0, 1]));
        let mut n_changed = 0;
        for (((before, first), second), both) in before.iter().zip(&first).zip(&second).zip(&both) {
            if before.0 {
                assert_eq!(before.1, both.1);
                continue;
            }
            for ((a, b), mean) in first.1.iter().zip(&second.1).zip(&both.1) {
                assert!((0.5 * (a + b) - mean).abs() < 1e-6);
            }
            n_changed += usize::from(before.1 != both.1);
        }
        assert!(n_changed > 4);
    }
}
