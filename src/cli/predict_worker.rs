//! `harmzone predict-worker`: serves the parent's tasks on stdin until it ends.

use clap::Args;

use super::ExitStatus;
use crate::infer::worker;

#[derive(Debug, Args)]
pub struct PredictWorkerArgs {}

pub fn run(_args: PredictWorkerArgs) -> anyhow::Result<ExitStatus> {
    worker::serve(std::io::stdin().lock(), std::io::stdout().lock())?;
    Ok(ExitStatus::Done)
}
