//! `harmzone predict`: a detector's boxes for a dataset, as MCAP and as nuScenes-style JSON.

use std::path::PathBuf;

use clap::Args;

use super::{Bar, DeviceArg, ExitStatus, print, split, tell, tell_seen};
use crate::config;
use crate::dataset::MeasuredSplit;
use crate::episode::Split;
use crate::infer::{self, Predictions, Trained};

#[derive(Debug, Args)]
pub struct PredictArgs {
    /// Run folder of `harmzone train`, a checkpoint, or `small`, the trained network inside the program
    run: PathBuf,
    /// Data set; it needs neither labels nor truth
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Split; without it, the first of val, dev and test that the data set has
    #[arg(long, value_parser = split())]
    split: Option<Split>,
    /// From when labels were needed; a detector sees none
    #[arg(long, value_name = "SET", hide = true)]
    labels: Option<String>,
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
        None => trained.predictions_folder(&args.data)?,
    };
    if !args.force {
        Predictions::check_free(&folder)?;
    }
    let device = args.device.open()?;
    let recording = MeasuredSplit::open(&args.data, args.split)?;
    // Boxes on training data serve to find faults; only figures on them are refused, by `eval`.
    if let Err(learned) = tell_seen(&trained, recording.episodes())? {
        tell(format!(
            "the network learned from {} of the {} episodes",
            learned.n_learned, learned.n_episodes
        ));
    }
    let config_toml = config::to_toml(&trained.config()?);
    let predictions = Predictions { folder, set: args.run.display().to_string(), config_toml };
    let detector = trained.load(&device)?;
    let n_boxes = infer::predict_recording(&detector, &recording, &predictions, &device, &Bar::default())?;
    tell_boxes(n_boxes, recording.n_samples(), &predictions)
}

/// Says how many boxes were written.
pub fn tell_boxes(n_boxes: usize, n_samples: usize, to: &Predictions) -> anyhow::Result<ExitStatus> {
    print(format!("{n_boxes} boxes for {n_samples} samples: {}", to.folder.display()))?;
    Ok(ExitStatus::Done)
}
