//! Training: targets, losses, schedule, optimizer and the resumable loop.

mod assignment;
mod augment;
mod average;
pub mod bench;
mod cache;
mod config;
mod dry_run;
mod folder;
mod history;
mod log;
mod losses;
mod optimizer;
mod paste;
mod plan;
mod replica;
mod run;
mod schedule;
mod spent;
mod state;
mod step;
mod targets;
#[cfg(test)]
mod twin_tests;
mod validate;

pub use config::{AugmentConfig, LossConfig, StageConfig, TrainConfig, TrainConfigError};
pub use dry_run::DryRun;
pub use folder::{CHECKPOINT, CONFIG_FILE, DATA_FILE};
pub use history::{History, HistoryError, ScoreRow, StepRow};
pub use losses::LossParts;
pub use run::{RunOptions, Summary, TrainError, run};
pub use schedule::{Pace, Schedule};
pub use spent::{Spent, TIME_FILE};
