//! One writer a folder: the second is told who the first is and changes nothing, and the lock of a dead one is taken over.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use fs_err as fs;

use super::folder::{difference, hashes};
use super::made_data::{succeed, text};
use super::signals::{ended, signal, start, status_field, wait_until};
use super::stages::{Stage, all, drive, named};

/// Where a writer says who it is.
const FILE: &str = "writer.partial";
/// What is said of a process that only these tests know.
const SOMEBODY: &str = "process 4711 on a host of the test: harmzone gen";

/// The folder whose lock a stage takes.
fn locked_folder(stage: &Stage, out: &Path) -> PathBuf {
    if stage.name == "label" { out.join("labels/again") } else { out.to_owned() }
}

/// Takes a folder's lock as a process of harmzone would.
fn hold(folder: &Path) -> fs::File {
    fs::create_dir_all(folder).expect("a folder of ours");
    let mut file = fs::File::create(folder.join(FILE)).expect("a folder of ours");
    file.try_lock().expect("nobody else knows the folder");
    writeln!(file, "{SOMEBODY}").expect("a folder of ours");
    file
}

#[test]
fn every_stage_finds_a_lock_that_is_held_says_by_whom_and_changes_nothing() {
    for stage in all().iter().chain([drive()]) {
        let home = tempfile::tempdir().expect("a temporary folder");
        let out = home.path().join("out");
        stage.prepare(&out);
        let folder = locked_folder(stage, &out);
        let held = hold(&folder);
        let before = hashes(&out);
        let (code, told) = ended(start(stage.command(&out)));
        assert_eq!(code, Some(1), "{}: {told}", stage.name);
        assert!(told.contains(SOMEBODY) && told.contains(text(&folder)), "{}: {told}", stage.name);
        assert_eq!(difference(&hashes(&out), &before), None, "{}", stage.name);
        // The file stays, as where the process was killed.
        drop(held);
        succeed(&mut stage.command(&out));
        assert!(!folder.join(FILE).exists(), "{} leaves its lock", stage.name);
        assert_eq!(difference(&hashes(&out), &stage.unbroken().hashes), None, "{}", stage.name);
    }
}

#[test]
fn the_second_writer_is_told_who_the_first_is_and_a_dead_ones_lock_is_taken_over() {
    for name in ["gen", "train"] {
        let stage = named(name);
        let home = tempfile::tempdir().expect("a temporary folder");
        let out = home.path().join("out");
        let mut first = start(stage.command(&out));
        let who = format!("process {}", first.id());
        wait_until(|| fs::read_to_string(out.join(FILE)).is_ok_and(|holder| holder.contains(&who)));
        // So that it cannot end before the second one.
        signal(first.id(), "STOP");
        wait_until(|| {
            status_field(first.id(), "State:").is_none_or(|state| !state.starts_with(['R', 'S', 'D']))
        });
        let state = status_field(first.id(), "State:").expect("a child that nobody waited for");
        assert!(state.starts_with('T'), "the first {name} has ended too soon: {state}");
        let (code, told) = ended(start(stage.command(&out)));
        assert_eq!(code, Some(1), "{name}: {told}");
        assert!(told.contains(&who) && told.contains(name) && told.contains(text(&out)), "{told}");
        first.kill().expect("a child of ours");
        first.wait().expect("a child of ours");
        succeed(&mut stage.command(&out));
        assert_eq!(difference(&hashes(&out), &stage.unbroken().hashes), None, "{name}");
    }
}
