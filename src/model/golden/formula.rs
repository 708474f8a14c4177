//! For tests: weights that the scripts in `tests/golden` make alike (`formula.py`), and what these wrote.

use std::collections::BTreeMap;

use burn::module::{Module, ModuleMapper, Param};
use burn::store::bridge::{from_data, into_data};
use burn::store::{BurnToPyTorchAdapter, ModuleSnapshot, PyTorchToBurnAdapter};
use burn::tensor::{DType, Device, Gradients, Tensor, TensorData};
use safetensors::SafeTensors;

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

/// Sets every weight to the formula of its PyTorch name.
pub fn fill(module: &mut impl ModuleSnapshot) {
    let tensors = named_weights(module).into_iter().map(|(name, dims)| {
        let data = TensorData::new(weight(&name, &dims), dims);
        from_data(data, name, None)
    });
    let tensors: Vec<_> = tensors.collect();
    let n = tensors.len();
    let result = module.apply(tensors, None, Some(Box::new(PyTorchToBurnAdapter)), false);
    assert!(result.errors.is_empty() && result.applied.len() == n, "{result}");
}

/// Sets all values of one weight, by its PyTorch name.
pub fn set_all(module: &mut impl ModuleSnapshot, name: &str, value: f32) {
    let named = named_weights(module).into_iter().find(|(of, _)| of == name);
    let dims = named.unwrap_or_else(|| panic!("no weight `{name}`")).1;
    let data = TensorData::new(vec![value; dims.iter().product()], dims);
    let result = module.apply(
        vec![from_data(data, name.to_owned(), None)],
        None,
        Some(Box::new(PyTorchToBurnAdapter)),
        false,
    );
    assert!(result.errors.is_empty() && result.applied.len() == 1, "{result}");
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

pub fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_to_vec().unwrap()
}

/// Tensors of a file that a golden script wrote.
pub fn golden(bytes: &[u8]) -> BTreeMap<String, Vec<f32>> {
    let file = SafeTensors::deserialize(bytes).unwrap();
    let float = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().unwrap());
    let tensors = file.tensors().into_iter();
    tensors.map(|(name, view)| (name, view.data().chunks_exact(4).map(float).collect())).collect()
}

/// Asserts that the largest difference is under 1e-4 of the largest expected value.
pub fn assert_equal(what: &str, found: &[f32], expected: &[f32]) {
    let largest = expected.iter().fold(0f32, |largest, value| largest.max(value.abs()));
    assert_equal_within(what, found, expected, 1e-4 * largest);
}

/// Asserts that no value differs by more than `tolerance`.
pub fn assert_equal_within(what: &str, found: &[f32], expected: &[f32], tolerance: f32) {
    assert_eq!(found.len(), expected.len(), "{what}: number of values");
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((a - b).abs() <= tolerance, "{what}: value {i} is {a}, expected {b} within {tolerance}");
    }
}

/// Asserts that every gradient of the module is as in `expected` under `gradient.<name>`.
///
/// A shift or scale of whole channels in front of a batch norm has no effect, and a gradient of nothing but
/// rounding: it is compared on the scale of the norm's gradients.
pub fn assert_gradients_equal(found: &BTreeMap<String, Vec<f32>>, expected: &BTreeMap<String, Vec<f32>>) {
    let largest = |values: &[f32]| values.iter().fold(0f32, |largest, value| largest.max(value.abs()));
    for (name, found) in found {
        let here = &expected[&format!("gradient.{name}")];
        let of_norm = name.rsplit_once("conv.").and_then(|(block, _)| {
            expected.get(&format!("gradient.{block}norm.weight")).filter(|norm| norm.len() == here.len())
        });
        let scale = of_norm.map_or(0.0, |norm| largest(norm)).max(largest(here));
        assert_equal_within(name, found, here, 1e-4 * scale);
    }
}

/// Trained parameters, without running statistics.
pub fn n_parameters(module: &impl ModuleSnapshot) -> usize {
    named_weights(module).iter().map(|(_, dims)| dims.iter().product::<usize>()).sum()
}
