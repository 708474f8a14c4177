//! `harmzone drive-worker`: serves the parent's tasks on stdin until it ends.

use clap::Args;

use super::ExitStatus;
use crate::drive::worker;
use crate::kernels::keep_freed_memory;

#[derive(Debug, Args)]
pub struct DriveWorkerArgs {}

pub fn run(_args: DriveWorkerArgs) -> anyhow::Result<ExitStatus> {
    keep_freed_memory();
    worker::serve(std::io::stdin().lock(), std::io::stdout().lock())?;
    Ok(ExitStatus::Done)
}
