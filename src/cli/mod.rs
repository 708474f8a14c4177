//! The command line: flags, logging, progress bars, exit codes; one file a subcommand.

mod baseline;
mod calibrate;
mod compare;
mod completions;
mod config;
mod curves;
mod detectors;
mod device;
mod doctor;
mod drive;
mod drive_worker;
mod engine;
mod eval;
mod examples;
mod exchange;
mod export;
mod foxglove_layout;
mod generate;
mod generate_worker;
mod heartbeat;
mod import;
mod info;
mod init;
mod label;
mod label_worker;
mod man;
mod merge;
mod migrate;
mod output;
mod predict;
mod predict_worker;
mod progress;
mod report;
mod serve;
mod sweep;
#[cfg(test)]
mod tests;
mod train;
mod urls;
mod values;
mod verbosity;
mod versus;
mod view;
mod world;
mod zones;

use std::ffi::OsString;
use std::process::ExitCode;
use std::sync::OnceLock;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory as _, Parser, Subcommand};

use tracing_subscriber::filter::{FilterExt as _, filter_fn};
use tracing_subscriber::layer::{Layer as _, SubscriberExt as _};
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, fmt};

pub use detectors::{judge_all, judge_all_at};
pub use device::{DeviceArg, DeviceNameArg, DevicesArg};
pub use eval::{ScoredData, command_line, provenance, tell_learned, tell_seen};
pub use output::{ClosedPipe, path_text, print, print_either, print_summary, tell};
pub use progress::Bar;
pub use values::{SamplesArgs, number, one_of, sensor, split};
use verbosity::VerbosityArgs;

use crate::interrupt;

/// Finds what matters to a self-driving car: makes driving episodes, labels objects harmful or
/// harmless by a danger zone, trains a fused LiDAR-camera detector and scores it.
#[derive(Debug, Parser)]
#[command(name = "harmzone", version, max_term_width = 100, after_help = EXIT_CODES)]
struct Cli {
    #[command(flatten)]
    verbosity: VerbosityArgs,
    #[command(subcommand)]
    command: Command,
}

const EXIT_CODES: &str = "Results go to standard output, logs and progress to standard error; colours only where a terminal shows them, and not with
NO_COLOR. `harmzone COMMAND --help` has examples.
Exit codes: 0 done; 1 failed; 2 wrong usage; 3 done, but a part that was asked for is missing, which standard error names;
130 or 143 ended by Ctrl-C or SIGTERM: what is whole is kept, and the same command goes on.";

#[derive(Debug, Subcommand)]
enum Command {
    /// Drive a simulated town and write episodes
    Gen(generate::GenerateArgs),
    /// Write episodes for `gen`, which starts this command as a process of its own
    #[command(hide = true)]
    GenWorker(generate_worker::WorkerArgs),
    /// Join the shards of a data set or of predictions, which `gen --shard` or `predict --shard` made in several places
    Merge(merge::MergeArgs),
    /// Make a data set of the logs of real cars
    Import(import::ImportArgs),
    /// Label the objects of a data set harmful or harmless by a danger zone
    Label(label::LabelArgs),
    /// Label episodes for `label`, which starts this command as a process of its own
    #[command(hide = true)]
    LabelWorker(label_worker::LabelWorkerArgs),
    /// Compare the danger zones on one data set: harmful shares, objects that change sides, a picture
    Zones(zones::ZonesArgs),
    /// Tell what a data set holds, beside the paper's: counts, harmful shares, hardness, histograms
    Info(info::InfoArgs),
    /// Set two data sets side by side, such as simulation and a real log: the domain gap in figures
    Compare(compare::CompareArgs),
    /// Train a detector on a labelled data set
    Train(train::TrainArgs),
    /// Draw the course of a training: losses, learning rate, AP on the validation split
    Curves(curves::CurvesArgs),
    /// Write a detector's boxes for a data set
    Predict(predict::PredictArgs),
    /// Predict episodes for `predict` and `eval`, which start this command as a process of its own
    #[command(hide = true)]
    PredictWorker(predict_worker::PredictWorkerArgs),
    /// Score a detector, or any detector's JSON, in and out of distribution
    Eval(eval::EvalArgs),
    /// Choose the score from which on a network warns, by its false alarms, and keep it with the network
    Calibrate(calibrate::CalibrateArgs),
    /// Write the boxes of a rival that decides on harm without the network's class branch
    Baseline(baseline::BaselineArgs),
    /// Set detectors side by side on the same samples: what each finds, and gains over the first, with intervals
    Versus(versus::VersusArgs),
    /// Let the ego drive on perception alone: collisions avoided, false stops, against who sees nothing and who sees all
    Drive(drive::DriveArgs),
    /// Drive for `drive`, which starts this command as a process of its own
    #[command(hide = true)]
    DriveWorker(drive_worker::DriveWorkerArgs),
    /// Show a data set's frames at other speeds and steering angles: curves, pictures, sensor errors
    Sweep(sweep::SweepArgs),
    /// Make one HTML page of scores: tables, curves, and a gallery of the worst misses and false alarms
    Report(report::ReportArgs),
    /// Look at a data set with its zone, true boxes and predictions: a picture, a clip, a file for Foxglove or Rerun
    View(view::ViewArgs),
    /// Show a folder's episodes, scores and reports in the browser of this machine: filter, play, read
    Serve(serve::ServeArgs),
    /// Write the layout with which Foxglove shows what `view --mcap` writes
    FoxgloveLayout(foxglove_layout::FoxgloveLayoutArgs),
    /// Write a data set or predictions in the formats of other tools
    Export(export::ExportArgs),
    /// Tell what this machine has and lacks, or what is wrong with a data set
    Doctor(doctor::DoctorArgs),
    /// Write a data set's manifests in today's format; episodes and labels stay as they are
    Migrate(migrate::MigrateArgs),
    /// Make a folder to work in: commented configs, and the commands of a whole experiment
    Init(init::InitArgs),
    /// Show the settings of a stage, or tell what a key is
    Config(config::ConfigArgs),
    /// Print what a shell completes commands and flags by
    Completions(completions::CompletionsArgs),
    /// Print the manual's page of a command, or write all pages
    Man(man::ManArgs),
}

impl Command {
    /// Whether a signal asks it to end, with what is whole kept; the others are ended at once.
    fn keeps_what_is_whole(&self) -> bool {
        matches!(
            self,
            Self::Gen(_)
                | Self::Merge(_)
                | Self::Import(_)
                | Self::Label(_)
                | Self::Train(_)
                | Self::Predict(_)
                | Self::Eval(_)
                | Self::Drive(_)
                | Self::Export(_)
                | Self::View(_)
        )
    }
}

/// How a subcommand ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExitStatus {
    Done,
    /// Done, but a part that was asked for is missing; standard error says which.
    DoneWithLosses,
}

/// Runs the program on the process's arguments.
#[must_use]
pub fn main() -> ExitCode {
    code().into()
}

/// What another program gave as this one's arguments.
static GIVEN_ARGS: OnceLock<Vec<OsString>> = OnceLock::new();

/// Runs the program on arguments that the program around it hands over, once a process: the words after `harmzone`.
/// Returns the exit code.
#[must_use]
pub fn main_on(words: Vec<OsString>) -> u8 {
    GIVEN_ARGS.get_or_init(|| words);
    code()
}

fn code() -> u8 {
    let cli = parse::<Cli>();
    cli.verbosity.apply();
    if cli.command.keeps_what_is_whole() {
        // Where the system refuses, signals end the process as ever.
        let _ = interrupt::listen();
    }
    code_of(cli.verbosity.filter(), || run(cli))
}

/// The program's commands as a reader sees them: with examples, without those that the program starts by itself.
fn visible() -> clap::Command {
    fn without_hidden(command: clap::Command) -> clap::Command {
        let mut kept = clap::Command::new("harmzone");
        let hidden = |inner: &&clap::Command| !inner.is_hide_set();
        let inner: Vec<clap::Command> = command.get_subcommands().filter(hidden).cloned().collect();
        if inner.len() == command.get_subcommands().count() {
            return command;
        }
        kept = command.get_arguments().fold(kept, |kept, arg| kept.arg(arg.clone()));
        if let Some(about) = command.get_about() {
            kept = kept.about(about.clone());
        }
        if let Some(after) = command.get_after_help() {
            kept = kept.after_help(after.clone());
        }
        kept.subcommands(inner).subcommand_required(true).version(env!("CARGO_PKG_VERSION"))
    }
    let mut command = without_hidden(prepare(Cli::command())).max_term_width(100).term_width(100);
    // Inner commands then know their whole names.
    command.build();
    command
}

/// What every command is given beside what its struct says.
fn prepare(command: clap::Command) -> clap::Command {
    examples::with_examples(urls::refuse_elsewhere(take_negative_numbers(command)))
}

/// The arguments, without the program's name.
fn words() -> Vec<OsString> {
    GIVEN_ARGS.get().cloned().unwrap_or_else(|| std::env::args_os().skip(1).collect())
}

fn run(cli: Cli) -> anyhow::Result<ExitStatus> {
    match cli.command {
        Command::Gen(args) => generate::run(args),
        Command::GenWorker(args) => generate_worker::run(args),
        Command::Merge(args) => merge::run(args),
        Command::Import(args) => import::run(args),
        Command::Label(args) => label::run(args),
        Command::LabelWorker(args) => label_worker::run(args),
        Command::Zones(args) => zones::run(args),
        Command::Info(args) => info::run(args),
        Command::Compare(args) => compare::run(args),
        Command::Train(args) => train::run(args),
        Command::Curves(args) => curves::run(args),
        Command::Predict(args) => predict::run(args),
        Command::PredictWorker(args) => predict_worker::run(args),
        Command::Eval(args) => eval::run(args),
        Command::Calibrate(args) => calibrate::run(args),
        Command::Baseline(args) => baseline::run(args),
        Command::Versus(args) => versus::run(args),
        Command::Drive(args) => drive::run(args),
        Command::DriveWorker(args) => drive_worker::run(args),
        Command::Sweep(args) => sweep::run(args),
        Command::Report(args) => report::run(args),
        Command::View(args) => view::run(args),
        Command::Serve(args) => serve::run(args),
        Command::FoxgloveLayout(args) => foxglove_layout::run(args),
        Command::Export(args) => export::run(args),
        Command::Doctor(args) => doctor::run(args),
        Command::Migrate(args) => migrate::run(args),
        Command::Init(args) => init::run(args),
        Command::Config(args) => config::run(args),
        Command::Completions(args) => completions::run(args),
        Command::Man(args) => man::run(args),
    }
}

/// Reads the process's arguments; ends the process where they are not valid.
#[must_use]
pub fn parse<C: Parser>() -> C {
    let mut command = prepare(C::command());
    // Before clap quotes it.
    if let Err(error) = urls::refuse_credentials(&words()) {
        command.error(ErrorKind::ValueValidation, error).exit();
    }
    let name = OsString::from(command.get_name());
    let matches = command.try_get_matches_from_mut([name].into_iter().chain(words()));
    let matches = matches.unwrap_or_else(|error| without_workers(error).exit());
    C::from_arg_matches(&matches).unwrap_or_else(|error| error.exit())
}

/// The error without suggestions of commands that only the program starts.
fn without_workers(mut error: clap::Error) -> clap::Error {
    let kind = ContextKind::SuggestedSubcommand;
    if let Some(ContextValue::Strings(names)) = error.remove(kind) {
        let kept: Vec<String> = names.into_iter().filter(|name| !name.ends_with("-worker")).collect();
        if !kept.is_empty() {
            error.insert(kind, ContextValue::Strings(kept));
        }
    }
    error
}

/// Lets options take values such as `-3`, so that the error says what is valid and not that `-3` is no flag.
fn take_negative_numbers(command: clap::Command) -> clap::Command {
    let command =
        command.mut_args(|arg| if takes_value(&arg) { arg.allow_negative_numbers(true) } else { arg });
    command.mut_subcommands(take_negative_numbers)
}

fn takes_value(arg: &clap::Arg) -> bool {
    arg.get_long().is_some() && arg.get_action().takes_values()
}

/// Does the work of a command, with logs on stderr, and tells how it ended. A closed pipe is a quiet end, as in ripgrep.
#[must_use]
pub fn finish(work: impl FnOnce() -> anyhow::Result<ExitStatus>) -> ExitCode {
    let wanted = EnvFilter::try_from_env("HARMZONE_LOG").unwrap_or_else(|_| "warn".into());
    code_of(wanted, work).into()
}

fn code_of(wanted: EnvFilter, work: impl FnOnce() -> anyhow::Result<ExitStatus>) -> u8 {
    let filter = wanted.and(filter_fn(|of| !urls::logs_credentials(of.target())));
    let lines = fmt::layer().with_writer(std::io::stderr).without_time().with_target(false);
    tracing_subscriber::registry().with(lines.with_filter(filter)).init();
    match work() {
        Ok(ExitStatus::Done) => 0,
        Ok(ExitStatus::DoneWithLosses) => 3,
        Err(error) if error.is::<ClosedPipe>() => 0,
        Err(error) if let Some(code) = interrupt::exit_code() => {
            tracing::debug!("{error:#}");
            tell("interrupted: what is whole is kept, and the same command goes on");
            code
        }
        Err(error) => {
            let mut told = error.to_string();
            tell(format!("{} {told}", verbosity::error_word()));
            for cause in error.chain().skip(1).map(ToString::to_string) {
                // Most messages hold their cause already.
                if !told.contains(&cause) {
                    tell(format!("  because: {cause}"));
                    told.push_str(&cause);
                }
            }
            1
        }
    }
}

/// Checks that a page that the program prints lies in docs/; with `UPDATE_DOCS=1` it is written there.
#[cfg(test)]
fn assert_is_in_docs(page: &str, text: &str) {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("docs").join(page);
    if std::env::var_os("UPDATE_DOCS").is_some() {
        crate::files::write_atomic(&path, text.as_bytes()).expect("the docs can be written");
    }
    let there = fs_err::read_to_string(&path).unwrap_or_default();
    assert!(there == text, "docs/{page} is not what the program prints: make reference");
}
