//! `harmzone predict-worker`: serves the parent's tasks on stdin until it ends.

use clap::Args;

use super::ExitStatus;
use crate::infer::worker;
use crate::kernels::keep_freed_memory;

#[derive(Debug, Args)]
pub struct PredictWorkerArgs {}

pub fn run(_args: PredictWorkerArgs) -> anyhow::Result<ExitStatus> {
    keep_freed_memory();
    worker::serve(std::io::stdin().lock(), std::io::stdout().lock())?;
    Ok(ExitStatus::Done)
}
