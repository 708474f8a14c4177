//! Harm labels: each annotated object of an episode is harmful or harmless by a danger zone; compares zones
//! too.

mod apply;
mod compare;
mod counts;
mod episode;
mod parts;
mod run;
pub mod worker;

pub use apply::SampleError;
pub use compare::{MOVING_MPS, ZoneComparison, ZoneCounts, compare};
pub use counts::{LabelSummary, count_of};
pub use run::{LabelOptions, run, run_with};
pub use worker::LabelWorkers;

use std::path::PathBuf;

use thiserror::Error;

use crate::episode::{EpisodeError, ManifestError};
use crate::zone::ZoneError;

/// Why a data set could not be labelled.
#[derive(Debug, Error)]
pub enum LabelError {
    #[error(transparent)]
    Zone(#[from] ZoneError),
    #[error(transparent)]
    Sample(#[from] SampleError),
    #[error(transparent)]
    Episode(#[from] EpisodeError),
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error("the label set's name is `{found}`; letters, digits, `-` and `_` are needed")]
    SetName { found: String },
    #[error("the data set holds no episode: {}", path.display())]
    NoEpisodes { path: PathBuf },
    #[error("episode `{episode}`: {message}")]
    Worker { episode: String, message: String },
    #[error("label set `{set}` was made with {what}; --force makes it anew, --labels NAME makes another: {}", path.display())]
    Other { set: String, what: &'static str, path: PathBuf },
    #[error(
        "nobody annotated these episodes, so there is nothing to label or score; `harmzone predict` and `harmzone view` \
         work without: {}",
        path.display()
    )]
    NoTruth { path: PathBuf },
}
