//! Which episodes a data set has: names, seeds and splits, known before anything is simulated.

use rand::RngExt;

use super::GenerateConfig;
use crate::episode::Split;
use crate::random;

/// One episode to be made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EpisodePlan {
    pub name: String,
    pub seed: u64,
    pub split: Split,
}

impl EpisodePlan {
    /// Path of the file from the data set's folder.
    #[must_use]
    pub fn file(&self) -> String {
        format!("episodes/{}.mcap", self.name)
    }
}

/// The first `n_episodes` episodes of a config; more episodes leave the first ones as they are.
#[must_use]
pub fn plan(config: &GenerateConfig, n_episodes: u32) -> Vec<EpisodePlan> {
    (0..n_episodes).map(|i| episode(config, i)).collect()
}

fn episode(config: &GenerateConfig, i: u32) -> EpisodePlan {
    // 40 bits: short in file names, exact in JSON numbers, and no two alike in any real data set.
    let seed = random::stream(config.seed, "episode", u64::from(i)).random::<u64>() >> 24;
    let split = if config.scene.ood {
        Split::Test
    } else if config.val_every > 0 && (i + 1).is_multiple_of(config.val_every) {
        Split::Val
    } else {
        Split::Train
    };
    // A path stands for its file, without the suffix.
    let town = config.town.rsplit(['/', '\\']).next().unwrap_or_default();
    let town = town.strip_suffix(".xodr").unwrap_or(town);
    EpisodePlan { name: format!("{town}-{}-{seed}", config.weather), seed, split }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sixth_episode_is_for_validation_and_all_ood_ones_for_testing() {
        let config = GenerateConfig::default();
        let splits: Vec<Split> = plan(&config, 12).into_iter().map(|episode| episode.split).collect();
        assert_eq!(splits.iter().filter(|&&split| split == Split::Val).count(), 2);
        assert_eq!((splits[5], splits[11]), (Split::Val, Split::Val));
        let mut ood = config;
        ood.scene.ood = true;
        assert!(plan(&ood, 12).iter().all(|episode| episode.split == Split::Test));
    }

    #[test]
    fn a_longer_plan_begins_with_the_shorter_one() {
        let config = GenerateConfig::default();
        assert_eq!(plan(&config, 20)[..5], plan(&config, 5)[..]);
    }

    #[test]
    fn a_path_gives_a_name_without_folders() {
        let config = GenerateConfig { town: "maps/Town01.xodr".into(), ..GenerateConfig::default() };
        assert!(plan(&config, 1)[0].name.starts_with("Town01-ClearNoon-"));
    }
}
