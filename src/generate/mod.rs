//! Generation: simulates drives through a town and records them, episode by episode.
//!
//! [`run()`] makes a data set with several worker processes; [`episode::record`] makes one episode. The
//! same seed and config give the same bytes, whatever the number of processes.

mod annotate;
mod aov;
mod appearance;
mod config;
mod drive;
pub mod episode;
mod folder;
mod leaves;
mod lighting;
mod live;
mod map;
mod merge;
#[cfg(test)]
mod merge_tests;
#[cfg(test)]
mod people_tests;
#[cfg(test)]
mod placement_tests;
mod plan;
pub mod preset;
#[cfg(test)]
mod projection_tests;
mod rays;
mod run;
mod sensing;
mod surfaces;
#[cfg(test)]
mod surround_tests;
mod timings;
mod towns;
mod upright;
#[cfg(test)]
mod variation_tests;
pub mod worker;

use std::path::PathBuf;

use thiserror::Error;

pub use aov::lacking_pictures;
pub use config::{
    ALL, AnnotationConfig, CONTROL_PERIOD_S, CheckedConfig, GenerateConfig, LidarEngine, RenderConfig,
    RendererName,
};
pub use live::{Contact, LiveEpisode};
pub use merge::{MergeError, MergeSummary, merge};
pub use plan::{EpisodePlan, plan};
pub use preset::Preset;
pub use run::{Extent, GenerateSummary, RunOptions, run};
pub use timings::Timings;

use crate::config::InvalidConfig;
use crate::episode::{EpisodeError, MAX_EPISODES, ManifestError};
use crate::scene::SceneError;
use crate::sensors::UnknownWeather;
use crate::sim::SimError;

/// Why a data set could not be made.
#[derive(Debug, Error)]
pub enum GenerateError {
    #[error(transparent)]
    Config(#[from] InvalidConfig),
    #[error(transparent)]
    Weather(#[from] UnknownWeather),
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error(transparent)]
    Simulation(#[from] SimError),
    #[error("{n_episodes} episodes are asked for; a data set has {MAX_EPISODES} at most")]
    TooMany { n_episodes: u32 },
    #[error("the scene has no {what} `{name}`")]
    Missing { what: &'static str, name: String },
    #[error("cannot pack the camera image: {0}")]
    Jpeg(#[from] jpeg_encoder::EncodingError),
    #[error(transparent)]
    Episode(#[from] EpisodeError),
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error("the folder holds other things than a data set; give a new folder: {}", path.display())]
    ForeignFolder { path: PathBuf },
    #[error(
        "the folder holds a data set of another {what} (found {found}, wanted {wanted}); give a new folder, \
         or --force to replace its episodes: {}", path.display()
    )]
    OtherData { what: &'static str, found: String, wanted: String, path: PathBuf },
    #[error("two runs of the same episodes differ: {}", path.display())]
    RunsDiffer { path: PathBuf },
    #[error("episode `{episode}`: {message}")]
    Worker { episode: String, message: String },
}
