//! What lies in a data set's folder beside what its manifest names: unfinished and unknown files, and files that are missing.

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};

use fs_err as fs;

use super::check::{Aspect, Found, Remark};
use crate::episode::Manifest;
use crate::episode::folder::{AOV, EPISODES};
use crate::files::{PARTIAL_SUFFIX, is_dir, is_lock, is_unfinished};
use crate::generate::lacking_pictures;

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

/// What runs left unfinished: files, and folders of further pictures.
///
/// # Errors
/// A folder cannot be read.
pub(super) fn unfinished(path: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for folder in written(path)? {
        found.extend(listed(&folder)?.into_iter().filter(|path| is_unfinished(path) && !path.is_dir()));
    }
    let of_pictures = path.join(AOV);
    if is_dir(&of_pictures)? && !of_pictures.is_symlink() {
        let is_half =
            |path: &PathBuf| has_suffix(path, PARTIAL_SUFFIX) && path.is_dir() && !path.is_symlink();
        found.extend(listed(&of_pictures)?.into_iter().filter(is_half));
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

/// Tells which episodes lack further pictures (`render.aov`) of one of so many cameras. They have no hash, so that they are counted.
///
/// # Errors
/// A folder cannot be read.
pub(super) fn examine_pictures(
    path: &Path,
    manifest: &Manifest,
    n_cameras: usize,
    found: &mut Found,
) -> io::Result<()> {
    for entry in &manifest.episodes {
        if let Some(lack) = lacking_pictures(path, entry, n_cameras)? {
            let text = format!(
                "{lack} (render.aov); `harmzone gen`, the same command again, makes the episode with them: {}",
                path.join(AOV).join(&entry.name).display()
            );
            found.add(&entry.name, Remark::fault(Aspect::Files, "missing pictures", text));
        }
    }
    Ok(())
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

    #[test]
    fn an_episode_without_all_its_further_pictures_is_told_with_what_it_lacks() {
        let folder = tempfile::tempdir().unwrap();
        test_data::write(folder.path(), &[2, 1]);
        let manifest = Manifest::read(folder.path()).unwrap();
        let told = || {
            let mut found = Found::default();
            examine_pictures(folder.path(), &manifest, 2, &mut found).unwrap();
            let (_, symptoms) = found.finish(|_| String::new());
            symptoms.into_iter().map(|of| (of.first_at, of.n_places, of.text)).collect::<Vec<_>>()
        };
        assert_eq!(told()[0].1, 2);
        for name in ["made-0/000000.exr", "made-0/000001.exr", "made-0/cam_back/000000.exr"]
            .into_iter()
            .chain(["made-0/objects.json", "made-1/000000.exr", "made-1/cam_back/000000.exr"])
        {
            let file = folder.path().join(AOV).join(name);
            fs::create_dir_all(file.parent().unwrap()).unwrap();
            fs::write(file, "").unwrap();
        }
        let (first_at, n_places, text) = &told()[0];
        assert_eq!((first_at.as_str(), *n_places), ("made-0", 2));
        assert!(text.starts_with("3 of 4 further pictures are there"), "{text}");
        fs::write(folder.path().join("aov/made-0/cam_back/000001.exr"), "").unwrap();
        let (first_at, n_places, text) = &told()[0];
        assert_eq!((first_at.as_str(), *n_places), ("made-1", 1));
        assert!(text.starts_with("objects.json of the further pictures is missing"), "{text}");
        fs::write(folder.path().join("aov/made-1/objects.json"), "").unwrap();
        assert!(told().is_empty());
    }
}
