//! `harmzone label`.

use std::path::PathBuf;

use clap::Args;

use super::ExitStatus;
use super::progress::Bar;
use crate::zone::ZoneConfig;
use crate::{config, label};

#[derive(Debug, Args)]
pub struct LabelArgs {
    /// The data set's folder
    dataset: PathBuf,
    /// Zone config; without it the paper's rectangle (configs/zone.toml)
    #[arg(long, value_name = "FILE")]
    zone: Option<PathBuf>,
    /// Name of the label set [default: the zone's kind]
    #[arg(long, value_name = "NAME")]
    set: Option<String>,
    /// Override one key of the zone config: kind=arc, kind=ttc, kind=rss, ...
    #[arg(long = "override", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    /// Replace a label set made with another zone
    #[arg(long)]
    force: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: LabelArgs) -> anyhow::Result<ExitStatus> {
    let zone: ZoneConfig = config::load(args.zone.as_deref(), &args.overrides)?;
    let set = args.set.unwrap_or_else(|| zone.kind.name().to_owned());
    let summary = label::run(&args.dataset, &zone, &set, args.force, &Bar::default())?;
    if args.json {
        println!("{}", serde_json::to_string_pretty(&summary)?);
    } else {
        println!("{summary}");
    }
    Ok(ExitStatus::Done)
}
