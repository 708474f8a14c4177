//! Training: targets, losses, schedule, optimizer and the resumable loop.

mod assignment;
pub mod augment;
pub mod average;
mod cache;
mod config;
mod dry_run;
mod folder;
mod history;
mod log;
pub mod losses;
pub mod optimizer;
mod paste;
pub mod plan;
mod replica;
mod run;
mod schedule;
mod spent;
pub mod state;
pub mod step;
pub mod targets;
#[cfg(test)]
mod twin_tests;
mod validate;

pub use config::{AugmentConfig, LossConfig, StageConfig, TrainConfig, TrainConfigError};
pub use dry_run::DryRun;
pub use folder::{CONFIG_FILE, DATA_FILE};
pub use history::{History, HistoryError, ScoreRow, StepRow};
pub use losses::LossParts;
pub use run::{RunOptions, Summary, TrainError, run};
pub use schedule::{BETA_1, Pace, Schedule};
pub use spent::{Spent, TIME_FILE};
