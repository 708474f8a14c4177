//! Stages that are killed at random moments, and called again until they end, leave the bytes of an unbroken run.

use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use harmzone::random::{Rng, stream};
use rand::RngExt as _;

use super::folder::{difference, hashes};
use super::n_faults;
use super::stages::{Stage, all, clear};

/// Kills before a run may end.
const MOST_A_RUN: usize = 3;

/// What came of one stage.
#[derive(Default)]
struct Outcome {
    n_runs: usize,
    n_kills: usize,
    differences: Vec<String>,
}

/// Starts a stage, kills it after a while, and so on; then lets it end. A worker that is left may go on writing meanwhile.
fn run(stage: &Stage, rng: &mut Rng, outcome: &mut Outcome) {
    let home = tempfile::tempdir().expect("a temporary folder");
    let out = home.path().join("out");
    stage.prepare(&out);
    let took = stage.unbroken().took.as_secs_f64();
    for _ in 0..rng.random_range(1..=MOST_A_RUN) {
        let after = Duration::from_secs_f64(rng.random_range(0.0..took));
        let mut child = quiet(stage.command(&out)).spawn().expect("the program starts");
        outcome.n_kills += usize::from(is_killed(&mut child, after));
    }
    let finished = stage.finish(&out);
    outcome.n_runs += 1;
    let differs = || difference(&hashes(&out), &stage.unbroken().hashes);
    outcome.differences.extend(finished.err().or_else(differs));
    clear(&out);
}

fn quiet(mut command: Command) -> Command {
    command.stdout(Stdio::null()).stderr(Stdio::null());
    command
}

/// Kills a process after a while; whether it was still at work.
fn is_killed(child: &mut Child, after: Duration) -> bool {
    let begin = Instant::now();
    while begin.elapsed() < after {
        if child.try_wait().expect("a child of ours").is_some() {
            return false;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    let is_at_work = child.try_wait().expect("a child of ours").is_none();
    if is_at_work {
        child.kill().expect("a running program can be killed");
        child.wait().expect("a killed program ends");
    }
    is_at_work
}

/// Kills all stages so often in all, and tells what came of it.
fn kill(n_kills: usize, seed: u64) -> Vec<(&'static str, Outcome)> {
    let mut rng = stream(seed, "kills", 0);
    let stages = all();
    let mut outcomes: Vec<(&'static str, Outcome)> =
        stages.iter().map(|stage| (stage.name, Outcome::default())).collect();
    loop {
        let n_done: usize = outcomes.iter().map(|(_, outcome)| outcome.n_kills).sum();
        println!("{n_done} of {n_kills} kills");
        if n_done >= n_kills {
            return outcomes;
        }
        for (stage, (_, outcome)) in stages.iter().zip(&mut outcomes) {
            run(stage, &mut rng, outcome);
        }
    }
}

fn assert_equal(outcomes: &[(&str, Outcome)]) {
    for (name, outcome) in outcomes {
        assert!(outcome.differences.is_empty(), "{name}: {:?}", outcome.differences);
    }
}

#[test]
fn killed_stages_end_with_the_bytes_of_unbroken_ones() {
    assert_equal(&kill(6, 1));
}

#[test]
#[ignore = "half an hour: make soak ROWS=kills"]
fn long_kills() {
    let outcomes = kill(n_faults(1_000), 20);
    println!("{:<10} {:>6} {:>6} {:>22}", "stage", "kills", "runs", "runs with other bytes");
    let mut sums = [0; 3];
    for (name, Outcome { n_runs, n_kills, differences }) in &outcomes {
        println!("{name:<10} {n_kills:>6} {n_runs:>6} {:>22}", differences.len());
        [*n_kills, *n_runs, differences.len()].iter().zip(&mut sums).for_each(|(n, sum)| *sum += n);
    }
    println!("{:<10} {:>6} {:>6} {:>22}", "all", sums[0], sums[1], sums[2]);
    assert_equal(&outcomes);
}
