//! An input or output error at each call of a stage: no torn file, a message, and the same command then ends as ever.

use std::path::Path;

use fs_err as fs;
use harmzone::episode::{LabelManifest, Manifest};

use super::folder::{copy, difference, hashes};
use super::made_data::{TINY, command, done, text};
use super::n_faults;
use super::shim::{Fault, with_fault};

const SMALLEST: [&str; 11] =
    ["gen", "--town", "downtown", "--samples", "2", "--seed", "10", "--set", "val_every=2", "--jobs", "1"];

/// Linux' numbers.
const EIO: i32 = 5;
const ENOSPC: i32 = 28;

/// A line is printed at each of so many calls.
const PROGRESS_CALLS: u64 = 50;

/// What came of one stage.
#[derive(Default, Debug)]
struct Outcome {
    n_calls: u64,
    n_failed: usize,
    /// Ended well all the same.
    n_unharmed: usize,
    faults: Vec<String>,
}

/// The smallest data that a network trains on, in a folder; each stage is a command that goes on in it.
fn stages(home: &Path) -> Vec<(&'static str, Vec<String>)> {
    let out = home.join("data");
    let run = home.join("data/run");
    let owned = |words: &[&str]| words.iter().map(|&word| word.to_owned()).collect();
    let tiny =
        [TINY.as_slice(), &["--set", "lidar_stage.epochs=1", "--set", "fused_stage.epochs=1"]].concat();
    vec![
        ("gen", owned(&[SMALLEST.as_slice(), &["--episodes", "2", "--out", text(&out)]].concat())),
        ("label", owned(&["label", text(&out)])),
        ("train", owned(&[&["train", text(&out), "--out", text(&run)], tiny.as_slice()].concat())),
    ]
}

/// Runs a stage on a copy of what was before it, with a fault; tells what is wrong afterwards.
fn check(words: &[String], home: &Path, before: &Path, after: &Path, fault: Fault, outcome: &mut Outcome) {
    let data = home.join("data");
    if data.exists() {
        fs::remove_dir_all(&data).expect("a folder of ours");
    }
    if before.exists() {
        copy(before, &data);
    }
    let mut faulty = command(&words.iter().map(String::as_str).collect::<Vec<_>>());
    let Some(_counter) = with_fault(&mut faulty, &data, fault) else { return };
    let output = faulty.output().expect("the program starts");
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    let mut wrong = |text: String| outcome.faults.push(format!("{fault:?}: {text}"));
    match output.status.code() {
        Some(0) => outcome.n_unharmed += 1,
        Some(1 | 3) => {
            outcome.n_failed += 1;
            let names_it = told.contains("os error") || told.contains("space") || told.contains("lock");
            if !names_it || !told.contains(text(&data)) {
                wrong(format!("a message that does not name error and path: {told}"));
            }
        }
        code => wrong(format!("ended with {code:?}: {told}")),
    }
    if told.contains("panicked") {
        wrong(format!("a panic: {told}"));
    }
    if data.exists() {
        for text in torn(&data, after) {
            wrong(text);
        }
    }
    let again =
        command(&words.iter().map(String::as_str).collect::<Vec<_>>()).output().expect("the program starts");
    if !again.status.success() {
        return wrong(format!("the same command fails: {}", String::from_utf8_lossy(&again.stderr)));
    }
    if let Some(text) = difference(&hashes(&data), &hashes(after)) {
        wrong(format!("after the same command, {text}"));
    }
}

/// Files under final names that are neither what an unbroken run leaves nor a whole file of less.
fn torn(data: &Path, after: &Path) -> Vec<String> {
    let wanted = hashes(after);
    let mut found = Vec::new();
    for (name, sha256) in hashes(data) {
        let is_whole = wanted.get(&name).is_none_or(|wanted| *wanted == sha256);
        let is_less = || match name.rsplit('/').next().unwrap_or_default() {
            Manifest::FILE => Manifest::read(data).is_ok(),
            LabelManifest::FILE => LabelManifest::read(data, "rect").is_ok(),
            // Of a run that is not at its end.
            "log.csv" | "validation.csv" => {
                let read = |folder: &Path| fs::read_to_string(folder.join(&name)).unwrap_or_default();
                read(after).starts_with(&read(data))
            }
            "curves.png" => image::open(data.join(&name)).is_ok(),
            "curves.svg" => {
                fs::read_to_string(data.join(&name)).is_ok_and(|text| text.trim_end().ends_with("</svg>"))
            }
            _ => false,
        };
        if !name.contains(".partial") && !name.contains("/state/") && !is_whole && !is_less() {
            found.push(format!("{name} is torn"));
        }
    }
    found
}

/// Fails calls of each stage, all of them or so many at even distances.
fn fail(most: Option<usize>, errnos: &[i32], wanted: Option<&str>) -> Vec<(&'static str, Outcome)> {
    let home = tempfile::tempdir().expect("a temporary folder");
    let snapshots = tempfile::tempdir().expect("a temporary folder");
    let mut outcomes = Vec::new();
    let mut before = snapshots.path().join("nothing");
    for (name, words) in stages(home.path()) {
        let data = home.path().join("data");
        let mut outcome = Outcome::default();
        if data.exists() {
            fs::remove_dir_all(&data).expect("a folder of ours");
        }
        if before.exists() {
            copy(&before, &data);
        }
        let words_of: Vec<&str> = words.iter().map(String::as_str).collect();
        let mut counted = command(&words_of);
        let Some(counter) = with_fault(&mut counted, &data, Fault::None) else { return outcomes };
        assert!(counted.status().expect("the program starts").success());
        outcome.n_calls = counter.n_calls();
        let after = snapshots.path().join(name);
        copy(&data, &after);
        let step = most.map_or(1, |most| (outcome.n_calls as usize / most).max(1));
        // The other stages run without errors.
        if !wanted.is_none_or(|wanted| wanted.split(',').any(|of| of == name)) {
            before = after;
            continue;
        }
        for &errno in errnos {
            for number in (0..outcome.n_calls).step_by(step) {
                // Of hours of work somebody wants to know how far it is.
                if number % PROGRESS_CALLS == 0 {
                    println!("{name}: error {errno} at call {number} of {}", outcome.n_calls);
                }
                let fault = Fault::Call { number, errno };
                check(&words, home.path(), &before, &after, fault, &mut outcome);
            }
        }
        for fault in [Fault::Short, Fault::Clock] {
            let n_before = outcome.n_unharmed;
            check(&words, home.path(), &before, &after, fault, &mut outcome);
            if outcome.n_unharmed == n_before {
                outcome.faults.push(format!("{fault:?} made it fail"));
            }
        }
        // Whoever stops it keeps the rows of the stages that ended.
        if outcomes.is_empty() {
            println!("{:<8} {:>8} {:>8} {:>10} {:>8}", "stage", "calls", "failed", "unharmed", "faults");
        }
        let Outcome { n_calls, n_failed, n_unharmed, faults } = &outcome;
        println!("{name:<8} {n_calls:>8} {n_failed:>8} {n_unharmed:>10} {:>8}", faults.len());
        outcomes.push((name, outcome));
        before = after;
    }
    outcomes
}

fn assert_unharmed(outcomes: &[(&str, Outcome)]) {
    for (name, outcome) in outcomes {
        assert!(outcome.faults.is_empty(), "{name}:\n{}", outcome.faults.join("\n"));
    }
}

#[test]
fn an_error_at_some_calls_tears_no_file() {
    assert_unharmed(&fail(Some(2), &[EIO], None));
}

#[test]
#[ignore = "an hour: make soak ROWS=io_errors; HARMZONE_FAULT_STAGES=train alone is half of it"]
fn long_io_errors() {
    let most = std::env::var_os("HARMZONE_FAULTS").map(|_| n_faults(0));
    let wanted = std::env::var("HARMZONE_FAULT_STAGES").ok();
    let outcomes = fail(most, &[EIO, ENOSPC], wanted.as_deref());
    let n_wanted = wanted.map_or(3, |wanted| wanted.split(',').count());
    assert_eq!(outcomes.len(), n_wanted, "HARMZONE_FAULT_STAGES takes gen, label and train");
    assert_unharmed(&outcomes);
}

#[test]
fn whole_data_is_not_changed_by_who_reads_it_with_errors() {
    let home = tempfile::tempdir().expect("a temporary folder");
    let data = home.path().join("data");
    done(&[SMALLEST.as_slice(), &["--episodes", "1", "--out", text(&data)]].concat());
    let before = hashes(&data);
    let mut counted = command(&["info", text(&data)]);
    let Some(counter) = with_fault(&mut counted, &data, Fault::None) else { return };
    assert!(counted.output().expect("the program starts").status.success());
    let n_calls = counter.n_calls();
    assert!(n_calls > 0);
    for number in 0..n_calls {
        let mut faulty = command(&["info", text(&data)]);
        let _counter = with_fault(&mut faulty, &data, Fault::Call { number, errno: EIO });
        let output = faulty.output().expect("the program starts");
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(
            output.status.success() || (told.contains(text(&data)) && !told.contains("panicked")),
            "{number}: {told}"
        );
        assert_eq!(difference(&hashes(&data), &before), None);
    }
}
