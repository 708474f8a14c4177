//! A folder of scores as tables, those that `eval` prints and the report shows.

use std::path::Path;

use serde::Serialize;

use super::ServeError;
use super::folder::ServedFolder;
use crate::report::provenance::Provenance;
use crate::report::scores::{CONFIG_FILE, FAULTS_FILE, METRICS_FILE, PROVENANCE_FILE, SWEEPS_FILE, Scores};
use crate::report::table::Table;
use crate::report::{missed, score_tables};

/// Scores for the page.
#[derive(Debug, Serialize)]
pub struct ShownScores {
    /// What the figures may be used for.
    standing: Option<String>,
    /// The command that made them.
    command: Option<String>,
    tables: Vec<TitledTable>,
}

#[derive(Debug, Serialize)]
struct TitledTable {
    title: String,
    /// Whether it is one of those that are read first.
    is_main: bool,
    #[serde(flatten)]
    table: Table,
}

impl ShownScores {
    /// Reads a folder that `eval --out` wrote.
    ///
    /// # Errors
    /// A file is broken, of another version, or leads out of the served folder.
    pub fn read(folder: &ServedFolder, path: &Path) -> Result<Self, ServeError> {
        folder.check_files(path, &[METRICS_FILE, CONFIG_FILE, FAULTS_FILE, PROVENANCE_FILE, SWEEPS_FILE])?;
        let Scores { evaluation, provenance, .. } = Scores::read(path)?;
        let metrics = &evaluation.metrics;
        let alarms = evaluation.safety.alarms.as_ref();
        let main = [
            ("Missed harm", alarms.and_then(|alarms| missed::table(&[("", alarms)]))),
            ("Average precision", Some(score_tables::headline(&[&evaluation]))),
            ("Errors of what was found", Some(score_tables::errors(metrics))),
            ("Counts", Some(score_tables::counts(metrics))),
            ("Detections that are neither right nor wrong", score_tables::neutral(metrics)),
        ];
        let main = main.into_iter().filter_map(|(title, table)| Some((title.to_owned(), table?)));
        let groups = evaluation
            .breakdowns
            .iter()
            .map(|of| (score_tables::title(of.axis).to_owned(), score_tables::groups(of)));
        let safety = score_tables::safety(&evaluation).into_iter().map(|table| {
            let head = table.head.first().map_or("", String::as_str).trim();
            (if head.is_empty() { "Safety".to_owned() } else { format!("Safety: {head}") }, table)
        });
        let main = main.map(|(title, table)| TitledTable { title, is_main: true, table });
        let rest = groups.chain(safety).map(|(title, table)| TitledTable { title, is_main: false, table });
        Ok(Self {
            standing: provenance.as_ref().and_then(Provenance::standing).map(|standing| standing.to_string()),
            command: provenance.map(|of| of.command),
            tables: main.chain(rest).collect(),
        })
    }
}
