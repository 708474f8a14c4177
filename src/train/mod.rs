//! Training: targets, losses, schedule, optimizer and the resumable loop.

mod assignment;
mod augment;
mod average;
pub mod bench;
mod cache;
mod config;
mod dry_run;
mod log;
mod losses;
mod optimizer;
mod plan;
mod run;
mod schedule;
mod state;
mod step;
mod targets;
#[cfg(test)]
mod twin_tests;
mod validate;

pub use config::{AugmentConfig, LossConfig, StageConfig, TrainConfig, TrainConfigError};
pub use dry_run::DryRun;
pub use losses::LossParts;
pub use run::{CHECKPOINT, RunOptions, Summary, TrainError, run};
