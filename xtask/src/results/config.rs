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

/// An experiment; `configs/results.toml` equals the default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResultsConfig {
    /// Preset of `harmzone gen` for both sets.
    pub preset: String,
    /// Maps in which split test is scored too, by path; what is not there is told and left out. Default: none.
    #[serde(default)]
    pub test_maps: Vec<PathBuf>,
    /// Name of the row above all tables: the network that ships. It stands alone, without the common keys.
    pub headline: RowConfig,
    /// `key=value` over configs/train.toml for every other row; a row's own keys go over these.
    pub common: Vec<String>,
    /// One training each.
    pub rows: Vec<RowConfig>,
    pub tables: Vec<TableConfig>,
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
    /// Name of the row; the closed set's, too, where a rule judges its boxes.
    pub row: String,
    /// The sensor that sees nothing. Default: none.
    #[serde(default)]
    pub blind: Option<Sensor>,
    /// Who decides on harm. Default: the network.
    #[serde(default = "network")]
    pub judge: Judge,
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
        let places = self.tables.iter().flat_map(|table| {
            table.rows.iter().map(|of| (format!("table `{}`", table.title), &of.row, &trainings[1..]))
        });
        let side_by_side = self.side_by_side.iter().flat_map(|of| {
            let rows = of.rows.iter().filter(|seen| !self.is_closed_set(&seen.row));
            rows.map(|row| (format!("side_by_side `{}`", of.title), &row.row, &trainings[..]))
        });
        let rivals = self.rivals.iter().map(|of| (format!("rivals `{}`", of.label), &of.row, &trainings[..]));
        for (place, row, valid) in places.chain(side_by_side).chain(rivals) {
            ensure!(
                valid.iter().any(|(name, _)| name == row),
                "results config: {place} names row `{row}`; there are: {}",
                valid.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ")
            );
        }
        let all: Vec<&(String, TrainConfig)> = trainings.iter().chain(&closed_set).collect();
        for of in &self.side_by_side {
            let asked =
                of.rows.iter().find(|seen| self.is_closed_set(&seen.row) && seen.judge.asks_the_network());
            if let Some(seen) = asked {
                bail!(
                    "results config: side_by_side `{}` asks row `{}` for harm, but a closed set tells kinds; give it a judge of boxes \
                     alone, such as zone-expected",
                    of.title,
                    seen.row
                );
            }
            check_side_by_side(of, &all)?;
        }
        if let Some((name, _)) =
            trainings.iter().find(|(_, config)| config.model.head.classes == Classes::Kind)
        {
            bail!("row `{name}` tells kinds, not harm; the closed set is the place of such a network");
        }
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

    fn is_closed_set(&self, row: &str) -> bool {
        self.closed_set.as_ref().is_some_and(|of| of.name == row)
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

/// Two rows or more, each with a label of its own, and no sensor blinded that the network does not have.
fn check_side_by_side(of: &SideBySideConfig, trainings: &[&(String, TrainConfig)]) -> anyhow::Result<()> {
    let title = &of.title;
    ensure!(
        of.rows.len() >= 2,
        "results config: side_by_side `{title}` has {} rows; two are needed",
        of.rows.len()
    );
    for (i, row) in of.rows.iter().enumerate() {
        let is_new = of.rows[..i].iter().all(|other| other.label != row.label);
        ensure!(is_new, "results config: side_by_side `{title}` has two rows called `{}`", row.label);
        let model = trainings.iter().find(|(name, _)| *name == row.row).map(|(_, config)| &config.model);
        let sees = model.is_some_and(|model| match row.blind {
            Some(Sensor::Camera) => model.use_camera,
            Some(Sensor::Lidar) => model.use_lidar,
            None => true,
        });
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

impl RowConfig {
    /// The training with the common keys and, over them, the row's own.
    fn training(&self, common: &[String], is_taken: bool) -> anyhow::Result<TrainConfig> {
        let Self { name, set } = self;
        let is_word =
            !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
        ensure!(
            is_word && !is_taken,
            "results config: row name `{name}`; letters, digits, `-` and `_` are needed, each name once"
        );
        let training = config::with_overrides(&TrainConfig::default(), &[common, set].concat())
            .with_context(|| format!("row `{name}`"))?;
        training.check().with_context(|| format!("row `{name}`"))?;
        Ok(training)
    }
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
        assert!(base.model.use_lidar && base.model.use_camera && base.lidar_stage.epochs == 0);
        assert_eq!(base.model.head.numeric_fusion, NumericFusion::Film);
        assert!(!of("lidar").model.use_camera && !of("camera").model.use_lidar);
        assert_eq!(of("numeric-none").model.head.numeric_fusion, NumericFusion::None);
        assert_eq!(of("numeric-paper").model.head.numeric_fusion, NumericFusion::Paper);
        assert!(of("two-stages").lidar_stage.epochs > 0 && of("two-stages").fused_stage.epochs > 0);
        let bare = &of("unaugmented").augment;
        assert_eq!(
            (bare.mirror, bare.max_pasted, bare.n_redrawn_states, bare.disturbed_share),
            (false, 0, 0, 0.0)
        );
        let epochs = |config: &TrainConfig| config.lidar_stage.epochs + config.fused_stage.epochs;
        assert!(trainings[1..].iter().all(|(_, config)| epochs(config) == epochs(base)));
        // Every row stands in a table.
        let placed = |name: &str| config.tables.iter().flat_map(|table| &table.rows).any(|of| of.row == name);
        assert!(config.rows.iter().all(|row| placed(&row.name)));
        // Repeats differ from their rows in the seed alone.
        for (row, (name, repeat)) in config.repeats().unwrap() {
            let closed_set = config.closed_set_training().unwrap();
            let once = trainings.iter().chain(&closed_set).find(|(name, _)| *name == row).unwrap();
            assert_eq!(TrainConfig { seed: once.1.seed, ..repeat.clone() }, once.1);
            assert_eq!(name, repeat_name(&row, repeat.seed));
        }
        // Every judge is told of one network, which is no other than a table's.
        let judged = |judge| config.rivals.iter().any(|rival| rival.row == "fused" && rival.judge == judge);
        assert!(Judge::ALL.into_iter().all(judged));
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let wrong = |change: fn(&mut ResultsConfig)| {
            let mut config = ResultsConfig::default();
            change(&mut config);
            format!("{:#}", config.trainings().unwrap_err())
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
        let message = wrong(|config| config.side_by_side[0].rows[0].row = "radar".into());
        assert!(message.contains("side_by_side") && message.contains("radar"), "{message}");
        let message = wrong(|config| config.side_by_side[0].rows[0].blind = Some(Sensor::Camera));
        assert!(message.contains("blinds") && message.contains("lidar"), "{message}");
        let seeds = |values: &[u64], row: &str| {
            let seeds = Some(SeedsConfig { values: values.to_vec(), rows: vec![row.to_owned()] });
            let config = ResultsConfig { seeds, ..ResultsConfig::default() };
            format!("{:#}", config.trainings().unwrap_err())
        };
        assert!(seeds(&[1], "radar").contains("radar") && seeds(&[1], "radar").contains("lidar"));
        assert!(seeds(&[1], "small").contains("seeds names row"), "the headline's runs are given");
        assert!(
            seeds(&[0], "lidar").contains("twice from seed 0") && seeds(&[2, 2], "lidar").contains("twice")
        );
        let message = wrong(|config| config.side_by_side[0].rows[0].row = "kinds".into());
        assert!(
            message.contains("asks row `kinds` for harm") && message.contains("zone-expected"),
            "{message}"
        );
        let message = wrong(|config| config.rows[0].set.push("model.head.classes=kind".into()));
        assert!(message.contains("row `fused` tells kinds"), "{message}");
        let message = wrong(|config| config.side_by_side[0].rows.truncate(1));
        assert!(message.contains("two are needed"), "{message}");
        let message = wrong(|config| config.side_by_side[0].questions[0].row = "LiDAR".into());
        assert!(
            message.contains("asks what `LiDAR` is") && message.contains("camera, LiDAR and black pictures"),
            "{message}"
        );
        let message = wrong(|config| config.rows[0].name = "a/b".into());
        assert!(message.contains("a/b"), "{message}");
        let message = wrong(|config| config.rows[1].name = config.rows[0].name.clone());
        assert!(message.contains("each name once"), "{message}");
        let message = wrong(|config| config.rows[0].set.push("model.use_radar=true".into()));
        assert!(message.contains("use_radar") && message.contains("fused"), "{message}");
        let message = wrong(|config| config.rows[0].set.push("model.head.dropout=nan".into()));
        assert!(message.contains("fused") && message.contains("model.head.dropout is nan"), "{message}");
        let message = wrong(|config| {
            config.rows[0].set.extend(["lidar_stage.epochs=2".into(), "fused_stage.epochs=0".into()]);
        });
        assert!(message.contains("fused_stage.epochs"), "{message}");
    }
}
