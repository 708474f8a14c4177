//! `xtask bench-stream`: what `make bench-stream` runs.

use std::path::PathBuf;

use clap::Args;

use crate::bench_stream::{self, StreamOptions, StreamStage};
use harmzone::cli::{Bar, ExitStatus, number, print, print_summary};

#[derive(Debug, Args)]
pub struct BenchStreamArgs {
    /// Episodes of the made-up data set
    #[arg(long, default_value_t = 100_000, value_parser = number(1..=u32::MAX))]
    entries: u32,
    /// Episodes of them that are streamed
    #[arg(long, default_value_t = 10_000, value_parser = number(1..=u32::MAX))]
    episodes: u32,
    /// Shards that are merged
    #[arg(long, default_value_t = 10, value_parser = number(1..=u32::MAX))]
    shards: u32,
    /// Episodes of a window
    #[arg(long, default_value_t = 64, value_parser = number(1..=usize::MAX))]
    window: usize,
    /// Folder to make the data set in, on a disk with room for four names for each episode; without it a temporary one
    #[arg(long, value_name = "DIR")]
    work: Option<PathBuf>,
    /// Print the figures as JSON
    #[arg(long)]
    json: bool,
}

/// One stage, in a process of its own.
#[derive(Debug, Args)]
pub struct StageArgs {
    /// Which one
    stage: StreamStage,
    /// Folder of the data
    #[arg(long)]
    work: PathBuf,
    /// Episodes of a window
    #[arg(long)]
    window: usize,
}

pub fn run(args: BenchStreamArgs) -> anyhow::Result<ExitStatus> {
    let options = StreamOptions {
        n_entries: args.entries,
        n_streamed: args.episodes.min(args.entries),
        n_shards: args.shards.min(args.entries),
        window_episodes: args.window,
    };
    let temporary = tempfile::tempdir()?;
    let work = args.work.unwrap_or_else(|| temporary.path().to_owned());
    print_summary(&bench_stream::run(options, &work, &Bar::default())?, args.json)?;
    Ok(ExitStatus::Done)
}

pub fn run_stage(args: &StageArgs) -> anyhow::Result<ExitStatus> {
    let figures = bench_stream::run_stage(args.stage, &args.work, args.window)?;
    print(serde_json::to_string(&figures)?)?;
    Ok(ExitStatus::Done)
}
