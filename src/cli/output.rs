//! What a command prints. Results leave here alone, so that every command ends alike where nobody reads on.

use std::fmt::Display;
use std::io::{self, Write};
use std::path::Path;

use anyhow::Context;
use serde::Serialize;

use crate::store;

/// The reader of standard output is gone, as behind `| head`: no fault of the command.
#[derive(Debug, thiserror::Error)]
#[error("nobody reads the standard output")]
pub struct ClosedPipe;

/// Prints a result, and ends its last line.
///
/// # Errors
/// [`ClosedPipe`], or the disk that standard output leads to.
pub fn print(result: impl Display) -> anyhow::Result<()> {
    let text = store::with_urls(&result.to_string());
    let mut out = io::stdout().lock();
    match writeln!(out, "{}", text.trim_end_matches('\n')).and_then(|()| out.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Err(ClosedPipe.into()),
        printed => printed.context("cannot write the result to standard output"),
    }
}

/// Prints a summary: for people, or for machines as JSON.
///
/// # Errors
/// As [`print()`].
pub fn print_summary(summary: &(impl Display + Serialize), as_json: bool) -> anyhow::Result<()> {
    if as_json { print(serde_json::to_string_pretty(summary)?) } else { print(summary) }
}

/// Prints a few words for people, or the same as JSON for machines.
///
/// # Errors
/// As [`print()`].
pub fn print_either(words: impl Display, json: &serde_json::Value, as_json: bool) -> anyhow::Result<()> {
    if as_json { print(serde_json::to_string_pretty(json)?) } else { print(words) }
}

/// A path for JSON, which is text: what is no Unicode in it is replaced, as on a screen.
#[must_use]
pub fn path_text(path: &Path) -> String {
    path.display().to_string()
}

/// Tells something on standard error; where nobody reads that either, nobody misses it.
pub fn tell(text: impl Display) {
    let _ = writeln!(io::stderr(), "{}", store::with_urls(&text.to_string()));
}
