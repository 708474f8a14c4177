//! What appears whole at its end, `export` and `view`: a full disk, a signal, a kill and a second process leave nothing for ever.

use std::io::Write as _;
use std::path::Path;
use std::process::Command;

use fs_err as fs;

use super::made_data::{command, fixture, succeed, text};
use super::shim::{Fault, with_fault};
use super::signals::{code_of, ended, has_ended, signal, start, wait_until};

/// Room for the lock and for none of the files.
const FEW_BYTES: u64 = 5_000;
/// What is said of a process that only these tests know.
const SOMEBODY: &str = "process 4711 on a host of the test: harmzone export";

/// Commands that make this folder, and one that makes a file of this name.
fn commands(out: &Path) -> [Command; 4] {
    let (data, out) = (text(&fixture().id), text(out));
    let mini = ["--categories", "source", "--version", "v1.0-mini"];
    [
        [&["export", "nuscenes", data, out, "--force"][..], &mini[..]].concat(),
        vec!["export", "kitti", data, out, "--force"],
        vec!["view", data, "--video", out, "--force"],
        vec!["view", data, "--mcap", out, "--force"],
    ]
    .map(|words| command(&words))
}

fn names_in(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("a readable folder");
    let name = |entry: std::io::Result<fs::DirEntry>| {
        entry.expect("a readable folder").file_name().to_string_lossy().into_owned()
    };
    let mut names: Vec<String> = entries.map(name).collect();
    names.sort();
    names
}

#[test]
fn a_full_disk_is_told_with_file_and_room_and_nothing_is_left() {
    for which in 0..4 {
        let home = tempfile::tempdir().expect("a temporary folder");
        let out = home.path().join("out");
        let [mut full, mut again] = [(); 2].map(|()| {
            let mut all = commands(&out).into_iter();
            all.nth(which).expect("one of four")
        });
        let Some(_counter) = with_fault(&mut full, home.path(), Fault::Room { n_bytes: FEW_BYTES }) else {
            return;
        };
        let output = full.output().expect("the program starts");
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{full:?}: {told}");
        for word in ["no space left on the disk", "wants", "are free", text(&out)] {
            assert!(told.contains(word), "`{word}` is not told by {full:?}: {told}");
        }
        assert!(!told.contains(".partial"), "the file is told by its final name: {told}");
        assert_eq!(names_in(home.path()), Vec::<String>::new(), "{full:?}");
        succeed(&mut again);
        assert_eq!(names_in(home.path()), ["out"]);
    }
}

#[test]
fn after_a_signal_nothing_is_left_and_what_a_kill_left_the_same_command_deletes() {
    let mut n_broken = 0;
    for name in ["INT", "TERM", "KILL"] {
        for which in 0..4 {
            let home = tempfile::tempdir().expect("a temporary folder");
            let out = home.path().join("out");
            let [first, again] = [(); 2].map(|()| commands(&out).into_iter().nth(which));
            let child = start(first.expect("one of four"));
            let process = child.id();
            wait_until(|| has_ended(process) || !names_in(home.path()).is_empty());
            signal(process, name);
            let (code, told) = ended(child);
            n_broken += usize::from(code != Some(0));
            if name != "KILL" && code != Some(0) {
                assert_eq!(code, Some(code_of(name)), "{told}");
                let left = names_in(home.path());
                assert!(told.contains("ended after") || left.is_empty(), "SIG{name}: {left:?}: {told}");
            }
            succeed(&mut again.expect("one of four"));
            assert_eq!(names_in(home.path()), ["out"], "SIG{name}");
        }
    }
    assert!(n_broken > 0, "no signal came while one was at work");
}

#[test]
fn the_second_one_is_told_who_makes_the_same_folder_or_file() {
    let home = tempfile::tempdir().expect("a temporary folder");
    let (out, lock) = (home.path().join("out"), home.path().join("out.writer.partial"));
    for mut command in commands(&out) {
        let mut held = fs::File::create(&lock).expect("a folder of ours");
        held.try_lock().expect("nobody else knows the folder");
        writeln!(held, "{SOMEBODY}").expect("a folder of ours");
        let output = command.output().expect("the program starts");
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{told}");
        assert!(told.contains(SOMEBODY) && told.contains(text(&out)), "{told}");
        assert_eq!(names_in(home.path()), ["out.writer.partial"]);
        // The file stays, as where the process was killed.
        drop(held);
        succeed(&mut command);
        assert_eq!(names_in(home.path()), ["out"]);
        let removed = if out.is_dir() { fs::remove_dir_all(&out) } else { fs::remove_file(&out) };
        removed.expect("a folder of ours");
    }
}
