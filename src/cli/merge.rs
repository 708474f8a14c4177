//! `harmzone merge`: joins the shards of a data set, or of predictions.

use std::path::PathBuf;

use clap::Args;

use super::{Bar, ExitStatus, print_summary};
use crate::generate;
use crate::infer::{self, PredictionPart};

#[derive(Debug, Args)]
pub struct MergeArgs {
    /// Folders that `harmzone gen --shard I/N` made, all N of them, labelled or not; or those of `harmzone predict --shard I/N`
    #[arg(required = true, value_name = "SHARD")]
    shards: Vec<PathBuf>,
    /// Folder of the whole; files are linked where they lie on the same disk, else copied
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: MergeArgs) -> anyhow::Result<ExitStatus> {
    if args.shards.iter().all(|path| PredictionPart::is_in(path)) {
        print_summary(&infer::join(&args.shards, &args.out)?, args.json)?;
        return Ok(ExitStatus::Done);
    }
    let summary = generate::merge(&args.shards, &args.out, &Bar::default())?;
    print_summary(&summary, args.json)?;
    Ok(ExitStatus::Done)
}
