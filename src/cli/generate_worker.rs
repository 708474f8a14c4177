//! `harmzone gen-worker`: serves the parent's tasks on stdin until it ends.

use clap::Args;

use super::ExitStatus;
use crate::generate::worker;

#[derive(Debug, Args)]
pub struct WorkerArgs {}

pub fn run(_args: WorkerArgs) -> anyhow::Result<ExitStatus> {
    worker::serve(std::io::stdin().lock(), std::io::stdout().lock())?;
    Ok(ExitStatus::Done)
}
