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
use super::plan::{Plan, Position};
use crate::files::{
    PARTIAL_SUFFIX, give_final_name, is_file, read_sealed, sha256_hex, sha256_of, write_atomic, write_sealed,
};
use crate::history::{History, STEPS_FILE};
use crate::model::checkpoint;

const OPTIMIZER_FILE: &str = "optimizer.bpk";
/// Written last; the networks beside it have hashes of their own.
const POSITION_FILE: &str = "position.json";

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Saved {
    position: Position,
    optimizer_sha256: String,
    /// Of all that belongs together: the run's config and data, and both networks. Older states lack it.
    #[serde(default)]
    whole_sha256: Option<String>,
    /// Of the log as it stood. Older states lack it.
    #[serde(default)]
    log_sha256: Option<String>,
}

const NETWORK_FILE: &str = "model.safetensors";
const AVERAGE_FILE: &str = "average.safetensors";

/// The hash of the run's own (of its config and data) and of both networks of a state.
fn whole_sha256(run_sha256: &str, state: &Path) -> std::io::Result<String> {
    let [network, average] = [NETWORK_FILE, AVERAGE_FILE].map(|file| sha256_of(&state.join(file)));
    Ok(sha256_hex(format!("{run_sha256} {} {}", network?, average?).as_bytes()))
}

/// What the folder of a state is called, which so many steps were taken before.
fn name(n_done: usize) -> String {
    format!("step-{n_done:08}")
}

pub(super) fn folder(run: &Path) -> PathBuf {
    run.join("state")
}

/// Saves a state, then removes older ones. `position` is the next step to take; the number of steps taken in all stages, of
/// which `history` is the log, names the state; `run_sha256` is the hash of the run's config and data, which it belongs to.
///
/// # Errors
/// Any IO error; the older state stays then.
pub fn save(
    run: &Path,
    run_sha256: &str,
    history: &History,
    position: Position,
    learner: &Learner,
) -> Result<(), StateError> {
    let states = folder(run);
    let whole = states.join(name(history.steps.len()));
    let partial = whole.with_extension(PARTIAL_SUFFIX);
    remove_folder(&partial)?;
    fs::create_dir_all(&partial)?;
    let broken = |message: String| StateError::Broken { message, path: partial.clone() };
    // Batch norms hand over their latest running statistics only to a `valid()` copy.
    checkpoint::save(&learner.detector().valid(), None, &partial.join(NETWORK_FILE))?;
    checkpoint::save(learner.average(), None, &partial.join(AVERAGE_FILE))?;
    write_atomic(&partial.join(OPTIMIZER_FILE), &learner.optimizer().to_bytes().map_err(broken)?)?;
    let optimizer_sha256 = sha256_of(&partial.join(OPTIMIZER_FILE))?;
    let whole_sha256 = Some(whole_sha256(run_sha256, &partial)?);
    let log_sha256 = Some(history.sha256());
    write_sealed(
        &partial.join(POSITION_FILE),
        &Saved { position, optimizer_sha256, whole_sha256, log_sha256 },
    )?;
    remove_folder(&whole)?;
    give_final_name(&partial, &whole)?;
    for older in list(run)?.into_iter().filter(|path| *path != whole) {
        fs::remove_dir_all(older)?;
    }
    Ok(())
}

/// Removes a folder; none there is no fault, one that cannot be looked at is.
fn remove_folder(folder: &Path) -> std::io::Result<()> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(()),
        done => done,
    }
}

/// Complete states of a run, oldest first.
fn list(run: &Path) -> Result<Vec<PathBuf>, StateError> {
    let states = folder(run);
    if !fs::exists(&states)? {
        return Ok(Vec::new());
    }
    let mut found = Vec::new();
    for entry in fs::read_dir(&states)? {
        let path = entry?.path();
        // A state that is half put to object storage lacks its position, which goes last.
        let named = path.file_name().unwrap_or_default().to_string_lossy();
        let n_done = named.strip_prefix("step-").and_then(|digits| digits.parse().ok());
        if n_done.is_some_and(|n_done| named == name(n_done)) && is_file(&path.join(POSITION_FILE))? {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// Loads the newest state of a run, if there is one: the next step to take, and the learner and the log before it.
///
/// # Errors
/// The state is broken or belongs to another run, or the log is not the one it was written with.
pub fn load_newest(
    run: &Path,
    run_sha256: &str,
    plan: &Plan,
    config: &TrainConfig,
    device: &Device,
    inference_device: &Device,
) -> Result<Option<(Position, Learner, History)>, StateError> {
    let Some(path) = list(run)?.pop() else { return Ok(None) };
    let broken = |message: String| StateError::Broken { message, path: path.clone() };
    let text = read_sealed(&path.join(POSITION_FILE))?;
    let Saved { position, optimizer_sha256, whole_sha256: wanted, log_sha256 } =
        serde_json::from_str(&text).map_err(|error| broken(error.to_string()))?;
    if !plan.has(position) || !path.ends_with(name(plan.n_done(position))) {
        let told = format!("it stands at {position:?}, and the run has {:?} steps", plan.n_steps);
        return Err(broken(told));
    }
    let found = whole_sha256(run_sha256, &path)?;
    if wanted.is_some_and(|wanted| wanted != found) {
        return Err(broken(
            "its networks, or the run's config or data, are not those it was written with".to_owned(),
        ));
    }
    let history = History::read_whole(run, plan.n_done(position))?;
    if log_sha256.is_some_and(|wanted| wanted != history.sha256()) {
        return Err(StateError::OtherLog { path: run.join(STEPS_FILE) });
    }
    let detector = checkpoint::load(&path.join(NETWORK_FILE), device)?;
    let average = checkpoint::load(&path.join(AVERAGE_FILE), inference_device)?;
    if [&detector, &average].iter().any(|network| *network.config() != config.model) {
        return Err(broken("its networks are of another config than the run's".to_owned()));
    }
    let bytes = fs::read(path.join(OPTIMIZER_FILE))?;
    if sha256_hex(&bytes) != optimizer_sha256 {
        return Err(broken(format!("{OPTIMIZER_FILE} is not as it was written")));
    }
    let optimizer = Optimizer::new(config).load_bytes(bytes).map_err(broken)?;
    Ok(Some((position, Learner::new(detector, average, optimizer, config), history)))
}

/// Whether a run has a state to go on from.
///
/// # Errors
/// The states cannot be looked at.
pub fn is_any(run: &Path) -> Result<bool, StateError> {
    Ok(!list(run)?.is_empty())
}

/// Bytes of disk that the states of a run will take beside those that are there: a state (weights, their average, and two moments
/// of each weight) is written while the one before it is there.
#[must_use]
pub fn bytes_to_come(n_parameters: usize, has_state: bool) -> u64 {
    let n_states: u64 = if has_state { 1 } else { 2 };
    n_states * 4 * 4 * n_parameters as u64
}

/// Removes all states of a finished run.
///
/// # Errors
/// Any IO error.
pub fn clear(run: &Path) -> Result<(), StateError> {
    Ok(remove_folder(&folder(run))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_that_cannot_be_looked_at_are_told_with_their_path_and_not_taken_for_none() {
        let home = tempfile::tempdir().unwrap();
        assert!(list(home.path()).unwrap().is_empty());
        let file = home.path().join("a file");
        fs::write(&file, "").unwrap();
        let told = list(&file).unwrap_err().to_string();
        assert!(told.contains(&folder(&file).display().to_string()), "{told}");
    }

    #[test]
    fn a_run_that_goes_on_needs_room_for_one_state_more_and_a_new_one_for_two() {
        assert_eq!([false, true].map(|has_state| bytes_to_come(10, has_state)), [320, 160]);
    }
}
