//! Scenarios: short drives of one idea each, written as TOML, by harmzone (`scenarios/`) or by a user.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use fs_err as fs;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::DriveConfig;
use crate::config::{Check as _, ConfigError, InvalidConfig, with_table};
use crate::episode::Split;
use crate::generate::{CheckedConfig, EpisodePlan, GenerateConfig, GenerateError, plan};
use crate::scene::{ActorConfig, PopulateConfig, check_actors, shipped_scenarios};

/// Names the scenarios that come with harmzone.
pub const SUITE: &str = "suite";

/// One scenario.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// The file's name without its ending.
    #[serde(default)]
    pub name: String,
    /// What happens, in a sentence.
    pub idea: String,
    /// What it is counted with; by default its own.
    #[serde(default)]
    pub family: String,
    #[serde(default = "default_town")]
    pub town: String,
    #[serde(default = "default_weather")]
    pub weather: String,
    /// Chooses the ego's start and route, and all else that is drawn.
    #[serde(default)]
    pub seed: u64,
    /// Longest time.
    #[serde(default = "default_seconds")]
    pub seconds: f64,
    /// Keys of `[scene]` of configs/gen.toml over a quiet town: no traffic, nobody on foot, nothing unfamiliar but the actors.
    #[serde(default)]
    pub scene: toml::Table,
    #[serde(default)]
    pub actors: BTreeMap<String, ActorConfig>,
}

/// Why scenarios could not be read.
#[derive(Debug, Error)]
pub enum ScenarioError {
    #[error("no scenarios there: `{SUITE}`, a TOML file, or a folder of them is needed: {}", path.display())]
    None { path: PathBuf },
    #[error("not a scenario: {message}: {}", path.display())]
    Parse { message: String, path: PathBuf },
    #[error(
        "`{key}` has no place in [scene] of a scenario: actors stand under [actors], and the split is --split: {}", path.display()
    )]
    Key { key: &'static str, path: PathBuf },
    #[error("the actor's name is `{actor}`; a letter, then letters, digits, `-` and `_` are needed: {}", path.display())]
    ActorName { actor: String, path: PathBuf },
    #[error("seconds is {found}; a number from 1 to 3600 is needed: {}", path.display())]
    Seconds { found: f64, path: PathBuf },
    #[error("the scenario `{name}`: {source}")]
    Config { name: String, source: ConfigError },
    #[error("the scenario `{name}`: {source}")]
    Invalid { name: String, source: InvalidConfig },
    #[error("the scenario `{name}`: {source}")]
    World { name: String, source: GenerateError },
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

fn default_town() -> String {
    "downtown".to_owned()
}

fn default_weather() -> String {
    "ClearNoon".to_owned()
}

fn default_seconds() -> f64 {
    15.0
}

/// Reads the scenarios of a file, of a folder, or those that come with harmzone, by name.
///
/// # Errors
/// [`ScenarioError`] names the file, the line and the key.
pub fn load(of: &Path) -> Result<Vec<Scenario>, ScenarioError> {
    let texts: Vec<(PathBuf, String)> = if of == Path::new(SUITE) {
        shipped_scenarios().into_iter().map(|(path, text)| (path.into(), text.to_owned())).collect()
    } else if of.is_dir() {
        let mut paths: Vec<PathBuf> =
            fs::read_dir(of)?.map(|entry| Ok(entry?.path())).collect::<Result<_, std::io::Error>>()?;
        paths.retain(|path| path.extension().is_some_and(|ending| ending == "toml"));
        paths.sort();
        paths
            .into_iter()
            .map(|path| Ok((path.clone(), fs::read_to_string(path)?)))
            .collect::<Result<_, std::io::Error>>()?
    } else if of.is_file() {
        vec![(of.to_owned(), fs::read_to_string(of)?)]
    } else {
        Vec::new()
    };
    if texts.is_empty() {
        return Err(ScenarioError::None { path: of.to_owned() });
    }
    texts.iter().map(|(path, text)| parse(path, text)).collect()
}

fn parse(path: &Path, text: &str) -> Result<Scenario, ScenarioError> {
    let mut scenario: Scenario = toml::from_str(text)
        .map_err(|error| ScenarioError::Parse { message: error.to_string(), path: path.to_owned() })?;
    scenario.name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    if scenario.family.is_empty() {
        scenario.family.clone_from(&scenario.name);
    }
    let path = || path.to_owned();
    if let Some(key) =
        ["actors", "own_models", "split"].into_iter().find(|key| scenario.scene.contains_key(*key))
    {
        return Err(ScenarioError::Key { key, path: path() });
    }
    let is_name = |name: &str| {
        name.starts_with(|c: char| c.is_ascii_alphabetic())
            && name.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c))
    };
    if let Some(actor) = scenario.actors.keys().find(|name| !is_name(name)) {
        return Err(ScenarioError::ActorName { actor: actor.clone(), path: path() });
    }
    if !(1.0..=3600.0).contains(&scenario.seconds) {
        return Err(ScenarioError::Seconds { found: scenario.seconds, path: path() });
    }
    scenario.world(&GenerateConfig::default())?;
    Ok(scenario)
}

impl Scenario {
    /// The scenario's world, with the sensors of another config.
    ///
    /// # Errors
    /// An unknown key, or a number out of its bounds.
    pub fn world(&self, base: &GenerateConfig) -> Result<GenerateConfig, ScenarioError> {
        let quiet = PopulateConfig {
            split: base.scene.split,
            traffic_density: 0.0,
            leader_share: 0.0,
            pedestrian_density: 0.0,
            jaywalker_share: 0.0,
            ..PopulateConfig::default()
        };
        let scene = with_table(&quiet, &self.scene)
            .map_err(|source| ScenarioError::Config { name: self.name.clone(), source })?;
        let scene = PopulateConfig { actors: self.actors.clone(), ..scene };
        let world = GenerateConfig {
            towns: vec![self.town.clone()],
            weathers: vec![self.weather.clone()],
            seed: self.seed,
            scene,
            ..base.clone()
        };
        world.check().map_err(|source| ScenarioError::Invalid { name: self.name.clone(), source })?;
        Ok(world)
    }
}

/// A drive to be made: its config, checked, and its world.
pub(super) struct Course {
    pub config: DriveConfig,
    pub checked: CheckedConfig,
    pub plan: EpisodePlan,
    pub family: String,
}

/// The drive of an index.
///
/// # Errors
/// A scenario's config is not valid.
pub(super) fn course(
    config: &DriveConfig,
    scenarios: &[Scenario],
    idx: u32,
) -> Result<Course, super::DriveError> {
    let Some(scenario) = scenarios.get(idx as usize) else {
        let checked = CheckedConfig::try_from(&config.world)?;
        let plan = plan(&checked, idx + 1).pop().map(for_choosing).expect("the plan holds the episode");
        return Ok(Course { config: config.clone(), checked, plan, family: String::new() });
    };
    let world = scenario.world(&config.world)?;
    let of_scenario = |source| ScenarioError::World { name: scenario.name.clone(), source };
    let checked = CheckedConfig::try_from(&world).map_err(of_scenario)?;
    let config = DriveConfig { world, seconds: scenario.seconds, ..config.clone() };
    let plan = for_choosing(plan(&checked, 1).remove(0));
    let plan = EpisodePlan { name: scenario.name.clone(), ..plan };
    Ok(Course { config, checked, plan, family: scenario.family.clone() })
}

/// The drives of a config's worlds.
pub(super) fn world_plans(checked: &CheckedConfig, n_episodes: u32) -> Vec<EpisodePlan> {
    plan(checked, n_episodes).into_iter().map(for_choosing).collect()
}

/// Bits of an episode's seed that hold its split, and those of `dev` ([`plan()`]).
const SPLIT_BITS: u64 = 3 << 38;
const DEV_BITS: u64 = 2 << 38;

/// No drive is for training, nor of a world that training data may show: what is not of `test` is of `dev`, by its seed too.
fn for_choosing(plan: EpisodePlan) -> EpisodePlan {
    if matches!(plan.split, Split::Dev | Split::Test) {
        return plan;
    }
    let seed = plan.seed & !SPLIT_BITS | DEV_BITS;
    let name = plan.name.replace(&plan.seed.to_string(), &seed.to_string());
    EpisodePlan { name, seed, split: Split::Dev, ..plan }
}

/// Refuses actors that are nothing, before any folder is begun.
pub(super) fn check_all_actors(
    config: &DriveConfig,
    scenarios: &[Scenario],
) -> Result<(), super::DriveError> {
    check_actors(&config.world.scene).map_err(GenerateError::from)?;
    for scenario in scenarios {
        let of_scenario = |source| ScenarioError::World { name: scenario.name.clone(), source };
        let scene = scenario.world(&config.world)?.scene;
        check_actors(&scene).map_err(GenerateError::from).map_err(of_scenario)?;
    }
    Ok(())
}

/// Refuses two scenarios of one name.
pub(super) fn check_names(scenarios: &[Scenario]) -> Result<(), super::DriveError> {
    let mut seen = BTreeSet::new();
    match scenarios.iter().find(|scenario| !seen.insert(&scenario.name)) {
        Some(scenario) => Err(super::DriveError::SameName { name: scenario.name.clone() }),
        None => Ok(()),
    }
}

impl From<ScenarioError> for super::DriveError {
    fn from(error: ScenarioError) -> Self {
        Self::Scenario(error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_suite_holds_a_hundred_valid_ideas_each_told() {
        let suite = load(Path::new(SUITE)).unwrap();
        assert!(suite.len() >= 100, "{}", suite.len());
        check_names(&suite).unwrap();
        for scenario in &suite {
            assert!(scenario.idea.len() > 15 && scenario.idea.ends_with('.'), "{}", scenario.name);
            assert!(!scenario.family.is_empty());
            assert!(CheckedConfig::try_from(&scenario.world(&GenerateConfig::default()).unwrap()).is_ok());
        }
    }

    #[test]
    fn no_drive_is_for_training_and_none_shares_a_seed_with_training_data() {
        let checked = CheckedConfig::try_from(&GenerateConfig::default()).unwrap();
        let (trained, driven) = (plan(&checked, 12), world_plans(&checked, 12));
        assert!(
            driven.iter().all(|plan| plan.split == Split::Dev && plan.name.ends_with(&plan.seed.to_string()))
        );
        assert!(driven.iter().all(|plan| trained.iter().all(|other| other.seed != plan.seed)));
    }

    #[test]
    fn a_wrong_key_or_number_is_told_with_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bale.toml");
        let told = |text: &str| {
            fs::write(&path, text).unwrap();
            load(&path).unwrap_err().to_string()
        };
        let error = told("idea = \"a bale\"\n[actors.bale]\nshape = \"hay_bale\"\n");
        assert!(
            error.contains("shape") && error.contains("line 3") && error.contains("bale.toml"),
            "{error}"
        );
        let error = told("idea = \"a bale\"\n[actors.bale]\nahead_m = 1e9\n");
        assert!(error.contains("scene.actors.bale.ahead_m"), "{error}");
        let error = told("idea = \"a bale\"\n[scene]\ntraffic_thickness = 1\n");
        assert!(error.contains("traffic_thickness") && error.contains("bale"), "{error}");
        for key in ["split = \"test\"", "own_models = \"x\""] {
            let error = told(&format!("idea = \"a bale\"\n[scene]\n{key}\n"));
            assert!(error.contains("no place in [scene]"), "{error}");
        }
        assert!(told("idea = \"a bale\"\nseconds = nan\n").contains("seconds is NaN"));
        assert!(told("idea = \"a bale\"\n[actors.\"a b\"]\nmodel = \"car\"\n").contains("name is `a b`"));
        assert!(load(&folder.path().join("none")).unwrap_err().to_string().contains("suite"));
    }
}
