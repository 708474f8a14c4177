//! Why a scene cannot be made.

use std::path::PathBuf;

use thiserror::Error;

/// Why a scene could not be made.
#[derive(Debug, Error)]
pub enum SceneError {
    #[error("no town `{name}`; there are {found:?}, or give the path of a .xodr file")]
    UnknownTown { name: String, found: Vec<String> },
    #[error("cannot read the town: {0}")]
    Read(#[from] std::io::Error),
    #[error("not a usable description of a town: {message}: {}", path.display())]
    TownConfig { message: String, path: PathBuf },
    #[error("not a usable OpenDRIVE map: {message}: {}", path.display())]
    OpenDrive { message: String, path: PathBuf },
    #[error("the map has no lane that can be driven: {}", path.display())]
    NoLanes { path: PathBuf },
    #[error("not a usable object model: {message}: {}", path.display())]
    Model { message: String, path: PathBuf },
    #[error("the actor `{actor}` is a `{model}`, and no model or category is called so; there are {}", found.join(", "))]
    UnknownModel { actor: String, model: String, found: Vec<String> },
    #[error(
        "the actor `{actor}` stands {ahead_m} m ahead of the ego (ahead_m), whose route ends after {end_m:.0} m"
    )]
    ActorOffRoute { actor: String, ahead_m: f64, end_m: f64 },
    #[error("the actor `{actor}` stands within {with}; another ahead_m or left_m is needed")]
    ActorWithin { actor: String, with: String },
    #[error("the town `{town}` has no place where the ego could start")]
    NoStart { town: String },
}
