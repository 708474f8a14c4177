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
/// How much longer the first episode may take where the machine is busy.
const LONGEST_IDLE: Duration = Duration::from_mins(10);
/// From so long on the workers' memory of two halves is compared: before, they have just begun.
const LEAST_LONG: Duration = Duration::from_mins(20);

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
    let (mut n_kills, mut n_episodes, mut rows) = (0, 0, Vec::new());
    let is_idle = |n_kills: usize, n_episodes: usize| n_kills == 0 || n_episodes == 0;
    // A busy machine may need longer to the first episode.
    while begin.elapsed() < length
        || (is_idle(n_kills, n_episodes) && begin.elapsed() < length + LONGEST_IDLE)
    {
        std::thread::sleep(period);
        assert!(child.try_wait().expect("a child of ours").is_none(), "the program ended");
        let (program_mb, workers) = memory_and_children(child.id());
        let workers_mb: f64 = workers.iter().map(|worker| memory_and_children(*worker).0).sum();
        let names = fs::read_dir(out.join("episodes")).into_iter().flatten().flatten();
        n_episodes = names.filter(|entry| !is_partial(&entry.path())).count();
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
        rows.push([program_mb, workers_mb]);
    }
    Command::new("kill").args(["-TERM", &child.id().to_string()]).status().expect("kill runs");
    let status = child.wait().expect("a child of ours");
    assert_eq!(status.code(), Some(143));
    let manifest = Manifest::read(out).expect("a data set");
    // Ended by force it says so, and what it was writing keeps its partial name.
    let is_forced = fs::read_to_string(&said_path).expect("it is there").contains("ended after");
    let files =
        fs::read_dir(out.join("episodes")).expect("a folder").map(|file| file.expect("a file").path());
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
    assert!(n_kills > 0, "no worker was killed");
    assert!(!manifest.episodes.is_empty(), "no episode was made");
    assert_flat(&rows, begin.elapsed());
}

/// Memory does not grow. `rows`: of the program and of its workers, MB, in so long a time.
fn assert_flat(rows: &[[f64; 2]], took: Duration) {
    let (first, last) = rows.split_at(rows.len().div_ceil(2));
    let most = |rows: &[[f64; 2]], i: usize| rows.iter().fold(0f64, |most, row| most.max(row[i]));
    // The program keeps a manifest in memory, and the log of nobody.
    let (before, end) = (most(first, 0), rows[rows.len() - 1][0]);
    println!("memory of the program: at most {before:.1} MB in the first half, {end:.1} MB at the end");
    assert!(end < before * 1.2 + 20.0, "memory of the program grows");
    if took >= LEAST_LONG {
        let (before, after) = (most(first, 1), most(last, 1));
        println!(
            "memory of all workers: at most {before:.1} MB in the first half, {after:.1} MB in the second"
        );
        assert!(before > 0.0 && after < before * 1.2 + 200.0, "memory of the workers grows");
    }
}

fn is_partial(path: &Path) -> bool {
    path.to_string_lossy().contains(".partial")
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
