//! How much a command tells on standard error beside its errors.

use std::sync::atomic::{AtomicBool, Ordering};

use clap::{ArgAction, Args};
use tracing_subscriber::EnvFilter;

static IS_QUIET: AtomicBool = AtomicBool::new(false);

/// Flags of every command.
#[derive(Debug, Clone, Copy, Args)]
pub struct VerbosityArgs {
    /// Tell less: no progress, of the log only errors
    #[arg(short, long, global = true, conflicts_with = "verbose", help_heading = "Everywhere")]
    quiet: bool,
    /// Tell more: the log from `info` on, twice from `debug` on; HARMZONE_LOG=harmzone::train=debug picks parts
    #[arg(short, long, global = true, action = ArgAction::Count, help_heading = "Everywhere")]
    verbose: u8,
}

impl VerbosityArgs {
    /// Takes effect for the whole process.
    pub fn apply(self) {
        IS_QUIET.store(self.quiet, Ordering::Relaxed);
    }

    /// What of the log is told: what the flags say, else the environment, else warnings.
    pub fn filter(self) -> EnvFilter {
        let level = match (self.quiet, self.verbose) {
            (true, _) => "error",
            (false, 1) => "info",
            (false, 2..) => "debug",
            (false, 0) => {
                return EnvFilter::try_from_env("HARMZONE_LOG").unwrap_or_else(|_| "warn".into());
            }
        };
        level.into()
    }
}

/// What errors begin with: in colour where standard error shows it, and never with NO_COLOR.
pub fn error_word() -> String {
    let is_plain = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    let word = "error:";
    if is_plain { word.to_owned() } else { console::style(word).red().bold().for_stderr().to_string() }
}

/// Whether progress is told.
pub fn is_quiet() -> bool {
    IS_QUIET.load(Ordering::Relaxed)
}
