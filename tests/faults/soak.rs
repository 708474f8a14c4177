//! Hours of `gen` while its workers are killed: memory, files, speed.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use fs_err as fs;
use harmzone::episode::Manifest;
use harmzone::files::sha256_of;

use super::made_data::{command, text};

/// How often a worker is killed, and memory looked at.
const PERIOD: Duration = Duration::from_mins(1);

/// Resident memory of a process, in MB, and the processes that its threads have started.
fn memory_and_children(process: u32) -> (f64, Vec<u32>) {
    let status = fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmRSS")).unwrap_or_default();
    let n_kb: f64 = line.split_whitespace().nth(1).map_or(0.0, |word| word.parse().expect("a number"));
    let mut children = Vec::new();
    for entry in fs::read_dir(format!("/proc/{process}/task")).into_iter().flatten().flatten() {
        let listed = fs::read_to_string(entry.path().join("children")).unwrap_or_default();
        children.extend(listed.split_whitespace().map(|word| word.parse::<u32>().expect("a number")));
    }
    (n_kb / 1e3, children)
}

/// Generates for so long with a worker killed each minute; prints a line each time.
fn soak(length: Duration, period: Duration, out: &Path) {
    let words = ["gen", "--town", "all", "--weather", "all", "--seed", "20", "--samples", "4"];
    let words = [words.as_slice(), &["--episodes", "30000", "--out", text(out)]].concat();
    let said_path = out.with_extension("said");
    let (said, _) = fs::File::create(&said_path).expect("a writable folder").into_parts();
    let mut child = command(&words).stdout(Stdio::null()).stderr(said).spawn().expect("the program starts");
    let begin = Instant::now();
    println!("{:>7} {:>8} {:>11} {:>13} {:>6}", "s", "episodes", "program MB", "workers MB", "kills");
    let (mut n_kills, mut rows) = (0, Vec::new());
    while begin.elapsed() < length {
        std::thread::sleep(period);
        assert!(child.try_wait().expect("a child of ours").is_none(), "the program ended");
        let (program_mb, workers) = memory_and_children(child.id());
        let workers_mb: f64 = workers.iter().map(|worker| memory_and_children(*worker).0).sum();
        let n_episodes = fs::read_dir(out.join("episodes")).map_or(0, Iterator::count);
        if let Some(worker) = workers.get(n_kills % workers.len().max(1)) {
            n_kills += usize::from(
                Command::new("kill")
                    .args(["-9", &worker.to_string()])
                    .status()
                    .is_ok_and(|status| status.success()),
            );
        }
        let at_s = begin.elapsed().as_secs();
        println!("{at_s:>7} {n_episodes:>8} {program_mb:>11.1} {workers_mb:>13.1} {n_kills:>6}");
        rows.push((n_episodes, program_mb));
    }
    Command::new("kill").args(["-TERM", &child.id().to_string()]).status().expect("kill runs");
    let status = child.wait().expect("a child of ours");
    assert_eq!(status.code(), Some(143));
    let manifest = Manifest::read(out).expect("a data set");
    // Ended by force it says so, and what it was writing keeps its partial name.
    let is_forced = fs::read_to_string(&said_path).expect("it is there").contains("ended after");
    let files =
        fs::read_dir(out.join("episodes")).expect("a folder").map(|file| file.expect("a file").path());
    let is_partial = |path: &Path| path.to_string_lossy().contains(".partial");
    let n_files = files.filter(|path| !is_forced || !is_partial(path)).count();
    assert_eq!(n_files, manifest.episodes.len(), "files without an entry, or unfinished ones");
    for entry in &manifest.episodes {
        assert_eq!(
            sha256_of(&out.join(&entry.file)).expect("a file"),
            entry.sha256,
            "{} is torn",
            entry.name
        );
    }
    let at_s = begin.elapsed().as_secs_f64();
    println!(
        "{} whole episodes, no torn one, {:.1} an hour; {n_kills} workers killed",
        manifest.episodes.len(),
        3_600.0 * manifest.episodes.len() as f64 / at_s
    );
    // The program keeps a manifest in memory, and the log of nobody.
    let first = rows[..rows.len().div_ceil(2)].iter().fold(0f64, |most, row| most.max(row.1));
    let last = rows[rows.len() - 1].1;
    println!("memory of the program: at most {first:.1} MB in the first half, {last:.1} MB at the end");
    assert!(last < first * 1.2 + 20.0, "memory grows");
}

#[test]
fn killed_workers_leave_whole_episodes_and_no_others() {
    let home = tempfile::tempdir().expect("a temporary folder");
    soak(Duration::from_secs(20), Duration::from_secs(4), &home.path().join("data"));
}

#[test]
#[ignore = "two hours: make soak ROWS=soak"]
fn long_soak() {
    let minutes = super::n_faults(120) as u64;
    let home = tempfile::tempdir().expect("a temporary folder");
    soak(Duration::from_secs(60 * minutes), PERIOD, &home.path().join("data"));
}
