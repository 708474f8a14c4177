//! What a run's folder tells of its course: `log.csv` and `validation.csv`, read back.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde::de::DeserializeOwned;
use thiserror::Error;

use super::folder::{LOG_FILE, VALIDATION_FILE};

/// A row of `log.csv`: one step.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct StepRow {
    /// Steps of all stages, this one included.
    pub n_done: usize,
    /// `lidar` or `fused`.
    pub stage: String,
    /// Of the stage, from 0.
    pub epoch: usize,
    pub learning_rate: f64,
    /// Parts of the loss, weighted.
    pub heatmap: f64,
    pub harm: f64,
    pub boxes: f64,
    /// Norm of all gradients together before clipping.
    pub gradient_norm: f64,
}

/// A row of `validation.csv`: AP after an epoch.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct ScoreRow {
    pub n_done: usize,
    pub stage: String,
    pub epoch: usize,
    pub harmful: f64,
    pub harmless: f64,
    pub mean: f64,
}

/// The course of a run, finished or under way.
#[derive(Debug, Clone, PartialEq)]
pub struct History {
    /// At least one.
    pub steps: Vec<StepRow>,
    pub scores: Vec<ScoreRow>,
}

/// Why a run's course could not be read.
#[derive(Debug, Error)]
pub enum HistoryError {
    #[error("no steps were logged here yet; give the --out folder of a `harmzone train`: {}", path.display())]
    Nothing { path: PathBuf },
    #[error("{source}: {}", path.display())]
    Broken { source: csv::Error, path: PathBuf },
}

impl History {
    /// Reads a run's folder; a run that has not been validated has no scores.
    ///
    /// # Errors
    /// There is no log, or a file is not what training writes; the message names the line.
    pub fn read(run: &Path) -> Result<Self, HistoryError> {
        let steps = read_rows(&run.join(LOG_FILE))?;
        if steps.is_empty() {
            return Err(HistoryError::Nothing { path: run.to_owned() });
        }
        Ok(Self { steps, scores: read_rows(&run.join(VALIDATION_FILE))? })
    }
}

/// The rows of a file; none where there is no file.
fn read_rows<T: DeserializeOwned>(path: &Path) -> Result<Vec<T>, HistoryError> {
    if !path.exists() {
        return Ok(Vec::new());
    }
    let broken = |source| HistoryError::Broken { source, path: path.to_owned() };
    csv::Reader::from_path(path).map_err(broken)?.deserialize().collect::<Result<_, _>>().map_err(broken)
}

#[cfg(test)]
mod tests {
    use super::*;
    use fs_err as fs;

    #[test]
    fn a_folder_without_a_log_and_a_broken_row_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let message = || History::read(folder.path()).unwrap_err().to_string();
        assert!(message().contains("harmzone train"), "{}", message());
        let row = "1,lidar,0,2.0e-4,4.1,6.3,3.2,62.1";
        let log = format!("{}\n{row}\n2,lidar,0,fast,1,1,1,1\n", super::super::run::LOG_HEADER);
        fs::write(folder.path().join(LOG_FILE), &log).unwrap();
        assert!(message().contains("line: 3") && message().contains("log.csv"), "{}", message());
        fs::write(folder.path().join(LOG_FILE), log.replace("fast", "1e-3")).unwrap();
        let history = History::read(folder.path()).unwrap();
        assert_eq!((history.steps.len(), history.scores.len()), (2, 0));
        assert_eq!((history.steps[0].learning_rate, history.steps[1].n_done), (2e-4, 2));
    }
}
