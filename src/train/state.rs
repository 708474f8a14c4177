//! The state from which a stopped run resumes: weights, optimizer and position, all of one step or none.
//!
//! `<run>/state/step-<n>/` is written under a temporary name and renamed when whole; the newest counts.

use std::path::{Path, PathBuf};

use burn::module::Module;
use burn::tensor::Device;
use fs_err as fs;
use serde::{Deserialize, Serialize};

use super::config::TrainConfig;
use super::error::StateError;
use super::learner::Learner;
use super::optimizer::Optimizer;
use super::plan::Position;
use crate::files::{PARTIAL_SUFFIX, is_file, read_sealed, sha256_hex, sha256_of, write_atomic, write_sealed};
use crate::model::checkpoint;

const OPTIMIZER_FILE: &str = "optimizer.bpk";
/// Written last; the networks beside it have hashes of their own.
const POSITION_FILE: &str = "position.json";

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Saved {
    position: Position,
    optimizer_sha256: String,
}

pub(super) fn folder(run: &Path) -> PathBuf {
    run.join("state")
}

/// Saves a state, then removes older ones. `position` is the next step to take; `n_done`, the number of steps taken in
/// all stages, names the state.
///
/// # Errors
/// Any IO error; the older state stays then.
pub fn save(run: &Path, n_done: usize, position: Position, learner: &Learner) -> Result<(), StateError> {
    let states = folder(run);
    let whole = states.join(format!("step-{n_done:08}"));
    let partial = states.join(format!("step-{n_done:08}.{PARTIAL_SUFFIX}"));
    if partial.exists() {
        fs::remove_dir_all(&partial)?;
    }
    fs::create_dir_all(&partial)?;
    let broken = |message: String| StateError::Broken { message, path: partial.clone() };
    // Batch norms hand over their latest running statistics only to a `valid()` copy.
    checkpoint::save(&learner.detector().valid(), None, &partial.join("model.safetensors"))?;
    checkpoint::save(learner.average(), None, &partial.join("average.safetensors"))?;
    write_atomic(&partial.join(OPTIMIZER_FILE), &learner.optimizer().to_bytes().map_err(broken)?)?;
    let optimizer_sha256 = sha256_of(&partial.join(OPTIMIZER_FILE))?;
    write_sealed(&partial.join(POSITION_FILE), &Saved { position, optimizer_sha256 })?;
    if whole.exists() {
        fs::remove_dir_all(&whole)?;
    }
    fs::rename(&partial, &whole)?;
    for older in list(run)?.into_iter().filter(|path| *path != whole) {
        fs::remove_dir_all(older)?;
    }
    Ok(())
}

/// Complete states of a run, oldest first.
fn list(run: &Path) -> Result<Vec<PathBuf>, StateError> {
    let states = folder(run);
    if !states.exists() {
        return Ok(Vec::new());
    }
    let mut found = Vec::new();
    for entry in fs::read_dir(&states)? {
        let path = entry?.path();
        // A state that is half put to object storage lacks its position, which goes last.
        let is_whole = path.extension().is_none()
            && path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("step-"));
        if is_whole && is_file(&path.join(POSITION_FILE))? {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// Loads the newest state of a run, if there is one: the next step to take, and the learner before it.
///
/// # Errors
/// The state is broken or belongs to another config.
pub fn load_newest(
    run: &Path,
    config: &TrainConfig,
    device: &Device,
    inference_device: &Device,
) -> Result<Option<(Position, Learner)>, StateError> {
    let Some(path) = list(run)?.pop() else { return Ok(None) };
    let broken = |message: String| StateError::Broken { message, path: path.clone() };
    let text = read_sealed(&path.join(POSITION_FILE))?;
    let Saved { position, optimizer_sha256 } =
        serde_json::from_str(&text).map_err(|error| broken(error.to_string()))?;
    let detector = checkpoint::load(&path.join("model.safetensors"), device)?;
    let average = checkpoint::load(&path.join("average.safetensors"), inference_device)?;
    let bytes = fs::read(path.join(OPTIMIZER_FILE))?;
    if sha256_hex(&bytes) != optimizer_sha256 {
        return Err(broken(format!("{OPTIMIZER_FILE} is not as it was written")));
    }
    let optimizer = Optimizer::new(config).load_bytes(bytes).map_err(broken)?;
    Ok(Some((position, Learner::new(detector, average, optimizer, config))))
}

/// Removes all states of a finished run.
///
/// # Errors
/// Any IO error.
pub fn clear(run: &Path) -> Result<(), StateError> {
    let states = folder(run);
    if states.exists() {
        fs::remove_dir_all(states)?;
    }
    Ok(())
}
