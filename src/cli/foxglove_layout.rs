//! `harmzone foxglove-layout`: the layout for Foxglove that comes with the program.

use std::path::PathBuf;

use anyhow::bail;
use clap::Args;
use serde_json::json;

use super::{ExitStatus, path_text, print, print_either};
use crate::files::{self, write_atomic};
use crate::report::foxglove_layout;

#[derive(Debug, Args)]
pub struct FoxgloveLayoutArgs {
    /// File to write; without it, the layout is printed
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Replace the file if it exists
    #[arg(long)]
    force: bool,
    /// Print the file's path as JSON
    #[arg(long, requires = "out")]
    json: bool,
}

pub fn run(args: FoxgloveLayoutArgs) -> anyhow::Result<ExitStatus> {
    let layout = foxglove_layout();
    let Some(out) = args.out else {
        print(layout)?;
        return Ok(ExitStatus::Done);
    };
    if !args.force && files::is_there(&out)? {
        bail!("the file exists; --force replaces it: {}", out.display());
    }
    write_atomic(&out, layout.as_bytes())?;
    let words =
        format!("{}: import it in Foxglove, then open what `harmzone view --mcap` wrote", out.display());
    print_either(words, &json!({"layout": path_text(&out)}), args.json)?;
    Ok(ExitStatus::Done)
}
