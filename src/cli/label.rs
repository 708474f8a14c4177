//! `harmzone label`.

use std::path::PathBuf;

use clap::Args;

use super::ExitStatus;
use super::progress::Bar;
use super::zones::ZoneArgs;
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
    if args.json {
        println!("{}", serde_json::to_string_pretty(&summary)?);
    } else {
        println!("{summary}");
    }
    Ok(ExitStatus::Done)
}
