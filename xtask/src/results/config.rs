//! Which rows are trained, over which schedule, and in which tables they stand.

use std::path::PathBuf;

use anyhow::{Context, bail, ensure};
use serde::{Deserialize, Serialize};

use harmzone::config::{self, Check};
use harmzone::dataset::blind::Sensor;
use harmzone::eval::judge::Judge;
use harmzone::generate::Preset;
use harmzone::model::Classes;
use harmzone::report::results::{QuestionConfig, TableConfig};
use harmzone::train::TrainConfig;

/// An experiment; `configs/results.toml` equals the default, `configs/ablations.toml` is another.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResultsConfig {
    /// What `RESULTS.md` says that it was written by. Default: `make results`, from `configs/results.toml`.
    #[serde(default = "made_by")]
    pub made_by: String,
    /// Preset of `harmzone gen` for both sets.
    pub preset: String,
    /// Seed of the drives of split test, in towns and maps. Default: the preset's.
    #[serde(default)]
    pub test_seed: Option<u64>,
    /// Maps in which split test is scored too, by path; what is not there is told and left out. Default: none.
    #[serde(default)]
    pub test_maps: Vec<PathBuf>,
    /// Name of the row above all tables: the network that ships. It stands alone, without the common keys.
    pub headline: RowConfig,
    /// `key=value` over configs/train.toml for every other row; a row's own keys go over these. Default: none.
    #[serde(default)]
    pub common: Vec<String>,
    /// One training each. Default: none.
    #[serde(default)]
    pub rows: Vec<RowConfig>,
    #[serde(default)]
    pub tables: Vec<TableConfig>,
    /// Finished runs that stand side by side with rows, and nowhere else. Default: none.
    #[serde(default)]
    pub given: Vec<GivenConfig>,
    /// Rows that are trained again from other seeds. Default: none.
    #[serde(default)]
    pub seeds: Option<SeedsConfig>,
    /// Rows on the same samples of the OOD set, with what each gains over the first. Default: none.
    #[serde(default)]
    pub side_by_side: Vec<SideBySideConfig>,
    /// Lines of the table of rivals, scored with both sensors right and off. Default: none.
    #[serde(default)]
    pub rivals: Vec<RivalConfig>,
    /// The training of a closed set, over the common keys: a network that tells kinds; its lines follow the rivals'.
    /// Default: none.
    #[serde(default)]
    pub closed_set: Option<RowConfig>,
}

/// A training that is done, from one seed or several.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GivenConfig {
    /// As of a row.
    pub name: String,
    /// Folders of its runs, which differ in their seed alone.
    pub runs: Vec<PathBuf>,
}

/// Rows to train once more for each of some seeds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SeedsConfig {
    pub values: Vec<u64>,
    /// Names of the rows.
    pub rows: Vec<String>,
}

/// Rows side by side.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SideBySideConfig {
    pub title: String,
    /// A sentence above the tables, without figures: those come from results.
    pub note: String,
    pub rows: Vec<SeenRowConfig>,
    /// What it is to answer at the top of the results. Default: nothing.
    #[serde(default)]
    pub questions: Vec<QuestionConfig>,
}

/// A row that sees all, or one sensor's part of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SeenRowConfig {
    pub label: String,
    /// Name of the row, or of a given run; where that tells kinds, as the closed set does, a rule judges its boxes.
    pub row: String,
    /// The sensor that sees nothing. Default: none.
    #[serde(default)]
    pub blind: Option<Sensor>,
    /// Who decides on harm. Default: the network.
    #[serde(default = "network")]
    pub judge: Judge,
}

fn made_by() -> String {
    "make results, from configs/results.toml".to_owned()
}

fn network() -> Judge {
    Judge::Network
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
    pub fn trainings(&self) -> anyhow::Result<Vec<(String, TrainConfig)>> {
        ensure!(
            Preset::named(&self.preset).is_some(),
            "results config: no preset `{}`; there are: {}",
            self.preset,
            Preset::ALL.map(Preset::name).join(", ")
        );
        let headline = std::iter::once((&self.headline, [].as_slice()));
        let mut trainings: Vec<(String, TrainConfig)> = Vec::new();
        for (row, common) in headline.chain(self.rows.iter().map(|row| (row, self.common.as_slice()))) {
            let is_taken = trainings.iter().any(|(name, _)| *name == row.name);
            trainings.push((row.name.clone(), row.training(common, is_taken)?));
        }
        let closed_set = self.closed_set_training()?;
        self.check_given()?;
        let all: Vec<String> = trainings.iter().map(|(name, _)| name.clone()).collect();
        let rows = all[1..].to_vec();
        let closed_set_names = closed_set.iter().map(|(name, _)| name.clone());
        let given = self.given.iter().map(|of| of.name.clone());
        let beside: Vec<String> = all.iter().cloned().chain(closed_set_names).chain(given).collect();
        let in_tables = self.tables.iter().flat_map(|table| {
            table.rows.iter().map(|of| (format!("table `{}`", table.title), &of.row, &rows))
        });
        let in_side_by_side = self.side_by_side.iter().flat_map(|of| {
            of.rows.iter().map(|row| (format!("side_by_side `{}`", of.title), &row.row, &beside))
        });
        let in_rivals = self.rivals.iter().map(|of| (format!("rivals `{}`", of.label), &of.row, &all));
        for (place, row, valid) in in_tables.chain(in_side_by_side).chain(in_rivals) {
            ensure!(
                valid.contains(row),
                "results config: {place} names row `{row}`; there are: {}",
                valid.join(", ")
            );
        }
        if let Some((name, _)) =
            trainings.iter().find(|(_, config)| config.model.head.classes == Classes::Kind)
        {
            bail!("row `{name}` tells kinds, not harm; the closed set is the place of such a network");
        }
        let known = trainings.iter().chain(&closed_set).map(|(name, config)| (name.as_str(), config));
        self.check_side_by_side(&known.collect::<Vec<_>>())?;
        self.repeats_of(&trainings)?;
        Ok(trainings)
    }

    /// Each row's trainings from other seeds, with the row's name.
    ///
    /// # Errors
    /// As [`Self::trainings`].
    pub fn repeats(&self) -> anyhow::Result<Vec<(String, (String, TrainConfig))>> {
        self.repeats_of(&self.trainings()?)
    }

    fn repeats_of(
        &self,
        trainings: &[(String, TrainConfig)],
    ) -> anyhow::Result<Vec<(String, (String, TrainConfig))>> {
        let Some(SeedsConfig { values, rows }) = &self.seeds else { return Ok(Vec::new()) };
        let closed_set = self.closed_set_training()?;
        let mut repeats: Vec<(String, (String, TrainConfig))> = Vec::new();
        for row in rows {
            let valid = || trainings[1..].iter().chain(&closed_set);
            let Some((_, config)) = valid().find(|(name, _)| name == row) else {
                let names: Vec<&str> = valid().map(|(name, _)| name.as_str()).collect();
                bail!("results config: seeds names row `{row}`; there are: {}", names.join(", "));
            };
            for &seed in values {
                let name = repeat_name(row, seed);
                let is_taken = repeats.iter().any(|(_, (other, _))| *other == name)
                    || trainings.iter().any(|(other, _)| *other == name);
                ensure!(
                    seed != config.seed && !is_taken,
                    "results config: seeds trains row `{row}` twice from seed {seed}; other seeds than {}, each once, are needed",
                    config.seed
                );
                repeats.push((row.clone(), (name, TrainConfig { seed, ..config.clone() })));
            }
        }
        Ok(repeats)
    }

    /// Each given training has a run, and a name of its own.
    fn check_given(&self) -> anyhow::Result<()> {
        let others = self.rows.iter().chain([&self.headline]).chain(&self.closed_set).map(|row| &row.name);
        let others: Vec<&String> = others.collect();
        for (i, GivenConfig { name, runs }) in self.given.iter().enumerate() {
            let is_taken = others.contains(&name) || self.given[..i].iter().any(|other| other.name == *name);
            ensure!(
                is_word(name) && !is_taken,
                "results config: given `{name}`; letters, digits, `-` and `_` are needed, each name once"
            );
            ensure!(
                !runs.is_empty(),
                "results config: given `{name}` has no run; one or more are needed, e.g. runs = [\"runs/{name}\"]"
            );
        }
        Ok(())
    }

    /// That the rows side by side can be asked what they are asked, as far as their trainings are known; those that are given are so
    /// once they are read.
    ///
    /// # Errors
    /// Names the rows that do not fit.
    pub fn check_side_by_side(&self, trainings: &[(&str, &TrainConfig)]) -> anyhow::Result<()> {
        self.side_by_side.iter().try_for_each(|of| check_side_by_side(of, trainings))
    }

    /// The closed set's training, if there is one.
    ///
    /// # Errors
    /// Its keys do not fit, or its network tells harm.
    pub fn closed_set_training(&self) -> anyhow::Result<Option<(String, TrainConfig)>> {
        let Some(row) = &self.closed_set else { return Ok(None) };
        let is_taken = self.rows.iter().chain([&self.headline]).any(|other| other.name == row.name);
        let training = row.training(&self.common, is_taken)?;
        ensure!(
            training.model.head.classes == Classes::Kind,
            "row `{}` is the closed set's, but its network tells harm; model.head.classes=kind is needed",
            row.name
        );
        Ok(Some((row.name.clone(), training)))
    }
}

/// Two rows or more, each with a label of its own, none blinded in a sensor that its network does not have, and none asked for harm
/// that tells kinds.
fn check_side_by_side(of: &SideBySideConfig, trainings: &[(&str, &TrainConfig)]) -> anyhow::Result<()> {
    let title = &of.title;
    ensure!(
        of.rows.len() >= 2,
        "results config: side_by_side `{title}` has {} rows; two are needed",
        of.rows.len()
    );
    for (i, row) in of.rows.iter().enumerate() {
        let is_new = of.rows[..i].iter().all(|other| other.label != row.label);
        ensure!(is_new, "results config: side_by_side `{title}` has two rows called `{}`", row.label);
        let training = trainings.iter().find(|(name, _)| *name == row.row).map(|(_, config)| *config);
        let Some(TrainConfig { model, .. }) = training else { continue };
        ensure!(
            model.head.classes != Classes::Kind || !row.judge.asks_the_network(),
            "results config: side_by_side `{title}` asks row `{}` for harm, but a closed set tells kinds; give it a judge of boxes \
             alone, such as zone-expected",
            row.row
        );
        let sees = match row.blind {
            Some(Sensor::Camera) => model.use_camera,
            Some(Sensor::Lidar) => model.use_lidar,
            None => true,
        };
        ensure!(
            sees,
            "results config: side_by_side `{title}` blinds a sensor of row `{}` that its network does not have",
            row.row
        );
    }
    let asked = of.rows.iter().skip(1).map(|row| row.label.as_str());
    let asked: Vec<&str> = asked.collect();
    for question in &of.questions {
        ensure!(
            asked.contains(&question.row.as_str()),
            "results config: side_by_side `{title}` asks what `{}` is beside the first row; there are: {}",
            question.row,
            asked.join(", ")
        );
    }
    Ok(())
}

/// What a row is called when it is trained once more.
pub fn repeat_name(row: &str, seed: u64) -> String {
    format!("{row}-seed-{seed}")
}

fn is_word(name: &str) -> bool {
    !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_')
}

impl RowConfig {
    /// The training with the common keys and, over them, the row's own.
    fn training(&self, common: &[String], is_taken: bool) -> anyhow::Result<TrainConfig> {
        let Self { name, set } = self;
        ensure!(
            is_word(name) && !is_taken,
            "results config: row name `{name}`; letters, digits, `-` and `_` are needed, each name once"
        );
        let training = config::with_overrides(&TrainConfig::default(), &[common, set].concat())
            .with_context(|| format!("row `{name}`"))?;
        training.check().with_context(|| format!("row `{name}`"))?;
        Ok(training)
    }
}

#[cfg(test)]
mod tests;
