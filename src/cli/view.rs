//! `harmzone view`.

use clap::Args;

use super::ExitStatus;

#[derive(Debug, Args)]
pub struct ViewArgs {}

pub fn run(_args: ViewArgs) -> anyhow::Result<ExitStatus> {
    anyhow::bail!("not built yet")
}
