//! Predictions of other tools to ours, and ours to theirs: one file a format.
//!
//! Others speak of samples by names of their own and of boxes in frames of their own; [`NamedSample`] has what a format needs to
//! translate both.

mod error;
mod export;
mod import;
pub mod kitti;
pub mod nuscenes;
mod samples;

pub use error::ExchangeError;
pub use export::{ExportPredictions, WriteBoxes, export_predictions};
pub use import::{
    ForeignBox, HarmRule, ImportPredictions, ImportedPredictions, ReadBoxes, import_predictions,
};
pub use samples::{NamedSample, NamedSamples};
