//! Checkpoints: safetensors files with the model's config inside, written whole or not at all.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use burn::store::{ModuleSnapshot, SafetensorsStore};
use burn::tensor::Device;
use fs_err as fs;
use serde::de::DeserializeOwned;
use sha2::{Digest as _, Sha256};
use thiserror::Error;

use super::config::ModelConfig;
use super::detector::Detector;
use super::operating_score::{OperatingScore, OperatingScores};
use crate::config::Check;
use crate::dataset::SeenEpisodes;
use crate::files;

/// Name of the finished checkpoint in a run's folder.
pub const CHECKPOINT: &str = "model.safetensors";
/// Metadata key of the model's config, as TOML.
const CONFIG_KEY: &str = "harmzone.model";
/// Metadata key of the episodes that the network has seen, as JSON; states of a training and older checkpoints lack it.
const SEEN_KEY: &str = "harmzone.seen";
/// Metadata key of the score from which on the network warns, as JSON; absent until one is chosen.
const OPERATING_KEY: &str = "harmzone.operating";
/// Metadata key of the score from which on a car brakes for what the network says, as JSON; absent until one is chosen.
const BRAKING_KEY: &str = "harmzone.braking";
/// Metadata key of the hash of everything else in the file; older checkpoints lack it.
const HASH_KEY: &str = "harmzone.sha256";
/// Metadata key of the format's version.
const VERSION_KEY: &str = "harmzone.format";
const VERSION: &str = "1";

/// Keys of the model that came after the first checkpoints, and what is their like.
const BEFORE_KEYS: [(&[&str], &str); 7] = [
    (&["lidar", "pillars", "ground"], "false"),
    (&["lidar", "drops", "left_out"], "\"never\""),
    (&["camera", "cnn", "paint_channels"], "0"),
    (&["head", "heatmap_power"], "1.0"),
    (&["head", "look_pillars"], "0"),
    (&["head", "spread"], "false"),
    (&["head", "judge"], "\"network\""),
];

/// Why a checkpoint could not be written or read.
#[derive(Debug, Error)]
pub enum CheckpointError {
    #[error("cannot read or write the checkpoint: {0}")]
    Io(#[source] std::io::Error),
    #[error("not a harmzone checkpoint ({found}); `harmzone train` writes `model.safetensors`: {}", path.display())]
    Foreign { found: String, path: PathBuf },
    #[error("the checkpoint's config is not valid: {message}: {}", path.display())]
    Config { message: String, path: PathBuf },
    #[error(
        "the checkpoint's weights do not fit its config: {} missing {missing:?}, {} of another shape {misshapen:?}: {}",
        missing.len(), misshapen.len(), path.display()
    )]
    Weights { missing: Vec<String>, misshapen: Vec<String>, path: PathBuf },
    #[error(
        "the checkpoint's weights `{name}` are not usable ({found}); finite numbers of 32 bits are needed: {}", path.display()
    )]
    Numbers { name: String, found: String, path: PathBuf },
    #[error("the weights cannot be packed: {message}: {}", path.display())]
    Pack { message: String, path: PathBuf },
}

/// The detector's bytes as a safetensors file, or what went wrong. Same weights, same bytes.
fn pack(detector: &Detector, seen: Option<&SeenEpisodes>) -> Result<Vec<u8>, Box<dyn std::error::Error>> {
    let mut store = SafetensorsStore::from_bytes(None);
    detector.save_into(&mut store)?;
    let packed = store.get_bytes()?;
    let mut metadata =
        serde_json::json!({ CONFIG_KEY: crate::config::to_toml(detector.config()), VERSION_KEY: VERSION });
    if let Some(seen) = seen {
        metadata[SEEN_KEY] = serde_json::to_string(seen)?.into();
    }
    Ok(with_metadata(&packed, metadata)?)
}

/// The tensors of a safetensors file under our own metadata, keys and tensors in a fixed order, so that bytes repeat.
fn with_metadata(
    packed: &[u8],
    mut metadata: serde_json::Value,
) -> Result<Vec<u8>, safetensors::SafeTensorError> {
    let views = sorted_views(packed)?;
    metadata.as_object_mut().expect("metadata is an object").remove(HASH_KEY);
    metadata[HASH_KEY] = content_hash(&views, &metadata).into();
    let header = header(&views, metadata);
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend_from_slice(header.as_bytes());
    for (_, view) in &views {
        bytes.extend_from_slice(view.data());
    }
    Ok(bytes)
}

type NamedView<'a> = (String, safetensors::tensor::TensorView<'a>);

/// The tensors of a safetensors file in the order of their names.
fn sorted_views(packed: &[u8]) -> Result<Vec<NamedView<'_>>, safetensors::SafeTensorError> {
    let mut views = safetensors::SafeTensors::deserialize(packed)?.tensors();
    views.sort_by(|a, b| a.0.cmp(&b.0));
    Ok(views)
}

/// SHA-256 of metadata without a hash, and of each tensor's name, type, shape and numbers.
fn content_hash(views: &[NamedView<'_>], metadata: &serde_json::Value) -> String {
    let mut hasher = Sha256::new();
    hasher.update(metadata.to_string());
    for (name, view) in views {
        hasher.update(serde_json::json!([name, view.dtype(), view.shape()]).to_string());
        hasher.update(view.data());
    }
    files::hex(&hasher.finalize())
}

/// The JSON header of a safetensors file, with keys in order and padded to eight bytes.
fn header(views: &[NamedView<'_>], metadata: serde_json::Value) -> String {
    let mut header = serde_json::Map::new();
    header.insert("__metadata__".into(), metadata);
    let mut offset = 0;
    for (name, view) in views {
        let end = offset + view.data().len();
        header.insert(
            name.clone(),
            serde_json::json!({ "dtype": view.dtype(), "shape": view.shape(), "data_offsets": [offset, end] }),
        );
        offset = end;
    }
    let mut text = serde_json::Value::from(header).to_string();
    while !text.len().is_multiple_of(8) {
        text.push(' ');
    }
    text
}

/// Writes a detector and the episodes that it has seen, whole or not at all.
///
/// # Errors
/// Any IO error, among them a full disk.
pub fn save(detector: &Detector, seen: Option<&SeenEpisodes>, path: &Path) -> Result<(), CheckpointError> {
    let bytes = pack(detector, seen)
        .map_err(|error| CheckpointError::Pack { message: error.to_string(), path: path.to_owned() })?;
    files::write_atomic(path, &bytes).map_err(CheckpointError::Io)
}

/// Reads the config inside a checkpoint.
///
/// # Errors
/// The file cannot be read, is not a harmzone checkpoint, or its config is not valid.
pub fn read_config(path: &Path) -> Result<ModelConfig, CheckpointError> {
    config_in(&fs::read(path).map_err(CheckpointError::Io)?, path)
}

/// Reads the config inside a checkpoint's bytes; errors name `path`.
///
/// # Errors
/// The bytes are not a harmzone checkpoint, or its config is not valid.
pub fn config_in(bytes: &[u8], path: &Path) -> Result<ModelConfig, CheckpointError> {
    let foreign = |found: String| CheckpointError::Foreign { found, path: path.to_owned() };
    let metadata = metadata_in(bytes).map_err(foreign)?;
    let text =
        metadata.get(CONFIG_KEY).ok_or_else(|| foreign(format!("no `{CONFIG_KEY}` in its metadata")))?;
    let version = metadata.get(VERSION_KEY).map_or("none", String::as_str);
    if version != VERSION {
        return Err(foreign(format!("format version {version}; this program reads {VERSION}")));
    }
    let invalid = |message: String| CheckpointError::Config { message, path: path.to_owned() };
    let config = read_model(text).map_err(|error| invalid(error.to_string()))?;
    config.check().map_err(|error| invalid(error.to_string()))?;
    Ok(config)
}

/// A model's config as a checkpoint holds it: in full, so that keys which are absent are younger than the checkpoint, whose
/// network is as if there were none.
fn read_model(text: &str) -> Result<ModelConfig, toml::de::Error> {
    let mut found: toml::Table = text.parse()?;
    for (path, before) in BEFORE_KEYS {
        let [tables @ .., key] = path else { unreachable!("a path has a key") };
        let table = tables.iter().try_fold(&mut found, |table, name| {
            table.entry(*name).or_insert_with(|| toml::Table::new().into()).as_table_mut()
        });
        if let Some(table) = table.filter(|table| !table.contains_key(*key)) {
            table.insert((*key).to_owned(), before.parse().expect("a value"));
        }
    }
    found.try_into()
}

/// The episodes that the network in a checkpoint's bytes has seen, where it says so; errors name `path`.
///
/// # Errors
/// The bytes are not a checkpoint, or what they say of episodes is broken.
pub fn seen_in(bytes: &[u8], path: &Path) -> Result<Option<SeenEpisodes>, CheckpointError> {
    json_in(bytes, SEEN_KEY, path)
}

/// The score from which on the network in a checkpoint's bytes warns, where one has been chosen; errors name `path`.
///
/// # Errors
/// The bytes are not a checkpoint, or what they say of the score is broken.
pub fn operating_score_in(bytes: &[u8], path: &Path) -> Result<Option<OperatingScore>, CheckpointError> {
    score_in(bytes, OPERATING_KEY, path)
}

/// The score from which on a car brakes for what the network in a checkpoint's bytes says, where one has been chosen; errors name
/// `path`.
///
/// # Errors
/// As [`operating_score_in`].
pub fn braking_score_in(bytes: &[u8], path: &Path) -> Result<Option<OperatingScore>, CheckpointError> {
    score_in(bytes, BRAKING_KEY, path)
}

/// A checkpoint's bytes with other scores, which were chosen on the episodes that `seen` now holds too; weights and config stay as
/// they are. Errors name `path`.
///
/// # Errors
/// The bytes are not a checkpoint.
pub fn with_operating_scores(
    bytes: &[u8],
    chosen: &OperatingScores,
    seen: Option<&SeenEpisodes>,
    path: &Path,
) -> Result<Vec<u8>, CheckpointError> {
    let foreign = |found: String| CheckpointError::Foreign { found, path: path.to_owned() };
    config_in(bytes, path)?;
    let mut metadata = serde_json::to_value(metadata_in(bytes).map_err(foreign)?).expect("texts are JSON");
    for (key, score) in [(OPERATING_KEY, &chosen.warning), (BRAKING_KEY, &chosen.braking)] {
        metadata[key] = serde_json::to_string(score).expect("numbers are JSON").into();
    }
    if let Some(seen) = seen {
        metadata[SEEN_KEY] = serde_json::to_string(seen).expect("hashes are JSON").into();
    }
    with_metadata(bytes, metadata).map_err(|error| foreign(error.to_string()))
}

/// A score under a key of the metadata of a checkpoint's bytes, where it is there.
fn score_in(bytes: &[u8], key: &str, path: &Path) -> Result<Option<OperatingScore>, CheckpointError> {
    let chosen: Option<OperatingScore> = json_in(bytes, key, path)?;
    match chosen.as_ref().map(|chosen| chosen.score).filter(|score| !(0.0..=1.0).contains(score)) {
        None => Ok(chosen),
        Some(score) => Err(CheckpointError::Foreign {
            found: format!("`{key}` has the score {score}; a number from 0 to 1 is needed"),
            path: path.to_owned(),
        }),
    }
}

/// What a key of the metadata of a checkpoint's bytes holds as JSON, where it is there.
fn json_in<T: DeserializeOwned>(bytes: &[u8], key: &str, path: &Path) -> Result<Option<T>, CheckpointError> {
    let foreign = |found: String| CheckpointError::Foreign { found, path: path.to_owned() };
    let metadata = metadata_in(bytes).map_err(foreign)?;
    let read = |text: &String| {
        serde_json::from_str(text).map_err(|error| foreign(format!("a broken `{key}`: {error}")))
    };
    metadata.get(key).map(read).transpose()
}

/// The metadata of a safetensors file's bytes, whose hash is checked where they have one.
fn metadata_in(bytes: &[u8]) -> Result<HashMap<String, String>, String> {
    let (_, metadata) = safetensors::SafeTensors::read_metadata(bytes).map_err(|error| error.to_string())?;
    let mut metadata = metadata.metadata().clone().unwrap_or_default();
    if let Some(found) = metadata.remove(HASH_KEY) {
        let views = sorted_views(bytes).map_err(|error| error.to_string())?;
        let wanted = content_hash(&views, &serde_json::to_value(&metadata).expect("texts are JSON"));
        if found != wanted {
            return Err(format!("damaged: the hash of its content is {wanted}, and it says {found}"));
        }
    }
    Ok(metadata)
}

/// Reads a detector.
///
/// # Errors
/// As [`read_config`], or the weights do not fit the config.
pub fn load(path: &Path, device: &Device) -> Result<Detector, CheckpointError> {
    unpack(&fs::read(path).map_err(CheckpointError::Io)?, path, device)
}

/// Makes a detector from a checkpoint's bytes; errors name `path`.
///
/// # Errors
/// As [`config_in`], or the weights do not fit the config or are no finite numbers of 32 bits.
pub fn unpack(bytes: &[u8], path: &Path, device: &Device) -> Result<Detector, CheckpointError> {
    let config = config_in(bytes, path)?;
    // A number takes a byte at least. Without this check, a small file could ask for any amount of memory.
    let n_least = config.least_weights();
    if n_least > bytes.len() {
        let found = format!("its config needs {n_least} weights or more, and it has {} bytes", bytes.len());
        return Err(CheckpointError::Foreign { found, path: path.to_owned() });
    }
    check_weights(bytes, path)?;
    let mut detector = Detector::init(&config, 0, device);
    let mut store = SafetensorsStore::from_bytes(Some(bytes.to_vec())).allow_partial(true).validate(false);
    let applied = detector
        .load_from(&mut store)
        .map_err(|error| CheckpointError::Foreign { found: error.to_string(), path: path.to_owned() })?;
    let misshapen: Vec<String> = applied.errors.iter().map(ToString::to_string).collect();
    let missing: Vec<String> = applied.missing.iter().map(|(name, _)| name.clone()).collect();
    if !misshapen.is_empty() || !missing.is_empty() {
        return Err(CheckpointError::Weights { missing, misshapen, path: path.to_owned() });
    }
    Ok(detector)
}

/// Refuses weights by which a network would find nothing, without a word: those that are no numbers, and variances below zero.
fn check_weights(bytes: &[u8], path: &Path) -> Result<(), CheckpointError> {
    let views = sorted_views(bytes)
        .map_err(|error| CheckpointError::Foreign { found: error.to_string(), path: path.to_owned() })?;
    for (name, view) in views {
        let fail =
            |found: String| CheckpointError::Numbers { name: name.clone(), found, path: path.to_owned() };
        if view.dtype() != safetensors::Dtype::F32 {
            return Err(fail(format!("of type {:?}", view.dtype())));
        }
        let least = if name.ends_with("running_var") { 0.0 } else { f32::MIN };
        let numbers = view.data().as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
        if let Some(number) = { numbers }.find(|number| !(number.is_finite() && *number >= least)) {
            return Err(fail(format!("{number} is among them")));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
