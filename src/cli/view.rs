//! `harmzone view`: one sample as a picture.

use std::path::PathBuf;

use clap::Args;

use super::{ExitStatus, number, print};
use crate::infer::Trained;
use crate::report::view::{self, ViewRequest};
use crate::store::{Access, Location};

/// Lowest score of the predictions that are drawn, of networks without a score of their own.
const DEFAULT_MIN_SCORE: f32 = 0.3;

#[derive(Debug, Args)]
pub struct ViewArgs {
    /// The data set's folder or URL
    dataset: Location,
    /// Number of the sample, counted from 0 through all episodes
    #[arg(long, value_name = "K", value_parser = number(0..=usize::MAX))]
    sample: usize,
    /// Label set to draw [default: rect, where it is there]
    #[arg(long, value_name = "SET")]
    labels: Option<String>,
    /// Predictions to draw: a folder or URL with a file for each episode, a run's folder, or `small` for those of the
    /// network inside the program
    #[arg(long, value_name = "DIR")]
    predictions: Option<Location>,
    /// Leave out predictions below this score, 0 to 1; default the score that `calibrate` left in the network that
    /// --predictions names, else 0.3
    #[arg(long, value_name = "SCORE", value_parser = number(0.0..=1.0_f32))]
    min_score: Option<f32>,
    /// The picture to write
    #[arg(long, value_name = "PNG")]
    out: PathBuf,
    /// Replace the picture if it exists
    #[arg(long)]
    force: bool,
}

pub fn run(args: ViewArgs) -> anyhow::Result<ExitStatus> {
    let ViewArgs { dataset, sample, labels: label_set, predictions, min_score, out, force } = args;
    let dataset = dataset.open(Access::Read)?.path().to_owned();
    let opened = predictions.map(|folder| folder.open(Access::Read)).transpose()?;
    let predictions = opened.map(|folder| folder.path().to_owned());
    // A folder needs no checkpoint; a name has one folder in each dataset.
    let network = predictions.as_deref().and_then(|folder| Trained::find(folder).ok());
    let predictions = predictions.map(|folder| match &network {
        Some(shipped @ Trained::Shipped(_)) => shipped.predictions_folder(&dataset),
        _ => Ok(folder),
    });
    let predictions = predictions.transpose()?;
    let min_score = match (min_score, network) {
        (None, Some(network)) => network.operating_score()?.map(|own| own.score as f32),
        (given, _) => given,
    };
    let min_score = min_score.unwrap_or(DEFAULT_MIN_SCORE);
    let request = ViewRequest { dataset, sample, label_set, predictions, min_score, out, force };
    let summary = view::run(&request)?;
    let objects = match (summary.n_objects, summary.n_harmful) {
        (None, _) => "no truth".to_owned(),
        (Some(n_objects), None) => format!("{n_objects} objects, no labels"),
        (Some(n_objects), Some(n_harmful)) => format!("{n_objects} objects, {n_harmful} harmful"),
    };
    print(format!(
        "{}: sample {} of {}, {objects}",
        summary.out.display(),
        summary.sample_idx,
        summary.episode
    ))?;
    Ok(ExitStatus::Done)
}
