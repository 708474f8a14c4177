//! The folder of an imported data set: what a repeated import keeps of it, and what it may replace.

use std::path::Path;

use fs_err as fs;

use super::ImportError;
use crate::episode::{EpisodeEntry, Manifest};
use crate::files::{PARTIAL_SUFFIX, sha256_hex, write_atomic};

/// The resolved config, written before anything else.
pub(super) const CONFIG_FILE: &str = "import.toml";
pub(super) const EPISODES: &str = "episodes";

/// Prepares the folder; returns the manifest to begin with, which holds the whole episodes of earlier imports with this config.
///
/// # Errors
/// The folder holds something else, or what another config made, unless `force`.
pub(super) fn open(folder: &Path, config_toml: &str, force: bool) -> Result<Manifest, ImportError> {
    let mut manifest = Manifest::new(sha256_hex(config_toml.as_bytes()), 0, false);
    let config_path = folder.join(CONFIG_FILE);
    if config_path.is_file() {
        match find_whole_episodes(folder, config_toml, &manifest) {
            Ok(entries) => manifest.episodes = entries,
            Err(_) if force => clear(folder)?,
            Err(error) => return Err(error),
        }
    } else if folder.is_dir() && fs::read_dir(folder)?.next().is_some() {
        return Err(ImportError::ForeignFolder { path: folder.to_owned() });
    }
    fs::create_dir_all(folder.join(EPISODES))?;
    remove_files(folder, |name| name.ends_with(&format!(".{PARTIAL_SUFFIX}")))?;
    write_atomic(&config_path, config_toml.as_bytes())?;
    manifest.ood = manifest.episodes.iter().any(|entry| entry.ood);
    manifest.write(folder)?;
    Ok(manifest)
}

/// The entries of earlier imports whose files are as they were written.
fn find_whole_episodes(
    folder: &Path,
    config_toml: &str,
    wanted: &Manifest,
) -> Result<Vec<EpisodeEntry>, ImportError> {
    let other = |what, found: String, wanted: String| {
        Err(ImportError::OtherData { what, found, wanted, path: folder.to_owned() })
    };
    let found_toml = fs::read_to_string(folder.join(CONFIG_FILE))?;
    if let Some((found, wanted)) = first_difference(&found_toml, config_toml) {
        return other("config", found, wanted);
    }
    if !folder.join(Manifest::FILE).is_file() {
        return Ok(Vec::new());
    }
    let found = Manifest::read(folder)?;
    if found.generator_version != wanted.generator_version {
        return other("version", found.generator_version, wanted.generator_version.clone());
    }
    let is_whole = |entry: &EpisodeEntry| {
        fs::read(folder.join(&entry.file)).is_ok_and(|bytes| sha256_hex(&bytes) == entry.sha256)
    };
    Ok(found.episodes.into_iter().filter(is_whole).collect())
}

fn first_difference(found: &str, wanted: &str) -> Option<(String, String)> {
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

/// Deletes what an earlier import made, and only that.
fn clear(folder: &Path) -> Result<(), ImportError> {
    // The manifest first: without it, a half-cleared folder is an empty data set and not a broken one.
    for name in [Manifest::FILE, CONFIG_FILE] {
        let path = folder.join(name);
        if path.is_file() {
            fs::remove_file(path)?;
        }
    }
    remove_files(folder, |name| Path::new(name).extension().is_some_and(|suffix| suffix == "mcap"))
}

fn remove_files(folder: &Path, is_ours: impl Fn(&str) -> bool) -> Result<(), ImportError> {
    let episodes = folder.join(EPISODES);
    if !episodes.is_dir() {
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
    use super::*;

    #[test]
    fn a_folder_with_foreign_files_is_refused_and_another_config_needs_force() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("thesis.doc"), "x").unwrap();
        assert!(matches!(open(folder.path(), "", true), Err(ImportError::ForeignFolder { .. })));
        let folder = tempfile::tempdir().unwrap();
        open(folder.path(), "every = 1\n", false).unwrap();
        let episode = folder.path().join("episodes/a.mcap");
        fs::write(&episode, "x").unwrap();
        let told = open(folder.path(), "every = 2\n", false).unwrap_err().to_string();
        assert!(told.contains("every = 1") && told.contains("--force"), "{told}");
        assert!(episode.is_file());
        open(folder.path(), "every = 2\n", true).unwrap();
        assert!(!episode.is_file());
    }
}
