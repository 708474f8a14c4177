//! Reads the golden files that `tests/golden/torch_<topic>.py` made; for tests only.

pub mod formula;

use std::path::PathBuf;

use burn::store::{ModuleSnapshot, PyTorchToBurnAdapter, SafetensorsStore};
use burn::tensor::{Device, Tensor, TensorData};
use safetensors::{Dtype, SafeTensors};

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
}

/// The greatest absolute difference over the greatest absolute value expected.
pub fn relative_error<const D: usize>(found: Tensor<D>, expected: Tensor<D>) -> f32 {
    assert_eq!(found.dims(), expected.dims());
    let largest = expected.clone().abs().max().into_scalar::<f32>();
    assert!(largest > 0.0, "an all-zero expectation proves nothing");
    (found - expected).abs().max().into_scalar::<f32>() / largest
}

/// Fails where [`relative_error`] exceeds 1e-4.
pub fn assert_close<const D: usize>(found: &Tensor<D>, expected: &Tensor<D>, what: &str) {
    let error = relative_error(found.clone().detach(), expected.clone().detach());
    assert!(error <= 1e-4, "{what}: relative error {error}");
}
