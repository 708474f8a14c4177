//! `harmzone import`: logs of real cars to data sets, one subcommand a format, and predictions of other tools.

use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::{Args, Subcommand};

use super::exchange::{self, ImportPredictionsArgs};
use super::{Bar, ExitStatus, number, print, print_summary, split};
use crate::config;
use crate::episode::Split;
use crate::files;
use crate::import::nuscenes::NuScenesLog;
use crate::import::ros2::{self, MappingConfig, Ros2Log};
use crate::import::{self, ImportConfig, ImportError, ImportOptions, Log, LogFormat};
use crate::store::{Access, Location};

#[derive(Debug, Args)]
pub struct ImportArgs {
    #[command(subcommand)]
    format: ImportCommand,
}

#[derive(Debug, Subcommand)]
enum ImportCommand {
    /// nuScenes: a version's folder, or a folder that holds one
    Nuscenes(LogArgs),
    /// KITTI: the object set (each frame an episode), tracking sequences, or raw drives
    Kitti(LogArgs),
    /// Argoverse 2 sensor logs: one log's folder, or a folder of logs
    Av2(LogArgs),
    /// ROS 2 bags in MCAP: a bag's folder, one .mcap file, or a folder of bags
    Ros2(Ros2Args),
    /// Another detector's boxes, as `harmzone predict` writes a network's
    Predictions(ImportPredictionsArgs),
}

/// What all formats share.
#[derive(Debug, Args)]
pub(super) struct LogArgs {
    /// The log
    source: PathBuf,
    /// Folder or URL of the data set; the same command again goes on where it stopped
    #[arg(long, value_name = "DIR")]
    out: Location,
    /// Import only these drives, with commas between
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    scenes: Vec<String>,
    /// Of each drive, import every so many samples [default: the config's, 1]
    #[arg(long, value_name = "N", value_parser = number(1..=1_000_000_u32))]
    every: Option<u32>,
    /// Further cameras that become topics, by the log's names, with commas between [default: the config's, none]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    cameras: Vec<String>,
    /// The part of the data set that the episodes belong to
    #[arg(long, default_value = "test", value_parser = split())]
    split: Split,
    /// Leave out samples and drives whose files are torn or missing, and tell each, rather than end at the first
    #[arg(long)]
    skip_bad: bool,
    /// Config (TOML) over the format's own, configs/import/FORMAT.toml: categories, vehicle, ground, ..
    #[arg(long, value_name = "TOML")]
    config: Option<PathBuf>,
    /// Override one key of the config, e.g. ground=fit
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    /// Replace the episodes that another config made in the folder, and drives of the same name of another log
    #[arg(long)]
    force: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

/// With `--list` nothing is imported, and `--out` need not be there.
#[derive(Debug, Args)]
#[command(mut_arg("out", |out| out.required(false).required_unless_present("list").default_value_if("list", "true", ".")))]
struct Ros2Args {
    #[command(flatten)]
    log: LogArgs,
    /// Which topics and frames are what (TOML, configs/import/ros2_mapping.toml) [default: guessed, as --list proposes]
    #[arg(long, value_name = "TOML")]
    mapping: Option<PathBuf>,
    /// Print what the bag has and the proposed mapping, to be saved and used as it is; import nothing
    #[arg(long, conflicts_with = "mapping")]
    list: bool,
}

impl Ros2Args {
    fn run(&self) -> anyhow::Result<ExitStatus> {
        if self.list {
            print(ros2::list(&self.log.source)?)?;
            return Ok(ExitStatus::Done);
        }
        let mapping = match &self.mapping {
            None => None,
            Some(path) => Some(config::load::<MappingConfig>(Some(path), &[])?),
        };
        if let Some(camera) = self.log.load(LogFormat::Ros2)?.cameras.first() {
            bail!(
                "a ROS 2 import takes the one camera of the mapping (`[camera] topic`), and further ones (`cameras`) of the other \
                 formats alone; found `{camera}`, none is needed"
            );
        }
        self.log.run(LogFormat::Ros2, |source, config| Ros2Log::open(source, mapping, config))
    }
}

impl LogArgs {
    /// The format's config with the file, the overrides and the flags over it.
    pub(super) fn load(&self, format: LogFormat) -> anyhow::Result<ImportConfig> {
        let mut config = ImportConfig::load(format, self.config.as_deref(), &self.overrides)?;
        config.every = self.every.unwrap_or(config.every);
        if !self.cameras.is_empty() {
            config.cameras.clone_from(&self.cameras);
        }
        Ok(config)
    }

    /// Runs the pipeline over an opened log.
    pub(super) fn import(
        &self,
        format: LogFormat,
        config: &ImportConfig,
        log: &dyn Log,
    ) -> anyhow::Result<ExitStatus> {
        let options = ImportOptions {
            scenes: self.scenes.clone(),
            split: self.split,
            skip_bad: self.skip_bad,
            force: self.force,
        };
        let out = self.out.open(Access::Write)?;
        let summary = import::run(log, format, config, out.path(), &options, &Bar::default())?;
        out.push()?;
        print_summary(&summary, self.json)?;
        Ok(if summary.skipped.is_empty() { ExitStatus::Done } else { ExitStatus::DoneWithLosses })
    }

    /// Opens a log and imports it.
    pub(super) fn run<L: Log>(
        &self,
        format: LogFormat,
        open: impl FnOnce(&Path, &ImportConfig) -> Result<L, ImportError>,
    ) -> anyhow::Result<ExitStatus> {
        if !files::is_there(&self.source)? {
            anyhow::bail!("there is no such log: {}", self.source.display());
        }
        let config = self.load(format)?;
        let log = open(&self.source, &config)?;
        self.import(format, &config, &log)
    }
}

pub fn run(args: ImportArgs) -> anyhow::Result<ExitStatus> {
    match args.format {
        ImportCommand::Nuscenes(args) => args.run(LogFormat::Nuscenes, NuScenesLog::open),
        ImportCommand::Kitti(args) => args.run(LogFormat::Kitti, import::open_kitti),
        ImportCommand::Av2(args) => args.run(LogFormat::Av2, import::open_av2),
        ImportCommand::Ros2(args) => args.run(),
        ImportCommand::Predictions(args) => exchange::import(&args),
    }
}
