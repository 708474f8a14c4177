//! For tests: weights and inputs, equal to those that the scripts in `tests/golden` make (`formula.py`).

use std::collections::BTreeMap;

use burn::module::{Module, ModuleMapper, Param};
use burn::store::bridge::{from_data, into_data};
use burn::store::{BurnToPyTorchAdapter, ModuleSnapshot, PyTorchToBurnAdapter};
use burn::tensor::{DType, Device, Gradients, Tensor, TensorData};

/// `n` numbers in [-1, 1) from an integer hash of the name and the index.
pub fn uniform(name: &str, n: usize) -> Vec<f64> {
    let fnv = |seed: u32, byte: u8| (seed ^ u32::from(byte)).wrapping_mul(16_777_619);
    let seed = name.bytes().fold(2_166_136_261, fnv);
    let number = |i: u32| {
        let h = i.wrapping_mul(2_654_435_761).wrapping_add(seed);
        let h = (h ^ (h >> 16)).wrapping_mul(0x85EB_CA6B);
        let h = (h ^ (h >> 13)).wrapping_mul(0xC2B2_AE35);
        f64::from((h ^ (h >> 16)) >> 8) / f64::from(1 << 23) - 1.0
    };
    (0..n as u32).map(number).collect()
}

/// An input: uniform in [-1, 1).
pub fn tensor<const D: usize>(name: &str, dims: [usize; D], device: &Device) -> Tensor<D> {
    let values: Vec<f32> = uniform(name, dims.iter().product()).into_iter().map(|v| v as f32).collect();
    Tensor::from_data(TensorData::new(values, dims), device)
}

fn weight(name: &str, dims: &[usize]) -> Vec<f32> {
    let values = uniform(name, dims.iter().product());
    let (middle, half) = match dims {
        [_, inputs @ ..] if !inputs.is_empty() => {
            (0.0, (3.0 / inputs.iter().product::<usize>() as f64).sqrt())
        }
        _ if name.ends_with("weight") => (1.0, 0.1),
        _ => (0.0, 0.1),
    };
    values.into_iter().map(|value| (middle + half * value) as f32).collect()
}

/// PyTorch's name and shape of each weight.
pub fn named_weights(module: &impl ModuleSnapshot) -> Vec<(String, Vec<usize>)> {
    let tensors = module.collect(None, Some(Box::new(BurnToPyTorchAdapter)), false);
    let weights = tensors.into_iter().filter(|t| t.dtype == DType::F32 && !t.name.contains("running_"));
    weights.map(|t| (t.name, t.shape.to_vec())).collect()
}

/// Puts values in the place of weights, by their PyTorch names.
fn put(module: &mut impl ModuleSnapshot, weights: Vec<(String, Vec<usize>, Vec<f32>)>) {
    let n = weights.len();
    let tensor =
        |(name, dims, values)| from_data(TensorData::new::<f32, Vec<usize>>(values, dims), name, None);
    let tensors = weights.into_iter().map(tensor).collect();
    let result = module.apply(tensors, None, Some(Box::new(PyTorchToBurnAdapter)), false);
    assert!(result.errors.is_empty() && result.applied.len() == n, "{result}");
}

/// Sets every weight to the formula of its PyTorch name.
pub fn fill(module: &mut impl ModuleSnapshot) {
    let named = named_weights(module).into_iter();
    let weights = named
        .map(|(name, dims)| {
            let values = weight(&name, &dims);
            (name, dims, values)
        })
        .collect();
    put(module, weights);
}

/// Sets all values of one weight, by its PyTorch name.
pub fn set_all(module: &mut impl ModuleSnapshot, name: &str, value: f32) {
    let mut named = named_weights(module).into_iter();
    let (name, dims) = named.find(|(of, _)| of == name).unwrap_or_else(|| panic!("no weight `{name}`"));
    let values = vec![value; dims.iter().product()];
    put(module, vec![(name, dims, values)]);
}

/// Puts each weight's gradient in its place.
struct ToGradients<'a>(&'a Gradients);

impl ModuleMapper for ToGradients<'_> {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let gradient = param.val().grad(self.0);
        param.map(|value| match gradient {
            Some(gradient) => gradient,
            None => value.inner().zeros_like(),
        })
    }
}

/// Gradients of all weights, with PyTorch's names and layouts.
pub fn gradients<M: Module + ModuleSnapshot>(module: M, gradients: &Gradients) -> BTreeMap<String, Vec<f32>> {
    let names: Vec<String> = named_weights(&module).into_iter().map(|(name, _)| name).collect();
    let module = module.map(&mut ToGradients(gradients));
    let tensors = module.collect(None, Some(Box::new(BurnToPyTorchAdapter)), false);
    let named = tensors.into_iter().filter(|tensor| names.contains(&tensor.name)).map(|tensor| {
        let name = tensor.name.clone();
        (name, into_data(tensor).unwrap().try_to_vec().unwrap())
    });
    named.collect()
}
