//! A folder of scores, which `harmzone eval --out` writes and the report reads.

use std::borrow::Cow;
use std::io;
use std::path::{Path, PathBuf};

use fs_err as fs;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::provenance::Provenance;
use super::score_tables;
use crate::config::to_toml;
use crate::eval::sweep::Sweeps;
use crate::eval::{Evaluation, Fault, Protocol};
use crate::files::{self, read_sealed, seal_result, write_atomic, write_sealed};

/// The whole evaluation.
pub const METRICS_FILE: &str = "metrics.json";
/// The resolved config of the scoring.
pub const CONFIG_FILE: &str = "eval.toml";
/// Where the scores come from, a [`Provenance`].
pub const PROVENANCE_FILE: &str = "source.json";
/// The worst misses and false alarms: [`Fault`]s under the key `faults`.
pub const FAULTS_FILE: &str = "faults.json";
/// For readers: the table beside the paper's, and scores by group.
const TABLE_FILE: &str = "table.txt";
const BREAKDOWN_FILE: &str = "breakdown.txt";
/// Speed and steering swept over the same frames; `harmzone sweep --out` writes it.
pub const SWEEPS_FILE: &str = "sweeps.json";

/// Why scores could not be read.
#[derive(Debug, Error)]
pub enum ScoresError {
    #[error("no scores, `{METRICS_FILE}` is missing; `harmzone eval RUN --data DIR --out {}` makes them: {}", path.display(), path.display())]
    NoMetrics { path: PathBuf },
    #[error("not a file that this version's `harmzone eval --out` writes, which makes it anew: {message}: {}", path.display())]
    Broken { message: String, path: PathBuf },
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// The content of `faults.json`.
#[derive(Serialize, Deserialize)]
struct FaultList<'a> {
    faults: Cow<'a, [Fault]>,
}

/// `faults.json` as it is, and as it was before it had a hash and a version.
#[derive(Deserialize)]
#[serde(untagged)]
enum FaultsFile {
    Sealed(FaultList<'static>),
    Bare(Vec<Fault>),
}

impl FaultsFile {
    fn into_list(self) -> Vec<Fault> {
        match self {
            Self::Sealed(list) => list.faults.into_owned(),
            Self::Bare(faults) => faults,
        }
    }
}

/// The content of a folder of scores; all but the metrics may be missing.
#[derive(Debug, Clone, PartialEq)]
pub struct Scores {
    pub folder: PathBuf,
    pub evaluation: Evaluation,
    pub config_toml: Option<String>,
    pub provenance: Option<Provenance>,
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
            config_toml: if files::is_file(&config)? { Some(fs::read_to_string(config)?) } else { None },
            provenance: read_json(&folder.join(PROVENANCE_FILE))?,
            faults: read_json(&folder.join(FAULTS_FILE))?.map(FaultsFile::into_list),
            sweeps: read_json(&folder.join(SWEEPS_FILE))?,
        })
    }
}

/// Writes a folder of scores, all but the sweeps; the metrics come last, so their presence means that all is
/// there.
///
/// # Errors
/// The folder cannot be written.
pub fn write(
    folder: &Path,
    protocol: &Protocol,
    evaluation: &Evaluation,
    provenance: &Provenance,
) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    let metrics = folder.join(METRICS_FILE);
    files::remove_if_there(&metrics)?;
    let config = format!("# harmzone {}, harmzone eval\n{}", provenance.version, to_toml(protocol.config()));
    write_atomic(&folder.join(CONFIG_FILE), config.as_bytes())?;
    let table = score_tables::with_standing(evaluation, provenance.standing());
    write_atomic(&folder.join(TABLE_FILE), table.as_bytes())?;
    write_atomic(&folder.join(BREAKDOWN_FILE), score_tables::breakdown(evaluation).as_bytes())?;
    write_sealed(&folder.join(FAULTS_FILE), &FaultList { faults: Cow::Borrowed(&evaluation.faults) })?;
    write_sealed(&folder.join(PROVENANCE_FILE), provenance)?;
    write_atomic(&metrics, seal_result(&evaluation.to_json()).as_bytes())
}

/// `None` if there is no such file.
fn read_json<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, ScoresError> {
    if !files::is_file(path)? {
        return Ok(None);
    }
    let broken =
        |error: serde_json::Error| ScoresError::Broken { message: error.to_string(), path: path.to_owned() };
    serde_json::from_str(&read_sealed(path)?).map(Some).map_err(broken)
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
}
