//! The data set's folder: what a repeated run keeps of it, and what it may replace.

use std::collections::BTreeSet;
use std::path::Path;

use fs_err as fs;

use super::aov::find_whole;
use super::{EpisodePlan, GenerateConfig, GenerateError};
use crate::episode::folder::{
    AOV, EPISODES, clear_episodes, first_difference, remove_unfinished, whole_ones,
};
use crate::episode::{EpisodeEntry, Manifest, PartOf};
use crate::files::{holds_anything, is_file, sha256_hex, write_atomic};
use crate::scene::clear_own_models;
use crate::store;

/// The resolved config, written before anything else.
pub(super) const CONFIG_FILE: &str = "gen.toml";

/// The folder of a user's own models.
pub(super) const OWN_MODELS: &str = "models";

/// Prepares the folder; returns the manifest to begin with, which holds the complete episodes.
pub(super) fn open(
    folder: &Path,
    config: &GenerateConfig,
    config_toml: &str,
    part: Option<PartOf>,
    plans: &[EpisodePlan],
    force: bool,
) -> Result<Manifest, GenerateError> {
    let sha256 = sha256_hex(config_toml.as_bytes());
    let mut manifest = Manifest { part, ..Manifest::new(sha256, config.seed, config.scene.ood) };
    let config_path = folder.join(CONFIG_FILE);
    if is_file(&config_path)? {
        match find_whole_episodes(folder, config_toml, &manifest, plans) {
            Ok(found) => {
                let mut episodes = Vec::new();
                for entry in found.episodes {
                    if has_pictures(folder, config, &entry)? {
                        episodes.push(entry);
                    }
                }
                manifest = Manifest { episodes, made_with: found.made_with, ..manifest }
            }
            Err(_) if force => {
                clear_episodes(folder, CONFIG_FILE, &[AOV])?;
                let models = folder.join(OWN_MODELS);
                clear_own_models(&models)?;
                store::discard(&models);
            }
            Err(error) => return Err(error),
        }
    } else if holds_anything(folder)? {
        return Err(GenerateError::ForeignFolder { path: folder.to_owned() });
    }
    // The config first: by it a folder is known as ours.
    fs::create_dir_all(folder)?;
    write_atomic(&config_path, config_toml.as_bytes())?;
    fs::create_dir_all(folder.join(EPISODES))?;
    remove_unfinished(folder)?;
    manifest.write(folder)?;
    Ok(manifest)
}

/// Whether an episode's further pictures are there, where the config wants them.
fn has_pictures(folder: &Path, config: &GenerateConfig, entry: &EpisodeEntry) -> Result<bool, GenerateError> {
    Ok(!config.render.aov || find_whole(folder, entry, config.rig.cameras.len())?.is_some())
}

/// The manifest of an earlier run of the same data set, with the episodes whose files are as they were written.
fn find_whole_episodes(
    folder: &Path,
    config_toml: &str,
    wanted: &Manifest,
    plans: &[EpisodePlan],
) -> Result<Manifest, GenerateError> {
    let other = |what, found: String, wanted: String| {
        Err(GenerateError::OtherData { what, found, wanted, path: folder.to_owned() })
    };
    let found_toml = fs::read_to_string(folder.join(CONFIG_FILE))?;
    if let Err(error) = found_toml.parse::<toml::Table>() {
        return other("config", format!("a broken {CONFIG_FILE}: {}", error.message()), "TOML".to_owned());
    }
    if let Some((found, wanted)) = first_difference(&found_toml, config_toml) {
        return other("config", found, wanted);
    }
    if !is_file(&folder.join(Manifest::FILE))? {
        return Ok(wanted.clone());
    }
    let found = Manifest::read(folder)?;
    if found.generator_version != wanted.generator_version {
        return other("version", found.generator_version, wanted.generator_version.clone());
    }
    // A store may have been left with the config of one call and the episodes of another.
    if found.config_sha256 != wanted.config_sha256 {
        return other("config", found.config_sha256, wanted.config_sha256.clone());
    }
    // A shard of other parts would keep episodes that are not of this one.
    if found.part != wanted.part {
        let part = |part: Option<PartOf>| {
            part.map_or_else(
                || "the whole".to_owned(),
                |part| format!("shard {} of {} episodes", part.shard, part.n_episodes),
            )
        };
        return other("part", part(found.part), part(wanted.part));
    }
    let planned: BTreeSet<&str> = plans.iter().map(|plan| plan.name.as_str()).collect();
    if found.episodes.iter().any(|entry| !planned.contains(entry.name.as_str())) {
        let n = |count: usize| format!("{count} episodes");
        return other("size", n(found.episodes.len()), n(plans.len()));
    }
    let episodes = whole_ones(folder, found.episodes)?;
    let made_with = if episodes.is_empty() { Vec::new() } else { found.made_with };
    Ok(Manifest { made_with, episodes, ..wanted.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open_with(folder: &Path, toml: &str, force: bool) -> Result<Manifest, GenerateError> {
        open(folder, &GenerateConfig::default(), toml, None, &[], force)
    }

    #[test]
    fn a_folder_with_foreign_files_is_refused_even_by_force() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("thesis.doc"), "x").unwrap();
        for force in [false, true] {
            let error = open_with(folder.path(), "seed = 0\n", force).unwrap_err();
            assert!(matches!(error, GenerateError::ForeignFolder { .. }), "{error}");
        }
    }

    #[test]
    fn another_config_needs_force_which_leaves_foreign_files_alone() {
        let folder = tempfile::tempdir().unwrap();
        open_with(folder.path(), "seed = 0\n", false).unwrap();
        let episode = folder.path().join("episodes/a.mcap");
        let note = folder.path().join("notes.txt");
        let models = folder.path().join(OWN_MODELS);
        let own = ["own_a/model.xml", "a/model.xml", "a.obj"].map(|file| models.join(file));
        for file in own.iter().chain([&episode, &note]) {
            fs::create_dir_all(file.parent().unwrap()).unwrap();
            fs::write(file, "x").unwrap();
        }
        let error = open_with(folder.path(), "seed = 1\n", false).unwrap_err().to_string();
        assert!(error.contains("seed = 0") && error.contains("--force"), "{error}");
        assert!(episode.is_file());
        open_with(folder.path(), "seed = 1\n", true).unwrap();
        assert!(!episode.is_file() && note.is_file());
        // Of the models those that `--models` made.
        assert_eq!(own.map(|file| file.is_file()), [false, true, true]);
    }

    #[test]
    fn partial_files_of_a_killed_run_are_swept_up() {
        let folder = tempfile::tempdir().unwrap();
        open_with(folder.path(), "seed = 0\n", false).unwrap();
        let partial = folder.path().join("episodes/a.mcap.partial");
        fs::write(&partial, "x").unwrap();
        open_with(folder.path(), "seed = 0\n", false).unwrap();
        assert!(!partial.exists());
    }
}
