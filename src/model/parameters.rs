//! The number of trained parameters, without the running statistics of batch norms.

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::Tensor;

struct Count(usize);

impl ModuleVisitor for Count {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if param.val().is_require_grad() {
            self.0 += param.shape().num_elements();
        }
    }
}

/// Counts the trained parameters of a module on an autodiff device, without frozen ones; on any other device there
/// are none. burn's `num_params` counts running statistics too.
#[must_use]
pub fn n_trained(module: &impl Module) -> usize {
    let mut count = Count(0);
    module.visit(&mut count);
    count.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::nn::BatchNormConfig;
    use burn::tensor::Device;

    #[test]
    fn running_statistics_and_frozen_parameters_do_not_count() {
        let norm = BatchNormConfig::new(5).init(&Device::flex().autodiff());
        assert_eq!((norm.num_params(), n_trained(&norm)), (20, 10));
        assert_eq!(n_trained(&norm.no_grad()), 0);
    }
}
