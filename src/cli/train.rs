//! `harmzone train`.

use clap::Args;

use super::ExitStatus;

#[derive(Debug, Args)]
pub struct TrainArgs {}

pub fn run(_args: TrainArgs) -> anyhow::Result<ExitStatus> {
    anyhow::bail!("not built yet")
}
