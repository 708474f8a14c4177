//! What an experiment came to, as `results.json` and `results.csv` hold it.

use serde::{Deserialize, Serialize};

use super::config::TableConfig;
use harmzone::dataset::Fingerprint;
use harmzone::eval::{ClassScores, Column, Columns};
use harmzone::train::TrainingTime;

/// An experiment, finished or under way.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// Of the program that wrote it.
    pub version: String,
    pub data: DataRecord,
    /// `key=value` that all rows but the headline share, over configs/train.toml.
    pub common: Vec<String>,
    /// Once it is trained and scored.
    pub headline: Option<Record>,
    /// Those that are done, in the config's order.
    pub rows: Vec<Record>,
    pub tables: Vec<TableConfig>,
    /// Those whose row is done, in the config's order.
    #[serde(default)]
    pub rivals: Vec<RivalRecord>,
}

/// One line of the table of rivals.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RivalRecord {
    pub label: String,
    /// Whose boxes.
    pub row: String,
    pub scores: JudgeScores,
}

/// A judge over one network's boxes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JudgeScores {
    /// Its name.
    pub judge: String,
    /// Median time of one sample, milliseconds: through the network, cloud and packed image to boxes, and through the
    /// judge.
    pub network_ms: f64,
    pub judge_ms: f64,
    /// Both sensors right.
    pub right: SetScores,
    /// Speed measured too low and too high, steering angle measured too far right and left.
    pub speed_off: [SetScores; 2],
    pub steering_off: [SetScores; 2],
}

/// AP on both sets.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SetScores {
    /// On the validation split, in distribution.
    pub id: ClassScores,
    /// On the OOD set.
    pub ood: Columns<ClassScores>,
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
    /// Samples to train on, to validate on and to test on.
    pub n_samples: [usize; 3],
    pub fingerprint: Fingerprint,
    /// Whether its config and its number of episodes are what this program's preset says.
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
    /// Of the LiDAR stage and of the fused stage.
    pub epochs: [usize; 2],
    /// Numbers that training changed.
    pub n_parameters: usize,
    /// Unknown for a run that did not keep it.
    pub spent: Option<TrainingTime>,
    pub checkpoint_sha256: String,
    pub checkpoint_bytes: usize,
    /// Data it was trained on, and was tested on out of distribution.
    pub trained_on: Fingerprint,
    pub tested_on: Fingerprint,
    /// AP on the validation split, in distribution.
    pub id: ClassScores,
    /// AP on the OOD set, in the four columns of Table III.
    pub ood: Columns<ClassScores>,
}

impl Record {
    /// The five groups of figures: ID, then the columns of the OOD set; `None` for ID.
    #[must_use]
    pub fn scores(&self) -> Vec<(Option<Column>, ClassScores)> {
        let ood = Column::ALL.into_iter().filter_map(|column| Some((Some(column), *self.ood.get(column)?)));
        std::iter::once((None, self.id)).chain(ood).collect()
    }
}

/// Short names of the groups, as columns of `results.csv` begin.
fn key(column: Option<Column>) -> &'static str {
    match column {
        None => "id",
        Some(Column::Total) => "ood_total",
        Some(Column::IdMatched) => "ood_id_matched",
        Some(Column::OodAll) => "ood_all",
        Some(Column::OodMatched) => "ood_matched",
    }
}

impl Results {
    /// The row of a name, the headline included.
    #[must_use]
    pub fn row(&self, name: &str) -> Option<&Record> {
        self.headline.iter().chain(&self.rows).find(|record| record.name == name)
    }

    /// `results.json`.
    #[must_use]
    pub fn to_json(&self) -> String {
        let mut text = serde_json::to_string_pretty(self).expect("names, numbers and lists have a JSON form");
        text.push('\n');
        text
    }

    /// `results.csv`: a line a row, the headline's first; times in seconds.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut writer = csv::Writer::from_writer(Vec::new());
        let groups = [None].into_iter().chain(Column::ALL.map(Some));
        let mut header: Vec<String> =
            ["name", "seed", "n_parameters", "wall_s", "cpu_s"].map(str::to_owned).into();
        header.extend(groups.flat_map(|group| {
            ["harmful", "harmless", "mean"].map(|class| format!("{}_{class}", key(group)))
        }));
        let expect = "writing to memory cannot fail";
        writer.write_record(&header).expect(expect);
        for record in self.headline.iter().chain(&self.rows) {
            let time = |of: fn(&TrainingTime) -> f64| {
                record.spent.as_ref().map(of).map_or_else(String::new, |s| s.to_string())
            };
            let mut line = vec![
                record.name.clone(),
                record.seed.to_string(),
                record.n_parameters.to_string(),
                time(|spent| spent.wall_s),
                time(|spent| spent.cpu_s),
            ];
            for (_, scores) in record.scores() {
                line.extend([scores.harmful, scores.harmless, scores.mean].map(|ap| format!("{ap:.4}")));
            }
            writer.write_record(&line).expect(expect);
        }
        String::from_utf8(writer.into_inner().expect(expect)).expect("names and numbers are text")
    }
}
