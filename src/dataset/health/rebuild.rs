//! `dataset.json` out of the episodes themselves: what it says of each stands in the episode, but for the split, which `gen`
//! plans by its config.

use std::io;
use std::path::Path;

use rayon::prelude::*;

use super::folder::episode_files;
use super::maker::{ConfigFile, Maker, Plans};
use crate::episode::manifest::{EpisodeEntry, ManifestError, ObjectCounts};
use crate::episode::{
    EpisodeError, EpisodeMeta, EpisodeReader, MAX_EPISODES, Manifest, Split, check_archive,
};
use crate::store;

/// Episodes are looked for among so many times those that are there, at first.
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

/// The plan of the episodes of these names, as far as it has them: of a shard's plan most lie elsewhere, so it is followed as long
/// as it leads to more of them.
pub(super) fn plans_for(maker: &Maker, names: &[String]) -> Plans {
    let n_first = u32::try_from(names.len() * PLANNED_TIMES + PLANNED_LEAST).unwrap_or(u32::MAX);
    let mut n_planned = n_first.min(MAX_EPISODES);
    let mut plans = maker.plans(n_planned);
    let count = |plans: &Plans| names.iter().filter(|name| plans.contains_key(*name)).count();
    let mut n_found = count(&plans);
    while n_found > 0 && n_found < names.len() && n_planned < MAX_EPISODES {
        n_planned = n_planned.saturating_mul(2).min(MAX_EPISODES);
        let longer = maker.plans(n_planned);
        let n_now = count(&longer);
        if n_now == n_found {
            break;
        }
        (plans, n_found) = (longer, n_now);
    }
    plans
}

/// The names that episodes have by their files.
pub(super) fn names_of(files: &[String]) -> Vec<String> {
    let stem = |file: &String| Path::new(file).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    files.iter().map(stem).collect()
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
    let plans = plans_for(&maker, &names_of(&files));
    let made: Vec<Option<(EpisodeEntry, EpisodeMeta)>> =
        files.par_iter().map(|file| entry_of(path, file, &maker, &plans)).collect::<io::Result<_>>()?;
    let mut made: Vec<(EpisodeEntry, EpisodeMeta)> = made.into_iter().flatten().collect();
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
///
/// # Errors
/// The disk does not answer: whether it is whole, nobody can tell.
pub(super) fn entry_of(
    path: &Path,
    file: &str,
    maker: &Maker,
    plans: &Plans,
) -> io::Result<Option<(EpisodeEntry, EpisodeMeta)>> {
    let of_file = path.join(file);
    let read = check_archive(&of_file).and_then(|_| EpisodeReader::open(&of_file)).and_then(|reader| {
        let counts = count(&reader)?;
        Ok((reader, counts))
    });
    let (reader, n_objects) = match read {
        Ok(read) => read,
        Err(error) if error.is_of_system() => return Err(io::Error::other(error)),
        Err(_) => return Ok(None),
    };
    let meta = reader.meta();
    let is_named = of_file.file_stem().is_some_and(|stem| stem.to_string_lossy() == meta.name.as_str());
    let split = match maker {
        Maker::Gen { .. } => match plans.get(&meta.name) {
            Some((_, split)) => *split,
            None => return Ok(None),
        },
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
        sha256: store::sha256_of(&of_file)?,
    };
    Ok((is_named && maker.has_made(meta)).then(|| (entry, meta.clone())))
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
    fn the_plan_is_followed_as_far_as_a_shard_goes() {
        let folder = tempfile::tempdir().unwrap();
        let manifest = made::write(folder.path(), 1);
        let config = ConfigFile::find(folder.path()).unwrap();
        let maker = Maker::of(config.as_ref(), &manifest.config_sha256);
        let all = maker.plans(20_000);
        let shard = all.iter().filter(|(_, (place, _))| place % 100 == 7).map(|(name, _)| name.clone());
        let mut names: Vec<String> = shard.collect();
        assert!(names.iter().all(|name| plans_for(&maker, &names).contains_key(name)));
        // One that nobody planned does not keep it going.
        names.push("somebody-elses".into());
        assert!(plans_for(&maker, &names).len() < 1_000_000);
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
