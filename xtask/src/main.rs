//! What developers of harmzone run through `make`: the results, the races and the benchmarks.

mod bench;
mod bench_command;
mod bench_gen;
mod bench_gen_command;
mod bench_model;
mod bench_model_command;
mod bench_stream;
mod bench_stream_command;
mod results;
mod results_command;

use clap::{Parser, Subcommand};
use harmzone::cli::ExitStatus;

/// What developers of harmzone run through `make`.
#[derive(Debug, Parser)]
#[command(name = "xtask", max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Measure all that is waited for, and print it beside what is wanted; fails where a floor is missed
    Bench(bench_command::BenchArgs),
    /// Measure the speed of `gen`: against bare MuJoCo, with several processes, and its memory
    BenchGen(bench_gen_command::BenchArgs),
    /// Measure the speed of a detector: inference stage by stage, training steps part by part
    BenchModel(bench_model_command::BenchModelArgs),
    /// Measure time and memory of a made-up data set of many episodes: manifests, `merge`, and samples as training streams them
    BenchStream(bench_stream_command::BenchStreamArgs),
    /// One stage of `bench-stream`
    #[command(hide = true)]
    BenchStreamStage(bench_stream_command::StageArgs),
    /// Write one episode; the processes that the others start to generate
    #[command(hide = true)]
    GenWorker,
    /// Generate, train and score a whole experiment, and write its tables
    Results(results_command::ResultsArgs),
}

fn main() -> std::process::ExitCode {
    harmzone::cli::finish(|| match harmzone::cli::parse::<Cli>().command {
        Command::Bench(args) => bench_command::run(args),
        Command::BenchGen(args) => bench_gen_command::run(args),
        Command::BenchModel(args) => bench_model_command::run(args),
        Command::BenchStream(args) => bench_stream_command::run(args),
        Command::BenchStreamStage(args) => bench_stream_command::run_stage(&args),
        Command::GenWorker => {
            harmzone::generate::worker::serve(std::io::stdin().lock(), std::io::stdout().lock())?;
            Ok(ExitStatus::Done)
        }
        Command::Results(args) => results_command::run(args),
    })
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::*;

    #[test]
    fn the_help_of_every_command() {
        for command in Cli::command().get_subcommands() {
            let help =
                Cli::command().term_width(100).try_get_matches_from(["xtask", command.get_name(), "--help"]);
            insta::assert_snapshot!(command.get_name(), help.expect_err("help ends a command"));
        }
    }
}
