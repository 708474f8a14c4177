//! `harmzone zones`, and the zone's flags, which `harmzone label` has too.

use std::path::PathBuf;

use clap::Args;

use super::{Bar, ExitStatus, number, print_summary};
use crate::config::{self, ConfigError};
use crate::report::zones::{self, ZonesRequest};
use crate::zone::{ZoneConfig, ZoneKind};

#[derive(Debug, Args)]
pub struct ZonesArgs {
    /// The data set's folder; it needs no labels, and none are written
    dataset: PathBuf,
    /// What the zones share; its `kind` is replaced by each
    #[command(flatten)]
    zone: ZoneArgs,
    /// Also draw one sample with all zones over each other
    #[arg(long, value_name = "PNG")]
    plot: Option<PathBuf>,
    /// The sample to draw, counted from 0 through all episodes [default: the one on which the zones differ most]
    #[arg(long, value_name = "K", requires = "plot", value_parser = number(0..=usize::MAX))]
    sample: Option<usize>,
    /// Replace the picture if it exists
    #[arg(long)]
    force: bool,
    /// Print everything as JSON
    #[arg(long)]
    json: bool,
}

/// A zone from a file and overrides.
#[derive(Debug, Args)]
pub struct ZoneArgs {
    /// Zone config (TOML); configs/zone.toml holds the defaults, the paper's rectangle
    #[arg(long, value_name = "FILE")]
    zone: Option<PathBuf>,
    #[arg(
        long = "set",
        value_name = "KEY=VALUE",
        value_parser = parse_set,
        help = format!("Override one key of the zone config, e.g. kind={}", ZoneKind::ALL.map(ZoneKind::name).join(" | "))
    )]
    overrides: Vec<String>,
    /// The old name of --set
    #[arg(long = "override", hide = true, value_parser = refuse_override)]
    old_overrides: Vec<String>,
}

impl ZoneArgs {
    /// Whether any of the flags is there.
    pub fn is_given(&self) -> bool {
        self.zone.is_some() || !self.overrides.is_empty()
    }

    pub fn load(&self) -> Result<ZoneConfig, ConfigError> {
        config::load(self.zone.as_deref(), &self.overrides)
    }
}

fn parse_set(text: &str) -> Result<String, &'static str> {
    let error = "KEY=VALUE is needed, a key of the zone config; a label set is named by `--labels NAME`";
    if text.contains('=') { Ok(text.to_owned()) } else { Err(error) }
}

fn refuse_override(text: &str) -> Result<String, String> {
    Err(format!("this flag is called --set now: `--set {text}`"))
}

pub fn run(args: ZonesArgs) -> anyhow::Result<ExitStatus> {
    let ZonesArgs { dataset, zone, plot, sample, force, json } = args;
    let zone = zone.load()?;
    let summary = zones::run(&ZonesRequest { dataset, zone, plot, sample, force }, &Bar::default())?;
    print_summary(&summary, json)?;
    Ok(ExitStatus::Done)
}
