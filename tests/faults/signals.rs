//! Signals, and workers that die or hang.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use fs_err as fs;
use harmzone::files::is_lock;
use rustix::process::{Pid, Signal, kill_process};

use super::folder::{difference, hashes, is_mcap};
use super::made_data::{command, fixture, generation, succeed, text};
use super::shim::{Counter, Fault, with_fault};
use super::stages::{Stage, all, drive, eval, named};

/// The longest that a stage may take to end once it is asked.
const LONGEST: Duration = Duration::from_secs(5);

/// The longest that it may take once it is asked twice: less than the patience with one step, which is 4 s.
const AT_ONCE: Duration = Duration::from_secs(2);

/// Exit code of a command that lost a part.
const WITH_LOSSES: i32 = 3;

pub fn start(mut command: Command) -> Child {
    command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("the program starts")
}

pub fn signal(process: u32, name: &str) {
    let signal = match name {
        "INT" => Signal::INT,
        "TERM" => Signal::TERM,
        "KILL" => Signal::KILL,
        "ABRT" => Signal::ABORT,
        "STOP" => Signal::STOP,
        _ => panic!("no test sends SIG{name}"),
    };
    let process = Pid::from_raw(process as i32).expect("a process has a number");
    kill_process(process, signal).expect("it is a child, and has not been waited for");
}

pub fn ended(child: Child) -> (Option<i32>, String) {
    let Output { status, stderr, .. } = child.wait_with_output().expect("a child of ours");
    (status.code(), String::from_utf8_lossy(&stderr).into_owned())
}

/// The worker processes that a process has started.
fn workers(of: u32) -> Vec<u32> {
    let listed = fs::read_to_string(format!("/proc/{of}/task/{of}/children")).unwrap_or_default();
    let mut found: Vec<u32> = listed.split_whitespace().map(|word| word.parse().expect("a number")).collect();
    // Those that other threads have started.
    for entry in fs::read_dir(format!("/proc/{of}/task")).into_iter().flatten().flatten() {
        let listed = fs::read_to_string(entry.path().join("children")).unwrap_or_default();
        found.extend(listed.split_whitespace().map(|word| word.parse::<u32>().expect("a number")));
    }
    found.sort_unstable();
    found.dedup();
    // Before it has become another program, the parent waits for it, whatever happens to it.
    let is_worker = |child: &u32| {
        fs::read(format!("/proc/{child}/cmdline")).is_ok_and(|words| words.ends_with(b"-worker\0"))
    };
    found.retain(is_worker);
    found
}

/// A field of what the system tells of a process.
pub fn status_field(process: u32, field: &str) -> Option<String> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    status.lines().find_map(|line| line.strip_prefix(field)).map(|value| value.trim().to_owned())
}

/// Whether a child that nobody has waited for yet has ended.
pub fn has_ended(process: u32) -> bool {
    status_field(process, "State:").is_none_or(|state| state.starts_with('Z'))
}

/// Whether a process has said what it does on a signal: before that, its end is the system's.
fn catches(process: u32, name: &str) -> bool {
    let number = if name == "INT" { 2 } else { 15 };
    let mask = status_field(process, "SigCgt:").and_then(|mask| u64::from_str_radix(&mask, 16).ok());
    mask.is_some_and(|mask| mask >> (number - 1) & 1 == 1)
}

/// Waits until something is so.
pub fn wait_until(is_so: impl Fn() -> bool) {
    let begin = Instant::now();
    while !is_so() {
        assert!(begin.elapsed() < Duration::from_mins(2), "it did not come to it");
        // A short stage is at work for a few milliseconds after it has said what it does on a signal.
        std::thread::sleep(Duration::from_micros(200));
    }
}

/// Shares of a stage's time at which it is asked to end, the next one where it had ended before: a short one may have had no time to
/// hear of it.
const MOMENTS: [f64; 12] = [0.5, 0.25, 0.1, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];

/// What came of a wish to end.
#[derive(Debug, PartialEq)]
enum End {
    /// The work was done before.
    Done,
    Soon,
    /// It had to be ended by force, or took longer than [`LONGEST`].
    Late,
}

/// The code of a process that a signal has asked to end.
pub fn code_of(name: &str) -> i32 {
    if name == "INT" { 130 } else { 143 }
}

/// How a folder differs from what the stage leaves where nothing happens; without the file that holds the command's own words.
fn differs(stage: &Stage, out: &Path) -> Option<String> {
    let without_words = |mut hashes: BTreeMap<String, String>| {
        if stage.name == "eval" {
            hashes.remove("source.json").expect("scores say where they come from");
        }
        hashes
    };
    difference(&without_words(hashes(out)), &without_words(stage.unbroken().hashes.clone()))
}

/// Asks a stage to end at a share of its time, checks how it does and that the same command goes on.
fn end_at(stage: &Stage, name: &str, share: f64) -> End {
    let home = tempfile::tempdir().expect("a temporary folder");
    let out = home.path().join("out");
    stage.prepare(&out);
    let took = stage.unbroken().took;
    let child = start(stage.command(&out));
    let process = child.id();
    std::thread::sleep(took.mul_f64(share));
    wait_until(|| has_ended(process) || catches(process, name));
    let begin = Instant::now();
    signal(process, name);
    let (code, told) = ended(child);
    let is_late = begin.elapsed() >= LONGEST;
    let is_forced = told.contains("ended after");
    if code != Some(0) {
        assert_eq!(code, Some(code_of(name)), "{}: {told}", stage.name);
        assert!(told.contains("goes on"), "{}: {told}", stage.name);
        let unfinished: Vec<String> = if out.is_dir() {
            hashes(&out).into_keys().filter(|file| file.contains(".partial")).collect()
        } else {
            Vec::new()
        };
        assert!(is_forced || unfinished.is_empty(), "{}: {unfinished:?}", stage.name);
    }
    stage.finish(&out).unwrap_or_else(|told| panic!("{}: {told}", stage.name));
    assert_eq!(differs(stage, &out), None, "{}", stage.name);
    match code {
        Some(0) => End::Done,
        _ if is_forced || is_late => End::Late,
        _ => End::Soon,
    }
}

/// Asks a stage to end while it is at work.
fn end_at_work(stage: &Stage, name: &str) -> End {
    let mut ends = MOMENTS.iter().map(|&share| end_at(stage, name, share));
    let end = ends.find(|end| *end != End::Done);
    end.unwrap_or_else(|| panic!("{}: no SIG{name} came while it was at work", stage.name))
}

#[test]
fn a_signal_ends_every_stage_soon_with_nothing_unfinished_and_the_same_command_goes_on() {
    for stage in all().iter().chain([drive()]) {
        for name in ["INT", "TERM"] {
            // On a busy machine one step may take longer than the patience with it: once, not always.
            let is_late = end_at_work(stage, name) == End::Late && end_at_work(stage, name) == End::Late;
            assert!(!is_late, "{} does not end by itself and soon on SIG{name}", stage.name);
        }
    }
}

/// Starts `eval` on a disk that does not answer, and waits until it asks it; `None` where there is no such disk.
fn hanging_eval(out: &Path) -> Option<(Child, Counter)> {
    let mut command = eval().command(out);
    let counter = with_fault(&mut command, &fixture().id, Fault::Hang)?;
    let child = start(command);
    wait_until(|| has_ended(child.id()) || counter.n_calls() > 0);
    Some((child, counter))
}

/// What takes `eval` time is to read and to detect; it writes within milliseconds, at its end.
#[test]
fn a_signal_ends_eval_in_time_even_where_the_disk_does_not_answer_and_the_same_command_goes_on() {
    let stage = eval();
    for name in ["INT", "TERM"] {
        let home = tempfile::tempdir().expect("a temporary folder");
        let out = home.path().join("out");
        // On a busy machine once more.
        let mut was_late = false;
        loop {
            let Some((child, _counter)) = hanging_eval(&out) else { return };
            let begin = Instant::now();
            signal(child.id(), name);
            let (code, told) = ended(child);
            let took = begin.elapsed();
            assert_eq!(code, Some(code_of(name)), "{told}");
            assert!(told.contains("goes on"), "{told}");
            // Ended by force, it leaves the lock that it held.
            let has_written = out.exists() && hashes(&out).keys().any(|name| !is_lock(Path::new(name)));
            assert!(!has_written, "eval wrote before it knew anything");
            if took < LONGEST {
                break;
            }
            assert!(!was_late, "eval takes {took:?} to end on SIG{name}");
            was_late = true;
        }
        stage.finish(&out).unwrap_or_else(|told| panic!("{told}"));
        assert_eq!(differs(stage, &out), None);
    }
}

#[test]
fn a_second_signal_ends_it_at_once() {
    let home = tempfile::tempdir().expect("a temporary folder");
    for (first, second) in [("INT", "INT"), ("INT", "TERM"), ("TERM", "INT")] {
        let Some((child, _counter)) = hanging_eval(&home.path().join("out")) else { return };
        signal(child.id(), first);
        // Two signals of one kind at a time may be heard as one.
        std::thread::sleep(Duration::from_millis(300));
        assert!(!has_ended(child.id()), "the first signal ended it: nothing is shown of the second");
        let begin = Instant::now();
        signal(child.id(), second);
        let (code, told) = ended(child);
        assert_eq!(code, Some(code_of(second)), "{told}");
        assert!(!told.contains("ended after") && begin.elapsed() < AT_ONCE, "{:?}: {told}", begin.elapsed());
    }
}

/// `gen` with one worker, to which something is done once it is at work; then what it says.
fn generate_while(out: &Path, more: &[&str], act: impl Fn(u32)) -> (Option<i32>, String) {
    let child = start(command(&generation(out, "1", &[&["--episodes", "3"], more].concat())));
    let process = child.id();
    wait_until(|| out.join("episodes").is_dir() && !workers(process).is_empty());
    act(process);
    ended(child)
}

#[test]
fn a_worker_that_is_killed_or_hangs_costs_time_and_no_episode() {
    let stage = named("gen");
    let wanted = &stage.unbroken().hashes;
    let home = tempfile::tempdir().expect("a temporary folder");
    // Not SEGV, of which the first one is taken for a stack that overflows.
    for name in ["KILL", "ABRT"] {
        let out = home.path().join(name);
        let (code, told) = generate_while(&out, &[], |process| signal(workers(process)[0], name));
        assert!(code == Some(0) && told.contains("try 1 of 3"), "{told}");
        assert_eq!(difference(&hashes(&out), wanted), None);
    }
    let out = home.path().join("hung");
    let (code, told) =
        generate_while(&out, &["--worker-timeout", "30"], |process| signal(workers(process)[0], "STOP"));
    assert!(code == Some(0) && told.contains("said nothing for 30 s"), "{told}");
    assert_eq!(difference(&hashes(&out), wanted), None);
}

/// From now on the system gives a process no more memory than it has.
fn refuse_memory(process: u32) {
    let sizes = fs::read_to_string(format!("/proc/{process}/statm")).unwrap_or_default();
    let n_pages: u64 = sizes.split_whitespace().next().map_or(0, |pages| pages.parse().expect("a number"));
    let limit = format!("--as={}", n_pages * 4096);
    let limited = Command::new("prlimit").args(["--pid", &process.to_string(), &limit]).output();
    let told = limited.expect("prlimit runs");
    let is_gone = || !Path::new(&format!("/proc/{process}")).exists();
    assert!(told.status.success() || is_gone(), "{}", String::from_utf8_lossy(&told.stderr));
}

#[test]
fn a_worker_that_is_given_no_more_memory_costs_time_and_no_episode() {
    let stage = named("gen");
    let wanted = &stage.unbroken().hashes;
    let home = tempfile::tempdir().expect("a temporary folder");
    let mut n_lost = 0;
    // More moments where none of the first hit.
    for (place, share) in [0.0, 0.1, 0.2, 0.4, 0.6, 0.05, 0.15, 0.3, 0.5, 0.7].into_iter().enumerate() {
        if place >= 5 && n_lost > 0 {
            break;
        }
        let out = home.path().join(place.to_string());
        let (code, told) = generate_while(&out, &[], |process| {
            std::thread::sleep(stage.unbroken().took.mul_f64(share));
            if let Some(worker) = workers(process).first() {
                refuse_memory(*worker);
            }
        });
        // Also while the driver of OpenGL is loaded, which without memory looks like one that is not there.
        assert_eq!(code, Some(0), "at {share}: {told}");
        assert_eq!(difference(&hashes(&out), wanted), None, "at {share}: {told}");
        n_lost += usize::from(told.contains("try 1 of 3"));
    }
    assert!(n_lost > 0, "no worker lacked memory");
}

#[test]
fn an_episode_that_kills_every_worker_is_left_out_the_rest_is_kept_and_the_next_call_makes_it() {
    let home = tempfile::tempdir().expect("a temporary folder");
    let out = home.path().join("out");
    let (code, told) = generate_while(&out, &[], |process| {
        // The first episode's workers, until it is given up.
        let mut killed = Vec::new();
        while killed.len() < 3 {
            wait_until(|| workers(process).iter().any(|child| !killed.contains(child)));
            let child = *workers(process).iter().find(|child| !killed.contains(child)).expect("it is there");
            signal(child, "KILL");
            killed.push(child);
        }
    });
    assert_eq!(code, Some(WITH_LOSSES), "{told}");
    assert!(told.contains("was left out") && told.contains("given up after 3 tries"), "{told}");
    let stage = named("gen");
    let (found, wanted) = (hashes(&out), &stage.unbroken().hashes);
    let n_episodes = |of: &BTreeMap<String, String>| of.keys().filter(|name| is_mcap(name)).count();
    assert_eq!(n_episodes(&found), n_episodes(wanted) - 1);
    succeed(&mut stage.command(&out));
    assert_eq!(difference(&hashes(&out), wanted), None);
}

#[test]
fn folders_that_vanish_or_cannot_be_written_are_named() {
    let home = tempfile::tempdir().expect("a temporary folder");
    let out = home.path().join("vanished");
    let (code, told) = generate_while(&out, &[], |_| fs::remove_dir_all(&out).expect("a folder of ours"));
    assert!(code == Some(1) && told.contains(text(&out)), "{code:?} {told}");
    let file = home.path().join("file");
    fs::write(&file, "no folder").expect("a writable folder");
    for stage in all() {
        let told = stage.command(&file.join("out")).output().expect("the program starts");
        let words = String::from_utf8_lossy(&told.stderr).into_owned();
        assert!(told.status.code() == Some(1) && words.contains(text(&file)), "{}: {words}", stage.name);
    }
    let out = home.path().join("without-temporary");
    let mut without_temporary = command(&generation(&out, "1", &["--episodes", "1"]));
    let told =
        without_temporary.env("TMPDIR", home.path().join("absent")).output().expect("the program starts");
    let words = String::from_utf8_lossy(&told.stderr).into_owned();
    assert!(told.status.success() || words.contains("absent"), "{words}");
}
