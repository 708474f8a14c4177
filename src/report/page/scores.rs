//! A folder of scores: what `harmzone eval --out` leaves, and the report reads.

use std::io;
use std::path::{Path, PathBuf};

use fs_err as fs;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::config::to_toml;
use crate::dataset::Fingerprint;
use crate::eval::sweep::Sweeps;
use crate::eval::{Evaluation, Fault, Protocol};
use crate::files::write_atomic;
use crate::report;

/// Everything that was found out.
pub const METRICS_FILE: &str = "metrics.json";
/// The resolved config of the scoring.
pub const CONFIG_FILE: &str = "eval.toml";
/// Where the scores come from, a [`Source`].
pub const SOURCE_FILE: &str = "source.json";
/// The worst misses and false alarms, a list of [`Fault`].
pub const FAULTS_FILE: &str = "faults.json";
/// For people: the table beside the paper's, and scores by group.
const TABLE_FILE: &str = "table.txt";
const BREAKDOWN_FILE: &str = "breakdown.txt";
/// Speed and steering swept over the same frames; `harmzone sweep --out` writes it.
pub const SWEEPS_FILE: &str = "sweeps.json";

/// Where scores come from.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Source {
    /// Of harmzone.
    pub version: String,
    /// As it was typed.
    pub command: String,
    /// The data set, as it was named.
    pub data: Option<PathBuf>,
    pub labels: Option<String>,
    /// Of the data set and its labels.
    pub fingerprint: Option<Fingerprint>,
    /// Of the network's file.
    pub checkpoint_sha256: Option<String>,
    /// The resolved config of the detector.
    pub model_toml: Option<String>,
    /// The resolved config of its training.
    pub train_toml: Option<String>,
}

/// Why scores could not be read.
#[derive(Debug, Error)]
pub enum ScoresError {
    #[error("no scores, `{METRICS_FILE}` is missing; `harmzone eval RUN --data DIR --out {}` makes them: {}", path.display(), path.display())]
    NoMetrics { path: PathBuf },
    #[error("not a file that `harmzone eval --out` writes: {message}: {}", path.display())]
    Broken { message: String, path: PathBuf },
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// What a folder of scores holds; all but the metrics may be missing.
#[derive(Debug, Clone, PartialEq)]
pub struct Scores {
    pub folder: PathBuf,
    pub evaluation: Evaluation,
    pub config_toml: Option<String>,
    pub source: Option<Source>,
    pub faults: Option<Vec<Fault>>,
    pub sweeps: Option<Sweeps>,
}

impl Scores {
    /// Reads a folder.
    ///
    /// # Errors
    /// There are no metrics, or a file is broken.
    pub fn read(folder: &Path) -> Result<Self, ScoresError> {
        let evaluation = read_json(&folder.join(METRICS_FILE))?;
        let config = folder.join(CONFIG_FILE);
        Ok(Self {
            folder: folder.to_owned(),
            evaluation: evaluation.ok_or_else(|| ScoresError::NoMetrics { path: folder.to_owned() })?,
            config_toml: if config.is_file() { Some(fs::read_to_string(config)?) } else { None },
            source: read_json(&folder.join(SOURCE_FILE))?,
            faults: read_json(&folder.join(FAULTS_FILE))?,
            sweeps: read_json(&folder.join(SWEEPS_FILE))?,
        })
    }
}

/// Writes a folder of scores, all but the sweeps; the metrics come last, their presence says that all is there.
///
/// # Errors
/// The folder cannot be written.
pub fn write(
    folder: &Path,
    protocol: &Protocol,
    evaluation: &Evaluation,
    faults: &[Fault],
    source: &Source,
) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    let metrics = folder.join(METRICS_FILE);
    if metrics.exists() {
        fs::remove_file(&metrics)?;
    }
    let config = format!("# harmzone {}, harmzone eval\n{}", source.version, to_toml(protocol.config()));
    write_atomic(&folder.join(CONFIG_FILE), config.as_bytes())?;
    write_atomic(&folder.join(TABLE_FILE), report::table(&evaluation.metrics).as_bytes())?;
    write_atomic(&folder.join(BREAKDOWN_FILE), report::breakdown(evaluation).as_bytes())?;
    write_atomic(&folder.join(FAULTS_FILE), &serde_json::to_vec(faults)?)?;
    write_atomic(&folder.join(SOURCE_FILE), &serde_json::to_vec_pretty(source)?)?;
    write_atomic(&metrics, evaluation.to_json().as_bytes())
}

/// `None` where there is no such file.
fn read_json<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, ScoresError> {
    if !path.is_file() {
        return Ok(None);
    }
    let broken =
        |error: serde_json::Error| ScoresError::Broken { message: error.to_string(), path: path.to_owned() };
    serde_json::from_str(&fs::read_to_string(path)?).map(Some).map_err(broken)
}

/// Words of a command, with quotes where a shell needs them.
#[must_use]
pub fn quote(words: impl IntoIterator<Item = impl AsRef<str>>) -> String {
    // `shlex` also quotes `=`, `,` and `%`, which mean nothing inside a word: `key=value` reads better bare.
    let is_bare = |c: char| c.is_ascii_alphanumeric() || "_-./=:,+@%".contains(c);
    let quoted = words.into_iter().map(|word| match word.as_ref() {
        word if !word.is_empty() && word.chars().all(is_bare) => word.to_owned(),
        word => shlex::Quoter::new().allow_nul(true).quote(word).expect("NUL is allowed").into_owned(),
    });
    quoted.collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_without_metrics_or_with_broken_ones_is_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let message = Scores::read(folder.path()).unwrap_err().to_string();
        assert!(message.contains("harmzone eval") && message.contains("metrics.json"), "{message}");
        fs::write(folder.path().join(METRICS_FILE), "{}").unwrap();
        let message = Scores::read(folder.path()).unwrap_err().to_string();
        assert!(message.contains("missing field") && message.ends_with(METRICS_FILE), "{message}");
    }

    #[test]
    fn a_command_is_quoted_where_a_shell_needs_it() {
        let words = ["harmzone", "eval", "a b", "it's", "--set", "max_range_m=30", "dist_m=[1, 2]", ""];
        assert_eq!(quote(words), r#"harmzone eval 'a b' "it's" --set max_range_m=30 'dist_m=[1, 2]' ''"#);
    }
}
