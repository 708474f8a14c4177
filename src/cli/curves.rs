//! `harmzone curves`: draws the course of a training.

use std::path::PathBuf;

use clap::Args;

use super::{ExitStatus, print};
use crate::report::curves;

#[derive(Debug, Args)]
pub struct CurvesArgs {
    /// Folder of a run, finished or under way; `curves.svg` and `curves.png` are written there
    run: PathBuf,
}

pub fn run(args: CurvesArgs) -> anyhow::Result<ExitStatus> {
    for path in curves::run(&args.run)? {
        print(path.display())?;
    }
    Ok(ExitStatus::Done)
}
