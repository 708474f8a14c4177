//! `dataset.json` out of the episodes themselves: what it says of each stands in the episode, but for the split, which `gen`
//! plans by its config.

use std::io;
use std::path::Path;

use rayon::prelude::*;

use super::folder::episode_files;
use super::maker::{ConfigFile, Maker, Plans};
use crate::episode::manifest::{EpisodeEntry, ManifestError, ObjectCounts};
use crate::episode::{EpisodeError, EpisodeMeta, EpisodeReader, Manifest, Split, check_archive};
use crate::store;

/// Episodes are looked for among so many times those that are there: of a shard, the rest of the plan lies elsewhere.
const PLANNED_TIMES: usize = 16;
const PLANNED_LEAST: usize = 1_000;

/// A manifest that was made anew.
pub(super) struct Rebuilt {
    pub manifest: Manifest,
    /// Why it is no more than a guess, in words.
    pub doubt: Option<&'static str>,
}

/// Whether a manifest that cannot be read is one of a data set that lies here, and was not written by a later version.
pub(super) fn is_of_a_set(path: &Path, error: &ManifestError) -> bool {
    let is_broken = match error {
        ManifestError::NotADataset { .. } => matches!(ConfigFile::find(path), Ok(Some(_))),
        ManifestError::Parse { .. } | ManifestError::Inconsistent { .. } => true,
        // A changed bit may make the text none.
        ManifestError::Io(error) => error.kind() == io::ErrorKind::InvalidData,
        _ => false,
    };
    is_broken && path.join(crate::episode::folder::EPISODES).is_dir()
}

/// How many episodes of a plan to look at for a folder with so many files.
pub(super) fn n_planned(n_files: usize) -> u32 {
    u32::try_from(n_files * PLANNED_TIMES + PLANNED_LEAST).unwrap_or(u32::MAX)
}

/// Makes the manifest anew; what is torn, or of another config, is left out.
///
/// # Errors
/// The folder cannot be read.
pub(super) fn rebuild(path: &Path) -> io::Result<Rebuilt> {
    let config = ConfigFile::find(path)?;
    let sha256 = config.as_ref().map_or_else(|| "0".repeat(64), |config| config.sha256.clone());
    let maker = Maker::of(config.as_ref(), &sha256);
    let files = episode_files(path)?;
    let plans = maker.plans(n_planned(files.len()));
    let mut made: Vec<(EpisodeEntry, EpisodeMeta)> =
        files.par_iter().filter_map(|file| entry_of(path, file, &maker, &plans)).collect();
    let place = |entry: &EpisodeEntry| plans.get(&entry.name).map_or(usize::MAX, |(place, _)| *place);
    made.sort_by_key(|(entry, _)| place(entry));
    let is_ood = made.iter().any(|(entry, _)| entry.ood);
    let (seed, ood) = maker.gen_config().map_or((0, is_ood), |config| (config.seed, config.scene.ood));
    let mut manifest = Manifest::new(sha256, seed, ood);
    if let Some((_, meta)) = made.first() {
        manifest.generator_version.clone_from(&meta.generator_version);
    }
    manifest.episodes = made.into_iter().map(|(entry, _)| entry).collect();
    let is_by_others = |file: &String| {
        EpisodeReader::open(&path.join(file)).is_ok_and(|reader| !maker.has_made(reader.meta()))
    };
    let is_of_others = manifest.episodes.is_empty() && files.iter().any(is_by_others);
    let doubt = match maker {
        _ if is_of_others => Some("the episodes that lie here are not of the config beside them"),
        Maker::Gen { .. } => None,
        Maker::Import { .. } => Some("the splits of imported drives stand in dataset.json alone"),
        Maker::Unknown => Some("there is no config of `gen` by which splits are planned"),
    };
    Ok(Rebuilt { manifest, doubt })
}

/// The entry of an episode's file, if it is whole and of this maker, and its metadata.
pub(super) fn entry_of(
    path: &Path,
    file: &str,
    maker: &Maker,
    plans: &Plans,
) -> Option<(EpisodeEntry, EpisodeMeta)> {
    let of_file = path.join(file);
    let read = check_archive(&of_file).and_then(|_| EpisodeReader::open(&of_file)).and_then(|reader| {
        let counts = count(&reader)?;
        Ok((reader, counts))
    });
    let (reader, n_objects) = read.ok()?;
    let meta = reader.meta();
    let is_named = of_file.file_stem().is_some_and(|stem| stem.to_string_lossy() == meta.name.as_str());
    let split = match maker {
        Maker::Gen { .. } => plans.get(&meta.name).map(|(_, split)| *split)?,
        // As an import has it where nobody says another.
        Maker::Import { .. } | Maker::Unknown => Split::Test,
    };
    let entry = EpisodeEntry {
        name: meta.name.clone(),
        file: file.to_owned(),
        split,
        seed: meta.seed,
        town: meta.town.clone(),
        weather: meta.weather.clone(),
        ood: meta.ood,
        n_samples: reader.len(),
        n_objects,
        sha256: store::sha256_of(&of_file).ok()?,
    };
    (is_named && maker.has_made(meta)).then(|| (entry, meta.clone()))
}

/// An episode's boxes, all of whose samples are read.
///
/// # Errors
/// A sample cannot be read.
pub(super) fn count(reader: &EpisodeReader) -> Result<ObjectCounts, EpisodeError> {
    let mut counts = ObjectCounts::default();
    for sample_idx in 0..reader.len() {
        for object in reader.whole_sample(sample_idx)?.objects() {
            if let Some(count) = counts.of_mut(object) {
                *count += 1;
            }
        }
    }
    Ok(counts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::health::made;
    use fs_err as fs;

    #[test]
    fn a_manifest_of_planned_episodes_is_made_again_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let wanted = made::write(folder.path(), 3);
        fs::remove_file(folder.path().join(Manifest::FILE)).unwrap();
        assert!(is_of_a_set(folder.path(), &Manifest::read(folder.path()).unwrap_err()));
        let rebuilt = rebuild(folder.path()).unwrap();
        assert_eq!((rebuilt.manifest, rebuilt.doubt), (wanted, None));
    }

    #[test]
    fn without_a_config_it_is_a_guess_and_what_is_torn_or_renamed_is_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let wanted = made::write(folder.path(), 3);
        let file = |i: usize| folder.path().join(&wanted.episodes[i].file);
        fs::write(file(0), "torn").unwrap();
        fs::rename(file(1), file(1).with_file_name("other.mcap")).unwrap();
        let rebuilt = rebuild(folder.path()).unwrap();
        assert_eq!(rebuilt.manifest.episodes, wanted.episodes[2..]);
        fs::remove_file(folder.path().join("gen.toml")).unwrap();
        assert!(rebuild(folder.path()).unwrap().doubt.is_some());
        fs::remove_file(folder.path().join(Manifest::FILE)).unwrap();
        assert!(!is_of_a_set(folder.path(), &Manifest::read(folder.path()).unwrap_err()));
    }
}
