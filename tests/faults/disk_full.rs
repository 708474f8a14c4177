//! A full disk, at each stage: a message with file and room, data whole, and the same command ends once there is room.

use std::process::Command;

use super::folder::{difference, hashes};
use super::made_data::{succeed, text};
use super::shim::{Fault, with_fault};
use super::skipped;
use super::stages::{Stage, all};

/// Shares of what a stage writes, at which the disk is full.
const SHARES: [f64; 12] = [0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.99];
/// With room for no more than this no stage ends well.
const SURELY_FULL: f64 = 0.5;

/// How many bytes a stage writes; what it links takes no room. `None` where that cannot be counted.
fn written(stage: &Stage) -> Option<u64> {
    let home = tempfile::tempdir().expect("a temporary folder");
    let out = home.path().join("out");
    stage.prepare(&out);
    let mut command = stage.command(&out);
    let counter = with_fault(&mut command, &out, Fault::None)?;
    succeed(&mut command);
    let n_bytes = counter.n_bytes();
    assert!(n_bytes > 0, "{} writes nothing", stage.name);
    Some(n_bytes)
}

/// What a stage says on a disk with room for a share of the bytes that it writes, and what is wrong with that.
fn fill(stage: &Stage, n_bytes: u64, share: f64) -> Option<(String, Vec<String>)> {
    let home = tempfile::tempdir().expect("a temporary folder");
    let out = home.path().join("out");
    stage.prepare(&out);
    let mut command = stage.command(&out);
    let room = Fault::Room { n_bytes: (n_bytes as f64 * share) as u64 };
    let _counter = with_fault(&mut command, &out, room)?;
    let output = command.output().expect("the program starts");
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    let mut wrong = Vec::new();
    if output.status.code() == Some(0) {
        // It can do without its last bytes, or has not seen that they were lost.
        if let Some(text) = difference(&hashes(&out), &stage.unbroken().hashes) {
            wrong.push(format!("{} at {share}: ended well, and {text}: {told}", stage.name));
        }
        if share <= SURELY_FULL {
            wrong.push(format!("{} at {share}: ended well on a full disk: {told}", stage.name));
        }
        return Some(("done".to_owned(), wrong));
    }
    if output.status.code() != Some(1) || told.contains("panicked") {
        wrong.push(format!("{} at {share}: ended with {:?}: {told}", stage.name, output.status.code()));
    }
    let line = told.lines().find(|line| line.contains("space")).unwrap_or_default().to_owned();
    for word in ["No space left", "no space left", text(&out)] {
        if !told.to_lowercase().contains(&word.to_lowercase()) {
            wrong.push(format!("{} at {share}: `{word}` is not told: {told}", stage.name));
        }
    }
    if !(told.contains("wants") && told.contains("free")) {
        wrong.push(format!("{} at {share}: the room is not told: {told}", stage.name));
    }
    if let Err(told) = stage.finish(&out) {
        wrong.push(format!("{} at {share}: not after it: {told}", stage.name));
    } else if let Some(text) = difference(&hashes(&out), &stage.unbroken().hashes) {
        wrong.push(format!("{} at {share}: after it, {text}", stage.name));
    }
    Some((line, wrong))
}

/// Fills the disk of every stage at these shares; prints what each says.
fn fill_all(shares: &[f64]) {
    let mut wrong = Vec::new();
    for stage in all() {
        let Some(n_bytes) = written(stage) else { return };
        for &share in shares {
            let Some((line, faults)) = fill(stage, n_bytes, share) else { return };
            println!("{:<8} {share:>5} {line}", stage.name);
            wrong.extend(faults);
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_full_disk_is_told_with_its_room_and_loses_nothing() {
    fill_all(&[0.5]);
}

#[test]
#[ignore = "some minutes: make soak ROWS=disk_full"]
fn long_disk_full() {
    fill_all(&SHARES);
}

/// A small disk of its own; `None`, told, where this user may not mount one.
struct SmallDisk(tempfile::TempDir);

impl SmallDisk {
    fn mount(n_kib: u32) -> Option<Self> {
        let home = tempfile::tempdir().expect("a temporary folder");
        let size = format!("size={n_kib}k");
        let mounted =
            Command::new("mount").args(["-t", "tmpfs", "-o", &size, "tmpfs"]).arg(home.path()).output();
        if !mounted.is_ok_and(|mounted| mounted.status.success()) {
            skipped("a disk of its own, which only root may mount");
            return None;
        }
        Some(Self(home))
    }

    fn remount(&self, options: &str) {
        let options = format!("remount,{options}");
        let done = Command::new("mount").args(["-o", &options]).arg(self.0.path()).status();
        assert!(done.is_ok_and(|status| status.success()), "the disk cannot be remounted");
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(self.0.path()).status();
    }
}

#[test]
fn on_a_small_disk_gen_says_at_the_start_that_it_cannot_end_and_a_read_only_one_is_named() {
    for stage in all() {
        let Some(disk) = SmallDisk::mount(64) else { return };
        let out = disk.0.path().join("out");
        disk.remount("ro");
        if stage.name != "label" {
            let told = stage.command(&out).output().expect("the program starts");
            let words = String::from_utf8_lossy(&told.stderr).into_owned();
            assert!(told.status.code() == Some(1) && words.contains("Read-only"), "{}: {words}", stage.name);
        }
        disk.remount("rw");
        if stage.name == "gen" {
            let told = stage.command(&out).output().expect("the program starts");
            let words = String::from_utf8_lossy(&told.stderr).into_owned();
            assert!(told.status.code() == Some(1), "{words}");
            assert!(words.contains("needs about") && words.contains("are free"), "{words}");
        }
        disk.remount("size=100m");
        stage.prepare(&out);
        assert!(stage.command(&out).status().expect("the program starts").success(), "{}", stage.name);
        assert_eq!(difference(&hashes(&out), &stage.unbroken().hashes), None, "{}", stage.name);
    }
}

#[test]
fn a_full_temporary_folder_is_named_or_not_needed() {
    for stage in all() {
        let Some(disk) = SmallDisk::mount(64) else { return };
        let temporary = disk.0.path();
        fs_err::write(temporary.join("full"), vec![1; 64 << 10]).expect("the disk has so much room");
        let home = tempfile::tempdir().expect("a temporary folder");
        let out = home.path().join("out");
        stage.prepare(&out);
        let told = stage.command(&out).env("TMPDIR", temporary).output().expect("the program starts");
        let words = String::from_utf8_lossy(&told.stderr).into_owned();
        if told.status.code() != Some(0) {
            assert_eq!(told.status.code(), Some(1), "{}: {words}", stage.name);
            assert!(words.contains(text(temporary)), "{}: {words}", stage.name);
            assert!(words.to_lowercase().contains("space"), "{}: {words}", stage.name);
        }
        stage.finish(&out).unwrap_or_else(|told| panic!("{}: {told}", stage.name));
        assert_eq!(difference(&hashes(&out), &stage.unbroken().hashes), None, "{}", stage.name);
    }
}
