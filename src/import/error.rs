//! Why a log could not be imported; each error ends with the path.

use std::io::ErrorKind;
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
    #[error(
        "the folder has a drive `{name}` of another log: its first cloud is another one; give a new folder, or --force to replace that \
         drive: {}", path.display()
    )]
    OtherCloud { name: String, path: PathBuf },
    #[error("the log holds no drive: {}", path.display())]
    NoDrives { path: PathBuf },
    #[error(
        "the import kept no sample of its {n_drives} drives, and --skip-bad left out {n_skipped} parts; a sample needs a cloud that can be read, \
         and annotations where its drive has some: {}", path.display()
    )]
    NoEpisodes { n_drives: usize, n_skipped: usize, path: PathBuf },
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

/// Reads a file of a log.
///
/// # Errors
/// [`ImportError::Source`] where it is missing; else [`ImportError::Io`].
pub(super) fn read(path: &Path) -> Result<Vec<u8>, ImportError> {
    fs_err::read(path).map_err(|error| told(path, error))
}

/// As [`read`], for text.
///
/// # Errors
/// As [`read`]; what is no UTF-8 is a fault of the log.
pub(super) fn read_text(path: &Path) -> Result<String, ImportError> {
    fs_err::read_to_string(path).map_err(|error| told(path, error))
}

/// What is missing or no text is a fault of the log; a disk that fails is none, and may hold the data still.
pub(super) fn told(path: &Path, error: std::io::Error) -> ImportError {
    match error.kind() {
        ErrorKind::NotFound | ErrorKind::NotADirectory => ImportError::at(path, "the log's file is missing"),
        ErrorKind::InvalidData => ImportError::at(path, "the file is no UTF-8 text"),
        ErrorKind::IsADirectory => ImportError::at(path, "the log has a folder where a file is needed"),
        _ => ImportError::Io(error),
    }
}

/// What lies in a folder of a log, sorted; nothing where there is no such folder.
///
/// # Errors
/// It cannot be read.
pub(super) fn listed(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let entries = match fs_err::read_dir(folder) {
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
            return Ok(Vec::new());
        }
        entries => entries?,
    };
    let mut paths = entries.map(|entry| entry.map(|entry| entry.path())).collect::<Result<Vec<_>, _>>()?;
    paths.sort();
    Ok(paths)
}

fn shorten(names: &[String]) -> String {
    let told = names.iter().take(8).map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    if names.len() > 8 { format!("{told}, .. ({} drives)", names.len()) } else { told }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disk_that_fails_is_no_fault_of_the_log() {
        let path = Path::new("log/cloud.bin");
        let of = |kind: ErrorKind| told(path, kind.into());
        assert!(of(ErrorKind::NotFound).is_bad_data() && of(ErrorKind::InvalidData).is_bad_data());
        for kind in [ErrorKind::PermissionDenied, ErrorKind::Other, ErrorKind::StaleNetworkFileHandle] {
            assert!(!of(kind).is_bad_data(), "{kind}");
        }
    }

    #[test]
    fn a_folder_that_is_not_there_lists_nothing() {
        let folder = tempfile::tempdir().unwrap();
        assert!(listed(&folder.path().join("absent")).unwrap().is_empty());
        for name in ["b", "a"] {
            fs_err::write(folder.path().join(name), "").unwrap();
        }
        assert_eq!(listed(folder.path()).unwrap(), ["a", "b"].map(|name| folder.path().join(name)));
    }
}
