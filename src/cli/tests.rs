//! The help of every command, and what is said of words that are nearly right.

use super::*;

/// What clap says to a command line; empty where it is valid.
pub(super) fn answer(args: &[&str]) -> String {
    let command = prepare(Cli::command()).term_width(100);
    let matches = command.try_get_matches_from(["harmzone"].iter().chain(args));
    matches.map_or_else(|error| without_workers(error).to_string(), |_| String::new())
}

#[test]
fn the_help_of_every_command() {
    let mut settings = insta::Settings::clone_current();
    settings.set_snapshot_path("../../tests/cli/help");
    settings.set_prepend_module_to_snapshot(false);
    settings.set_omit_expression(true);
    settings.bind(|| {
        insta::assert_snapshot!("harmzone", answer(&["--help"]));
        for command in Cli::command().get_subcommands() {
            insta::assert_snapshot!(command.get_name(), answer(&[command.get_name(), "--help"]));
            for inner in command.get_subcommands() {
                let name = format!("{}-{}", command.get_name(), inner.get_name());
                insta::assert_snapshot!(name, answer(&[command.get_name(), inner.get_name(), "--help"]));
            }
        }
    });
}

#[test]
fn the_page_of_commands_in_the_docs_is_their_help() {
    assert_is_in_docs("reference/commands.md", &man::markdown());
}

#[test]
fn what_is_nearly_right_is_told_the_right_word() {
    let of_command = answer(&["labels", "data"]);
    assert!(of_command.contains("'label'") && !of_command.contains("worker"), "{of_command}");
    let of_flag = answer(&["gen", "--out", "x", "--epsodes", "3"]);
    assert!(of_flag.contains("'--episodes'"), "{of_flag}");
    let of_value = answer(&["gen", "--out", "x", "--preset", "smalls"]);
    assert!(of_value.contains("'small'"), "{of_value}");
}

#[test]
fn a_number_out_of_its_range_is_told_the_range() {
    let mut told = Vec::new();
    for command in Cli::command().get_subcommands() {
        for arg in command.get_arguments().filter(|arg| takes_value(arg)) {
            let flag = arg.get_long().expect("an option has a name");
            let answer = answer(&[command.get_name(), &format!("--{flag}"), "-3"]);
            assert!(!answer.contains("unexpected argument '-3'"), "{answer}");
            // What the standard library says of a number that it cannot parse.
            assert!(!answer.contains("digit") && !answer.contains("literal"), "{answer}");
            if answer.contains("valid is a number from") {
                told.push(format!("{} --{flag}", command.get_name()));
            }
        }
    }
    let numbers = ["gen --episodes", "gen --seed", "gen --samples", "gen --jobs", "zones --sample"];
    let more = [
        "calibrate --false-alarms-per-km",
        "calibrate --braking-false-alarms-per-km",
        "drive --episodes",
        "drive --seed",
        "drive --record-worst",
        "drive --jobs",
        "drive --worker-timeout",
        "report --cards",
        "view --sample",
        "view --min-score",
        "view --width",
        "serve --port",
        "serve --min-score",
    ];
    let of_engine = ["--worker-timeout", "--task-cpus", "--task-gpus", "--in-flight"];
    let is_of_engine =
        |flag: &String| of_engine.iter().any(|of| flag.ends_with(of)) && !flag.starts_with("drive ");
    let (on_a_cluster, told): (Vec<String>, Vec<String>) = told.into_iter().partition(is_of_engine);
    assert_eq!(told, [&numbers[..], &more].concat());
    // gen, label, predict, eval
    assert_eq!(on_a_cluster.len(), 4 * of_engine.len(), "{on_a_cluster:?}");
}
