//! Training: targets, losses, schedule, optimizer and the resumable loop.

mod augment;
mod config;
mod losses;
mod optimizer;
mod run;
mod schedule;
mod state;
mod targets;

pub use config::{AugmentConfig, LossConfig, StageConfig, TrainConfig, TrainConfigError};
pub use losses::LossParts;
pub use run::{CHECKPOINT, RunOptions, Summary, TrainError, run};
