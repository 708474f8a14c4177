//! The folder of an imported data set: what a repeated import keeps of it, and what it may replace.

use std::path::Path;

use fs_err as fs;

use super::ImportError;
use crate::episode::folder::{EPISODES, clear_episodes, first_difference, remove_unfinished, whole_ones};
use crate::episode::{EpisodeEntry, Manifest};
use crate::files::{holds_anything, is_file, sha256_hex, write_atomic};

/// The resolved config, written before anything else.
pub(super) const CONFIG_FILE: &str = "import.toml";

/// Prepares the folder; returns the manifest to begin with, which holds the whole episodes of earlier imports with this config.
///
/// # Errors
/// The folder holds something else, or what another config made, unless `force`.
pub(super) fn open(folder: &Path, config_toml: &str, force: bool) -> Result<Manifest, ImportError> {
    let mut manifest = Manifest::new(sha256_hex(config_toml.as_bytes()), 0, false);
    let config_path = folder.join(CONFIG_FILE);
    if is_file(&config_path)? {
        match find_whole_episodes(folder, config_toml, &manifest) {
            Ok(entries) => manifest.episodes = entries,
            Err(_) if force => clear_episodes(folder, CONFIG_FILE, &[])?,
            Err(error) => return Err(error),
        }
    } else if holds_anything(folder)? {
        return Err(ImportError::ForeignFolder { path: folder.to_owned() });
    }
    // The config first: by it a folder is known as ours.
    fs::create_dir_all(folder)?;
    write_atomic(&config_path, config_toml.as_bytes())?;
    fs::create_dir_all(folder.join(EPISODES))?;
    remove_unfinished(folder)?;
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
    if !is_file(&folder.join(Manifest::FILE))? {
        return Ok(Vec::new());
    }
    let found = Manifest::read(folder)?;
    if found.generator_version != wanted.generator_version {
        return other("version", found.generator_version, wanted.generator_version.clone());
    }
    // A store may have been left with the config of one call and the episodes of another.
    if found.config_sha256 != wanted.config_sha256 {
        return other("config", found.config_sha256, wanted.config_sha256.clone());
    }
    Ok(whole_ones(folder, found.episodes)?)
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
