//! `harmzone drive`: closed-loop drives on perception alone.

use std::path::PathBuf;

use anyhow::{anyhow, bail};
use clap::Args;

use super::engine::WorkerTimeoutArg;
use super::world::WorldArgs;
use super::{Bar, DeviceNameArg, ExitStatus, number, one_of, print_summary, tell};
use crate::config;
use crate::drive::{self, Courses, DriveConfig, DriveOptions, RecordedDrives, load_scenarios};
use crate::generate::preset;
use crate::outcome::{DriveSummary, End, Who};
use crate::scene::SceneSplit;
use crate::worker::Program;

#[derive(Debug, Args)]
pub struct DriveArgs {
    /// Who drives: `blind` sees nothing; `truth`, the zone over the true boxes; a RUN (a folder, a checkpoint, or `small`, the
    /// network inside the program); `JUDGE:RUN`, such as `zone:small`, a rule over the network's boxes; `exec:COMMAND`, a
    /// detector of your own (docs/drive.md). NAME=.. gives one a name, RUN@0.5 the score from which it brakes hard, RUN@0.5,0.3 also the one from which it brakes a little
    #[arg(required = true, value_name = "WHO")]
    drivers: Vec<String>,
    /// Folder of the drives; the same command again goes on where it stopped
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    world: WorldArgs,
    /// Whose towns and kinds of unfamiliar objects: `dev`, to choose by, or `test`, to report; that needs --final
    #[arg(long, value_parser = one_of(SceneSplit::ALL, SceneSplit::name))]
    split: Option<SceneSplit>,
    /// Scenarios in place of drawn worlds: `suite`, those that come with harmzone, or a TOML file or a folder of them
    /// (docs/drive.md)
    #[arg(long, value_name = "SCENARIOS", conflicts_with_all = ["preset", "town", "weather", "episodes", "seed", "ood"])]
    scenarios: Option<PathBuf>,
    /// Do not record episodes; who needs no sensors drives several times as fast then
    #[arg(long)]
    no_record: bool,
    /// Record only each driver's N worst drives, which are driven again for it: collisions, the hardest first, false stops, and drives that ended stuck
    #[arg(long, value_name = "N", conflicts_with = "no_record", value_parser = number(1..=usize::MAX))]
    record_worst: Option<usize>,
    /// Report on split test, once
    #[arg(long = "final")]
    is_final: bool,
    #[command(flatten)]
    device: DeviceNameArg,
    /// Worker processes [default: one for each core]
    #[arg(long, value_name = "N", value_parser = number(1..=usize::MAX))]
    jobs: Option<usize>,
    #[command(flatten)]
    timeout: WorkerTimeoutArg,
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
    let (split, ood) =
        (args.split.unwrap_or(asked.world.scene.split), args.world.ood || asked.world.scene.ood);
    let (world, n_episodes) = preset::load(args.world.preset, Some(split), ood, None, &[])?;
    let base = DriveConfig { world, ..DriveConfig::default() };
    let mut config = config::load_over(&base, args.config.as_deref(), &args.overrides)?;
    (config.world.scene.split, config.world.scene.ood) = (split, ood);
    args.world.apply(&mut config.world);
    if split == SceneSplit::Test && !args.is_final {
        bail!("split test is for reporting, once: give --final, or drive on dev");
    }
    let all_cores = std::thread::available_parallelism().map_or(1, usize::from);
    let options = DriveOptions {
        program: Program::this()?,
        jobs: args.jobs.unwrap_or(all_cores),
        recording: match args.record_worst {
            Some(most) => RecordedDrives::Worst(most),
            None if args.no_record => RecordedDrives::None,
            None => RecordedDrives::All,
        },
        device: args.device.name(),
        silence: args.timeout.silence(),
    };
    let scenarios = args.scenarios.as_deref().map(load_scenarios).transpose()?.unwrap_or_default();
    let courses = Courses { n_episodes: args.world.episodes.unwrap_or(n_episodes), scenarios };
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

fn first_failure(summary: &DriveSummary) -> Option<String> {
    summary.outcomes.iter().flatten().find_map(|outcome| match &outcome.end {
        End::Failed(reason) => Some(anyhow!("{}: {reason}", outcome.episode).to_string()),
        _ => None,
    })
}
