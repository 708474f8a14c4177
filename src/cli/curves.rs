//! `harmzone curves`: draws the course of a training.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::{ExitStatus, print_either};
use crate::report::curves;

#[derive(Debug, Args)]
pub struct CurvesArgs {
    /// Folder of a run, finished or under way; `curves.svg` and `curves.png` are written there
    run: PathBuf,
    /// Print the files as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: CurvesArgs) -> anyhow::Result<ExitStatus> {
    let files = curves::run(&args.run)?;
    let words: Vec<String> = files.iter().map(|path| path.display().to_string()).collect();
    print_either(words.join("\n"), &json!({"files": words}), args.json)?;
    Ok(ExitStatus::Done)
}
