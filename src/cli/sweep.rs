//! `harmzone sweep`: a dataset's frames at other speeds and steering angles.

use std::path::PathBuf;

use clap::Args;

use super::{Bar, DeviceArg, ExitStatus, SamplesArgs, print_summary};
use crate::config::{self, Checked};
use crate::eval::Protocol;
use crate::eval::sweep::SweepConfig;
use crate::files::FolderLock;
use crate::infer::{self, Trained};
use crate::report::sweeps::{self, SweepRequest};

#[derive(Debug, Args)]
pub struct SweepArgs {
    /// Folder of a trained detector, a checkpoint, or `small`, the network inside the program
    run: PathBuf,
    #[command(flatten)]
    samples: SamplesArgs,
    /// Folder for sweeps.json, sweeps.csv, sweep.toml, plots (SVG and PNG) and pictures
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// What is swept (TOML); `configs/sweep.toml` holds the defaults
    #[arg(long, value_name = "TOML")]
    config: Option<PathBuf>,
    /// Override one key of the config, e.g. n_episodes=4
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    #[command(flatten)]
    device: DeviceArg,
    /// Replace the sweeps of an existing output folder
    #[arg(long)]
    force: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: SweepArgs) -> anyhow::Result<ExitStatus> {
    let trained = Trained::find(&args.run)?;
    let mut base = SweepConfig::default();
    if let Some(own) = trained.operating_score()? {
        base.picture_min_score = own.score as f32;
    }
    let config = Checked::try_from(config::load_over(&base, args.config.as_deref(), &args.overrides)?)?;
    let _lock = FolderLock::take(&args.out)?;
    sweeps::refuse_to_overwrite(&args.out, args.force)?;
    let device = args.device.open()?;
    let dataset = args.samples.open()?;
    let detector = trained.load(&device)?;
    let (swept, series) = infer::sweep(&detector, &dataset, &config, &device, &Bar::default())?;
    let request = SweepRequest {
        swept: &swept,
        series: &series,
        dataset: &dataset,
        config: &config,
        protocol: &Protocol::try_from(trained.eval_config()?)?,
        out: &args.out,
    };
    print_summary(&sweeps::run(&request)?, args.json)?;
    Ok(ExitStatus::Done)
}
