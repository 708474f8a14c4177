//! The closed loop: the ego drives its route on perception alone, and physics decides what comes of it.
//!
//! A driver under test knows the route and its target speed; what it knows of objects are the boxes of a detector, of the truth
//! or of nobody ([`crate::outcome::Source`]). Harmful boxes brake ([`reflex::Reflex`]); a contact of the ego with anything but the ground is a
//! collision. Every driver meets the same worlds, by seed. docs/drive.md has the rules and the figures.

mod config;
mod episode;
mod external;
mod folder;
mod foresight;
mod hazards;
mod notes;
mod origin;
mod perception;
mod recorder;
mod reflex;
mod rest;
mod route_ahead;
mod run;
mod scenario;
mod strip;
mod tracks;
pub mod worker;

use std::path::PathBuf;

use thiserror::Error;

pub use config::{DriveConfig, HARD_BRAKING_MPS2, ReflexConfig};
pub use external::{External, ExternalError};
pub use reflex::Reflex;
pub use run::{Courses, DriveOptions, RecordedDrives, run};
pub use scenario::{SUITE, Scenario, ScenarioError, load as load_scenarios};

use crate::config::InvalidConfig;
use crate::device::DeviceError;
use crate::episode::{EpisodeError, ManifestError};
use crate::generate::GenerateError;
use crate::infer::{PredictError, TrainedError};
use crate::zone::ZoneError;

/// Why a drive could not be made.
#[derive(Debug, Error)]
pub enum DriveError {
    #[error(transparent)]
    Config(#[from] InvalidConfig),
    #[error(transparent)]
    Generate(#[from] GenerateError),
    #[error(transparent)]
    Episode(#[from] EpisodeError),
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    #[error(transparent)]
    Trained(#[from] TrainedError),
    #[error(transparent)]
    Predict(#[from] PredictError),
    #[error(transparent)]
    Device(#[from] DeviceError),
    #[error(transparent)]
    Zone(#[from] ZoneError),
    #[error(transparent)]
    Label(#[from] crate::label::LabelError),
    #[error(transparent)]
    Scenario(ScenarioError),
    #[error(transparent)]
    External(ExternalError),
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error(
        "{name}: the network tells kinds of objects, not harm (model.head.classes = \"kind\"); a rule over its boxes can drive, \
         such as `zone-expected:RUN`"
    )]
    TellsKinds { name: String },
    #[error("{name}: `{judge}` cannot judge its boxes where zone.kind is `{kind}`: {source}")]
    NoJudge { name: String, judge: &'static str, kind: &'static str, source: ZoneError },
    #[error("{name}: split test reports once, and {message}")]
    NoScore { name: String, message: String },
    /// In these words a worker knows it.
    #[error("out of memory: {message}")]
    OutOfMemory { message: String },
    #[error("two drivers are called `{name}`; give one another name, NAME=..")]
    SameName { name: String },
    #[error("the folder holds other things than drives; give a new folder: {}", path.display())]
    ForeignFolder { path: PathBuf },
    #[error("the folder holds drives of another config (found {found}, wanted {wanted}); give a new folder: {}", path.display())]
    OtherConfig { found: String, wanted: String, path: PathBuf },
    #[error("not what a drive writes: {message}: {}", path.display())]
    BadOutcome { message: String, path: PathBuf },
    #[error("episode `{episode}`: {message}")]
    Worker { episode: String, message: String },
}
