//! `harmzone drive`: closed-loop drives on perception alone.

use std::path::PathBuf;

use anyhow::{anyhow, bail};
use clap::Args;

use super::{Bar, DeviceNameArg, ExitStatus, number, one_of, print_summary, tell};
use crate::config;
use crate::drive::{self, Courses, DriveConfig, DriveOptions, Who, load_scenarios};
use crate::generate::{Preset, preset};
use crate::scene::SceneSplit;

#[derive(Debug, Args)]
pub struct DriveArgs {
    /// Who drives: `blind` sees nothing; `truth`, the zone over the true boxes; a RUN (a folder, a checkpoint, or `small`, the
    /// network inside the program); `JUDGE:RUN`, such as `zone:small`, a rule over the network's boxes; `exec:COMMAND`, a
    /// detector of your own (docs/drive.md). NAME=.. gives one a name
    #[arg(required = true, value_name = "WHO")]
    drivers: Vec<String>,
    /// Folder of the drives; the same command again goes on where it stopped
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Towns, weathers and seeds as of `gen`'s presets; the other flags go over it
    #[arg(long, value_parser = one_of(Preset::ALL, Preset::name))]
    preset: Option<Preset>,
    /// Whose towns and kinds of unfamiliar objects: `dev`, to choose by, or `test`, to report; that needs --final
    #[arg(long, value_parser = one_of(SceneSplit::ALL, SceneSplit::name))]
    split: Option<SceneSplit>,
    /// Towns that come with harmzone, or paths of OpenDRIVE files, with commas between; or `all` [default: downtown]
    #[arg(long, value_name = "TOWNS", value_delimiter = ',')]
    town: Vec<String>,
    /// Weathers by CARLA's names, with commas between; or `all` [default: ClearNoon]
    #[arg(long, value_name = "WEATHERS", value_delimiter = ',')]
    weather: Vec<String>,
    /// Scenarios in place of drawn worlds: `suite`, those that come with harmzone, or a TOML file or a folder of them
    /// (docs/drive.md)
    #[arg(long, value_name = "SCENARIOS", conflicts_with_all = ["preset", "town", "weather", "episodes", "seed", "ood"])]
    scenarios: Option<PathBuf>,
    /// Number of episodes, each a world of its own [default: the preset's, else 6]
    #[arg(long, value_name = "N", value_parser = number(1..=u32::MAX))]
    episodes: Option<u32>,
    /// Seed of every random draw: the same seed gives the same drives [default: 0]
    #[arg(long, value_name = "N", value_parser = number(0..=u64::MAX))]
    seed: Option<u64>,
    /// Also place unfamiliar objects, of kinds that no training set holds
    #[arg(long)]
    ood: bool,
    /// Do not record episodes; who needs no sensors drives several times as fast then
    #[arg(long)]
    no_record: bool,
    /// Report on split test, once
    #[arg(long = "final")]
    is_final: bool,
    #[command(flatten)]
    device: DeviceNameArg,
    /// Worker processes [default: one for each core]
    #[arg(long, value_name = "N", value_parser = number(1..=usize::MAX))]
    jobs: Option<usize>,
    /// Config (TOML); configs/drive.toml holds the defaults. It goes over the preset, --set over it, other flags over both
    #[arg(long, value_name = "TOML")]
    config: Option<PathBuf>,
    /// Override one key of the config, e.g. reflex.latency_s=0.2 or world.scene.traffic_density=0
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    /// Print drive.json
    #[arg(long)]
    json: bool,
}

pub fn run(args: DriveArgs) -> anyhow::Result<ExitStatus> {
    let drivers = args.drivers.iter().map(|text| text.parse::<Who>()).collect::<Result<Vec<_>, _>>()?;
    let asked: DriveConfig = config::load(args.config.as_deref(), &args.overrides)?;
    let (split, ood) = (args.split.unwrap_or(asked.world.scene.split), args.ood || asked.world.scene.ood);
    let (world, n_episodes) = preset::load(args.preset, Some(split), ood, None, &[])?;
    let base = DriveConfig { world, ..DriveConfig::default() };
    let mut config = config::load_over(&base, args.config.as_deref(), &args.overrides)?;
    (config.world.scene.split, config.world.scene.ood) = (split, ood);
    if !args.town.is_empty() {
        config.world.towns = args.town;
    }
    if !args.weather.is_empty() {
        config.world.weathers = args.weather;
    }
    config.world.seed = args.seed.unwrap_or(config.world.seed);
    if split == SceneSplit::Test && !args.is_final {
        bail!("split test is for reporting, once: give --final, or drive on dev");
    }
    let all_cores = std::thread::available_parallelism().map_or(1, usize::from);
    let options = DriveOptions {
        program: std::env::current_exe()?,
        jobs: args.jobs.unwrap_or(all_cores),
        records: !args.no_record,
        device: args.device.name(),
    };
    let scenarios = args.scenarios.as_deref().map(load_scenarios).transpose()?.unwrap_or_default();
    let courses = Courses { n_episodes: args.episodes.unwrap_or(n_episodes), scenarios };
    let summary = drive::run(&config, &drivers, &courses, &args.out, &options, &Bar::default())?;
    if split == SceneSplit::Dev && !args.json {
        tell("development figures: these worlds are to choose by, not to report");
    }
    print_summary(&summary, args.json)?;
    if let Some(reason) = first_failure(&summary) {
        tell(format!("{} drives failed; the first: {reason}", summary.n_failed()));
        return Ok(ExitStatus::DoneWithLosses);
    }
    Ok(ExitStatus::Done)
}

fn first_failure(summary: &drive::DriveSummary) -> Option<String> {
    summary.outcomes.iter().flatten().find_map(|outcome| match &outcome.end {
        drive::End::Failed(reason) => Some(anyhow!("{}: {reason}", outcome.episode).to_string()),
        _ => None,
    })
}
