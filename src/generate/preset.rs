//! Presets: towns, weathers, counts and splits of a whole experiment under one name.
//!
//! The files of `configs/presets/` are part of the program. Later over earlier: the defaults, the preset,
//! the preset's `[ood]` part if out-of-distribution objects are placed, the config file, overrides.

use std::path::Path;

use serde::Deserialize;

use super::GenerateConfig;
use crate::config::{self, ConfigError};

/// Number of episodes if neither a preset nor the caller gives one.
const DEFAULT_EPISODES: u32 = 6;

/// A whole experiment's data by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preset {
    /// Minutes: what `make demo` makes.
    Demo,
    /// 3,000 / 600 / 600 samples over all towns and weathers.
    Small,
    /// As many samples as the paper's sets have.
    Paper,
}

/// A file of `configs/presets/`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PresetFile {
    episodes: u32,
    /// Keys of [`GenerateConfig`].
    #[serde(rename = "gen")]
    config: toml::Table,
    ood: OodPart,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct OodPart {
    episodes: u32,
    #[serde(rename = "gen")]
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
/// With `is_ood`, or where file or overrides turn `scene.ood` on, the preset's `[ood]` part applies too.
///
/// # Errors
/// [`ConfigError`]: an unreadable file, an unknown key, a malformed override.
pub fn load(
    preset: Option<Preset>,
    is_ood: bool,
    file: Option<&Path>,
    overrides: &[String],
) -> Result<(GenerateConfig, u32), ConfigError> {
    let Some(preset) = preset.map(Preset::file) else {
        let mut config = config::load_over(&GenerateConfig::default(), file, overrides)?;
        config.scene.ood |= is_ood;
        return Ok((config, DEFAULT_EPISODES));
    };
    let of_preset = config::with_table(&GenerateConfig::default(), &preset.config)?;
    let mut config = config::load_over(&of_preset, file, overrides)?;
    if !is_ood && !config.scene.ood {
        return Ok((config, preset.episodes));
    }
    let of_preset = config::with_table(&of_preset, &preset.ood.config)?;
    config = config::load_over(&of_preset, file, overrides)?;
    config.scene.ood = true;
    Ok((config, preset.ood.episodes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::episode::Split;
    use crate::generate::{CheckedConfig, plan};

    /// Samples for training, validation and testing, ID and OOD together.
    fn samples(preset: Preset) -> [u32; 3] {
        let mut samples = [0; 3];
        for is_ood in [false, true] {
            let (config, n_episodes) = load(Some(preset), is_ood, None, &[]).unwrap();
            let plans = plan(&CheckedConfig::try_from(&config).unwrap(), n_episodes);
            for (count, split) in samples.iter_mut().zip([Split::Train, Split::Val, Split::Test]) {
                let n_episodes = plans.iter().filter(|plan| plan.split == split).count();
                *count += n_episodes as u32 * config.samples;
            }
        }
        samples
    }

    #[test]
    fn the_presets_have_the_samples_that_they_promise() {
        assert_eq!(samples(Preset::Demo), [300, 60, 120]);
        assert_eq!(samples(Preset::Small), [3000, 600, 600]);
        assert_eq!(samples(Preset::Paper), [33_800, 9_080, 6_360]);
    }

    #[test]
    fn the_ood_set_has_another_seed_and_the_same_towns_and_weathers() {
        for preset in Preset::ALL {
            let (id, _) = load(Some(preset), false, None, &[]).unwrap();
            let (ood, _) = load(Some(preset), true, None, &[]).unwrap();
            assert!(!id.scene.ood && ood.scene.ood && id.seed != ood.seed);
            assert_eq!((id.towns, id.weathers), (ood.towns, ood.weathers));
        }
    }

    #[test]
    fn a_file_lies_over_the_preset_and_overrides_over_both() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("own.toml");
        fs_err::write(&path, "samples = 7\nseed = 70\n[render]\njpeg_quality = 80\n").unwrap();
        let overrides = ["seed=700".to_owned()];
        let (config, n_episodes) = load(Some(Preset::Small), false, Some(&path), &overrides).unwrap();
        assert_eq!((config.samples, config.seed, config.render.jpeg_quality), (7, 700, 80));
        assert_eq!((config.towns, n_episodes), (vec!["all".to_owned()], 150));
        assert_eq!(config.render.shadow_size_px, GenerateConfig::default().render.shadow_size_px);
    }

    #[test]
    fn ood_objects_turned_on_by_an_override_bring_the_presets_ood_part() {
        let overrides = ["scene.ood=true".to_owned()];
        let (config, n_episodes) = load(Some(Preset::Small), false, None, &overrides).unwrap();
        assert_eq!((config.seed, n_episodes), (2, 25));
    }

    #[test]
    fn without_a_preset_the_defaults_stand() {
        assert_eq!(load(None, false, None, &[]).unwrap(), (GenerateConfig::default(), 6));
    }
}
