//! What lies in a data set's folder beside what its manifest names: unfinished and unknown files, and files that are missing.

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};

use fs_err as fs;

use super::check::{Aspect, Found, Remark};
use crate::episode::Manifest;
use crate::episode::folder::EPISODES;
use crate::files::{is_lock, is_unfinished};

fn has_suffix(path: &Path, wanted: &str) -> bool {
    path.extension().is_some_and(|suffix| suffix == wanted)
}

/// What lies in a folder, sorted; nothing where there is none.
///
/// # Errors
/// It cannot be read.
pub(super) fn listed(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries?,
    };
    let mut paths =
        entries.map(|entry| entry.map(|entry| entry.path())).collect::<io::Result<Vec<PathBuf>>>()?;
    paths.sort();
    Ok(paths)
}

/// The folders of a data set's label sets by their names, sorted.
///
/// # Errors
/// The folder of labels cannot be read.
pub(super) fn label_folders(path: &Path) -> io::Result<Vec<(String, PathBuf)>> {
    let folders = listed(&path.join("labels"))?.into_iter().filter(|path| path.is_dir());
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok(folders.map(|path| (name(&path), path)).collect())
}

/// The folders in which stages write: the data set's own, that of the episodes, and those of the label sets.
///
/// # Errors
/// One cannot be read.
pub(super) fn written(path: &Path) -> io::Result<Vec<PathBuf>> {
    let of_labels = label_folders(path)?.into_iter().map(|(_, folder)| folder);
    Ok([path.to_owned(), path.join(EPISODES)].into_iter().chain(of_labels).collect())
}

/// What runs left unfinished.
///
/// # Errors
/// A folder cannot be read.
pub(super) fn unfinished(path: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for folder in written(path)? {
        found.extend(listed(&folder)?.into_iter().filter(|path| is_unfinished(path) && !path.is_dir()));
    }
    Ok(found)
}

/// The files in the folder of episodes whose names end so, from the data set's folder, with `/`.
///
/// # Errors
/// The folder cannot be read.
pub(super) fn episode_files(path: &Path) -> io::Result<Vec<String>> {
    let paths = listed(&path.join(EPISODES))?;
    Ok(paths.iter().filter(|path| has_suffix(path, "mcap")).map(|path| from_folder(path)).collect())
}

fn from_folder(path: &Path) -> String {
    format!("{EPISODES}/{}", path.file_name().unwrap_or_default().to_string_lossy())
}

/// Episode files that the manifest does not name.
///
/// # Errors
/// The folder cannot be read.
pub(super) fn unknown_episodes(path: &Path, manifest: &Manifest) -> io::Result<Vec<String>> {
    let known: BTreeSet<&str> = manifest.episodes.iter().map(|entry| entry.file.as_str()).collect();
    Ok(episode_files(path)?.into_iter().filter(|file| !known.contains(file.as_str())).collect())
}

/// Tells what the manifest does not name. Files that are missing are found where they are opened.
///
/// # Errors
/// A folder cannot be read.
pub(super) fn examine(path: &Path, manifest: &Manifest, found: &mut Found) -> io::Result<String> {
    let unfinished = unfinished(path)?;
    for leftover in &unfinished {
        let text = format!(
            "a run that ended early left this, or one is writing it now; the next run or `--fix` deletes it: {}",
            leftover.display()
        );
        let at = leftover.file_name().unwrap_or_default().to_string_lossy();
        found.add(&at, Remark::warning(Aspect::Files, "unfinished", text));
    }
    let unknown = unknown_episodes(path, manifest)?;
    for file in &unknown {
        let text = format!(
            "dataset.json does not name this file, so that no stage reads it; the same command that made the data set, or \
             `--fix`, enters it or sets it aside: {}",
            path.join(file).display()
        );
        found.add(file, Remark::fault(Aspect::Files, "unknown episode", text));
    }
    let is_other = |path: &&PathBuf| !has_suffix(path, "mcap") && !is_unfinished(path) && !is_lock(path);
    for other in listed(&path.join(EPISODES))?.iter().filter(is_other) {
        let text = format!("only episodes belong here; nothing reads this: {}", other.display());
        found.add(&from_folder(other), Remark::warning(Aspect::Files, "other file", text));
    }
    let n_listed = manifest.episodes.len();
    Ok(format!("{n_listed} episodes named, {} unknown, {} unfinished", unknown.len(), unfinished.len()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;

    #[test]
    fn leftovers_strangers_and_unknown_episodes_are_told_apart_from_locks() {
        let folder = tempfile::tempdir().unwrap();
        test_data::write(folder.path(), &[1]);
        let manifest = Manifest::read(folder.path()).unwrap();
        let told = |found: Found| {
            let (_, symptoms) = found.finish(|_| String::new());
            symptoms.into_iter().map(|symptom| symptom.first_at).collect::<Vec<_>>()
        };
        let mut found = Found::default();
        examine(folder.path(), &manifest, &mut found).unwrap();
        assert_eq!(told(found), [""; 0]);
        let files = [
            "writer.partial",
            "episodes/a.mcap.7.partial",
            "labels/rect/b.mcap.partial",
            "episodes/x.mcap",
            "episodes/notes.txt",
        ];
        for file in files {
            fs::write(folder.path().join(file), "").unwrap();
        }
        let mut found = Found::default();
        let figures = examine(folder.path(), &manifest, &mut found).unwrap();
        assert_eq!(told(found), ["episodes/x.mcap", "a.mcap.7.partial", "episodes/notes.txt"]);
        assert_eq!(figures, "1 episodes named, 1 unknown, 2 unfinished");
    }
}
