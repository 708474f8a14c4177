//! The folder of a data set that is being made: what a repeated run may keep of it, and what it may delete.

use std::collections::BTreeSet;
use std::io;
use std::path::Path;

use fs_err as fs;
use rayon::prelude::*;

use super::manifest::{EpisodeEntry, Manifest};
use crate::files;
use crate::store;

/// Where a data set's episodes lie.
pub const EPISODES: &str = "episodes";

/// Where further pictures of the episodes lie, in a folder of each one's name.
pub const AOV: &str = "aov";

/// Whether an episode's file is as it was written.
///
/// # Errors
/// It cannot be read, or the store that it lies in does not answer.
pub fn is_whole(folder: &Path, entry: &EpisodeEntry) -> io::Result<bool> {
    store::has(&folder.join(&entry.file), &entry.sha256)
}

/// The entries whose files are as they were written.
///
/// # Errors
/// As [`is_whole`].
pub fn whole_ones(folder: &Path, entries: Vec<EpisodeEntry>) -> io::Result<Vec<EpisodeEntry>> {
    let are_whole =
        entries.par_iter().map(|entry| is_whole(folder, entry)).collect::<io::Result<Vec<bool>>>()?;
    Ok(entries.into_iter().zip(are_whole).filter_map(|(entry, is_whole)| is_whole.then_some(entry)).collect())
}

/// The first line in which two texts differ, of each.
#[must_use]
pub fn first_difference(found: &str, wanted: &str) -> Option<(String, String)> {
    if found == wanted {
        return None;
    }
    let missing = "nothing";
    let (mut found, mut wanted) = (found.lines(), wanted.lines());
    loop {
        match (found.next(), wanted.next()) {
            (Some(a), Some(b)) if a == b => {}
            (a, b) => return Some((a.unwrap_or(missing).to_owned(), b.unwrap_or(missing).to_owned())),
        }
    }
}

/// Deletes what an earlier run made, with its config of this name and its further `folders`, and only that.
///
/// # Errors
/// A file cannot be deleted.
pub fn clear_episodes(folder: &Path, config_file: &str, folders: &[&str]) -> io::Result<()> {
    let remove = |name: &str| files::remove_if_there(&folder.join(name));
    // The manifest first: without it, a half-cleared folder is an empty data set and not a broken one.
    remove(Manifest::FILE)?;
    remove_files(folder, |name| Path::new(name).extension().is_some_and(|suffix| suffix == "mcap"))?;
    store::discard(&folder.join(EPISODES));
    for made in folders.iter().map(|name| folder.join(name)) {
        if files::is_dir(&made)? {
            fs::remove_dir_all(&made)?;
        }
        store::discard(&made);
    }
    // By it the folder is known as ours.
    remove(config_file)
}

/// Deletes episodes that a killed run left unfinished.
///
/// # Errors
/// A file cannot be deleted.
pub fn remove_unfinished(folder: &Path) -> io::Result<()> {
    let episodes = folder.join(EPISODES);
    if files::is_dir(&episodes)? {
        files::remove_unfinished(&episodes)?;
    }
    files::remove_unfinished_folders(&folder.join(AOV))?;
    files::remove_unfinished(folder)
}

/// Deletes whole files of the planned episodes that the manifest does not list: a worker that was ended between its last write and
/// its answer leaves one, and the same command makes it again.
///
/// # Errors
/// A file cannot be deleted.
pub fn remove_unlisted(folder: &Path, planned: &BTreeSet<&str>, manifest: &Manifest) -> io::Result<()> {
    let listed: BTreeSet<&str> = manifest.episodes.iter().map(|entry| entry.name.as_str()).collect();
    remove_files(folder, |name| {
        name.strip_suffix(".mcap").is_some_and(|name| planned.contains(name) && !listed.contains(name))
    })
}

fn remove_files(folder: &Path, is_ours: impl Fn(&str) -> bool) -> io::Result<()> {
    let episodes = folder.join(EPISODES);
    if !files::is_dir(&episodes)? {
        return Ok(());
    }
    for entry in fs::read_dir(episodes)? {
        let entry = entry?;
        if entry.file_name().to_str().is_some_and(&is_ours) {
            fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::manifest_tests::entry;
    use super::*;

    #[test]
    fn what_the_manifest_lacks_of_the_plan_goes_and_all_else_stays() {
        let home = tempfile::tempdir().unwrap();
        let episodes = home.path().join(EPISODES);
        fs::create_dir(&episodes).unwrap();
        for name in ["listed.mcap", "unlisted.mcap", "unlisted.txt", "mine.mcap"] {
            fs::write(episodes.join(name), name).unwrap();
        }
        let mut manifest = Manifest::new("c0ffee".into(), 7, false);
        manifest.episodes.push(entry("listed"));
        let planned = ["listed", "unlisted", "not made yet"].into();
        remove_unlisted(home.path(), &planned, &manifest).unwrap();
        let mut left: Vec<_> =
            fs::read_dir(&episodes).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        left.sort();
        assert_eq!(left, ["listed.mcap", "mine.mcap", "unlisted.txt"]);
    }
}
