//! Tiny real data for tests from end to end: two labelled data sets and a trained run, made by the program itself.

#![allow(dead_code, reason = "each test file uses its part")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;
use std::time::Duration;

use fs_err as fs;

/// A config small enough to train in seconds.
pub const TINY: [&str; 26] = [
    // A box of each class for each query, however near each other they are.
    "--set",
    "model.head.judge=network",
    "--set",
    "model.grid.cell_size_m=3.2",
    "--set",
    "model.lidar.pillars.bev_channels=[16,16]",
    "--set",
    "model.fuser_channels=16",
    "--set",
    "model.head.channels=64",
    "--set",
    "model.lidar.pillars.channels=32",
    "--set",
    "model.head.n_queries=16",
    "--set",
    "model.camera.cnn.image_width_px=128",
    "--set",
    "model.camera.cnn.n_depth_bins=12",
    "--set",
    "lidar_stage.epochs=3",
    "--set",
    "fused_stage.epochs=2",
    "--set",
    "save_every_steps=1",
    "--set",
    "batch_size=2",
];

/// Over that, a closed set that fits three samples well enough to find some object of each kind.
pub const KINDS: [&str; 9] = [
    "model.head.classes=kind",
    "model.head.numeric_fusion=none",
    "validate_every_epochs=0",
    "model.use_camera=false",
    "fused_stage.epochs=0",
    "lidar_stage.epochs=100",
    "save_every_steps=100",
    "average_decay=0.5",
    "model.head.n_queries=40",
];

/// The program: the one that `HARMZONE_PROGRAM` names, which long tests run while another is built; else beside xtask's where
/// these are the tests of xtask.
pub fn program() -> PathBuf {
    if let Some(named) = std::env::var_os("HARMZONE_PROGRAM") {
        return named.into();
    }
    if let Some(program) = option_env!("CARGO_BIN_EXE_harmzone") {
        return program.into();
    }
    let tests = std::env::current_exe().expect("a running program has a path");
    let release = tests.ancestors().nth(2).expect("tests lie in target/release/deps");
    let program = release.join("harmzone");
    assert!(program.is_file(), "no {}: run `cargo build --release` first", program.display());
    program
}

/// From another folder: the program finds all it needs by itself.
pub fn command(args: &[&str]) -> Command {
    let mut command = Command::new(program());
    command.args(args).current_dir(std::env::temp_dir());
    command
}

pub fn harmzone(args: &[&str]) -> Output {
    command(args).output().expect("the program starts")
}

/// What the program prints; it must succeed.
pub fn done(args: &[&str]) -> String {
    succeed(&mut command(args))
}

/// The message of a program that must fail with exit code 1.
pub fn fails(args: &[&str]) -> String {
    fail(&mut command(args))
}

pub fn succeed(command: &mut Command) -> String {
    let output = command.output().expect("the program starts");
    assert!(output.status.success(), "{command:?} failed:\n{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("output is text")
}

pub fn fail(command: &mut Command) -> String {
    let output = command.output().expect("the program starts");
    assert_eq!(output.status.code(), Some(1), "{command:?} ended with {:?}", output.status);
    String::from_utf8(output.stderr).expect("messages are text")
}

/// Kills a program as soon as something lies in a folder that it writes.
pub fn kill_when_filled(command: &mut Command, folder: &Path) {
    let mut child = command.spawn().expect("the program starts");
    let is_whole = |path: &Path| path.extension().is_none_or(|extension| extension != "partial");
    let is_filled = || {
        fs::read_dir(folder)
            .is_ok_and(|mut dir| dir.any(|entry| entry.is_ok_and(|entry| is_whole(&entry.path()))))
    };
    while !is_filled() {
        let has_ended = child.try_wait().expect("a child of ours").is_some();
        assert!(!has_ended, "{command:?} ended and left nothing in {}", folder.display());
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().expect("a running program can be killed");
    child.wait().expect("a killed program ends");
}

pub fn text(path: &Path) -> &str {
    path.to_str().expect("temporary paths are text")
}

/// Flags of `gen` for data of three samples an episode; the seed gives people and harmful objects in so few.
pub fn generation<'a>(out: &'a Path, jobs: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let base = "gen --town downtown --samples 3 --seed 10 --set val_every=2".split(' ');
    base.chain(["--jobs", jobs, "--out", text(out)]).chain(more.iter().copied()).collect()
}

pub fn generate(out: &Path, jobs: &str, more: &[&str]) {
    done(&generation(out, jobs, more));
}

/// Two labelled datasets, ID and OOD, and a trained run; made once for all tests here.
pub struct Fixture {
    _folder: tempfile::TempDir,
    pub id: PathBuf,
    pub ood: PathBuf,
    pub run: PathBuf,
}

pub fn fixture() -> &'static Fixture {
    static FIXTURE: OnceLock<Fixture> = OnceLock::new();
    FIXTURE.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (id, ood, run) = (folder.path().join("id"), folder.path().join("ood"), folder.path().join("run"));
        generate(&id, "2", &["--episodes", "2"]);
        generate(&ood, "2", &["--episodes", "1", "--ood"]);
        done(&["label", text(&id)]);
        done(&["label", text(&ood)]);
        done(&[&["train", text(&id), "--out", text(&run)], TINY.as_slice()].concat());
        Fixture { _folder: folder, id, ood, run }
    })
}

pub fn episodes(dataset: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found: Vec<(String, Vec<u8>)> = fs::read_dir(dataset.join("episodes"))
        .expect("the dataset has episodes")
        .map(|entry| entry.expect("a readable folder").path())
        .map(|path| {
            (
                text(&path).rsplit('/').next().unwrap_or_default().to_owned(),
                fs::read(&path).expect("a readable file"),
            )
        })
        .collect();
    found.sort();
    found
}

/// A copy of the labelled ID dataset that a test may spoil.
pub fn copy() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let to = folder.path().join("copy");
    let copied = Command::new("cp").arg("-r").arg(&fixture().id).arg(&to).status().expect("cp runs");
    assert!(copied.success());
    (folder, to)
}
