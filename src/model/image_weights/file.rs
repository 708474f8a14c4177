//! Named tensors of a PyTorch or safetensors file.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use burn::store::pytorch::PytorchReader;
use burn::store::{ModuleStore, SafetensorsStore, bridge, burn_pack};
use fs_err::File;

use super::ImageWeightsError;

/// Offset of the JSON header in a safetensors file; its length comes first.
const SAFETENSORS_HEADER_AT: u64 = 8;

/// Reads the names of a file's tensors, but not yet their values; names inside a dictionary have its key and a dot in
/// front. Safetensors is recognised by its content; any other file is read as PyTorch's.
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

/// Reads the values of a tensor as f32, or says why not.
pub(super) fn values(tensor: &burn_pack::Tensor) -> Result<Vec<f32>, String> {
    let data = bridge::to_data(tensor).map_err(|error| error.to_string())?;
    data.convert::<f32>().try_to_vec().map_err(|error| format!("{error:?}"))
}
