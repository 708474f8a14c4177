//! `harmzone completions`: what shells complete its commands and flags by.

use clap::Args;
use clap_complete::Shell;

use super::{ExitStatus, print};

#[derive(Debug, Args)]
pub struct CompletionsArgs {
    /// The shell
    shell: Shell,
}

pub fn run(args: CompletionsArgs) -> anyhow::Result<ExitStatus> {
    let mut script = Vec::new();
    let mut command = super::visible();
    clap_complete::generate(args.shell, &mut command, "harmzone", &mut script);
    print(String::from_utf8(script)?)?;
    Ok(ExitStatus::Done)
}
