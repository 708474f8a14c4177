//! `harmzone generate_worker`.

use clap::Args;

use super::ExitStatus;

#[derive(Debug, Args)]
pub struct WorkerArgs {}

pub fn run(_args: WorkerArgs) -> anyhow::Result<ExitStatus> {
    anyhow::bail!("not built yet")
}
