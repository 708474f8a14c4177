//! The `paper` profile through the whole program, its parts in little, on tiny real data; and the dry run.
//! Needs what `make setup` makes.

mod made_data;

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use fs_err as fs;
use made_data::{command, done, fails, kill_when_filled, text};

/// Every part of the paper's network with few channels on a small map.
const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/paper_scaled_down.toml");
const IMAGE_WEIGHTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/swin_weights_torchvision.pth");

/// A labelled dataset of two episodes, made once for all tests here.
fn dataset() -> &'static Path {
    static DATASET: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    let (_, path) = DATASET.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("id");
        let size = ["--town", "downtown", "--samples", "3", "--episodes", "2", "--seed", "5"];
        done(&[&["gen"], size.as_slice(), &["--set", "val_every=2", "--out", text(&path)]].concat());
        done(&["label", text(&path)]);
        (folder, path)
    });
    path
}

/// Dropout and skipped branches draw at random: they too must not know of the break.
#[test]
fn a_run_killed_in_the_middle_ends_with_the_same_bytes_and_is_scored() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (whole, broken) = (folder.path().join("whole"), folder.path().join("broken"));
    let args = |out| {
        let run =
            ["train", text(dataset()), "--model", MODEL, "--image-weights", IMAGE_WEIGHTS, "--out", out];
        let settings = ["batch_size=2", "save_every_steps=1", "lidar_stage.epochs=1", "fused_stage.epochs=1"];
        run.into_iter().chain(settings.into_iter().flat_map(|key| ["--set", key])).collect::<Vec<_>>()
    };
    let told = done(&args(text(&whole)));
    assert!(told.contains("image weights loaded (torchvision names"), "{told}");
    kill_when_filled(&mut command(&args(text(&broken))), &broken.join("state"));
    done(&args(text(&broken)));
    let checkpoint = |run: &Path| fs::read(run.join("model.safetensors")).expect("the run is whole");
    assert!(checkpoint(&whole) == checkpoint(&broken), "the checkpoints differ");

    let table = done(&["eval", text(&whole.join("model.safetensors")), "--data", text(dataset())]);
    assert!(table.contains("harmful"), "{table}");
}

#[test]
fn a_dry_run_tells_of_a_run_and_makes_none() {
    let id = text(dataset());
    let told = done(&["train", id, "--model", "paper", "--dry-run"]);
    assert!(told.contains("image backbone") && told.contains("activations"), "{told}");
    let told = done(&["train", id, "--dry-run", "--json", "--set", "lidar_stage.epochs=4"]);
    let told: serde_json::Value = serde_json::from_str(&told).expect("JSON");
    assert_eq!(told["stages"][0]["n_epochs"], 4);
    assert_eq!(told["parameters"][0]["name"], "LiDAR encoder");
}

#[test]
fn profiles_and_settings_that_do_not_fit_are_named() {
    let id = text(dataset());
    let message = fails(&["train", id, "--model", "middling", "--dry-run"]);
    assert!(message.contains("middling") && message.contains("small, paper"), "{message}");
    let message = fails(&["train", id, "--dry-run", "--image-weights", "swin.pth"]);
    assert!(message.contains("swin.pth") && message.contains("--model paper"), "{message}");
    let message = fails(&["train", id, "--model", "paper", "--dry-run", "--set", "model.use_camera=false"]);
    assert!(message.contains("fused_stage.epochs"), "{message}");
    let message = fails(&["train", id, "--model", "paper", "--dry-run", "--set", "model.grid.x_max_m=48"]);
    assert!(message.contains("lidar.voxel"), "{message}");
}
