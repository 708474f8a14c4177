//! `harmzone label`.

use std::path::PathBuf;

use clap::Args;

use super::zones::ZoneArgs;
use super::{Bar, ExitStatus, print_summary};
use crate::label;

#[derive(Debug, Args)]
pub struct LabelArgs {
    /// The data set's folder
    dataset: PathBuf,
    #[command(flatten)]
    zone: ZoneArgs,
    /// Name of the label set [default: the zone's kind]
    #[arg(long, value_name = "NAME")]
    labels: Option<String>,
    /// Replace a label set made with another zone
    #[arg(long)]
    force: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: LabelArgs) -> anyhow::Result<ExitStatus> {
    let zone = args.zone.load()?;
    let set = args.labels.unwrap_or_else(|| zone.kind.name().to_owned());
    let summary = label::run(&args.dataset, &zone, &set, args.force, &Bar::default())?;
    print_summary(&summary, args.json)?;
    Ok(ExitStatus::Done)
}
