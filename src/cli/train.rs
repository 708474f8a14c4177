//! `harmzone train`: trains a detector on a labelled dataset, resumable.

use std::path::PathBuf;

use clap::Args;

use super::ExitStatus;
use super::device::DeviceArg;
use super::progress::Bar;
use crate::config;
use crate::dataset::{Dataset, DatasetError};
use crate::episode::manifest::Split;
use crate::train::{self, RunOptions, TrainConfig};

#[derive(Debug, Args)]
pub struct TrainArgs {
    /// Labelled dataset
    data: PathBuf,
    /// Folder of the run: config, log, states, and at the end `model.safetensors`. The same command
    /// again goes on where it stopped
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Label set
    #[arg(long, value_name = "SET", default_value = "rect")]
    labels: String,
    /// Training config (TOML); `configs/train.toml` holds the defaults
    #[arg(long, value_name = "TOML")]
    config: Option<PathBuf>,
    /// Override one key of the config, e.g. lidar_stage.epochs=4
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    #[command(flatten)]
    device: DeviceArg,
    /// Require a run to go on with
    #[arg(long, conflicts_with = "force")]
    resume: bool,
    /// Discard what another run left in the folder
    #[arg(long)]
    force: bool,
}

pub fn run(args: TrainArgs) -> anyhow::Result<ExitStatus> {
    let config: TrainConfig = config::load(args.config.as_deref(), &args.overrides)?;
    config.check()?;
    let device = args.device.open()?;
    let dataset = Dataset::open(&args.data, &args.labels, Split::Train)?;
    let options = RunOptions { force: args.force, resume: args.resume };
    let validation = match Dataset::open(&args.data, &args.labels, Split::Val) {
        Ok(split) if config.validate_every_epochs > 0 => Some(split),
        Ok(_) | Err(DatasetError::EmptySplit { .. }) => None,
        Err(error) => return Err(error.into()),
    };
    let summary =
        train::run(&dataset, validation.as_ref(), &config, &args.out, options, &device, &Bar::default())?;
    if summary.n_steps_now == 0 {
        println!("already trained: {}", summary.checkpoint.display());
        return Ok(ExitStatus::Done);
    }
    let loss = summary.last_loss;
    println!(
        "trained on {} samples: {} of {} steps in {:.0} s; last epoch's loss {:.3} (heatmap {:.3}, harm {:.3}, \
         boxes {:.3})",
        summary.n_samples,
        summary.n_steps_now,
        summary.n_steps,
        summary.elapsed.as_secs_f64(),
        loss.total(),
        loss.heatmap,
        loss.harm,
        loss.boxes,
    );
    println!("checkpoint: {}", summary.checkpoint.display());
    Ok(ExitStatus::Done)
}
