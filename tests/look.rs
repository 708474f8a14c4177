//! Looking before reading: the file and the layout for Foxglove, and clips, as outside readers see them. Needs what `make setup` makes.

mod made_data;

use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use fs_err as fs;
use made_data::{command, done, fails, fixture, text};
use serde_json::Value;

/// The data set out of distribution and what the network inside the program finds in it; made once.
fn predicted() -> &'static (tempfile::TempDir, PathBuf) {
    static PREDICTED: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    PREDICTED.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let predictions = folder.path().join("predictions");
        done(&["predict", "small", "--data", text(&fixture().ood), "--out", text(&predictions)]);
        (folder, predictions)
    })
}

fn view(more: &[&str]) -> String {
    let fixed = ["view", text(&fixture().ood), "--predictions", text(&predicted().1), "--min-score", "0.1"];
    done(&[&fixed[..], more].concat())
}

/// What a check in Python says, which must succeed.
fn check(script: &str, args: &[&Path]) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python = root.join(".venv-test/bin/python");
    assert!(python.is_file(), "no {}: run `make setup-test` first", python.display());
    let checked = Command::new(python).arg(root.join("tests/python").join(script)).args(args).output();
    let checked = checked.expect("Python starts");
    let said = String::from_utf8_lossy(&checked.stdout).into_owned();
    assert!(checked.status.success(), "{said}{}", String::from_utf8_lossy(&checked.stderr));
    said
}

/// The one file of a folder that ends so.
fn only_mcap(folder: &Path) -> PathBuf {
    let entries = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    let mut found = entries.filter(|path| path.extension().is_some_and(|end| end == "mcap"));
    found.next().expect("a file")
}

#[test]
fn foxglove_finds_every_topic_and_field_of_the_layout() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (joined, layout) = (folder.path().join("joined.mcap"), folder.path().join("layout.json"));
    let told = view(&["--mcap", text(&joined)]);
    assert!(told.contains("3 samples of downtown-"), "{told}");
    done(&["foxglove-layout", "--out", text(&layout)]);
    let ood = &fixture().ood;
    let files = [&ood.join("episodes"), &ood.join("labels/rect"), &predicted().1].map(|at| only_mcap(at));
    let [episode, labels, detections] = files.each_ref().map(PathBuf::as_path);
    let told = check("check_view.py", &[&layout, &joined, episode, labels, detections]);
    assert!(told.contains("7 panels") && told.contains("3 samples"), "{told}");

    let message = fails(&["foxglove-layout", "--out", text(&layout)]);
    assert!(message.contains("--force"), "{message}");
    let printed: Value = serde_json::from_str(&done(&["foxglove-layout"])).expect("JSON");
    assert!(printed["configById"].is_object());
}

#[test]
fn clips_hold_each_picture_at_its_time() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let at = |name: &str| folder.path().join(name);
    let (mp4, gif, pictures) = (at("clip.mp4"), at("clip.gif"), at("pictures"));
    let small = ["--width", "640"];
    for out in [&mp4, &gif, &pictures] {
        let told = view(&[&["--video", text(out)], &small[..]].concat());
        assert!(told.contains("3 pictures of 640 x 290, 0.9 s of downtown-"), "{told}");
    }
    let again = at("again.mp4");
    view(&[&["--video", text(&again)], &small[..]].concat());
    assert!(fs::read(&mp4).expect("a clip") == fs::read(&again).expect("a clip"), "the same bytes");
    let part = at("part.gif");
    let told = view(&[&["--video", text(&part), "--from", "0.2s", "--to", "2"], &small[..]].concat());
    assert!(told.contains("1 pictures"), "{told}");
    let told = check("check_clips.py", &[&pictures, &mp4, &gif]);
    assert!(told.contains("mp4: 3 pictures") && told.contains("gif: 3 pictures"), "{told}");
}

#[test]
fn reruns_own_program_takes_the_recording_and_finds_all_of_it() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let recording = folder.path().join("look.rrd");
    let bin = Path::new(env!("CARGO_MANIFEST_DIR")).join(".venv-test/bin");
    let words =
        ["view", text(&fixture().ood), "--predictions", text(&predicted().1), "--rrd", text(&recording)];
    let told = made_data::succeed(made_data::command(&words).env("HARMZONE_PYTHON", bin.join("python")));
    assert!(told.contains("3 samples of downtown-"), "{told}");
    let rerun = |word: &str, recording: &Path| {
        let mut rerun = Command::new(bin.join("rerun"));
        made_data::succeed(rerun.args(["rrd", word]).arg(recording))
    };
    rerun("verify", &recording);
    let holds = rerun("print", &recording);
    let wanted = [
        "/world/ego/camera/image",
        "/world/ego/points",
        "/world/ego/truth/harmless/ood",
        "/world/ego/zone/outline",
        "/world/map/lanes",
        "/plots/speed/speed_mps",
        "/plots/harmful/n_predicted_harmful",
        "RecordingInfo:name",
    ];
    let missing: Vec<&str> = wanted.into_iter().filter(|path| !holds.contains(path)).collect();
    assert!(missing.is_empty(), "{missing:?} of {holds}");
    // The viewer would join two recordings of one id, though they show other boxes.
    let other = folder.path().join("other.rrd");
    let words = [&words[..4], &["--min-score", "0.9", "--rrd", text(&other)]].concat();
    made_data::succeed(made_data::command(&words).env("HARMZONE_PYTHON", bin.join("python")));
    let id_in = |printed: &str| {
        let is_id = |line: &&str| line.trim().starts_with("\"downtown-");
        printed.lines().find(is_id).map(|line| line.trim().to_owned()).expect("an id")
    };
    assert_ne!(id_in(&rerun("print", &other)), id_in(&holds));
    let mut without =
        made_data::command(&["view", text(&fixture().ood), "--rrd", text(&recording), "--force"]);
    let message = made_data::fail(without.env("HARMZONE_PYTHON", "/nowhere/python"));
    assert!(message.contains("HARMZONE_PYTHON"), "{message}");
}

#[test]
fn what_is_not_there_is_listed_and_what_is_there_stays() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("clip.gif");
    let refused = |more: &[&str]| fails(&[&["view", text(&fixture().id)], more].concat());
    let message = refused(&["--video", text(&out), "--episode", "nowhere"]);
    assert!(message.contains("`nowhere`") && message.matches("`downtown-").count() == 2, "{message}");
    let message = refused(&["--video", text(&out), "--from", "7"]);
    assert!(message.contains("sample 7") && message.contains("0 to 2"), "{message}");
    let message = refused(&["--video", text(&folder.path().join("clip.avi"))]);
    assert!(message.contains("`.gif`"), "{message}");
    for flag in ["--video", "--mcap"] {
        fs::write(&out, "mine").expect("a writable folder");
        let message = refused(&[flag, text(&out)]);
        assert!(message.contains("--force"), "{message}");
        assert_eq!(fs::read_to_string(&out).expect("a file"), "mine");
    }
    done(&["view", text(&fixture().id), "--video", text(&out), "--force"]);
    assert!(fs::read(&out).expect("a file").starts_with(b"GIF89a"));
}

#[test]
fn an_episode_that_came_after_the_labels_is_drawn_without_and_any_name_will_do() {
    let (home, data) = made_data::copy();
    made_data::generate(&data, "1", &["--episodes", "3"]);
    let name = OsStr::from_bytes(b"\xff.png");
    let view = |sample: &str, more: &[&str]| {
        let mut view = command(&["view", text(&data), "--sample", sample, "--force"]);
        view.args(more).arg("--out").arg(home.path().join(name));
        view
    };
    let told = made_data::succeed(&mut view("0", &[]));
    assert!(told.contains("harmful"), "{told}");
    let told = made_data::succeed(&mut view("8", &["--json"]));
    assert!(told.contains("\"n_harmful\":null"), "{told}");
    let told = made_data::fail(&mut view("8", &["--labels", "rect"]));
    assert!(told.contains("has no labels in set") && told.contains("harmzone label"), "{told}");
}
