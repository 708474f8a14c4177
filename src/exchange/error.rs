//! Why predictions could not be exchanged; each error ends with the path.

use std::path::PathBuf;

use thiserror::Error;

use crate::dataset::DatasetError;
use crate::episode::{EpisodeError, ManifestError};
use crate::eval::json::JsonError;
use crate::export::ExportError;
use crate::files::FolderError;
use crate::infer::PredictionsError;
use crate::zone::ZoneError;

/// Why predictions could not be imported or exported.
#[derive(Debug, Error)]
pub enum ExchangeError {
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    #[error(transparent)]
    Episode(#[from] EpisodeError),
    #[error(transparent)]
    Export(#[from] ExportError),
    #[error(transparent)]
    Predictions(#[from] PredictionsError),
    #[error(transparent)]
    Json(#[from] JsonError),
    #[error(transparent)]
    Folder(#[from] FolderError),
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error("there is something already; give --force to replace it: {}", path.display())]
    Exists { path: PathBuf },
    #[error("{message}: {}", path.display())]
    Foreign { message: String, path: PathBuf },
    #[error("box {index}: {message}: sample `{sample}`: {}", path.display())]
    BadBox { message: String, index: usize, sample: String, path: PathBuf },
    #[error("no list of boxes for {n_missing} samples of the split, the first is `{sample}`; an empty list is needed where there is nothing: {}", path.display())]
    MissingSamples { n_missing: usize, sample: String, path: PathBuf },
    #[error("box {index} of sample `{sample}` has no harm: {source}")]
    Zone { index: usize, sample: String, source: ZoneError },
    #[error("box {index} of sample `{sample}` is named `{found}`; {wanted}: {}", path.display())]
    Name { index: usize, sample: String, found: String, wanted: &'static str, path: PathBuf },
}
