//! `harmzone eval`.

use clap::Args;

use super::ExitStatus;

#[derive(Debug, Args)]
pub struct EvalArgs {}

pub fn run(_args: EvalArgs) -> anyhow::Result<ExitStatus> {
    anyhow::bail!("not built yet")
}
