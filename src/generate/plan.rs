//! Which episodes a data set has: names, seeds, towns, weathers and splits, known before anything is
//! simulated.
//!
//! Every pair of town and weather comes once before any comes twice. The pairs lie in one order in which
//! any few neighbours see many towns and many weathers; training takes them from its front and validation
//! from its back, so that both splits are as mixed as their size allows.
//!
//! An episode's seed has 40 bits: 2 of its split, 1 of whether unfamiliar objects are placed, the last 4 of the config's seed, 33
//! drawn. So no two splits share a seed, and no two presets do, since theirs differ in the last 4 bits.

use rand::RngExt;
use rand::seq::SliceRandom;

use super::CheckedConfig;
use crate::episode::Split;
use crate::random;
use crate::scene::{SceneSplit, town_name};
use crate::sensors::Weather;

/// One episode to be made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EpisodePlan {
    /// `<town>-<weather>-<seed>`.
    pub name: String,
    pub seed: u64,
    /// As in the config: a name or a path.
    pub town: String,
    pub weather: Weather,
    pub split: Split,
}

impl EpisodePlan {
    /// Path of the file from the data set's folder.
    pub fn file(&self) -> String {
        format!("episodes/{}.mcap", self.name)
    }
}

/// The first `n_episodes` episodes of a config; more episodes leave the first ones as they are.
pub fn plan(config: &CheckedConfig, n_episodes: u32) -> Vec<EpisodePlan> {
    let pairs = pairs(config);
    (0..n_episodes).map(|i| episode(config, &pairs, i)).collect()
}

fn episode(config: &CheckedConfig, pairs: &[(&str, Weather)], i: u32) -> EpisodePlan {
    let raw = &config.raw;
    // The split of what is not for validation.
    let split = match (raw.scene.split, raw.scene.ood) {
        (SceneSplit::Dev, false) => Split::Train,
        (SceneSplit::Dev, true) => Split::Dev,
        (SceneSplit::Test, _) => Split::Test,
    };
    let every = if split == Split::Train { raw.val_every } else { 0.0 };
    let n_val =
        |n_episodes: u32| if every > 0.0 { (f64::from(n_episodes) / every).floor() as usize } else { 0 };
    let n_val_before = n_val(i);
    let (split, place) = if n_val(i + 1) > n_val_before {
        (Split::Val, pairs.len() - 1 - n_val_before % pairs.len())
    } else {
        (split, (i as usize - n_val_before) % pairs.len())
    };
    let (town, weather) = pairs[place];
    let seed = episode_seed(raw.seed, split, raw.scene.ood, i);
    EpisodePlan {
        name: format!("{}-{}-{seed}", town_name(town), weather.name()),
        seed,
        town: town.to_owned(),
        weather,
        split,
    }
}

/// Short in file names, exact in JSON numbers, never 0, and no two alike in any real data set.
fn episode_seed(config_seed: u64, split: Split, is_ood: bool, i: u32) -> u64 {
    let of_split = match split {
        Split::Train => 0,
        Split::Val => 1,
        Split::Dev => 2,
        Split::Test => 3,
    };
    let drawn = (random::stream(config_seed, "episode", u64::from(i)).random::<u64>() >> 31).max(1);
    ((of_split << 1 | u64::from(is_ood)) << 4 | config_seed & 15) << 33 | drawn
}

/// Every pair of town and weather once, each step going on to the next town and to the next weather.
fn pairs(config: &CheckedConfig) -> Vec<(&str, Weather)> {
    let mut towns: Vec<&str> = config.raw.towns.iter().map(String::as_str).collect();
    let mut weathers = config.weathers.clone();
    towns.shuffle(&mut random::stream(config.raw.seed, "towns", 0));
    weathers.shuffle(&mut random::stream(config.raw.seed, "weathers", 0));
    let (n_towns, n_weathers) = (towns.len(), weathers.len());
    // Where both end at the same time, their least common multiple, the weathers skip one.
    let round = n_towns / greatest_common_divisor(n_towns, n_weathers) * n_weathers;
    (0..n_towns * n_weathers).map(|i| (towns[i % n_towns], weathers[(i + i / round) % n_weathers])).collect()
}

fn greatest_common_divisor(a: usize, b: usize) -> usize {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use super::*;
    use crate::generate::GenerateConfig;
    use crate::scene::PopulateConfig;

    fn checked(towns: &[&str], weathers: &[Weather]) -> CheckedConfig {
        let mut config = CheckedConfig::try_from(&GenerateConfig::default()).unwrap();
        config.raw.towns = towns.iter().map(|&town| town.to_owned()).collect();
        config.weathers = weathers.to_vec();
        config
    }

    fn of_split(plans: &[EpisodePlan], split: Split) -> impl Iterator<Item = &EpisodePlan> {
        plans.iter().filter(move |plan| plan.split == split)
    }

    const TOWNS: [&str; 5] = ["a", "b", "c", "d", "e"];

    #[test]
    fn every_sixth_episode_is_for_validation_and_none_of_those_for_choosing_or_reporting() {
        let mut config = checked(&["downtown"], &[Weather::ClearNoon]);
        let splits: Vec<Split> = plan(&config, 12).into_iter().map(|episode| episode.split).collect();
        assert_eq!(splits.iter().filter(|&&split| split == Split::Val).count(), 2);
        assert_eq!((splits[5], splits[11]), (Split::Val, Split::Val));
        config.raw.scene.ood = true;
        assert!(plan(&config, 12).iter().all(|episode| episode.split == Split::Dev));
        for is_ood in [false, true] {
            config.raw.scene = PopulateConfig { split: SceneSplit::Test, ood: is_ood, ..config.raw.scene };
            assert!(plan(&config, 12).iter().all(|episode| episode.split == Split::Test));
        }
        config.raw.scene = PopulateConfig::default();
        config.raw.val_every = 4.5;
        assert_eq!(of_split(&plan(&config, 90), Split::Val).count(), 20);
        config.raw.val_every = 0.0;
        assert_eq!(of_split(&plan(&config, 90), Split::Val).count(), 0);
    }

    #[test]
    fn sets_of_one_config_seed_or_of_presets_never_share_an_episodes_seed() {
        let sets = [
            (Split::Train, false),
            (Split::Val, false),
            (Split::Dev, true),
            (Split::Test, false),
            (Split::Test, true),
        ];
        let mut seen = BTreeSet::new();
        for (config_seed, (split, is_ood)) in (0..16).flat_map(|seed| sets.map(|set| (seed, set))) {
            for i in 0..50 {
                let seed = episode_seed(config_seed, split, is_ood, i);
                assert!(seed < 1 << 40 && seed != 0);
                // Without the drawn bits, so that luck has no part in it.
                seen.insert((seed >> 33, config_seed, split, is_ood));
            }
        }
        let prefixes: BTreeSet<u64> = seen.iter().map(|(prefix, ..)| *prefix).collect();
        assert_eq!((seen.len(), prefixes.len()), (16 * sets.len(), 16 * sets.len()));
    }

    #[test]
    fn a_longer_plan_begins_with_the_shorter_one() {
        let config = checked(&TOWNS, Weather::ALL);
        assert_eq!(plan(&config, 200)[..95], plan(&config, 95)[..]);
    }

    #[test]
    fn a_path_gives_a_name_without_folders() {
        let config = checked(&["maps/Town01.xodr"], &[Weather::FogNight]);
        let plan = &plan(&config, 1)[0];
        assert!(plan.name.starts_with("town01-FogNight-"), "{}", plan.name);
        assert_eq!(plan.town, "maps/Town01.xodr");
    }

    #[test]
    fn every_pair_comes_once_before_any_comes_twice() {
        for (towns, n_weathers, val_every) in
            [(5, 18, 6.0), (2, 18, 6.0), (3, 6, 4.7), (4, 6, 0.0), (1, 1, 2.0)]
        {
            let mut config = checked(&TOWNS[..towns], &Weather::ALL[..n_weathers]);
            config.raw.val_every = val_every;
            let n_pairs = towns * n_weathers;
            let plans = plan(&config, 3 * n_pairs as u32);
            for round in 1..=3 {
                let mut counts = BTreeMap::<_, usize>::new();
                for plan in &plans[..round * n_pairs] {
                    *counts.entry((&plan.town, plan.weather.name())).or_default() += 1;
                }
                assert_eq!(counts.len(), n_pairs);
                assert!(counts.values().all(|&count| count == round), "{towns} x {n_weathers}: {counts:?}");
            }
        }
    }

    #[test]
    fn training_and_validation_see_every_town_and_weather_and_few_episodes_many_of_both() {
        let config = checked(&TOWNS, Weather::ALL);
        let plans = plan(&config, 150);
        let seen = |plans: &[&EpisodePlan]| {
            let towns: BTreeSet<&str> = plans.iter().map(|plan| plan.town.as_str()).collect();
            let weathers: BTreeSet<&str> = plans.iter().map(|plan| plan.weather.name()).collect();
            (towns.len(), weathers.len())
        };
        for split in [Split::Train, Split::Val] {
            let of_split: Vec<&EpisodePlan> = of_split(&plans, split).collect();
            assert_eq!(seen(&of_split), (5, 18), "{split:?}");
            assert_eq!(seen(&of_split[..5]), (5, 5), "{split:?}");
        }
        assert_ne!(plans[0].name, plans[90].name);
    }

    #[test]
    fn another_seed_begins_with_other_towns_and_weathers() {
        let mut config = checked(&TOWNS, Weather::ALL);
        let pairs_of = |config: &CheckedConfig| -> Vec<(String, Weather)> {
            plan(config, 8).into_iter().map(|plan| (plan.town, plan.weather)).collect()
        };
        let first = pairs_of(&config);
        config.raw.seed += 1;
        assert_ne!(pairs_of(&config), first);
    }
}
