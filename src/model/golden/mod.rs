//! For tests: compares with the golden files that `tests/golden/torch_<topic>.py` wrote.

pub mod formula;

use std::collections::BTreeMap;
use std::path::PathBuf;

use burn::store::{ModuleSnapshot, PyTorchToBurnAdapter, SafetensorsStore};
use burn::tensor::{Device, Tensor, TensorData};
use safetensors::{Dtype, SafeTensors};

use crate::device::{test_device, test_slack};

/// The tensors of one topic.
pub struct Golden {
    bytes: Vec<u8>,
}

impl Golden {
    pub fn read(topic: &str) -> Self {
        let path =
            PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("tests/golden/{topic}.safetensors"));
        Self { bytes: fs_err::read(path).unwrap() }
    }

    /// Shape and numbers of a tensor, whatever their type.
    fn view(&self, name: &str) -> (Vec<usize>, Vec<f64>) {
        let tensors = SafeTensors::deserialize(&self.bytes).unwrap();
        let view = tensors.tensor(name).unwrap_or_else(|_| panic!("no golden tensor `{name}`"));
        let data = view.data();
        let numbers = match view.dtype() {
            Dtype::F32 => {
                data.as_chunks().0.iter().map(|&word| f64::from(f32::from_le_bytes(word))).collect()
            }
            Dtype::F64 => data.as_chunks().0.iter().map(|&word| f64::from_le_bytes(word)).collect(),
            Dtype::I64 => data.as_chunks().0.iter().map(|&word| i64::from_le_bytes(word) as f64).collect(),
            other => panic!("{name}: no reader for {other:?}"),
        };
        (view.shape().to_vec(), numbers)
    }

    /// All numbers of a tensor, in order.
    pub fn numbers(&self, name: &str) -> Vec<f64> {
        self.view(name).1
    }

    pub fn tensor<const D: usize>(&self, name: &str, device: &Device) -> Tensor<D> {
        let (shape, numbers) = self.view(name);
        let values: Vec<f32> = numbers.into_iter().map(|value| value as f32).collect();
        Tensor::from_data(TensorData::new(values, shape), device)
    }

    /// The module with all of its parameters and statistics from the tensors `<prefix>.<name>`, which are
    /// laid out as PyTorch does; none of them may be left over.
    pub fn load_torch<M: ModuleSnapshot>(&self, prefix: &str, mut module: M) -> M {
        let tensors = SafeTensors::deserialize(&self.bytes).unwrap();
        let of_module = tensors.tensors().into_iter().filter_map(|(name, view)| {
            Some((name.strip_prefix(prefix)?.strip_prefix('.')?.to_owned(), view))
        });
        let bytes = safetensors::serialize(of_module, None).unwrap();
        let mut store = SafetensorsStore::from_bytes(Some(bytes))
            .with_from_adapter(PyTorchToBurnAdapter)
            .allow_partial(true)
            .validate(false);
        let applied = module.load_from(&mut store).unwrap();
        let is_whole = applied.errors.is_empty() && applied.missing.is_empty() && applied.unused.is_empty();
        assert!(is_whole, "{applied}");
        module
    }

    pub fn n_tensors(&self) -> usize {
        SafeTensors::deserialize(&self.bytes).unwrap().len()
    }

    /// Fails where `found` has another shape or differs by more than 1e-4 of the largest value.
    pub fn check<const D: usize>(&self, name: &str, found: &Tensor<D>) {
        assert_close(found, &self.tensor(name, &test_device()), name);
    }

    /// As [`Self::check`], for numbers in order; the largest value is at least `scale`.
    pub fn check_numbers(&self, name: &str, found: &[f32], scale: f64) {
        let expected = self.numbers(name);
        let tolerance = 1e-4 * test_slack() * largest(&expected).max(scale);
        assert_eq!(found.len(), expected.len(), "{name}: number of values");
        for (i, (&a, b)) in found.iter().zip(expected).enumerate() {
            let error = (f64::from(a) - b).abs();
            assert!(error <= tolerance, "{name}: value {i} is {a}, expected {b} within {tolerance}");
        }
    }

    /// Checks every gradient of a module against `gradient.<name>`.
    ///
    /// A shift or scale of whole channels in front of a batch norm has no effect, and its gradient is only
    /// rounding: it is compared on the scale of the norm's gradients.
    pub fn check_gradients(&self, found: &BTreeMap<String, Vec<f32>>) {
        for (name, found) in found {
            let norm = name.rsplit_once("conv.").map(|(block, _)| format!("gradient.{block}norm.weight"));
            let of_norm = norm.filter(|norm| self.has(norm)).map(|norm| self.numbers(&norm));
            let of_norm = of_norm.filter(|norm| norm.len() == found.len());
            let scale = of_norm.map_or(0.0, |norm| largest(&norm));
            self.check_numbers(&format!("gradient.{name}"), found, scale);
        }
    }

    fn has(&self, name: &str) -> bool {
        SafeTensors::deserialize(&self.bytes).unwrap().tensor(name).is_ok()
    }
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |largest, value| largest.max(value.abs()))
}

/// The numbers of a tensor, in order.
pub fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_to_vec().unwrap()
}

/// The largest absolute difference over the largest absolute value expected.
pub fn relative_error<const D: usize>(found: Tensor<D>, expected: Tensor<D>) -> f32 {
    assert_eq!(found.dims(), expected.dims());
    let largest = expected.clone().abs().max().into_scalar::<f32>();
    assert!(largest > 0.0, "an all-zero expectation proves nothing");
    (found - expected).abs().max().into_scalar::<f32>() / largest
}

/// Fails where [`relative_error`] exceeds 1e-4; more on CUDA ([`test_slack`]).
pub fn assert_close<const D: usize>(found: &Tensor<D>, expected: &Tensor<D>, what: &str) {
    assert_within(1e-4, found, expected, what);
}

/// Fails where [`relative_error`] exceeds a tolerance, which [`test_slack`] widens.
pub fn assert_within<const D: usize>(tolerance: f32, found: &Tensor<D>, expected: &Tensor<D>, what: &str) {
    let plain = |of: &Tensor<D>| Tensor::<D>::from_data(of.clone().into_data(), &test_device());
    let error = relative_error(plain(found), plain(expected));
    let tolerance = tolerance * test_slack() as f32;
    assert!(error <= tolerance, "{what}: relative error {error}");
}
