//! `harmzone gen`: drives a town and writes a data set of episodes.

use std::path::PathBuf;

use clap::Args;

use super::ExitStatus;
use super::progress::Bar;
use crate::config;
use crate::generate::{self, GenerateConfig, RunOptions};

#[derive(Debug, Args)]
pub struct GenerateArgs {
    /// Folder of the data set; a run that was broken off is taken up again
    #[arg(long)]
    out: PathBuf,
    /// A town that comes with harmzone, or the path of an OpenDRIVE file
    #[arg(long)]
    town: Option<String>,
    /// Weather, by CARLA's names
    #[arg(long)]
    weather: Option<String>,
    /// How many episodes the data set has
    #[arg(long, default_value_t = 6, value_parser = clap::value_parser!(u32).range(1..))]
    episodes: u32,
    /// Samples an episode
    #[arg(long)]
    samples: Option<u32>,
    /// The same seed gives the same bytes
    #[arg(long)]
    seed: Option<u64>,
    /// Also place objects of kinds that no training set holds
    #[arg(long)]
    ood: bool,
    /// Worker processes [default: all cores]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    jobs: Option<u32>,
    /// Config file (see configs/gen.toml)
    #[arg(long)]
    config: Option<PathBuf>,
    /// Override a key of the config, for example render.jpeg_quality=95
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    /// Replace the episodes of another config in the folder
    #[arg(long)]
    force: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: GenerateArgs) -> anyhow::Result<ExitStatus> {
    let mut config: GenerateConfig = config::load(args.config.as_deref(), &args.overrides)?;
    config.town = args.town.unwrap_or(config.town);
    config.weather = args.weather.unwrap_or(config.weather);
    config.samples = args.samples.unwrap_or(config.samples);
    config.seed = args.seed.unwrap_or(config.seed);
    config.scene.ood |= args.ood;
    let all_cores = std::thread::available_parallelism().map_or(1, usize::from);
    let options = RunOptions {
        program: std::env::current_exe()?,
        jobs: args.jobs.map_or(all_cores, |jobs| jobs as usize),
        force: args.force,
    };
    let summary = generate::run(&config, args.episodes, &args.out, &options, &Bar::default())?;
    if args.json {
        println!("{}", serde_json::to_string_pretty(&summary)?);
    } else {
        print!("{summary}");
    }
    Ok(ExitStatus::Done)
}
