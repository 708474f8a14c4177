//! Training: targets, losses, schedule, optimizer and the resumable loop.

mod assignment;
mod augment;
mod average;
mod cache;
mod config;
mod copies;
mod cut_out;
mod data_check;
mod disturb;
mod dry_run;
mod epoch_table;
mod error;
mod folder;
mod lanes;
mod learner;
mod losses;
mod mean_loss;
pub mod memory;
mod optimizer;
mod paste;
mod picture;
mod plan;
mod rings;
mod run;
#[cfg(test)]
mod run_tests;
mod schedule;
mod state;
mod step;
mod targets;
mod time;
mod trained_on;
#[cfg(test)]
mod twin_tests;
mod validate;
mod windows;

pub use config::{AugmentConfig, LossConfig, StageConfig, StreamConfig, TrainConfig, Unhit};
pub use dry_run::DryRun;
pub use error::TrainError;
pub use folder::{CONFIG_FILE, DATA_FILE, TrainOptions};
pub use run::{Summary, TrainingData, run};
pub use schedule::{BETA_1, Pace, Schedule};
pub use time::{TIME_FILE, TrainingTime};
pub use trained_on::{MADE_WITH_FILE, TrainedOn};

// The parts of one step, for measurements.
pub use augment::{ObjectsByState, TrainView, draw};
pub use learner::Learner;
pub use losses::{LossParts, Losses, losses};
pub use plan::{Plan, Position, STAGES};
pub use step::Steps;
pub use targets::trainable;
pub use windows::{Shown, Windows};
