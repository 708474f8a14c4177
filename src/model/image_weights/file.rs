//! Named tensors of a PyTorch or safetensors file.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use burn::store::pytorch::PytorchReader;
use burn::store::{ModuleStore, SafetensorsStore, bridge, burn_pack};
use fs_err::File;

use super::ImageWeightsError;

/// Where the JSON header of a safetensors file begins, behind its length.
const SAFETENSORS_HEADER_AT: u64 = 8;

/// Tensors by name, their values not yet read; a name inside a dictionary of the file has the dictionary's key
/// and a dot in front. safetensors is told by its content, anything else is taken for PyTorch's.
pub(super) fn read(path: &Path) -> Result<BTreeMap<String, burn_pack::Tensor>, ImageWeightsError> {
    let unreadable = |message: String| ImageWeightsError::Unreadable { message, path: path.to_owned() };
    let mut start = Vec::new();
    let file = File::open(path).map_err(ImageWeightsError::Io)?;
    file.take(SAFETENSORS_HEADER_AT + 1).read_to_end(&mut start).map_err(ImageWeightsError::Io)?;
    if start.get(SAFETENSORS_HEADER_AT as usize) == Some(&b'{') {
        let mut store = SafetensorsStore::from_file(path);
        return store.get_all_tensors().cloned().map_err(|error| unreadable(error.to_string()));
    }
    let reader = PytorchReader::new(path).map_err(|error| unreadable(error.to_string()))?;
    let tensors = reader.into_tensors().into_iter();
    Ok(tensors.map(|(name, tensor)| (name, bridge::from_pytorch(tensor))).collect())
}

/// Values of a tensor as f32, or why they cannot be had.
pub(super) fn values(tensor: &burn_pack::Tensor) -> Result<Vec<f32>, String> {
    let data = bridge::to_data(tensor).map_err(|error| error.to_string())?;
    data.convert::<f32>().try_to_vec().map_err(|error| format!("{error:?}"))
}
