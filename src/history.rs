//! The course of a training run: `log.csv` and `validation.csv` in its folder, written and read.

use std::fmt::{Display, LowerExp};
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize, Serializer};
use thiserror::Error;

use crate::files::{is_file, sha256_hex, write_atomic};

/// Name of the file with a row for each step.
pub const STEPS_FILE: &str = "log.csv";
/// Name of the file with a row for each validation.
pub const SCORES_FILE: &str = "validation.csv";
/// Names of the files in which both are drawn.
pub const CURVE_FILES: [&str; 2] = ["curves.svg", "curves.png"];

/// A row of `log.csv`: one step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepRow {
    /// Steps of all stages, this one included.
    pub n_done: usize,
    /// `lidar` or `fused`.
    pub stage: String,
    /// Epoch of the stage, from 0.
    pub epoch: usize,
    #[serde(serialize_with = "scientific")]
    pub learning_rate: f64,
    /// This part of the loss, weighted; the next two are the other parts.
    #[serde(serialize_with = "decimals::<5, _, _>")]
    pub heatmap: f64,
    #[serde(serialize_with = "decimals::<5, _, _>")]
    pub harm: f64,
    #[serde(serialize_with = "decimals::<5, _, _>")]
    pub boxes: f64,
    #[serde(serialize_with = "decimals::<5, _, _>", default)]
    pub picture: f64,
    /// Norm of all gradients together before clipping.
    #[serde(serialize_with = "decimals::<3, _, _>")]
    pub gradient_norm: f64,
}

/// A row of `validation.csv`: AP after an epoch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ScoreRow {
    pub n_done: usize,
    pub stage: String,
    pub epoch: usize,
    /// `None`, an empty cell, where the split has no truth of the class.
    #[serde(serialize_with = "decimals_if_known::<4, _, _>")]
    pub harmful: Option<f64>,
    #[serde(serialize_with = "decimals_if_known::<4, _, _>")]
    pub harmless: Option<f64>,
    #[serde(serialize_with = "decimals_if_known::<4, _, _>")]
    pub mean: Option<f64>,
}

fn decimals<const N: usize, T: Display, S: Serializer>(value: &T, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&format_args!("{value:.N$}"))
}

#[expect(clippy::ref_option, reason = "serde hands over a reference to the field")]
fn decimals_if_known<const N: usize, T: Display, S: Serializer>(
    value: &Option<T>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    match value {
        Some(value) => decimals::<N, T, S>(value, serializer),
        None => serializer.serialize_none(),
    }
}

fn scientific<T: LowerExp, S: Serializer>(value: &T, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&format_args!("{value:.3e}"))
}

/// The course of a run, finished or under way.
#[derive(Debug, Clone, PartialEq)]
pub struct History {
    pub steps: Vec<StepRow>,
    pub scores: Vec<ScoreRow>,
}

/// Why the course of a run could not be read.
#[derive(Debug, Error)]
pub enum HistoryError {
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error("no steps were logged here yet; give the --out folder of a `harmzone train`: {}", path.display())]
    Nothing { path: PathBuf },
    #[error(
        "the log has no row of step {step}, though the state stands behind step {n_done}; put the log back, or give --force to \
         start anew: {}", path.display()
    )]
    Gap { step: usize, n_done: usize, path: PathBuf },
    #[error("{source}: {}", path.display())]
    Broken { source: csv::Error, path: PathBuf },
}

impl History {
    /// Reads the folder of a run that has taken at least one step; a run that has not been validated has no scores.
    ///
    /// # Errors
    /// There is no log, or training did not write a file; the message names the line.
    pub fn read(run: &Path) -> Result<Self, HistoryError> {
        let history = Self::read_until(run, usize::MAX)?;
        if history.steps.is_empty() {
            return Err(HistoryError::Nothing { path: run.to_owned() });
        }
        Ok(history)
    }

    /// As [`Self::read_until`], for a run that goes on and must have them all.
    ///
    /// # Errors
    /// As [`Self::read_until`]; a row is missing.
    pub fn read_whole(run: &Path, n_done: usize) -> Result<Self, HistoryError> {
        let history = Self::read_until(run, n_done)?;
        let mut rows = history.steps.iter().map(|row| row.n_done);
        match (1..=n_done).find(|step| rows.next() != Some(*step)) {
            Some(step) => Err(HistoryError::Gap { step, n_done, path: run.join(STEPS_FILE) }),
            None => Ok(history),
        }
    }

    /// Reads the rows of the first `n_done` steps; empty if there is no log.
    ///
    /// # Errors
    /// Training did not write a file; the message names the line.
    pub fn read_until(run: &Path, n_done: usize) -> Result<Self, HistoryError> {
        let mut steps: Vec<StepRow> = read_rows(&run.join(STEPS_FILE))?;
        let mut scores: Vec<ScoreRow> = read_rows(&run.join(SCORES_FILE))?;
        steps.retain(|row| row.n_done <= n_done);
        scores.retain(|row| row.n_done <= n_done);
        Ok(Self { steps, scores })
    }

    /// The hash of both files as they are written.
    #[must_use]
    pub fn sha256(&self) -> String {
        sha256_hex(&[to_csv(&self.steps), to_csv(&self.scores)].concat())
    }

    /// Writes both files, each whole or not at all; without rows there is no file.
    ///
    /// # Errors
    /// Any IO error.
    pub fn write(&self, run: &Path) -> std::io::Result<()> {
        write_rows(&run.join(STEPS_FILE), &self.steps)?;
        write_rows(&run.join(SCORES_FILE), &self.scores)
    }
}

/// The rows of a file; empty if there is no file.
fn read_rows<T: DeserializeOwned>(path: &Path) -> Result<Vec<T>, HistoryError> {
    if !is_file(path)? {
        return Ok(Vec::new());
    }
    let broken = |source| HistoryError::Broken { source, path: path.to_owned() };
    // Whole first: `csv` takes an error of the disk while it reads the header for the end of the file.
    let bytes = fs_err::read(path)?;
    csv::Reader::from_reader(bytes.as_slice()).deserialize().collect::<Result<_, _>>().map_err(broken)
}

fn write_rows<T: Serialize>(path: &Path, rows: &[T]) -> std::io::Result<()> {
    if rows.is_empty() {
        return Ok(());
    }
    write_atomic(path, &to_csv(rows))
}

fn to_csv<T: Serialize>(rows: &[T]) -> Vec<u8> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row).expect("a row of numbers and a name has a CSV form");
    }
    writer.into_inner().expect("a vector takes all that is written")
}

#[cfg(test)]
mod tests {
    use super::*;
    use fs_err as fs;

    const HEADER: &str = "n_done,stage,epoch,learning_rate,heatmap,harm,boxes,picture,gradient_norm";

    #[test]
    fn an_error_of_the_disk_is_told_and_is_no_empty_log() {
        let folder = tempfile::tempdir().unwrap();
        // Its first byte cannot be read: EIO.
        std::os::unix::fs::symlink("/proc/self/mem", folder.path().join(STEPS_FILE)).unwrap();
        let error = History::read(folder.path()).unwrap_err();
        assert!(matches!(error, HistoryError::Io(_)) && error.to_string().contains(STEPS_FILE), "{error}");
    }

    #[test]
    fn a_folder_without_a_log_and_a_broken_row_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let message = || History::read(folder.path()).unwrap_err().to_string();
        assert!(message().contains("harmzone train"), "{}", message());
        let row = "1,lidar,0,2.0e-4,4.1,6.3,3.2,0.2,62.1";
        fs::write(folder.path().join(STEPS_FILE), format!("{HEADER}\n{row}\n2,lidar,0,fast,1,1,1,1,1\n"))
            .unwrap();
        assert!(message().contains("line: 3") && message().contains("log.csv"), "{}", message());
    }

    #[test]
    fn rows_cut_back_to_a_step_are_written_with_the_same_digits() {
        let folder = tempfile::tempdir().unwrap();
        let first = format!("{HEADER}\n1,lidar,0,2.000e-4,4.10000,6.30001,3.20000,0.10000,62.100\n");
        let path = folder.path().join(STEPS_FILE);
        fs::write(&path, format!("{first}2,lidar,0,1.000e-3,1.00000,1.00000,1.00000,0.00000,1.000\n"))
            .unwrap();
        let history = History::read_whole(folder.path(), 1).unwrap();
        let told = History::read_whole(folder.path(), 3).unwrap_err().to_string();
        assert!(told.contains("no row of step 3"), "{told}");
        assert_eq!((history.steps.len(), history.scores.len()), (1, 0));
        assert_eq!((history.steps[0].learning_rate, history.steps[0].harm), (2e-4, 6.30001));
        history.write(folder.path()).unwrap();
        assert_eq!(fs::read_to_string(path).unwrap(), first);
        assert!(!folder.path().join(SCORES_FILE).exists());
    }
}
