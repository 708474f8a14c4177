//! `xtask bench`: what `make bench` runs.

use std::path::PathBuf;

use anyhow::bail;
use clap::{Args, ValueEnum};

use crate::bench::{self, Options, Part, Verdict};
use harmzone::cli::{Bar, DeviceArg, ExitStatus, print, tell};

#[derive(Debug, Args)]
pub struct BenchArgs {
    /// Parts of the table, with commas between [default: all]
    #[arg(long, value_name = "ROWS", value_delimiter = ',')]
    rows: Vec<Part>,
    /// Labelled data set that networks race on; made where it is missing
    #[arg(long, value_name = "DIR", default_value = "data/race")]
    data: PathBuf,
    /// Make the data of the preset `small` in a folder and train on it, in place of computing how long that takes; an hour
    #[arg(long, value_name = "DIR")]
    train_in: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceArg,
    /// Write the figures to a file as JSON, too
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Fails where a floor is missed.
pub fn run(args: BenchArgs) -> anyhow::Result<ExitStatus> {
    let parts = if args.rows.is_empty() { Part::value_variants() } else { &args.rows };
    let options =
        Options { parts, data: &args.data, train_in: args.train_in.as_deref(), device: &args.device.open()? };
    let report = bench::run(&options, &Bar::default())?;
    if let Some(file) = &args.json {
        harmzone::files::write_atomic(file, &serde_json::to_vec_pretty(&report)?)?;
    }
    print(&report)?;
    let (missed, absent) = (report.named(Verdict::Missed), report.named(Verdict::Absent));
    if !missed.is_empty() {
        bail!("below the floor: {}", missed.join("; "));
    }
    if absent.is_empty() {
        return Ok(ExitStatus::Done);
    }
    tell(format!("not measured: {}", absent.join("; ")));
    Ok(ExitStatus::DoneWithLosses)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_about_speed_has_every_part() {
        let page = include_str!("../../docs/speed.md");
        for part in Part::value_variants() {
            let name = part.to_possible_value().expect("no part is hidden");
            assert!(page.contains(&format!("`{}`", name.get_name())), "{part:?}");
        }
    }
}
