//! What an experiment runs, and where.

use std::path::PathBuf;

use super::config::ResultsConfig;

/// What to run, and where.
#[derive(Debug, Clone)]
pub struct Request<'a> {
    pub config: &'a ResultsConfig,
    /// The experiment's folder.
    pub out: PathBuf,
    /// Data sets to use in place of those made in `out`.
    pub data: Option<PathBuf>,
    pub ood: Option<PathBuf>,
    /// A finished run to be the headline, in place of training one.
    pub headline: Option<PathBuf>,
    /// Finished runs of the headline's training from other seeds.
    pub headline_repeats: Vec<PathBuf>,
    /// The one row to train and score.
    pub only: Option<String>,
    /// What stands beside figures on split test; `None` where those are not asked for.
    pub reported: Option<ReportStamp>,
    /// A network's card to write the headline's figures into; the network lies beside it.
    pub card: Option<PathBuf>,
    /// This program, started to generate, and how many of it.
    pub program: PathBuf,
    pub jobs: usize,
    /// The command, as it was typed.
    pub command: String,
}

/// What stands beside figures for reporting.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReportStamp {
    pub commit: String,
    pub date: String,
}

impl Request<'_> {
    /// Whether a row may be trained and scored now.
    pub fn wants(&self, row: &str) -> bool {
        self.only.as_ref().is_none_or(|only| only == row)
    }
}
