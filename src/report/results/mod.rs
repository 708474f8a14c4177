//! The results of an experiment of trainings: `results.json`, which `make results` writes.

mod answers;
mod blocks;
mod reported;
mod seeds;
pub mod test_data;
mod towns;

pub use answers::QuestionConfig;
pub use blocks::{blocks, headline_blocks};
pub use reported::{ReportedGroup, ReportedRecord, ReportedSet};
pub use seeds::{SeedMean, SeedMeans};

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use fs_err as fs;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::dataset::Fingerprint;
use crate::eval::safety::Alarms;
use crate::eval::versus::Versus;
use crate::eval::{ClassScores, Column, Columns, Confidence};

/// Why results could not be read.
#[derive(Debug, Error)]
pub enum ReadResultsError {
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error("this is not the results.json of `make results`: {source}: {}", path.display())]
    Broken { source: serde_json::Error, path: PathBuf },
}

/// An experiment, finished or under way.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// Version of the program that wrote it.
    pub version: String,
    /// Which target made it, from which config; empty in what older versions wrote.
    #[serde(default)]
    pub made_by: String,
    pub data: DataRecord,
    /// The headline's figures on split test; none until they are asked for.
    #[serde(default)]
    pub reported: Option<ReportedRecord>,
    /// Those of the headline's repeats.
    #[serde(default)]
    pub reported_repeats: Vec<ReportedRecord>,
    /// The headline and its repeats as one detector, with intervals.
    #[serde(default)]
    pub seed_means: Option<SeedMeans>,
    /// `key=value` that all rows but the headline share, over configs/train.toml.
    pub common: Vec<String>,
    /// `None` until it is trained and scored.
    pub headline: Option<Record>,
    /// The rows that are done, in the config's order.
    pub rows: Vec<Record>,
    /// Rows trained once more, those that are done: the headline's, then in the config's order.
    #[serde(default)]
    pub repeats: Vec<Repeat>,
    pub tables: Vec<TableConfig>,
    /// Rows on the same samples of the OOD set; empty in what older versions wrote.
    #[serde(default)]
    pub side_by_side: Vec<SideBySide>,
    /// The rivals whose row is done, in the config's order.
    pub rivals: Vec<RivalRecord>,
    /// For each row with rivals: the median time of a sample through its network, cloud and packed image to
    /// boxes, milliseconds.
    pub network_ms: BTreeMap<String, f64>,
}

/// Both data sets.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct DataRecord {
    /// Preset of `harmzone gen`.
    pub preset: String,
    pub id: SetRecord,
    pub ood: SetRecord,
}

/// A data set.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetRecord {
    /// Samples to train on, to validate on and to choose by.
    pub n_samples: [usize; 3],
    pub fingerprint: Fingerprint,
    /// Whether its config and its number of episodes are those of this program's preset.
    pub is_of_preset: bool,
}

/// A trained and scored row.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Record {
    pub name: String,
    /// `--model` of its training.
    pub profile: String,
    /// `key=value` in which its training differs from the profile's.
    pub set: Vec<String>,
    pub seed: u64,
    /// Epochs of the LiDAR stage and of the fused stage.
    pub epochs: [usize; 2],
    /// Numbers that training changed.
    pub n_parameters: usize,
    /// Time of the training on the clock and of all threads together, seconds; unknown for a run that did not keep it.
    pub wall_and_cpu_s: Option<[f64; 2]>,
    pub checkpoint_sha256: String,
    pub checkpoint_bytes: usize,
    /// The experiment's data: in distribution, of which it was trained on one split and scored on another, and out of it.
    pub trained_on: Fingerprint,
    pub tested_on: Fingerprint,
    /// What it was trained on, where that is other data than the experiment's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub learned_from: Option<Fingerprint>,
    /// AP on the validation split, in distribution.
    pub id: ClassScores,
    /// AP on the OOD set, in the four columns of Table III.
    pub ood: Columns<ClassScores>,
    /// With neutral detections as false positives, where there may be such; unknown in what older versions wrote.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strict: Option<SetScores>,
    /// Missed harm on both sets; unknown in what older versions wrote.
    #[serde(default)]
    pub missed: MissedHarm,
    /// Of the APs.
    #[serde(default)]
    pub confidence: SetConfidence,
}

/// The training of a row once more from another seed, and nothing else changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Repeat {
    /// Name of the row.
    pub row: String,
    /// Under a name of its own.
    pub record: Record,
}

/// Missed harm at fixed false alarms.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct MissedHarm {
    /// On the validation split, in distribution.
    pub id: Option<Alarms>,
    /// On the OOD set.
    pub ood: Option<Alarms>,
}

/// Intervals of the APs by a bootstrap over the episodes; unknown in what older versions wrote.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SetConfidence {
    /// On the validation split, in distribution.
    pub id: Option<Confidence>,
    /// On the OOD set.
    pub ood: Option<Confidence>,
}

/// A table of rows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TableConfig {
    pub title: String,
    /// A sentence above the table, without figures: those come from results.
    pub note: String,
    pub rows: Vec<RowOf>,
}

/// A row's place in a table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RowOf {
    pub label: String,
    /// Name of the row.
    pub row: String,
}

/// Rows side by side on the OOD set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SideBySide {
    pub title: String,
    pub note: String,
    /// The rows' names in the tables, the first one to measure by.
    pub labels: Vec<String>,
    pub of: Versus,
    /// On split test; none until it is asked for.
    #[serde(default)]
    pub reported: Option<ReportedVersus>,
    /// What it is to answer at the top of the results.
    #[serde(default)]
    pub questions: Vec<QuestionConfig>,
}

/// Rows side by side on split test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReportedVersus {
    /// What the program was built from, as `git describe` tells it.
    pub commit: String,
    /// The commit's date, or the one that was given.
    pub date: String,
    /// Of the data.
    pub fingerprint: Fingerprint,
    pub of: Versus,
}

/// One line of the table of rivals: a judge over the boxes of one network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RivalRecord {
    pub label: String,
    /// The row whose boxes are judged.
    pub row: String,
    pub scores: JudgeScores,
}

/// A judge's results on one network's boxes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JudgeScores {
    /// Its name.
    pub judge: String,
    /// Median time of one sample through the judge, milliseconds.
    pub judge_ms: f64,
    /// Scores with both sensors right.
    pub right: SetScores,
    /// Missed harm with both sensors right.
    #[serde(default)]
    pub missed: MissedHarm,
    /// Of the APs with both sensors right.
    #[serde(default)]
    pub confidence: SetConfidence,
    /// Scores with the speed measured too low and too high, and the steering angle too far right and left.
    pub speed_off: [SetScores; 2],
    pub steering_off: [SetScores; 2],
}

/// AP on both sets.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SetScores {
    /// AP on the validation split, in distribution.
    pub id: ClassScores,
    /// AP on the OOD set.
    pub ood: Columns<ClassScores>,
}

impl Record {
    /// The five groups of figures: ID, then the columns of the OOD set; `None` for ID.
    #[must_use]
    pub fn scores(&self) -> Vec<(Option<Column>, ClassScores)> {
        let ood = Column::ALL.into_iter().filter_map(|column| Some((Some(column), *self.ood.get(column)?)));
        std::iter::once((None, self.id)).chain(ood).collect()
    }

    /// Intervals of the means of [`Self::scores`], in their order.
    fn mean_intervals(&self) -> Vec<Option<[f64; 2]>> {
        let of = |confidence: &Option<Confidence>, column: Column| {
            confidence.as_ref().and_then(|of| of.columns.get(column)?.mean)
        };
        let ood = self.scores().into_iter().filter_map(|(column, _)| column);
        let ood = ood.map(|column| of(&self.confidence.ood, column));
        std::iter::once(of(&self.confidence.id, Column::Total)).chain(ood).collect()
    }

    /// In distribution there is no other column than the total.
    fn id_columns(&self) -> Columns<ClassScores> {
        Columns { total: self.id, id_matched: None, ood_all: None, ood_matched: None }
    }
}

impl Results {
    /// Reads `results.json`.
    ///
    /// # Errors
    /// The file is missing, or holds something else.
    pub fn read(path: &Path) -> Result<Self, ReadResultsError> {
        serde_json::from_str(&fs::read_to_string(path)?)
            .map_err(|source| ReadResultsError::Broken { source, path: path.to_owned() })
    }

    /// `results.json`.
    #[must_use]
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("names, numbers and lists have a JSON form") + "\n"
    }

    /// The row with this name, the headline included.
    #[must_use]
    pub fn row(&self, name: &str) -> Option<&Record> {
        self.headline.iter().chain(&self.rows).find(|record| record.name == name)
    }

    /// Whether any figure is of split test.
    #[must_use]
    pub fn has_reported(&self) -> bool {
        self.reported.is_some() || self.has_reported_rows()
    }

    /// Whether rows stand side by side on split test.
    fn has_reported_rows(&self) -> bool {
        self.side_by_side.iter().any(|of| of.reported.is_some())
    }

    /// The row with this name and its repeats; none where the row is not done.
    #[must_use]
    pub fn runs_of(&self, name: &str) -> Vec<&Record> {
        let repeats = self.repeats.iter().filter(|repeat| repeat.row == name).map(|repeat| &repeat.record);
        self.row(name).map(|first| std::iter::once(first).chain(repeats).collect()).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::test_data::test_results;
    use super::*;

    #[test]
    fn what_was_written_is_read_back_and_anything_else_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("results.json");
        fs::write(&path, test_results().to_json()).unwrap();
        assert_eq!(Results::read(&path).unwrap(), test_results());
        fs::write(&path, "# Results").unwrap();
        let message = Results::read(&path).unwrap_err().to_string();
        assert!(message.contains("make results") && message.ends_with("results.json"), "{message}");
    }
}
