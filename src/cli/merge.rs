//! `harmzone merge`: joins the shards of a data set, or of predictions.

use std::path::PathBuf;

use clap::Args;

use super::{Bar, ExitStatus, print_summary};
use crate::generate;
use crate::infer::{self, PredictionPart};
use crate::store::{Access, Location};

#[derive(Debug, Args)]
pub struct MergeArgs {
    /// Folders or URLs that `harmzone gen --shard I/N` made, all N of them, labelled or not; or those of `harmzone predict --shard I/N`
    #[arg(required = true, value_name = "SHARD")]
    shards: Vec<Location>,
    /// Folder or URL of the whole; files are linked where they lie on the same disk, else copied
    #[arg(long, value_name = "DIR")]
    out: Location,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: MergeArgs) -> anyhow::Result<ExitStatus> {
    let opened = args.shards.iter().map(|shard| Ok(shard.open(Access::Read)?.path().to_owned()));
    let shards = opened.collect::<anyhow::Result<Vec<PathBuf>>>()?;
    let out = args.out.open(Access::Write)?;
    if shards.iter().all(|path| PredictionPart::is_in(path)) {
        let summary = infer::join(&shards, out.path())?;
        out.push()?;
        print_summary(&summary, args.json)?;
        return Ok(ExitStatus::Done);
    }
    let summary = generate::merge(&shards, out.path(), &Bar::default())?;
    out.push()?;
    print_summary(&summary, args.json)?;
    Ok(ExitStatus::Done)
}
