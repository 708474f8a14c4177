//! An input or output error at each call of a stage: no torn file, a message, and the same command then ends as ever.

use std::collections::BTreeMap;
use std::path::Path;

use fs_err as fs;
use harmzone::episode::{LabelManifest, Manifest};
use harmzone::files::{is_lock, is_unfinished};

use super::folder::{copy, difference, hashes};
use super::made_data::{TINY, command, done, succeed, text};
use super::n_faults;
use super::shim::{Fault, with_fault};

const SMALLEST: [&str; 11] =
    ["gen", "--town", "downtown", "--samples", "2", "--seed", "10", "--set", "val_every=2", "--jobs", "1"];

/// Linux' numbers.
pub const EIO: i32 = 5;
const EEXIST: i32 = 17;
const ENOSPC: i32 = 28;

/// The label set of the stages.
const SET: &str = "rect";

/// A line is printed at each of so many calls.
const PROGRESS_CALLS: u64 = 50;

/// What came of one stage.
#[derive(Default, Debug)]
pub struct Outcome {
    pub n_calls: u64,
    n_failed: usize,
    /// Ended well all the same.
    n_unharmed: usize,
    pub faults: Vec<String>,
}

impl Outcome {
    pub fn print_head() {
        println!("{:<12} {:>8} {:>8} {:>10} {:>8}", "stage", "calls", "failed", "unharmed", "faults");
    }

    pub fn print(&self, name: &str) {
        let Self { n_calls, n_failed, n_unharmed, faults } = self;
        println!("{name:<12} {n_calls:>8} {n_failed:>8} {n_unharmed:>10} {:>8}", faults.len());
        // At once: a later stage may end the test.
        faults.iter().for_each(|fault| println!("{name}: {fault}"));
    }
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
pub fn check(
    words: &[String],
    home: &Path,
    before: &Path,
    after: &Path,
    fault: Fault,
    outcome: &mut Outcome,
) {
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
    let mut told = String::from_utf8_lossy(&output.stderr).into_owned();
    if output.status.code() == Some(3) {
        // What `doctor` finds is its result.
        told += &String::from_utf8_lossy(&output.stdout);
    }
    let mut wrong = |text: String| outcome.faults.push(format!("{fault:?}: {text}"));
    match output.status.code() {
        Some(0) => {
            outcome.n_unharmed += 1;
            // At once: the same command would make anew what is lost.
            if let Some(text) = difference(&finished(&data, &told), &finished(after, &told)) {
                wrong(format!("it ended well, and {text}: {told}"));
            }
        }
        Some(code @ (1 | 3)) => {
            outcome.n_failed += 1;
            if !names_fault(code, &told, fault, &data) {
                wrong(format!("a message that does not name error and path: {told}"));
            }
        }
        code => wrong(format!("ended with {code:?}: {told}")),
    }
    if told.contains("panicked") {
        wrong(format!("a panic: {told}"));
    }
    if data.exists() {
        for text in [torn(&data, after), lost(&data, before, after)].concat() {
            wrong(text);
        }
    }
    let again =
        command(&words.iter().map(String::as_str).collect::<Vec<_>>()).output().expect("the program starts");
    // Results that are there already are what the first command left, and are compared all the same.
    let is_done = String::from_utf8_lossy(&again.stderr).contains("exist already");
    if !again.status.success() && !is_done {
        return wrong(format!("the same command fails: {}", String::from_utf8_lossy(&again.stderr)));
    }
    if let Some(text) = difference(&hashes(&data), &hashes(after)) {
        wrong(format!("after the same command, {text}"));
    }
}

/// What of a folder a command that ended well answers for: leftovers under names that say so may be there, and the curves may be missing
/// where that is told.
fn finished(folder: &Path, told: &str) -> BTreeMap<String, String> {
    let mut found = hashes(folder);
    let file = |name: &str| name.rsplit('/').next().unwrap_or_default().to_owned();
    // A run's folder has a lock of its own for its curves.
    let is_lock = |name: &str| is_lock(Path::new(name)) || file(name) == "curves.partial";
    let is_left = |name: &str| is_unfinished(Path::new(name)) || is_lock(name);
    let is_curves = |name: &str| file(name).starts_with("curves.");
    found.retain(|name, _| !(is_left(name) || told.contains("left out: the curves") && is_curves(name)));
    found
}

/// Whether a message names the error of the disk and a path in the folder.
fn names_fault(code: i32, told: &str, fault: Fault, data: &Path) -> bool {
    let Fault::Call { errno, .. } = fault else { return false };
    // What comes before is of progress; that something was left out is told on the way.
    let error = if code == 1 { told.find("error: ").map(|at| &told[at..]) } else { Some(told) };
    let Some(error) = error else { return false };
    let is_reason = |errno: i32| error.contains(&format!("(os error {errno})"));
    // A folder that cannot be looked at seems to be in the way of itself.
    let names_reason = is_reason(errno)
        || (errno == ENOSPC && error.contains("no space left on the disk"))
        || (is_reason(EEXIST) && error.contains("failed to create directory"));
    let folder = text(data);
    let names_path = error.match_indices(folder).any(|(at, _)| {
        let rest = error[at + folder.len()..].chars().next();
        rest.is_none_or(|next| !next.is_alphanumeric())
    });
    names_reason && names_path
}

/// Files that were there before and are not now, and those that a manifest names and that are not what it says.
fn lost(data: &Path, before: &Path, after: &Path) -> Vec<String> {
    let (there, wanted) = (hashes(data), hashes(after));
    let known = if before.exists() { hashes(before) } else { BTreeMap::new() };
    // What the stage replaces is in both, and not the same.
    let kept = known.into_iter().filter(|(name, sha256)| wanted.get(name) == Some(sha256));
    let gone = kept.filter(|(name, sha256)| there.get(name) != Some(sha256));
    let mut found: Vec<String> = gone.map(|(name, _)| format!("{name} was there before")).collect();
    let sets = there.keys().filter_map(|name| name.strip_suffix(Manifest::FILE));
    for set in sets.filter(|set| set.is_empty() || set.ends_with('/')) {
        let folder = data.join(set);
        let episodes = Manifest::read(&folder).map(|manifest| manifest.episodes).unwrap_or_default();
        let labels = LabelManifest::read(&folder, SET).map(|manifest| manifest.episodes).unwrap_or_default();
        let of_labels =
            labels.into_iter().map(|entry| (format!("labels/{SET}/{}", entry.file), entry.sha256));
        let named = episodes.into_iter().map(|entry| (entry.file, entry.sha256)).chain(of_labels);
        let absent = named.filter(|(name, sha256)| there.get(&format!("{set}{name}")) != Some(sha256));
        found.extend(
            absent.map(|(name, _)| format!("a manifest names {set}{name}, which is not there or another")),
        );
    }
    found
}

/// Files under final names that are neither what an unbroken run leaves nor a whole file of less.
fn torn(data: &Path, after: &Path) -> Vec<String> {
    let wanted = hashes(after);
    let mut found = Vec::new();
    for (name, sha256) in hashes(data) {
        let is_whole = wanted.get(&name).is_none_or(|wanted| *wanted == sha256);
        let path = data.join(&name);
        let above = |n: usize| path.ancestors().nth(n).expect("it lies in a folder of ours");
        let is_less = || match name.rsplit('/').next().unwrap_or_default() {
            Manifest::FILE => Manifest::read(above(1)).is_ok(),
            // DATA/labels/SET/labels.json
            LabelManifest::FILE => LabelManifest::read(above(3), SET).is_ok(),
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
                tell_progress(name, errno, number, outcome.n_calls);
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
            Outcome::print_head();
        }
        outcome.print(name);
        outcomes.push((name, outcome));
        before = after;
    }
    outcomes
}

pub fn tell_progress(name: &str, errno: i32, number: u64, n_calls: u64) {
    if number.is_multiple_of(PROGRESS_CALLS) {
        println!("{name}: error {errno} at call {number} of {n_calls}");
    }
}

pub fn assert_unharmed(outcomes: &[(&str, Outcome)]) {
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
    done(&["label", text(&data)]);
    let before = hashes(&data);
    let mut counted = command(&["info", text(&data)]);
    let Some(counter) = with_fault(&mut counted, &data, Fault::None) else { return };
    let whole = succeed(&mut counted);
    let n_calls = counter.n_calls();
    assert!(n_calls > 0);
    let mut wrong = Vec::new();
    for number in 0..n_calls {
        let mut faulty = command(&["info", text(&data)]);
        let fault = Fault::Call { number, errno: EIO };
        let _counter = with_fault(&mut faulty, &data, fault);
        let output = faulty.output().expect("the program starts");
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        let is_right = match output.status.code() {
            // It may ask for what it can do without, but not leave out what is there.
            Some(0) => String::from_utf8_lossy(&output.stdout) == whole,
            Some(1) => names_fault(1, &told, fault, &data),
            _ => false,
        };
        if !is_right || told.contains("panicked") {
            let said = String::from_utf8_lossy(&output.stdout);
            wrong.push(format!("{fault:?}: {:?}: {told}{said}", output.status.code()));
        }
        assert_eq!(difference(&hashes(&data), &before), None);
    }
    assert!(wrong.is_empty(), "{} of {n_calls} errors:\n{}", wrong.len(), wrong.join("\n"));
}
