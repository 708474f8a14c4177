//! `harmzone gen`: drives a town and writes a data set of episodes.

use std::path::PathBuf;

use clap::Args;
use clap::builder::PossibleValuesParser;

use super::{Bar, ExitStatus, number, print_summary};
use crate::config;
use crate::generate::{self, Preset, RendererName, RunOptions, preset};

#[derive(Debug, Args)]
pub struct GenerateArgs {
    /// Folder of the data set; a run that was broken off is taken up again
    #[arg(long)]
    out: PathBuf,
    /// Towns, weathers, counts and splits of a whole experiment; other flags override it
    #[arg(long, value_parser = PossibleValuesParser::new(Preset::ALL.map(Preset::name)))]
    preset: Option<String>,
    /// Towns that come with harmzone, or paths of OpenDRIVE files, with commas between; or `all`
    #[arg(long, value_delimiter = ',')]
    town: Vec<String>,
    /// Weathers by CARLA's names, with commas between; or `all`. Every pair of town and weather comes once
    /// before any comes twice
    #[arg(long, value_delimiter = ',')]
    weather: Vec<String>,
    /// How many episodes the data set has [default: the preset's, else 6]
    #[arg(long, value_parser = number(1..=u32::MAX))]
    episodes: Option<u32>,
    /// Samples an episode
    #[arg(long, value_parser = number(1..=u32::MAX))]
    samples: Option<u32>,
    /// The same seed gives the same bytes
    #[arg(long, value_parser = number(0..=u64::MAX))]
    seed: Option<u64>,
    /// Also place objects of kinds that no training set holds
    #[arg(long)]
    ood: bool,
    /// Sensor rig (TOML with the tables camera and lidar) in place of the config's
    #[arg(long)]
    rig: Option<PathBuf>,
    /// Who draws the camera's picture; `filament` is physically based and needs mujoco-studio and Vulkan
    #[arg(long, value_parser = PossibleValuesParser::new(["classic", "filament"]))]
    renderer: Option<String>,
    /// Also write depth, instance and category of each pixel as EXR files under aov/
    #[arg(long)]
    aov: bool,
    /// Worker processes [default: all cores]
    #[arg(long, value_parser = number(1..=usize::MAX))]
    jobs: Option<usize>,
    /// Config file (see configs/gen.toml); over the preset, under --set, which is under the other flags
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
    let preset = args.preset.as_deref().and_then(Preset::named);
    let (mut config, n_episodes) = preset::load(preset, args.ood, args.config.as_deref(), &args.overrides)?;
    if !args.town.is_empty() {
        config.towns = args.town;
    }
    if !args.weather.is_empty() {
        config.weathers = args.weather;
    }
    if let Some(path) = &args.rig {
        config.rig = config::load(Some(path), &[])?;
    }
    match args.renderer.as_deref() {
        Some("filament") => config.render.renderer = RendererName::Filament,
        Some(_) => config.render.renderer = RendererName::Classic,
        None => {}
    }
    config.render.aov |= args.aov;
    config.samples = args.samples.unwrap_or(config.samples);
    config.seed = args.seed.unwrap_or(config.seed);
    let all_cores = std::thread::available_parallelism().map_or(1, usize::from);
    let options = RunOptions {
        program: std::env::current_exe()?,
        jobs: args.jobs.unwrap_or(all_cores),
        force: args.force,
    };
    let summary =
        generate::run(&config, args.episodes.unwrap_or(n_episodes), &args.out, &options, &Bar::default())?;
    print_summary(&summary, args.json)?;
    Ok(ExitStatus::Done)
}
