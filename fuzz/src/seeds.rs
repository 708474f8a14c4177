//! Inputs to begin with, made in code: the fuzzers change them until something new happens.

use std::path::Path;

use fs_err as fs;

use super::{archives, imports, mesh_files, networks, roads, scratch, texts};

/// Writes the made inputs of a target into a folder; `make_corpus.sh` adds those that lie in files.
///
/// # Errors
/// The folder cannot be written.
pub fn write_seeds(target: &str, folder: &Path) -> std::io::Result<()> {
    fs::create_dir_all(folder)?;
    for (i, seed) in seeds(target).into_iter().enumerate() {
        fs::write(folder.join(format!("made_{i:03}")), seed)?;
    }
    Ok(())
}

fn with_kind(kind: usize, bytes: &[u8]) -> Vec<u8> {
    [&[kind as u8], bytes].concat()
}

fn seeds(target: &str) -> Vec<Vec<u8>> {
    match target {
        "episode" => archives::episode_seeds(),
        "sidecar" => archives::sidecar_seeds(),
        "manifest" => {
            let made = super::made_episode::dataset("seeds");
            let files = ["dataset.json", "labels/harm/labels.json"];
            let read = |file: &str| fs::read(made.dataset.join(file)).expect("it was just written");
            files.iter().enumerate().map(|(kind, file)| with_kind(kind, &read(file))).collect()
        }
        "results" => {
            let folder = scratch::empty_folder("seeds/scores");
            texts::made_scores(&folder);
            let names = texts::RESULTS.iter().enumerate();
            names.filter_map(|(kind, name)| Some(with_kind(kind, &fs::read(folder.join(name)).ok()?))).collect()
        }
        "road" => vec![
            with_kind(0, roads::STREET.as_bytes()),
            with_kind(2, roads::STREET.as_bytes()),
            with_kind(0, roads::CROSSROADS.as_bytes()),
            with_kind(1, b"split = \"dev\"\n"),
        ],
        "mesh" => [mesh_files::OBJ, "", "", mesh_files::MTL, "", "", mesh_files::TOML]
            .iter()
            .enumerate()
            .flat_map(|(kind, text)| [kind, kind + 8].map(|kind| with_kind(kind, text.as_bytes())))
            .filter(|seed| seed.len() > 1)
            .collect(),
        "import_nuscenes" => imports::nuscenes_seeds(),
        "import_kitti" => imports::kitti_seeds(),
        "import_av2" => imports::av2_seeds(),
        "import_ros2" => imports::ros2_seeds(),
        "checkpoint" => networks::checkpoint_seeds(),
        _ => Vec::new(),
    }
}
