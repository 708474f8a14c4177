//! Changed bits and cut files: the right data, or an error that names the file; never a panic, never other data without a word.

mod kinds;
mod logs;
mod rock;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

use fs_err as fs;
use harmzone::random::stream;
use rand::RngExt as _;

use self::kinds::{Kind, kinds};
use super::folder::{copy, difference, hashes};
use super::made_data::text;
use super::n_faults;
use super::stages::named;

/// Cuts are so far apart.
const CUT_BYTES: usize = 1_000;
/// A reader that takes longer hangs.
const LONGEST: Duration = Duration::from_secs(20);

/// What came of the damages of one kind.
#[derive(Default)]
struct Outcome {
    n_same: usize,
    n_errors: usize,
    n_other: usize,
    /// What should not be, in words.
    faults: Vec<String>,
    longest: Duration,
}

#[derive(Debug, Clone, Copy)]
enum Damage {
    /// This bit is another.
    Flip(usize),
    /// Nothing from this byte on.
    Cut(usize),
}

/// Damages of a file: every bit of a small one, else bits by chance, half of them among the first and last kilobytes, where the
/// structure is; and all cuts.
fn damages(n_bytes: usize, n_flips: usize, seed: u64) -> Vec<Damage> {
    let mut rng = stream(seed, "bits", n_bytes as u64);
    let n_bits = n_bytes * 8;
    let mut draw = |i: usize| {
        let ends = n_bytes.min(4_096);
        let byte = match i % 4 {
            0 => rng.random_range(0..ends),
            1 => n_bytes - 1 - rng.random_range(0..ends),
            _ => rng.random_range(0..n_bytes),
        };
        byte * 8 + rng.random_range(0..8)
    };
    let flips = (0..n_flips.min(n_bits)).map(|i| Damage::Flip(if n_bits <= n_flips { i } else { draw(i) }));
    let mut all: Vec<Damage> = flips.collect();
    all.extend((0..n_bytes).step_by(CUT_BYTES).map(Damage::Cut));
    all
}

fn damaged(bytes: &[u8], damage: Damage) -> Vec<u8> {
    match damage {
        Damage::Flip(bit) => {
            let mut bytes = bytes.to_vec();
            bytes[bit / 8] ^= 1 << (bit % 8);
            bytes
        }
        Damage::Cut(at) => bytes[..at].to_vec(),
    }
}

/// Damages a kind's file in so many ways, and leaves it whole.
fn damage(kind: &Kind, n_flips: usize) -> Outcome {
    let whole = fs::read(&kind.path).expect("a readable file");
    let mut outcome = Outcome::default();
    let wanted = match (kind.read)(&kind.path) {
        Ok(wanted) => wanted,
        Err(error) => {
            outcome.faults.push(format!("{}: the whole file is refused: {error}", kind.name));
            return outcome;
        }
    };
    let again = (kind.read)(&kind.path);
    if again.as_ref() != Ok(&wanted) {
        outcome.faults.push(format!("{}: the whole file is not the same twice: {again:?}", kind.name));
        return outcome;
    }
    for damage in damages(whole.len(), n_flips, 20) {
        fs::write(&kind.path, damaged(&whole, damage)).expect("a writable copy");
        let begin = Instant::now();
        let read = catch_unwind(AssertUnwindSafe(|| (kind.read)(&kind.path)));
        let took = begin.elapsed();
        outcome.longest = outcome.longest.max(took);
        let mut fault = |text: String| outcome.faults.push(format!("{}: {damage:?}: {text}", kind.name));
        if took > LONGEST {
            fault(format!("took {took:?}"));
        }
        match read {
            Err(_) => fault("a panic".to_owned()),
            Ok(Ok(found)) if found == wanted => outcome.n_same += 1,
            Ok(Ok(_)) => {
                outcome.n_other += 1;
                if kind.is_hashed {
                    fault("other data without a word".to_owned());
                }
            }
            Ok(Err(told)) => {
                outcome.n_errors += 1;
                if !kind.is_named_in(&told) {
                    fault(format!("an error that does not name the file: {told}"));
                }
            }
        }
    }
    fs::write(&kind.path, whole).expect("a writable copy");
    outcome
}

/// Prints a table; tells the faults.
fn damage_all(n_flips: usize) -> Vec<String> {
    let home = tempfile::tempdir().expect("a temporary folder");
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| ()));
    let mut faults = Vec::new();
    println!(
        "{:<18} {:>8} {:>8} {:>8} {:>8} {:>8} {:>10} {:>10}",
        "file", "bytes", "damages", "errors", "same", "other", "faults", "longest ms"
    );
    for kind in kinds(home.path()) {
        let n_bytes = fs::metadata(&kind.path).expect("a readable file").len();
        let outcome = damage(&kind, n_flips);
        let Outcome { n_same, n_errors, n_other, longest, .. } = outcome;
        let n = n_same + n_errors + n_other;
        let (n_faults, longest) = (outcome.faults.len(), longest.as_millis());
        println!(
            "{:<18} {n_bytes:>8} {n:>8} {n_errors:>8} {n_same:>8} {n_other:>8} {n_faults:>10} {longest:>10}{}",
            kind.name,
            if kind.is_hashed { "" } else { "  (no hash in the format)" }
        );
        faults.extend(outcome.faults);
    }
    std::panic::set_hook(hook);
    faults
}

#[test]
fn no_changed_bit_and_no_cut_passes_for_other_data() {
    let faults = damage_all(12);
    assert!(faults.is_empty(), "{} faults:\n{}", faults.len(), faults[..faults.len().min(10)].join("\n"));
}

#[test]
#[ignore = "an hour: make soak ROWS=bits"]
fn long_bits() {
    let faults = damage_all(n_faults(10_000));
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    println!("{}", status.lines().find(|line| line.starts_with("VmHWM")).unwrap_or_default());
    assert!(faults.is_empty(), "{} faults:\n{}", faults.len(), faults[..faults.len().min(40)].join("\n"));
}

/// Every file below a folder.
fn files_below(folder: &Path) -> Vec<PathBuf> {
    hashes(folder).into_keys().map(|name| folder.join(name)).collect()
}

#[test]
fn a_changed_bit_in_a_saved_state_of_a_training_is_told_or_does_not_matter() {
    let stage = named("train");
    let home = tempfile::tempdir().expect("a temporary folder");
    let stopped = home.path().join("stopped");
    let mut child = stage.command(&stopped).stderr(Stdio::null()).spawn().expect("the program starts");
    let is_saved = || {
        let listed = fs::read_dir(stopped.join("state")).into_iter().flatten().flatten();
        listed.into_iter().any(|entry| !entry.file_name().to_string_lossy().contains("partial"))
    };
    while !is_saved() && child.try_wait().expect("a child of ours").is_none() {
        std::thread::sleep(Duration::from_millis(1));
    }
    child.kill().expect("a child of ours");
    child.wait().expect("a child of ours");
    let files = files_below(&stopped.join("state"));
    assert!(files.len() >= 4, "{files:?}");
    let mut rng = stream(20, "states", 0);
    let mut n_errors = 0;
    for file in files.iter().flat_map(|file| [file; 3]) {
        let out = home.path().join("out");
        copy(&stopped, &out);
        let file = out.join(file.strip_prefix(&stopped).expect("it is below"));
        let whole = fs::read(&file).expect("a readable file");
        let bit = rng.random_range(0..whole.len() * 8);
        fs::write(&file, damaged(&whole, Damage::Flip(bit))).expect("a writable copy");
        let output = stage.command(&out).output().expect("the program starts");
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        if output.status.code() == Some(0) {
            assert_eq!(
                difference(&hashes(&out), &stage.unbroken().hashes),
                None,
                "{}, bit {bit}",
                file.display()
            );
        } else {
            let folder = text(file.parent().expect("a folder"));
            assert!(
                output.status.code() == Some(1) && told.contains(folder),
                "{}, bit {bit}: {told}",
                file.display()
            );
            n_errors += 1;
        }
        fs::remove_dir_all(&out).expect("a folder of ours");
    }
    assert!(n_errors > 0, "no changed bit was told");
}
