//! `harmzone label`.

use clap::Args;

use super::ExitStatus;

#[derive(Debug, Args)]
pub struct LabelArgs {}

pub fn run(_args: LabelArgs) -> anyhow::Result<ExitStatus> {
    anyhow::bail!("not built yet")
}
