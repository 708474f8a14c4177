//! Presets: towns, weathers, counts and seeds of a whole experiment's data sets under one name.
//!
//! The files of `configs/presets/` are part of the program. Later over earlier: the defaults, the preset,
//! the preset's part for the data set that is made, the config file, overrides.

use std::path::Path;

use serde::Deserialize;

use super::{ALL, GenerateConfig};
use crate::config::{self, ConfigError};
use crate::scene::SceneSplit;

/// Number of episodes if neither a preset nor the caller gives one.
const DEFAULT_EPISODES: u32 = 6;

/// A whole experiment's data by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preset {
    /// Minutes: what `make demo` makes.
    Demo,
    /// 3,000 samples to train on, 600 to validate, 600 to choose by, 2 x 2,592 to report, over all weathers.
    Small,
    /// As many samples as the paper's sets have.
    Paper,
}

/// A file of `configs/presets/`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PresetFile {
    /// Keys of [`GenerateConfig`] for every data set.
    #[serde(rename = "gen")]
    config: toml::Table,
    train_val: SetPart,
    dev: SetPart,
    test: SetPart,
    test_ood: SetPart,
}

/// What one of a preset's data sets has of its own.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SetPart {
    episodes: u32,
    #[serde(rename = "gen", default)]
    config: toml::Table,
}

impl Preset {
    pub const ALL: [Self; 3] = [Self::Demo, Self::Small, Self::Paper];

    pub fn name(self) -> &'static str {
        match self {
            Self::Demo => "demo",
            Self::Small => "small",
            Self::Paper => "paper",
        }
    }

    /// The preset with this name, if any.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|preset| preset.name() == name)
    }

    fn file(self) -> PresetFile {
        let text = match self {
            Self::Demo => include_str!("../../configs/presets/demo.toml"),
            Self::Small => include_str!("../../configs/presets/small.toml"),
            Self::Paper => include_str!("../../configs/presets/paper.toml"),
        };
        toml::from_str(text).expect("a test reads every preset")
    }
}

/// The config of a run before its flags, and how many episodes it has: defaults, `preset`, `file`, `overrides`.
///
/// Which data set it is, and with it the preset's part, the flags say: `split`, and `is_ood` for one with unfamiliar
/// objects. Where they do not, `scene.split` and `scene.ood` of file and overrides do. Without a preset, the towns are
/// by default all of those for reporting where the set is for that.
///
/// # Errors
/// [`ConfigError`]: an unreadable file, an unknown key, a malformed override.
pub fn load(
    preset: Option<Preset>,
    split: Option<SceneSplit>,
    is_ood: bool,
    file: Option<&Path>,
    overrides: &[String],
) -> Result<(GenerateConfig, u32), ConfigError> {
    let mut base = GenerateConfig::default();
    let asked = config::load_over(&base, file, overrides)?.scene;
    let (split, is_ood) = (split.unwrap_or(asked.split), is_ood || asked.ood);
    let mut n_episodes = DEFAULT_EPISODES;
    if let Some(preset) = preset.map(Preset::file) {
        let part = match (split, is_ood) {
            (SceneSplit::Dev, false) => preset.train_val,
            (SceneSplit::Dev, true) => preset.dev,
            (SceneSplit::Test, false) => preset.test,
            (SceneSplit::Test, true) => preset.test_ood,
        };
        base = config::with_table(&config::with_table(&base, &preset.config)?, &part.config)?;
        n_episodes = part.episodes;
    } else if split == SceneSplit::Test {
        base.towns = vec![ALL.to_owned()];
    }
    let mut config = config::load_over(&base, file, overrides)?;
    (config.scene.split, config.scene.ood) = (split, is_ood);
    Ok((config, n_episodes))
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use super::*;
    use crate::episode::Split;
    use crate::generate::{CheckedConfig, EpisodePlan, plan};
    use crate::scene::town_split;

    fn load_set(preset: Preset, split: SceneSplit, is_ood: bool) -> (GenerateConfig, u32) {
        load(Some(preset), Some(split), is_ood, None, &[]).unwrap()
    }

    /// The data sets of a preset: their side of the benchmark, whether they hold unfamiliar objects, their episodes.
    fn sets(preset: Preset) -> Vec<(SceneSplit, bool, Vec<EpisodePlan>)> {
        let choices = SceneSplit::ALL.into_iter().flat_map(|split| [(split, false), (split, true)]);
        let of_choice = |(split, is_ood)| {
            let (config, n_episodes) = load_set(preset, split, is_ood);
            (split, is_ood, plan(&CheckedConfig::try_from(&config).unwrap(), n_episodes))
        };
        choices.map(of_choice).collect()
    }

    /// Samples by split, and those of `test` with unfamiliar objects apart.
    fn samples(preset: Preset) -> [u32; 5] {
        let (config, _) = load_set(preset, SceneSplit::Dev, false);
        let mut samples = [0; 5];
        for (_, is_ood, plans) in sets(preset) {
            for plan in plans {
                let at = plan.split as usize + usize::from(plan.split == Split::Test && is_ood);
                samples[at] += config.samples;
            }
        }
        samples
    }

    #[test]
    fn the_presets_have_the_samples_that_they_promise() {
        assert_eq!(samples(Preset::Demo), [300, 60, 120, 120, 120]);
        assert_eq!(samples(Preset::Small), [3000, 600, 600, 2592, 2592]);
        assert_eq!(samples(Preset::Paper), [33_800, 9_080, 6_360, 7_200, 7_200]);
    }

    #[test]
    fn no_seed_is_in_two_splits_or_presets_and_no_town_on_both_sides() {
        let mut sets_of_seed = BTreeMap::<u64, BTreeSet<(&str, Split, bool)>>::new();
        let mut n_episodes = 0;
        for preset in Preset::ALL {
            for (split, is_ood, plans) in sets(preset) {
                n_episodes += plans.len();
                for plan in plans {
                    assert_eq!(town_split(&plan.town), Some(split), "{}", plan.name);
                    let set = (preset.name(), plan.split, is_ood);
                    sets_of_seed.entry(plan.seed).or_default().insert(set);
                }
            }
        }
        let overlap = sets_of_seed.values().filter(|sets| sets.len() > 1).count();
        assert_eq!((overlap, sets_of_seed.len()), (0, n_episodes));
    }

    #[test]
    fn the_sets_of_a_preset_differ_in_towns_and_objects_and_in_nothing_else() {
        for preset in Preset::ALL {
            let (mut learn, _) = load_set(preset, SceneSplit::Dev, false);
            learn.scene.ood = true;
            assert_eq!(learn, load_set(preset, SceneSplit::Dev, true).0);
            learn.scene.split = SceneSplit::Test;
            learn.towns = vec![ALL.to_owned()];
            assert_eq!(learn, load_set(preset, SceneSplit::Test, true).0);
        }
    }

    #[test]
    fn the_test_sets_of_small_and_paper_have_a_hundred_clips_over_all_pairs() {
        for preset in [Preset::Small, Preset::Paper] {
            for (_, _, plans) in sets(preset).into_iter().filter(|(split, ..)| *split == SceneSplit::Test) {
                let mut counts = BTreeMap::<_, usize>::new();
                for plan in &plans {
                    *counts.entry((&plan.town, plan.weather.name())).or_default() += 1;
                }
                let (least, most) = (counts.values().min().unwrap(), counts.values().max().unwrap());
                assert!(plans.len() >= 100 && counts.len() >= 18 && least == most, "{counts:?}");
            }
        }
    }

    #[test]
    fn a_file_lies_over_the_preset_and_overrides_over_both() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("own.toml");
        fs_err::write(&path, "samples = 7\nseed = 70\n[render]\njpeg_quality = 80\n").unwrap();
        let overrides = ["seed=700".to_owned()];
        let (config, n_episodes) = load(Some(Preset::Small), None, false, Some(&path), &overrides).unwrap();
        assert_eq!((config.samples, config.seed, config.render.jpeg_quality), (7, 700, 80));
        assert_eq!((config.towns, n_episodes), (vec![ALL.to_owned()], 150));
        assert_eq!(config.render.shadow_size_px, GenerateConfig::default().render.shadow_size_px);
    }

    #[test]
    fn a_set_that_overrides_name_brings_the_presets_part() {
        for (overrides, n_wanted) in [
            (&["scene.ood=true"][..], 25),
            (&["scene.split=test"], 108),
            (&["scene.split=\"test\"", "scene.ood=true"], 108),
        ] {
            let overrides: Vec<String> = overrides.iter().map(|&text| text.to_owned()).collect();
            let (config, n_episodes) = load(Some(Preset::Small), None, false, None, &overrides).unwrap();
            assert_eq!(n_episodes, n_wanted);
            assert_eq!(config.scene.split == SceneSplit::Test, overrides[0].contains("split"));
        }
    }

    #[test]
    fn without_a_preset_the_defaults_stand_and_reports_take_all_their_towns() {
        assert_eq!(load(None, None, false, None, &[]).unwrap(), (GenerateConfig::default(), 6));
        let (config, _) = load(None, Some(SceneSplit::Test), false, None, &[]).unwrap();
        assert_eq!(config.towns, [ALL]);
        let (config, _) =
            load(None, Some(SceneSplit::Test), false, None, &["towns=[\"a.xodr\"]".to_owned()]).unwrap();
        assert_eq!(config.towns, ["a.xodr"]);
    }
}
