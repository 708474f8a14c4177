//! `xtask bench-model`: how fast a detector infers and trains; what `make race` runs.

use std::io::BufRead;
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use serde_json::json;

use crate::bench_model::{self as bench, Bench, BenchOptions, Contest};
use harmzone::cli::{Bar, DeviceArg, ExitStatus, SamplesArgs, number, print, print_summary};
use harmzone::config::{self, Checked};
use harmzone::infer::Trained;
use harmzone::train::TrainConfig;

#[derive(Debug, Args)]
pub struct BenchModelArgs {
    #[command(flatten)]
    samples_of: SamplesArgs,
    /// Run folder, checkpoint, or the name of a network inside the program; without it, the config's with
    /// random weights
    #[arg(long, value_name = "RUN")]
    model: Option<PathBuf>,
    /// Samples of inference
    #[arg(long, default_value_t = 200, value_parser = number(1..=u32::MAX))]
    samples: u32,
    /// Training steps of each stage
    #[arg(long, default_value_t = 20, value_parser = number(1..=u32::MAX))]
    steps: u32,
    /// Training config (TOML); `configs/train.toml` holds the defaults
    #[arg(long, value_name = "TOML")]
    config: Option<PathBuf>,
    /// Override one key of the training config, e.g. batch_size=2
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    #[command(flatten)]
    device: DeviceArg,
    /// Write inputs, weights and outputs for `scripts/race_pytorch.py` into a folder, and stop
    #[arg(long, value_name = "DIR")]
    dump: Option<PathBuf>,
    /// Do what each line on stdin names, once, and print its milliseconds: "lidar_step", "fused_step",
    /// "inference", "whole", each a JSON string
    #[arg(long, conflicts_with = "dump")]
    lockstep: bool,
    /// Print the figures as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: BenchModelArgs) -> anyhow::Result<ExitStatus> {
    let trained = args.model.as_deref().map(Trained::find).transpose()?;
    let mut config: TrainConfig =
        config::load_over(&TrainConfig::default(), args.config.as_deref(), &args.overrides)?;
    if let Some(trained) = &trained {
        config.model = trained.config()?;
    }
    let config = Checked::try_from(config)?;
    let checkpoint = trained.as_ref().map(Trained::bytes).transpose()?;
    let device = args.device.open()?;
    let dataset = args.samples_of.open()?;
    let bench = Bench { dataset: &dataset, config: &config, checkpoint, device: &device };
    if let Some(folder) = &args.dump {
        bench::dump(&bench, folder)?;
        print(folder.display())?;
    } else if args.lockstep {
        lockstep(&bench)?;
    } else {
        let options = BenchOptions { n_samples: args.samples as usize, n_steps: args.steps as usize };
        let report = bench.run(options, &Bar::default())?;
        print_summary(&report, args.json)?;
    }
    Ok(ExitStatus::Done)
}

fn lockstep(bench: &Bench) -> anyhow::Result<()> {
    let mut unread = None;
    let mut lines = std::io::stdin().lock().lines();
    let next = || {
        let contest = lines.next()?.map_err(anyhow::Error::from).and_then(|line| {
            serde_json::from_str::<Contest>(&line).with_context(|| format!("no contest in the line `{line}`"))
        });
        contest.map_err(|error| unread = Some(error)).ok()
    };
    bench::race(bench, next, |contest, ms| print(json!({ "contest": contest, "ms": ms })))?;
    unread.map_or(Ok(()), Err)
}
