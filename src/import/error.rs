//! Why a log could not be imported; each error ends with the path.

use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::config::InvalidConfig;
use crate::episode::{EpisodeError, ManifestError};

/// Why a log could not be imported.
#[derive(Debug, Error)]
pub enum ImportError {
    #[error(transparent)]
    Config(#[from] InvalidConfig),
    #[error(transparent)]
    Episode(#[from] EpisodeError),
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// A file of the log is missing, torn or not valid.
    #[error("{message}: {}", path.display())]
    Source { message: String, path: PathBuf },
    #[error("drive `{drive}`, sample {sample_idx}: {source}")]
    Sample { drive: String, sample_idx: usize, source: Box<ImportError> },
    #[error("the log has no drive `{found}`; it has {}", shorten(valid))]
    NoDrive { found: String, valid: Vec<String> },
    #[error("two drives of the log have the name `{name}`; import the folders that hold them one at a time")]
    TwoDrives { name: String },
    #[error(
        "the folder has a drive `{name}` of another log: it was recorded from {found_ns} ns on, this log's from {wanted_ns} ns on; \
         give a new folder, or --force to replace that drive: {}", path.display()
    )]
    OtherDrive { name: String, found_ns: u64, wanted_ns: u64, path: PathBuf },
    #[error("the log holds no drive: {}", path.display())]
    NoDrives { path: PathBuf },
    #[error("the folder holds other things than an imported data set; give a new folder: {}", path.display())]
    ForeignFolder { path: PathBuf },
    #[error(
        "the folder holds a data set that was imported with another {what} (found {found}, wanted {wanted}); give a new \
         folder, or --force to replace its episodes: {}", path.display()
    )]
    OtherData { what: &'static str, found: String, wanted: String, path: PathBuf },
}

impl ImportError {
    /// A fault of a log's file: what was found and what would be right.
    pub fn at(path: &Path, message: impl Into<String>) -> Self {
        Self::Source { message: message.into(), path: path.to_owned() }
    }

    /// Whether it lies in the log's data, so that `--skip-bad` may pass over it.
    #[must_use]
    pub fn is_bad_data(&self) -> bool {
        match self {
            Self::Source { .. } => true,
            Self::Sample { source, .. } => source.is_bad_data(),
            // A sample that a reader of episodes would refuse.
            Self::Episode(error) => matches!(error, EpisodeError::Invalid { .. }),
            _ => false,
        }
    }
}

/// Reads a file of a log; what cannot be read is a fault of the log.
///
/// # Errors
/// [`ImportError::Source`].
pub(super) fn read(path: &Path) -> Result<Vec<u8>, ImportError> {
    fs_err::read(path).map_err(|error| told(path, &error))
}

/// As [`read`], for text.
///
/// # Errors
/// [`ImportError::Source`].
pub(super) fn read_text(path: &Path) -> Result<String, ImportError> {
    fs_err::read_to_string(path).map_err(|error| told(path, &error))
}

fn told(path: &Path, error: &std::io::Error) -> ImportError {
    let message = match error.kind() {
        std::io::ErrorKind::NotFound => "the log's file is missing".to_owned(),
        std::io::ErrorKind::InvalidData => "the file is no UTF-8 text".to_owned(),
        kind => format!("the log's file cannot be read ({kind})"),
    };
    ImportError::at(path, message)
}

fn shorten(names: &[String]) -> String {
    let told = names.iter().take(8).map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    if names.len() > 8 { format!("{told}, .. ({} drives)", names.len()) } else { told }
}
