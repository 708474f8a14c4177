//! `harmzone predict`: a detector's boxes for a dataset, as MCAP and as nuScenes-style JSON.

use std::path::PathBuf;

use clap::Args;

use super::{Bar, DeviceArg, ExitStatus, SamplesArgs, print};
use crate::config;
use crate::dataset::Dataset;
use crate::infer::{self, Predictions, Trained};
use crate::object::Detection;

#[derive(Debug, Args)]
pub struct PredictArgs {
    /// Run folder of `harmzone train`, a checkpoint, or `small`, the trained network inside the program
    run: PathBuf,
    #[command(flatten)]
    samples: SamplesArgs,
    /// Folder for one MCAP an episode and predictions.json; default `<run>/predictions/<dataset>`, and
    /// `<dataset>/predictions/small` for `small`
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceArg,
    /// Replace predictions that are there
    #[arg(long)]
    force: bool,
}

pub fn run(args: PredictArgs) -> anyhow::Result<ExitStatus> {
    let trained = Trained::find(&args.run)?;
    let folder = match &args.out {
        Some(out) => out.clone(),
        None => trained.predictions_folder(&args.samples.data)?,
    };
    if !args.force {
        Predictions::check_free(&folder)?;
    }
    let device = args.device.open()?;
    let dataset = args.samples.open()?;
    let found = infer::detect(&trained.load(&device)?, &dataset, &device, &Bar::default())?;
    let config_toml = config::to_toml(&trained.config()?);
    let predictions = Predictions { folder, set: args.run.display().to_string(), config_toml };
    write(&predictions, &dataset, &found)
}

/// Writes boxes and says how many.
pub fn write(
    predictions: &Predictions,
    dataset: &Dataset,
    found: &[Vec<Detection>],
) -> anyhow::Result<ExitStatus> {
    predictions.write(dataset, found)?;
    let n_boxes: usize = found.iter().map(Vec::len).sum();
    print(format!("{n_boxes} boxes for {} samples: {}", found.len(), predictions.folder.display()))?;
    Ok(ExitStatus::Done)
}
