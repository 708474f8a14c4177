//! Named tensors of a PyTorch or safetensors file.

use std::collections::BTreeMap;
use std::io::{BufReader, Read};
use std::path::Path;

use burn::store::pytorch::PytorchReader;
use burn::store::{ModuleStore, SafetensorsStore, bridge, burn_pack};
use fs_err::File;
use zip::{CompressionMethod, ZipArchive};

use super::ImageWeightsError;

/// Offset of the JSON header in a safetensors file; its length comes first.
const SAFETENSORS_HEADER_AT: u64 = 8;
/// Where a TAR file has its magic, as PyTorch wrote such before 0.1.10.
const TAR_MAGIC_AT: usize = 257;
const TAR_MAGIC: &[u8] = b"ustar";
/// Most bytes of a compressed pickle, each of which may become an object of a hundred bytes. `torch.save` compresses nothing.
const MAX_PACKED_PICKLE_BYTES: u64 = 4 << 20;
/// A compressed entry of more than these bytes may unpack to so many times its size: weights hardly shrink.
const MAX_PACKED_BYTES: u64 = 64 << 20;
const MAX_PACKED_RATIO: u64 = 16;

/// Reads the names of a file's tensors, but not yet their values; names inside a dictionary have its key and a dot in
/// front. Safetensors is recognised by its content; any other file is read as PyTorch's.
pub(super) fn read(path: &Path) -> Result<BTreeMap<String, burn_pack::Tensor>, ImageWeightsError> {
    let unreadable = |message: String| ImageWeightsError::Unreadable { message, path: path.to_owned() };
    let mut start = Vec::new();
    let file = File::open(path).map_err(ImageWeightsError::Io)?;
    let n_start = (TAR_MAGIC_AT + TAR_MAGIC.len()) as u64;
    file.take(n_start).read_to_end(&mut start).map_err(ImageWeightsError::Io)?;
    if start.get(SAFETENSORS_HEADER_AT as usize) == Some(&b'{') {
        let mut store = SafetensorsStore::from_file(path);
        return store.get_all_tensors().cloned().map_err(|error| unreadable(error.to_string()));
    }
    check_archive(path, &start).map_err(unreadable)?;
    let reader = PytorchReader::new(path).map_err(|error| unreadable(error.to_string()))?;
    let tensors = reader.into_tensors().into_iter();
    Ok(tensors.map(|(name, tensor)| (name, bridge::from_pytorch(tensor))).collect())
}

/// Refuses an archive that may take any amount of memory: the crate that reads it bounds a pickle by 100 MiB, and tensors by 10 GiB.
fn check_archive(path: &Path, start: &[u8]) -> Result<(), String> {
    if start.get(TAR_MAGIC_AT..) == Some(TAR_MAGIC) {
        return Err(
            "a TAR file, as PyTorch wrote before 0.1.10; save it anew with a later `torch.save`".into()
        );
    }
    if !start.starts_with(b"PK") {
        return Ok(());
    }
    let file = File::open(path).map_err(|error| error.to_string())?;
    let mut archive = ZipArchive::new(BufReader::new(file)).map_err(|error| error.to_string())?;
    for i in 0..archive.len() {
        let entry = archive.by_index_raw(i).map_err(|error| error.to_string())?;
        if entry.compression() == CompressionMethod::Stored {
            continue;
        }
        let name = entry.name().map_err(|error| error.to_string())?;
        let most = if name.ends_with("data.pkl") {
            MAX_PACKED_PICKLE_BYTES
        } else {
            MAX_PACKED_BYTES.max(entry.compressed_size().saturating_mul(MAX_PACKED_RATIO))
        };
        if entry.size() > most {
            return Err(format!(
                "its entry `{name}` unpacks from {} to {} bytes; up to {most} are read, and more as `torch.save` writes it, not \
                 compressed",
                entry.compressed_size(),
                entry.size()
            ));
        }
    }
    Ok(())
}

/// Reads the values of a tensor as f32, or says why not.
pub(super) fn values(tensor: &burn_pack::Tensor) -> Result<Vec<f32>, String> {
    let data = bridge::to_data(tensor).map_err(|error| error.to_string())?;
    data.convert::<f32>().try_to_vec().map_err(|error| format!("{error:?}"))
}
