//! What a run needs to go on where it stopped: weights, optimizer, position, all of one step or none.
//!
//! `<run>/state/step-<n>/` is written under a temporary name and renamed when whole; the newest counts.

use std::path::{Path, PathBuf};

use burn::tensor::Device;
use fs_err as fs;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::optimizer::Optimizer;
use crate::files::PARTIAL_SUFFIX;
use crate::model::Detector;
use crate::model::checkpoint::{self, CheckpointError};

/// Where a run stands: the next step to take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Position {
    /// 0 LiDAR, 1 fused.
    pub stage: usize,
    /// Step within the stage.
    pub step: usize,
}

/// Why a state could not be kept or taken up.
#[derive(Debug, Error)]
pub enum StateError {
    #[error("cannot keep or read the run's state: {0}")]
    Io(#[from] std::io::Error),
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    #[error("the run's state is broken: {message}; delete it to start anew: {}", path.display())]
    Broken { message: String, path: PathBuf },
}

/// A state read back.
pub struct Kept {
    pub position: Position,
    pub detector: Detector,
    /// The moving average, on the inference device.
    pub average: Detector,
    pub optimizer: Optimizer,
}

fn folder(run: &Path) -> PathBuf {
    run.join("state")
}

/// Keeps a state and drops older ones. The detector must be a `valid()` copy: batch norms hand over their
/// latest running statistics only there. `n_done` counts the steps of all stages and names it.
///
/// # Errors
/// Any IO error; the older state stays then.
pub fn keep(
    run: &Path,
    n_done: usize,
    position: Position,
    detector: &Detector,
    average: &Detector,
    optimizer: &Optimizer,
) -> Result<(), StateError> {
    let states = folder(run);
    let whole = states.join(format!("step-{n_done:08}"));
    let partial = states.join(format!("step-{n_done:08}.{PARTIAL_SUFFIX}"));
    if partial.exists() {
        fs::remove_dir_all(&partial)?;
    }
    fs::create_dir_all(&partial)?;
    let broken = |message: String| StateError::Broken { message, path: partial.clone() };
    checkpoint::save(detector, &partial.join("model.safetensors"))?;
    checkpoint::save(average, &partial.join("average.safetensors"))?;
    fs::write(partial.join("optimizer.bpk"), optimizer.to_bytes().map_err(broken)?)?;
    let text = serde_json::to_string(&position).expect("a position always has a JSON form");
    fs::write(partial.join("position.json"), text)?;
    if whole.exists() {
        fs::remove_dir_all(&whole)?;
    }
    fs::rename(&partial, &whole)?;
    for older in all(run)?.into_iter().filter(|path| *path != whole) {
        fs::remove_dir_all(older)?;
    }
    Ok(())
}

/// Whole states of a run, oldest first.
fn all(run: &Path) -> Result<Vec<PathBuf>, StateError> {
    let states = folder(run);
    if !states.exists() {
        return Ok(Vec::new());
    }
    let mut found = Vec::new();
    for entry in fs::read_dir(&states)? {
        let path = entry?.path();
        let is_whole = path.extension().is_none()
            && path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("step-"));
        if is_whole {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// Takes up the newest state of a run, if there is one.
///
/// # Errors
/// The state is broken or of another config.
pub fn newest(
    run: &Path,
    optimizer: Optimizer,
    device: &Device,
    inference_device: &Device,
) -> Result<Option<Kept>, StateError> {
    let Some(path) = all(run)?.pop() else { return Ok(None) };
    let broken = |message: String| StateError::Broken { message, path: path.clone() };
    let text = fs::read_to_string(path.join("position.json"))?;
    let position = serde_json::from_str(&text).map_err(|error| broken(error.to_string()))?;
    let detector = checkpoint::load(&path.join("model.safetensors"), device)?;
    let average = checkpoint::load(&path.join("average.safetensors"), inference_device)?;
    let optimizer = optimizer.load_bytes(fs::read(path.join("optimizer.bpk"))?).map_err(broken)?;
    Ok(Some(Kept { position, detector, average, optimizer }))
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
