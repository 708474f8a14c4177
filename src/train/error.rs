//! Why a training run stopped.

use std::path::PathBuf;

use thiserror::Error;

use super::validate::ValidationError;
use crate::config::InvalidConfig;
use crate::dataset::DatasetError;
use crate::history::{HistoryError, SCORES_FILE};
use crate::model::checkpoint::CheckpointError;
use crate::model::{ImageWeightsError, InputError};
use crate::zone::ZoneError;

/// Why a run stopped.
#[derive(Debug, Error)]
pub enum TrainError {
    #[error(transparent)]
    Config(#[from] InvalidConfig),
    #[error("cannot write the run: {0}")]
    Io(#[from] std::io::Error),
    #[error(transparent)]
    ImageWeights(#[from] ImageWeightsError),
    #[error(transparent)]
    State(#[from] StateError),
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    #[error("cannot read the run's log: {0}")]
    History(#[from] HistoryError),
    #[error("the dataset has no training samples: {}", path.display())]
    NoSamples { path: PathBuf },
    #[error(
        "this folder holds a run with another config or other data; use another --out, or --force to \
         discard it: {}", path.display()
    )]
    OtherRun { path: PathBuf },
    #[error(
        "this network is not the run's, whose config names another; move it away, and the run goes on from its state: {}",
        path.display()
    )]
    OtherNetwork { path: PathBuf },
    #[error("this folder is not empty and holds no run; use another --out: {}", path.display())]
    NotARun { path: PathBuf },
    #[error("nothing to resume: no run in {}; leave --resume out to start one", path.display())]
    NothingToResume { path: PathBuf },
    #[error(
        "the run needs about {:.0} MiB ({held_mib:.0} are held, the data among them, and a step takes {step_mib:.0}), more than \
         --max-memory allows, {most_mib:.0} MiB: allow more, or make `batch_size`, `accumulate` or `stream.window_episodes` smaller",
        held_mib + step_mib
    )]
    TooLarge { held_mib: f64, step_mib: f64, most_mib: f64 },
    #[error(
        "the run has taken {peak_mib:.0} MiB, more than --max-memory allows, {most_mib:.0} MiB; its state is saved, and the same command \
         goes on with a larger --max-memory"
    )]
    Grown { peak_mib: f64, most_mib: f64 },
    #[error("sample {sample}: {source}")]
    Input { sample: String, source: InputError },
    #[error(
        "the pictures of samples {one} and {other} are {one_px} and {other_px} px high at the network's width, and a batch holds pictures of \
         one height: give --set batch_size=1, or train on the data of one camera"
    )]
    PictureHeights { one: String, one_px: usize, other: String, other_px: usize },
    #[error("sample {sample}: {source}")]
    Label { sample: String, source: ZoneError },
    #[error(transparent)]
    Data(#[from] DatasetError),
    #[error("validation failed: {0}")]
    Validation(#[from] ValidationError),
    #[error(
        "the loss became {found} at step {step} of the {stage} stage, on samples {samples:?}; the last saved \
         state stays: lower the learning rate or look at these samples"
    )]
    NotFinite { found: f32, step: usize, stage: &'static str, samples: Vec<String> },
}

/// Why a state could not be saved or loaded.
#[derive(Debug, Error)]
pub enum StateError {
    #[error("cannot write or read the run's state: {0}")]
    Io(#[from] std::io::Error),
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    #[error(transparent)]
    History(#[from] HistoryError),
    #[error(
        "the log, or `{SCORES_FILE}` beside it, was changed since the run's state was saved; put it back, or give --force to start \
         anew: {}", path.display()
    )]
    OtherLog { path: PathBuf },
    #[error("the run's state is broken: {message}; delete it to start anew: {}", path.display())]
    Broken { message: String, path: PathBuf },
}
