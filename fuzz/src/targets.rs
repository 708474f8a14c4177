//! What is fuzzed: one function a target. Each takes any bytes for a file that somebody else wrote and must return: an
//! error is welcome; a panic, a hang and a gigabyte of memory are faults.
//!
//! The first byte mostly chooses what the others are, so that one corpus serves formats that are alike. Readers that take a
//! path get files in a scratch folder. `tests/fuzz_regressions.rs` runs the same functions over inputs that once failed.

#[path = "archives.rs"]
mod archives;
#[path = "data_sets.rs"]
mod data_sets;
#[path = "imports.rs"]
mod imports;
#[path = "made_episode.rs"]
mod made_episode;
#[path = "made_logs.rs"]
mod made_logs;
#[path = "mcap_files.rs"]
mod mcap_files;
#[path = "mesh_files.rs"]
mod mesh_files;
#[path = "networks.rs"]
mod networks;
#[path = "patched.rs"]
mod patched;
#[path = "predictions.rs"]
mod predictions;
#[path = "results.rs"]
mod results;
#[path = "roads.rs"]
mod roads;
#[path = "scratch.rs"]
mod scratch;
#[path = "seeds.rs"]
mod seeds;
#[path = "texts.rs"]
mod texts;

pub use seeds::write_seeds;

/// A target.
pub type Target = fn(&[u8]);

/// Every target with its name, which is that of its folder of inputs and of its program in `fuzz_targets`.
pub const TARGETS: [(&str, Target); 15] = [
    ("episode", archives::episode),
    ("sidecar", archives::sidecar),
    ("manifest", texts::manifest),
    ("data_set", data_sets::data_set),
    ("config", texts::config),
    ("results", results::results),
    ("road", roads::road),
    ("predictions", predictions::predictions),
    ("mesh", mesh_files::mesh),
    ("import_nuscenes", imports::nuscenes),
    ("import_kitti", imports::kitti),
    ("import_av2", imports::av2),
    ("import_ros2", imports::ros2),
    ("checkpoint", networks::checkpoint),
    ("image_weights", networks::image_weights),
];

/// Runs the target of this name.
///
/// # Panics
/// There is no such target, or the target found a fault.
pub fn run(name: &str, bytes: &[u8]) {
    let (_, target) = TARGETS.iter().find(|(known, _)| *known == name).expect("a target of this name");
    target(bytes);
}
