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
mod tests {
    use super::*;
    use harmzone::model::NumericFusion;

    fn ablations() -> ResultsConfig {
        toml::from_str(include_str!("../../../configs/ablations.toml")).unwrap()
    }

    #[test]
    fn what_ships_stands_beside_its_rivals_and_every_judge_of_boxes_is_told() {
        let config = ResultsConfig::default();
        let trainings = config.trainings().unwrap();
        assert_eq!(trainings.len(), 1, "nothing is trained but the headline, where it is not given");
        assert_eq!(trainings[0].1, TrainConfig::default());
        let given: Vec<&str> = config.given.iter().map(|of| of.name.as_str()).collect();
        assert_eq!(given, ["lidar", "kinds"]);
        let beside =
            |name: &str| config.side_by_side.iter().any(|of| of.rows.iter().any(|row| row.row == name));
        assert!(given.iter().all(|name| beside(name)));
        assert!(!ablations().trainings().unwrap().is_empty());
    }

    #[test]
    fn a_given_run_has_a_name_of_its_own_and_is_asked_what_it_can_tell() {
        let wrong = |change: fn(&mut ResultsConfig)| {
            let mut config = ResultsConfig::default();
            change(&mut config);
            format!("{:#}", config.trainings().unwrap_err())
        };
        let message = wrong(|config| config.given[1].name = "lidar".into());
        assert!(message.contains("given `lidar`") && message.contains("each name once"), "{message}");
        let message = wrong(|config| config.given[0].name = "small".into());
        assert!(message.contains("given `small`"), "{message}");
        let message = wrong(|config| config.given[0].runs.clear());
        assert!(message.contains("given `lidar` has no run"), "{message}");
        let message = wrong(|config| config.side_by_side[0].rows[0].row = "radar".into());
        assert!(message.contains("names row `radar`; there are: small, lidar, kinds"), "{message}");
        // Once they are read.
        let config = ResultsConfig::default();
        let small = TrainConfig::default();
        let mut kinds = small.clone();
        kinds.model.head.classes = Classes::Kind;
        let mut lidar = small.clone();
        lidar.model.use_camera = false;
        let known = [("small", &small), ("lidar", &lidar), ("kinds", &kinds)];
        config.check_side_by_side(&known).unwrap();
        let mut asked = config.clone();
        asked.side_by_side[1].rows[0].judge = Judge::Network;
        let message = asked.check_side_by_side(&known).unwrap_err().to_string();
        assert!(message.contains("asks row `kinds` for harm"), "{message}");
        let mut blinded = config;
        blinded.side_by_side[0].rows[0].blind = Some(Sensor::Camera);
        let message = blinded.check_side_by_side(&known).unwrap_err().to_string();
        assert!(message.contains("blinds a sensor of row `lidar`"), "{message}");
    }

    #[test]
    fn the_rows_are_the_ablations_and_see_each_sample_equally_often() {
        let config = ablations();
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
            let mut config = ablations();
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
            let config = ResultsConfig { seeds, ..ablations() };
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
