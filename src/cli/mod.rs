//! The command line: flags, logging, progress bars, exit codes; one file a subcommand.

mod baseline;
mod curves;
mod device;
mod doctor;
mod eval;
mod generate;
mod generate_worker;
mod info;
mod label;
mod predict;
mod progress;
mod report;
mod sweep;
mod train;
mod view;
mod zones;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

pub use device::DeviceArg;
pub use eval::command_line;
pub use predict::open_split;
pub use progress::Bar;

/// Finds what matters to a self-driving car: makes driving episodes, labels objects harmful or
/// harmless by a danger zone, trains a fused LiDAR-camera detector and scores it.
#[derive(Debug, Parser)]
#[command(name = "harmzone", version, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Drive a simulated town and write episodes
    Gen(generate::GenerateArgs),
    /// Write one episode; the processes that `gen --jobs` starts
    #[command(hide = true)]
    GenWorker(generate_worker::WorkerArgs),
    /// Label the objects of a dataset harmful or harmless by a danger zone
    Label(label::LabelArgs),
    /// Compare the danger zones on one dataset: harmful shares, objects that change sides, a picture
    Zones(zones::ZonesArgs),
    /// Tell what a dataset holds, beside the paper's: counts, harmful shares, hardness, histograms
    Info(info::InfoArgs),
    /// Train a detector on a labelled dataset
    Train(train::TrainArgs),
    /// Draw the course of a training: losses, learning rate, AP on the validation split
    Curves(curves::CurvesArgs),
    /// Write a detector's boxes for a dataset
    Predict(predict::PredictArgs),
    /// Score a detector, or any detector's JSON, in and out of distribution
    Eval(eval::EvalArgs),
    /// Write the boxes of a rival that decides on harm without the network's class branch
    Baseline(baseline::BaselineArgs),
    /// Show a dataset's frames at other speeds and steering angles: curves, pictures, sensor errors
    Sweep(sweep::SweepArgs),
    /// Make one HTML page of scores: tables, curves, and a gallery of the worst misses and false alarms
    Report(report::ReportArgs),
    /// Draw a sample with its zone, truth and predictions
    View(view::ViewArgs),
    /// Tell what this machine has and what is missing
    Doctor(doctor::DoctorArgs),
}

/// How a subcommand ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExitStatus {
    Done,
    /// Done, but something was left out; the summary says what.
    DoneWithLosses,
}

/// Runs the program on the process's arguments.
#[must_use]
pub fn main() -> ExitCode {
    let command = Cli::parse().command;
    finish(|| match command {
        Command::Gen(args) => generate::run(args),
        Command::GenWorker(args) => generate_worker::run(args),
        Command::Label(args) => label::run(args),
        Command::Zones(args) => zones::run(args),
        Command::Info(args) => info::run(args),
        Command::Train(args) => train::run(args),
        Command::Curves(args) => curves::run(args),
        Command::Predict(args) => predict::run(args),
        Command::Eval(args) => eval::run(args),
        Command::Baseline(args) => baseline::run(args),
        Command::Sweep(args) => sweep::run(args),
        Command::Report(args) => report::run(args),
        Command::View(args) => view::run(args),
        Command::Doctor(args) => doctor::run(args),
    })
}

/// Does the work of a command, with logs on stderr, and tells how it ended.
#[must_use]
pub fn finish(work: impl FnOnce() -> anyhow::Result<ExitStatus>) -> ExitCode {
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .without_time()
        .with_target(false)
        .with_env_filter(
            tracing_subscriber::EnvFilter::try_from_env("HARMZONE_LOG").unwrap_or_else(|_| "warn".into()),
        )
        .init();
    match work() {
        Ok(ExitStatus::Done) => ExitCode::SUCCESS,
        Ok(ExitStatus::DoneWithLosses) => ExitCode::from(3),
        Err(error) => {
            let mut told = error.to_string();
            eprintln!("error: {told}");
            for cause in error.chain().skip(1).map(ToString::to_string) {
                // Most messages hold their cause already.
                if !told.contains(&cause) {
                    eprintln!("  because: {cause}");
                    told.push_str(&cause);
                }
            }
            ExitCode::FAILURE
        }
    }
}
