//! `harmzone zones`.

use std::path::PathBuf;

use clap::Args;

use super::ExitStatus;
use super::progress::Bar;
use crate::config;
use crate::report::zones::{self, ZonesRequest};

#[derive(Debug, Args)]
pub struct ZonesArgs {
    /// The data set's folder; it needs no labels, and none are written
    dataset: PathBuf,
    /// Zone config, whose `kind` is replaced by each; without it configs/zone.toml
    #[arg(long, value_name = "FILE")]
    zone: Option<PathBuf>,
    /// Override one key of the zone config
    #[arg(long = "override", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    /// Also draw one sample with all zones over each other
    #[arg(long, value_name = "PNG")]
    plot: Option<PathBuf>,
    /// The sample to draw, from 0 through all episodes [default: the one on which the zones differ most]
    #[arg(long, value_name = "K", requires = "plot")]
    sample: Option<usize>,
    /// Replace the picture if it exists
    #[arg(long)]
    force: bool,
    /// Print everything as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: ZonesArgs) -> anyhow::Result<ExitStatus> {
    let ZonesArgs { dataset, zone, overrides, plot, sample, force, json } = args;
    let zone = config::load(zone.as_deref(), &overrides)?;
    let summary = zones::run(&ZonesRequest { dataset, zone, plot, sample, force }, &Bar::default())?;
    if json {
        println!("{}", serde_json::to_string_pretty(&summary)?);
    } else {
        println!("{summary}");
    }
    Ok(ExitStatus::Done)
}
