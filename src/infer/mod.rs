//! Runs a trained network over a data set: what `predict`, `eval`, `sweep` and `baseline` share.

mod closed_set;
mod parts;
mod predict;
mod predictions;
mod recorded;
mod sweep;
mod trained;
pub mod worker;

pub use closed_set::{ClosedSet, ClosedSetError, Strangeness};
pub use parts::{JoinError, JoinSummary, PredictedEpisode, PredictionPart, join};
pub use predict::{
    PredictError, detect, detect_for, detect_kinds, predict, predict_for, predict_kinds, predict_states,
};
pub use predictions::{Predictions, PredictionsError};
pub use recorded::{RecordedError, predict_recording};
pub use sweep::{SweepRunError, sweep};
pub use trained::{CheckpointFile, Trained, TrainedError};
