//! `harmzone predict`.

use clap::Args;

use super::ExitStatus;

#[derive(Debug, Args)]
pub struct PredictArgs {}

pub fn run(_args: PredictArgs) -> anyhow::Result<ExitStatus> {
    anyhow::bail!("not built yet")
}
