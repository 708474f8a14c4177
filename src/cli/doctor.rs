//! `harmzone doctor`.

use clap::Args;

use super::ExitStatus;

#[derive(Debug, Args)]
pub struct DoctorArgs {}

pub fn run(_args: DoctorArgs) -> anyhow::Result<ExitStatus> {
    anyhow::bail!("not built yet")
}
