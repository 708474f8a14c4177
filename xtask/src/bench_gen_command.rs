//! `xtask bench-gen`: what `make bench-gen` runs.

use std::path::PathBuf;

use clap::Args;

use crate::bench_gen::{self as bench, BenchOptions};
use harmzone::cli::{Bar, ExitStatus, number, print_summary};
use harmzone::config;
use harmzone::generate::GenerateConfig;
use harmzone::worker::ALLOCATOR_ENVIRONMENT;

#[derive(Debug, Args)]
pub struct BenchArgs {
    /// Towns, with commas between; or `all`
    #[arg(long, value_delimiter = ',', default_value = "all")]
    town: Vec<String>,
    /// Weathers, with commas between; or `all`
    #[arg(long, value_delimiter = ',', default_value = "ClearNoon")]
    weather: Vec<String>,
    /// Episodes that are measured against bare MuJoCo; 0 measures none
    #[arg(long, default_value_t = 5, value_parser = number(0..=u32::MAX))]
    episodes: u32,
    /// Samples that one process and then several make, whose time and memory are compared; 0 makes none
    #[arg(long, default_value_t = 1000, value_parser = number(0..=u32::MAX))]
    run_samples: u32,
    /// Processes of the second run
    #[arg(long, default_value_t = 2, value_parser = number(2..=u32::MAX))]
    jobs: u32,
    /// Config file (see configs/gen.toml)
    #[arg(long)]
    config: Option<PathBuf>,
    /// Override a key of the config, for example render.samples_per_pixel=4
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    /// Print the figures as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: BenchArgs) -> anyhow::Result<ExitStatus> {
    // The measured process has the environment of a worker, which counts from its start on.
    if ALLOCATOR_ENVIRONMENT.iter().any(|(name, value)| std::env::var(name).as_deref() != Ok(value)) {
        let status = std::process::Command::new(std::env::current_exe()?)
            .args(std::env::args_os().skip(1))
            .envs(ALLOCATOR_ENVIRONMENT)
            .status()?;
        return if status.success() {
            Ok(ExitStatus::Done)
        } else {
            anyhow::bail!("the benchmark ended with {status}")
        };
    }
    let mut config: GenerateConfig = config::load(args.config.as_deref(), &args.overrides)?;
    (config.towns, config.weathers) = (args.town, args.weather);
    let options = BenchOptions {
        program: std::env::current_exe()?,
        n_episodes: args.episodes,
        n_run_samples: args.run_samples,
        jobs: args.jobs as usize,
    };
    let report = bench::run(&config, &options, &Bar::default())?;
    print_summary(&report, args.json)?;
    Ok(ExitStatus::Done)
}
