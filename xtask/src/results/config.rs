//! Which rows are trained, over which schedule, and in which tables they stand.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use harmzone::config::{self, ConfigError};
use harmzone::eval::judge::Judge;
use harmzone::generate::Preset;
use harmzone::model::Classes;
use harmzone::train::{TrainConfig, TrainConfigError};

/// An experiment; `configs/results.toml` equals the default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResultsConfig {
    /// Preset of `harmzone gen` for both sets.
    pub preset: String,
    /// Name of the row above all tables: the network that ships. It stands alone, without the common keys.
    pub headline: RowConfig,
    /// `key=value` over configs/train.toml for every other row; a row's own keys go over these.
    pub common: Vec<String>,
    /// One training each.
    pub rows: Vec<RowConfig>,
    pub tables: Vec<TableConfig>,
    /// Lines of the table of rivals, scored with both sensors right and off. Default: none.
    #[serde(default)]
    pub rivals: Vec<RivalConfig>,
    /// The training of a closed set, over the common keys: a network that tells kinds; its lines follow the rivals'.
    /// Default: none.
    #[serde(default)]
    pub closed_set: Option<RowConfig>,
}

/// Who decides on harm over whose boxes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RivalConfig {
    pub label: String,
    /// Name of the row whose boxes are judged, the headline's included.
    pub row: String,
    pub judge: Judge,
}

/// A training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RowConfig {
    /// Letters, digits, `-` and `_`: it names files.
    pub name: String,
    /// `key=value` of the training config.
    #[serde(default)]
    pub set: Vec<String>,
}

/// A table of rows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TableConfig {
    pub title: String,
    /// A sentence above the table.
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

/// What is wrong with an experiment's config.
#[derive(Debug, Error)]
pub enum ResultsConfigError {
    #[error("results config: no preset `{found}`; there are: {}", Preset::ALL.map(Preset::name).join(", "))]
    Preset { found: String },
    #[error("results config: row name `{found}`; letters, digits, `-` and `_` are needed, each name once")]
    Name { found: String },
    #[error("results config: table `{table}` names row `{found}`; there are: {}", valid.join(", "))]
    TableRow { table: String, found: String, valid: Vec<String> },
    #[error("row `{row}`: {source}")]
    Keys { row: String, source: ConfigError },
    #[error("row `{row}` is the closed set's, but its network tells harm; model.head.classes=kind is needed")]
    TellsHarm { row: String },
    #[error("row `{row}`: {source}")]
    Train { row: String, source: TrainConfigError },
    #[error("no row `{found}`; there are: {}", valid.join(", "))]
    Only { found: String, valid: Vec<String> },
}

impl Default for ResultsConfig {
    fn default() -> Self {
        toml::from_str(include_str!("../../../configs/results.toml")).expect("a test reads the shipped file")
    }
}

impl ResultsConfig {
    /// Each row's training, the headline's first.
    ///
    /// # Errors
    /// Names the row or table that does not fit.
    pub fn trainings(&self) -> Result<Vec<(String, TrainConfig)>, ResultsConfigError> {
        if Preset::named(&self.preset).is_none() {
            return Err(ResultsConfigError::Preset { found: self.preset.clone() });
        }
        let none = Vec::new();
        let others = self.rows.iter().map(|row| (row, &self.common));
        let mut trainings: Vec<(String, TrainConfig)> = Vec::new();
        for (row, common) in std::iter::once((&self.headline, &none)).chain(others) {
            let name = row.name.clone();
            if !is_word(&name) || trainings.iter().any(|(n, _)| *n == name) {
                return Err(ResultsConfigError::Name { found: name });
            }
            let training = training(&name, &[common.as_slice(), &row.set].concat())?;
            trainings.push((name, training));
        }
        for table in &self.tables {
            for RowOf { row, .. } in &table.rows {
                if !self.rows.iter().any(|known| known.name == *row) {
                    let valid = self.rows.iter().map(|row| row.name.clone()).collect();
                    let (table, found) = (table.title.clone(), row.clone());
                    return Err(ResultsConfigError::TableRow { table, found, valid });
                }
            }
        }
        self.closed_set_training()?;
        for RivalConfig { label, row, .. } in &self.rivals {
            if !trainings.iter().any(|(name, _)| name == row) {
                let valid = trainings.iter().map(|(name, _)| name.clone()).collect();
                let (table, found) = (format!("rivals: {label}"), row.clone());
                return Err(ResultsConfigError::TableRow { table, found, valid });
            }
        }
        Ok(trainings)
    }

    /// The closed set's training, if there is one.
    ///
    /// # Errors
    /// Its keys do not fit, or its network tells harm.
    pub fn closed_set_training(&self) -> Result<Option<(String, TrainConfig)>, ResultsConfigError> {
        let Some(RowConfig { name, set }) = &self.closed_set else { return Ok(None) };
        let is_taken = self.rows.iter().chain([&self.headline]).any(|row| row.name == *name);
        if !is_word(name) || is_taken {
            return Err(ResultsConfigError::Name { found: name.clone() });
        }
        let training = training(name, &[self.common.as_slice(), set].concat())?;
        if training.model.head.classes != Classes::Kind {
            return Err(ResultsConfigError::TellsHarm { row: name.clone() });
        }
        Ok(Some((name.clone(), training)))
    }
}

fn is_word(name: &str) -> bool {
    !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_')
}

/// The training of a row with these keys.
fn training(row: &str, keys: &[String]) -> Result<TrainConfig, ResultsConfigError> {
    let training = config::with_overrides(&TrainConfig::default(), keys)
        .map_err(|source| ResultsConfigError::Keys { row: row.to_owned(), source })?;
    training.check().map_err(|source| ResultsConfigError::Train { row: row.to_owned(), source })?;
    Ok(training)
}

#[cfg(test)]
mod tests {
    use super::*;
    use harmzone::model::NumericFusion;

    #[test]
    fn the_shipped_rows_are_the_ablations_and_see_each_sample_equally_often() {
        let config = ResultsConfig::default();
        let trainings = config.trainings().unwrap();
        assert_eq!(trainings[0].1, TrainConfig::default(), "the headline is what `harmzone train` does");
        let of = |name: &str| &trainings.iter().find(|(n, _)| n == name).unwrap().1;
        let base = of("fused");
        assert!(base.model.use_lidar && base.model.use_camera && base.lidar_stage.epochs > 0);
        assert_eq!(base.model.head.numeric_fusion, NumericFusion::Film);
        assert!(!of("lidar").model.use_camera && !of("camera").model.use_lidar);
        assert_eq!(of("numeric-none").model.head.numeric_fusion, NumericFusion::None);
        assert_eq!(of("numeric-paper").model.head.numeric_fusion, NumericFusion::Paper);
        assert_eq!(of("one-stage").lidar_stage.epochs, 0);
        let epochs = |config: &TrainConfig| config.lidar_stage.epochs + config.fused_stage.epochs;
        assert!(trainings[1..].iter().all(|(_, config)| epochs(config) == epochs(base)));
        // Every row stands in a table.
        let placed = |name: &str| config.tables.iter().flat_map(|table| &table.rows).any(|of| of.row == name);
        assert!(config.rows.iter().all(|row| placed(&row.name)));
        // Every judge is told of one network, which is no other than a table's.
        let judged = |judge| config.rivals.iter().any(|rival| rival.row == "fused" && rival.judge == judge);
        assert!(Judge::ALL.into_iter().all(judged));
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let wrong = |change: fn(&mut ResultsConfig)| {
            let mut config = ResultsConfig::default();
            change(&mut config);
            config.trainings().unwrap_err().to_string()
        };
        let message = wrong(|config| config.preset = "huge".into());
        assert!(message.contains("huge") && message.contains("small"), "{message}");
        let message = wrong(|config| config.tables[0].rows[0].row = "radar".into());
        assert!(message.contains("radar") && message.contains("lidar"), "{message}");
        let message = wrong(|config| config.closed_set.as_mut().unwrap().set.clear());
        assert!(message.contains("kinds") && message.contains("classes=kind"), "{message}");
        let message = wrong(|config| config.closed_set.as_mut().unwrap().name = "fused".into());
        assert!(message.contains("each name once"), "{message}");
        let message = wrong(|config| config.rivals[0].row = "radar".into());
        assert!(message.contains("rivals") && message.contains("radar"), "{message}");
        let message = wrong(|config| config.rows[0].name = "a/b".into());
        assert!(message.contains("a/b"), "{message}");
        let message = wrong(|config| config.rows[1].name = config.rows[0].name.clone());
        assert!(message.contains("each name once"), "{message}");
        let message = wrong(|config| config.rows[0].set.push("model.use_radar=true".into()));
        assert!(message.contains("use_radar") && message.contains("fused"), "{message}");
        let message = wrong(|config| config.rows[0].set.push("fused_stage.epochs=0".into()));
        assert!(message.contains("fused_stage.epochs"), "{message}");
    }
}
