//! What the program says of bad input, and that it leaves alone what is not its own. Needs what `make setup` makes.

mod made_data;

use std::process::Command;

use fs_err as fs;
use harmzone::episode::{Manifest, Split};
use harmzone::files::FolderLock;
use made_data::{Fixture, TINY, command, copy, done, episodes, fails, fixture, harmzone, text};

#[test]
fn unknown_towns_and_weathers_list_those_that_exist() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("data");
    let message = fails(&["gen", "--town", "atlantis", "--out", text(&out)]);
    assert!(message.contains("atlantis") && message.contains("downtown"), "{message}");
    let message = fails(&["gen", "--town", "downtown", "--weather", "Hail", "--out", text(&out)]);
    assert!(message.contains("Hail") && message.contains("ClearNoon"), "{message}");
    assert!(!out.join("dataset.json").exists());
}

#[test]
fn unfamiliar_objects_of_ones_own_alone_need_a_folder_of_meshes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("data");
    let message = fails(&["gen", "--ood", "--set", "scene.shipped_kinds=false", "--out", text(&out)]);
    assert!(message.contains("shipped_kinds") && message.contains("give --models DIR"), "{message}");
    assert!(!out.exists());
}

#[test]
fn who_writes_several_files_into_a_folder_is_told_of_another_writer_before_the_work_begins() {
    let home = tempfile::tempdir().expect("a temporary folder");
    let at = |name: &str| home.path().join(name);
    let (out, network, absent) = (at("out"), at("out/model.safetensors"), at("absent"));
    let lock = FolderLock::take(&out).expect("a writable folder");
    fs::write(&network, "a network").expect("a writable folder");
    let (out, network, absent) = (text(&out), text(&network), text(&absent));
    for words in [
        &["eval", "--predictions", absent, "--truth", absent, "--out", out] as &[&str],
        &["sweep", "small", "--data", absent, "--out", out],
        &["versus", "small", "truth", "--data", absent, "--out", out],
        &["compare", absent, absent, "--out", out],
        &["calibrate", network, "--data", absent],
        &["init", out],
        &["man", "--out", out],
    ] {
        let told = fails(words);
        let who = format!("another process writes here (process {}", std::process::id());
        assert!(told.contains(&who) && told.contains(out), "{words:?}: {told}");
    }
    drop(lock);
    // What is only looked for is not made.
    let new = at("new");
    let told = fails(&["compare", absent, absent, "--out", text(&new)]);
    assert!(told.contains(absent) && !new.exists(), "{told}");
}

#[test]
fn a_dataset_without_labels_says_how_to_make_them() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let message = fails(&[
        "train",
        text(&fixture().id),
        "--labels",
        "absent",
        "--out",
        text(&folder.path().join("run")),
    ]);
    assert!(message.contains("harmzone label") && message.contains("absent"), "{message}");
}

#[test]
fn labels_of_another_dataset_are_refused() {
    let (_folder, dataset) = copy();
    fs::remove_dir_all(dataset.join("labels")).expect("labels were there");
    let other = fixture().ood.join("labels");
    let copied =
        Command::new("cp").arg("-r").arg(other).arg(dataset.join("labels")).status().expect("cp runs");
    assert!(copied.success());
    let message = fails(&["train", text(&dataset), "--out", text(&dataset.join("run"))]);
    assert!(message.contains("another dataset") && message.contains("harmzone label"), "{message}");
}

#[test]
fn a_truncated_episode_and_a_foreign_file_are_named() {
    let (_folder, dataset) = copy();
    let (name, bytes) = episodes(&dataset).remove(0);
    let path = dataset.join("episodes").join(&name);
    fs::write(&path, &bytes[..bytes.len() / 2]).expect("a writable copy");
    let message = fails(&["label", text(&dataset), "--labels", "again"]);
    assert!(message.contains(&name), "{message}");
    fs::write(&path, b"not an MCAP at all").expect("a writable copy");
    let message = fails(&["label", text(&dataset), "--labels", "again"]);
    assert!(message.contains(&name), "{message}");
}

#[test]
fn a_validation_split_that_is_not_scored_is_not_read() {
    let (_folder, dataset) = copy();
    let manifest = Manifest::read(&dataset).expect("a manifest");
    let broken = &manifest.of_split(Split::Val).next().expect("an episode of val").file;
    fs::write(dataset.join(broken), b"not an MCAP at all").expect("a writable copy");
    let out = dataset.join("run");
    let train = [&["train", text(&dataset), "--out", text(&out)], TINY.as_slice()].concat();
    let message = fails(&train);
    assert!(message.contains(broken.as_str()), "{message}");
    done(&[train.as_slice(), &["--set", "validate_every_epochs=0"]].concat());
    assert!(out.join("model.safetensors").is_file() && !out.join("validation.csv").exists());
}

#[test]
fn calibrate_refuses_a_judge_that_does_not_fit_the_labels_zone() {
    let (_folder, dataset) = copy();
    done(&["label", text(&dataset), "--set", "kind=arc"]);
    let calibrate = ["calibrate", text(&fixture().run), "--judge", "zone-soft", "--labels", "arc"];
    let message = fails(&[calibrate.as_slice(), &["--data", text(&dataset)]].concat());
    assert!(message.contains("`zone-soft` cannot judge by zone `arc`"), "{message}");
    assert!(message.contains(text(&dataset)), "{message}");
}

#[test]
fn an_output_folder_of_something_else_is_left_alone() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    fs::write(folder.path().join("thesis.txt"), "years of work").expect("a writable folder");
    fails(&["gen", "--town", "downtown", "--episodes", "1", "--samples", "1", "--out", text(folder.path())]);
    fails(&["train", text(&fixture().id), "--out", text(folder.path())]);
    assert_eq!(fs::read_to_string(folder.path().join("thesis.txt")).expect("still there"), "years of work");
    assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1);
}

#[test]
fn another_config_in_the_same_folder_needs_force() {
    let Fixture { id, run, .. } = fixture();
    let before = fs::read(run.join("model.safetensors")).expect("a checkpoint");
    let message = fails(&["train", text(id), "--out", text(run), "--set", "seed=9"]);
    assert!(message.contains("--force"), "{message}");
    assert!(fs::read(run.join("model.safetensors")).expect("a checkpoint") == before);
    // Its lock would be seen by those who copy the shared one meanwhile.
    let (_folder, own) = copy();
    let message = fails(&["gen", "--town", "downtown", "--seed", "6", "--samples", "3", "--out", text(&own)]);
    assert!(message.contains("--force"), "{message}");
}

#[test]
fn a_checkpoint_that_does_not_fit_its_config_is_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("model.safetensors");
    let mut bytes = fs::read(fixture().run.join("model.safetensors")).expect("a checkpoint");
    // Checkpoints without a hash were written before there was one; a key that nobody knows is no hash.
    for (from, to) in
        [(&b"fuser_channels = 16"[..], &b"fuser_channels = 32"[..]), (b"harmzone.sha256", b"harmzone.sha255")]
    {
        let at = bytes.windows(from.len()).position(|window| window == from).expect("the config is inside");
        bytes[at..at + from.len()].copy_from_slice(to);
    }
    fs::write(&path, bytes).expect("a writable folder");
    let message = fails(&["eval", text(&path), "--data", text(&fixture().id)]);
    assert!(message.contains("do not fit its config"), "{message}");
}

#[test]
fn a_sample_out_of_range_tells_the_range() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("x.png");
    let message = fails(&["view", text(&fixture().id), "--sample", "6", "--out", text(&out)]);
    assert!(message.contains('6') && message.contains('5'), "{message}");
}

#[test]
fn missing_gl_says_what_to_install() {
    let output = command(&["doctor"])
        .env("__EGL_VENDOR_LIBRARY_FILENAMES", "/nowhere/egl.json")
        .output()
        .expect("the program starts");
    assert_eq!(output.status.code(), Some(1));
    let all = [output.stdout, output.stderr].concat();
    let all = String::from_utf8_lossy(&all);
    assert!(all.contains("libegl1"), "{all}");
}

#[test]
fn a_device_that_is_not_there_is_told_with_what_is() {
    let of = |device| harmzone(&["train", "nowhere", "--out", "nowhere", "--device", device]);
    let absent = of("vulkan:99");
    let text = String::from_utf8_lossy(&absent.stderr).into_owned();
    let told = if cfg!(feature = "vulkan") { "no device vulkan:99" } else { "this build has cpu" };
    assert!(absent.status.code() == Some(1) && text.contains(told), "{text}");
    let unknown = of("gpu");
    let text = String::from_utf8_lossy(&unknown.stderr).into_owned();
    assert!(unknown.status.code() == Some(2) && text.contains("vulkan:N"), "{text}");
}

#[test]
fn a_wrong_flag_is_a_usage_error() {
    assert_eq!(harmzone(&["gen", "--city", "downtown"]).status.code(), Some(2));
}
