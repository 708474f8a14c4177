//! Flags that say which worlds episodes are made of, for `gen` and `drive`.

use clap::Args;

use super::{number, one_of};
use crate::episode::MAX_EPISODES;
use crate::generate::{GenerateConfig, Preset};

#[derive(Debug, Args)]
pub struct WorldArgs {
    /// Towns, weathers, counts and seeds of a whole experiment's data sets; the other flags go over it
    #[arg(long, value_parser = one_of(Preset::ALL, Preset::name))]
    pub preset: Option<Preset>,
    /// Towns that come with harmzone, or paths of OpenDRIVE files, with commas between; `all`: all that come with it
    /// and are for the split [default: downtown, or all for reporting]
    #[arg(long, value_name = "TOWNS", value_delimiter = ',')]
    town: Vec<String>,
    /// Weathers by CARLA's names, with commas between; or `all`. Every pair of town and weather comes once
    /// before any comes twice [default: ClearNoon]
    #[arg(long, value_name = "WEATHERS", value_delimiter = ',')]
    weather: Vec<String>,
    /// Number of episodes, each a world of its own [default: the preset's, else 6]
    #[arg(long, value_name = "N", value_parser = number(1..=MAX_EPISODES))]
    pub episodes: Option<u32>,
    /// Seed of every random draw: the same seed gives the same bytes [default: 0]
    #[arg(long, value_name = "N", value_parser = number(0..=i64::MAX as u64))]
    seed: Option<u64>,
    /// Also place unfamiliar objects, of kinds that no training set holds
    #[arg(long)]
    pub ood: bool,
}

impl WorldArgs {
    /// Writes what was given over a config.
    pub fn apply(&self, config: &mut GenerateConfig) {
        if !self.town.is_empty() {
            config.towns.clone_from(&self.town);
        }
        if !self.weather.is_empty() {
            config.weathers.clone_from(&self.weather);
        }
        config.seed = self.seed.unwrap_or(config.seed);
    }
}
