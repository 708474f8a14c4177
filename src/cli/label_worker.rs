//! `harmzone label-worker`: serves the parent's tasks on stdin until it ends.

use clap::Args;

use super::ExitStatus;
use crate::label::worker;

#[derive(Debug, Args)]
pub struct LabelWorkerArgs {}

pub fn run(_args: LabelWorkerArgs) -> anyhow::Result<ExitStatus> {
    worker::serve(std::io::stdin().lock(), std::io::stdout().lock())?;
    Ok(ExitStatus::Done)
}
