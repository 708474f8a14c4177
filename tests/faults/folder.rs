//! What lies in a folder: every file with its content, so that two folders can be compared.

use std::collections::BTreeMap;
use std::path::Path;

use fs_err as fs;
use harmzone::files::sha256_of;

/// Files whose content is the time that a run took.
const OF_TIME: [&str; 1] = ["time.json"];

/// SHA-256 of each file by its path in the folder.
pub fn hashes(folder: &Path) -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(inner) = folders.pop() {
        for entry in fs::read_dir(&inner).expect("a readable folder") {
            let path = entry.expect("a readable folder").path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let name = path.strip_prefix(folder).expect("it is below").to_string_lossy().into_owned();
            if !OF_TIME.contains(&name.rsplit('/').next().unwrap_or_default()) {
                found.insert(name, sha256_of(&path).expect("a readable file"));
            }
        }
    }
    found
}

/// Whether a file is an MCAP by its name.
pub fn is_mcap(name: &str) -> bool {
    Path::new(name).extension().is_some_and(|suffix| suffix == "mcap")
}

/// The first way in which two folders differ.
pub fn difference(found: &BTreeMap<String, String>, wanted: &BTreeMap<String, String>) -> Option<String> {
    let missing =
        wanted.keys().find(|name| !found.contains_key(*name)).map(|name| format!("{name} is missing"));
    let more =
        || found.keys().find(|name| !wanted.contains_key(*name)).map(|name| format!("{name} is too much"));
    let other = || {
        found
            .iter()
            .find(|(name, sha256)| wanted[*name] != **sha256)
            .map(|(name, _)| format!("{name} differs"))
    };
    missing.or_else(more).or_else(other)
}

/// A copy of a folder.
pub fn copy(from: &Path, to: &Path) {
    let copied = std::process::Command::new("cp").arg("-r").arg(from).arg(to).status().expect("cp runs");
    assert!(copied.success());
}
