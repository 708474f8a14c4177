//! `harmzone compare`: two data sets side by side, the domain gap in figures.

use std::path::PathBuf;

use clap::Args;

use super::{Bar, ExitStatus, print_summary, split};
use crate::episode::Split;
use crate::report::compare::{self, CompareRequest};

#[derive(Debug, Args)]
pub struct CompareArgs {
    /// The data set to measure by, such as the one that a network was trained on; it needs no labels
    a: PathBuf,
    /// The data set to set beside it, such as an imported log
    b: PathBuf,
    /// Compare only this split of both [default: all]
    #[arg(long, value_parser = split())]
    split: Option<Split>,
    /// Also write compare.txt, compare.json with every histogram, and compare.png
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace files that are there
    #[arg(long)]
    force: bool,
    /// Print everything as JSON, with the histograms
    #[arg(long)]
    json: bool,
}

pub fn run(args: CompareArgs) -> anyhow::Result<ExitStatus> {
    let CompareArgs { a, b, split, out, force, json } = args;
    let gap = compare::run(&CompareRequest { a, b, split, out, force }, &Bar::default())?;
    print_summary(&gap, json)?;
    Ok(ExitStatus::Done)
}
