//! `harmzone generate`.

use clap::Args;

use super::ExitStatus;

#[derive(Debug, Args)]
pub struct GenerateArgs {}

pub fn run(_args: GenerateArgs) -> anyhow::Result<ExitStatus> {
    anyhow::bail!("not built yet")
}
