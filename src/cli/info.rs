//! `harmzone info`: what a data set holds.

use std::path::PathBuf;

use clap::Args;

use super::{Bar, ExitStatus, print_summary};
use crate::report::info::{self, InfoRequest};
use crate::store::{Access, Location};

#[derive(Debug, Args)]
pub struct InfoArgs {
    /// The data set's folder or URL
    dataset: Location,
    /// Label set to count [default: rect, where it is there]
    #[arg(long, value_name = "SET")]
    labels: Option<String>,
    /// Also draw the histograms into a picture
    #[arg(long, value_name = "PNG")]
    plot: Option<PathBuf>,
    /// Replace the picture if it exists
    #[arg(long)]
    force: bool,
    /// Print everything as JSON, with histograms and shares by split, town and weather
    #[arg(long)]
    json: bool,
}

pub fn run(args: InfoArgs) -> anyhow::Result<ExitStatus> {
    let InfoArgs { dataset, labels: label_set, plot, force, json } = args;
    let dataset = dataset.open(Access::Read)?.path().to_owned();
    let info = info::run(&InfoRequest { dataset, label_set, plot, force }, &Bar::default())?;
    print_summary(&info, json)?;
    Ok(ExitStatus::Done)
}
