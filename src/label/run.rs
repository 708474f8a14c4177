//! Labels a whole data set: one file per episode under `labels/<set>/`, and `labels.json` last.
//!
//! `labels.json` is written when every episode is done, so a set without it is unfinished. What is whole of it is noted beside
//! it meanwhile ([`parts`]), and the same command labels the rest.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Mutex;

use fs_err as fs;
use rayon::prelude::*;

use super::LabelError;
use super::counts::LabelSummary;
use super::episode::{LabelledEpisode, label_episode};
use super::parts::{self, LabelledSoFar};
use super::worker::{self, LabelJob, LabelWorkers};
use crate::config;
use crate::episode::manifest::{EpisodeEntry, LabelEntry, LabelManifest, Manifest};
use crate::episode::{Shard, is_any_annotated};
use crate::files::{FolderLock, PARTIAL_SUFFIX, is_file, remove_if_there, remove_unfinished};
use crate::interrupt;
use crate::progress::Progress;
use crate::store;
use crate::zone::{Zone, ZoneConfig};

/// How a data set is labelled; this does not change the labels.
#[derive(Debug, Clone, Copy, Default)]
pub struct LabelOptions<'a> {
    /// Whether a set of another zone or of other episodes may be replaced.
    pub force: bool,
    /// Only this part of the episodes: the set is whole when a run without it has joined all parts.
    pub shard: Option<Shard>,
    /// Who labels; `None`: this process.
    pub workers: Option<LabelWorkers<'a>>,
}

/// Labels every annotated object of a data set, in this process.
///
/// # Errors
/// As [`run_with`].
pub fn run(
    dataset: &Path,
    zone_config: &ZoneConfig,
    set: &str,
    force: bool,
    progress: &dyn Progress,
) -> Result<LabelSummary, LabelError> {
    run_with(dataset, zone_config, set, &LabelOptions { force, ..LabelOptions::default() }, progress)
}

/// Labels every annotated object of a data set, or of a part of its episodes.
///
/// A set that is complete and of the same zone is left as it is and its counts are returned. Parts that are there, and what an
/// earlier run has left of the same set, are joined: only what they lack is labelled. Where workers were lost, the set is left
/// unfinished, and the summary says of which episodes. A shard of a data set that has no episode has nothing to label.
///
/// # Errors
/// [`LabelError`]; a set of another zone or of other episodes is kept unless `options.force`. Of several broken episodes the first
/// one is told, and what is whole is kept.
pub fn run_with(
    dataset: &Path,
    zone_config: &ZoneConfig,
    set: &str,
    options: &LabelOptions<'_>,
    progress: &dyn Progress,
) -> Result<LabelSummary, LabelError> {
    let is_word = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    if set.is_empty() || !set.chars().all(is_word) {
        return Err(LabelError::SetName { found: set.to_owned() });
    }
    let zone = Zone::try_from(zone_config.clone())?;
    let zone_toml = config::to_toml(zone_config);
    let manifest = Manifest::read(dataset)?;
    if manifest.episodes.is_empty() {
        // Of more shards than episodes some have none.
        return match manifest.part {
            Some(_) => Ok(summary(&LabelManifest::new(set, zone_toml, &manifest), false)),
            None => Err(LabelError::NoEpisodes { path: dataset.to_owned() }),
        };
    }
    let folder = LabelManifest::folder(dataset, set);
    if !options.force
        && is_file(&folder.join(LabelManifest::FILE))?
        && let Some(done) = finished(LabelManifest::read(dataset, set)?, &manifest, zone_config, &folder)?
    {
        // One that was killed after its last file may have left them.
        parts::remove_all(&folder)?;
        FolderLock::tidy(&folder);
        return Ok(summary(&done, true));
    }
    // Episodes without truth beside others get the zone and no labels.
    if !is_any_annotated(dataset, &manifest)? {
        return Err(LabelError::NoTruth { path: dataset.to_owned() });
    }
    let lock = match options.shard {
        None => FolderLock::take(&folder)?,
        Some(Shard { index, of }) => {
            FolderLock::take_named(&folder, &format!("writer-{index}-of-{of}.{PARTIAL_SUFFIX}"))?
        }
    };
    if options.shard.is_none() {
        remove_unfinished(&folder)?;
    }
    // Until the new files are complete, the set must not look finished.
    remove_if_there(&folder.join(LabelManifest::FILE))?;
    let parts = match options.shard {
        _ if options.force => Vec::new(),
        Some(shard) => match parts::find(&folder, shard, &zone_toml, &manifest) {
            Some(done) => return Ok(summary(&done, true)),
            None => parts::find_so_far(&folder, shard, &zone_toml, &manifest).into_iter().collect(),
        },
        None => parts::find_all(&folder, &zone_toml, &manifest)?,
    };
    let labels = LabelManifest::new(set, zone_toml, &manifest);
    let so_far = LabelledSoFar::new(labels, parts, &folder, options.shard);
    let known: BTreeSet<String> = so_far.labels.episodes.iter().map(|entry| entry.name.clone()).collect();
    let is_wanted = |i: usize| options.shard.is_none_or(|shard| shard.holds(i as u32));
    let todo: Vec<&EpisodeEntry> = manifest
        .episodes
        .iter()
        .enumerate()
        .filter(|(i, entry)| is_wanted(*i) && !known.contains(&entry.name))
        .map(|(_, entry)| entry)
        .collect();
    progress.start("label", todo.iter().map(|entry| entry.n_samples as u64).sum());
    let zone_toml = so_far.labels.zone_toml.clone();
    let so_far = Mutex::new(so_far);
    let keep = |labelled: LabelledEpisode| {
        lock.check()?;
        so_far.lock().expect("no thread that labels panics").add(labelled)
    };
    let done = match &options.workers {
        None => {
            let label_one = |entry: &&EpisodeEntry| {
                interrupt::check()?;
                progress.note(&entry.name);
                keep(label_episode(dataset, entry, &zone, set, &zone_toml, &|| progress.advance(1))?)
            };
            // All are tried, so that of several broken episodes the first one is told.
            let tried: Vec<Result<(), LabelError>> = todo.par_iter().map(label_one).collect();
            tried.into_iter().collect::<Result<(), _>>().map(|()| Vec::new())
        }
        Some(workers) => {
            let job = LabelJob { folder: fs::canonicalize(dataset)?, set: set.to_owned(), zone_toml };
            worker::label_by(workers, &job, &todo, progress, &keep)
        }
    };
    let so_far = so_far.into_inner().expect("no thread that labels panics");
    lock.check()?;
    if !matches!(&done, Ok(lost) if lost.is_empty()) {
        // The first error is the one to tell.
        let noted = so_far.note();
        let lost = done?;
        noted?;
        progress.finish();
        return Ok(LabelSummary { lost, ..summary(&so_far.labels, false) });
    }
    let mut labels = so_far.labels;
    let mut of_name: BTreeMap<String, LabelEntry> =
        labels.episodes.drain(..).map(|entry| (entry.name.clone(), entry)).collect();
    labels.episodes = manifest.episodes.iter().filter_map(|entry| of_name.remove(&entry.name)).collect();
    if let Some(shard) = options.shard {
        parts::write(&folder, shard, &labels)?;
    } else {
        labels.write(dataset)?;
        parts::remove_all(&folder)?;
    }
    progress.finish();
    Ok(summary(&labels, false))
}

/// The set as it is if there is nothing to do; `None` if episodes are missing from it.
fn finished(
    labels: LabelManifest,
    manifest: &Manifest,
    zone_config: &ZoneConfig,
    folder: &Path,
) -> Result<Option<LabelManifest>, LabelError> {
    let other = |what| LabelError::Other { set: labels.set.clone(), what, path: folder.to_owned() };
    // Parsed, not compared as text: a set made before a key existed was made with its default.
    if toml::from_str::<ZoneConfig>(&labels.zone_toml).ok().as_ref() != Some(zone_config) {
        return Err(other("another zone"));
    }
    let hashes = manifest.hash_of_name();
    let is_known =
        |entry: &LabelEntry| hashes.get(entry.name.as_str()) == Some(&entry.episode_sha256.as_str());
    if !labels.episodes.iter().all(is_known) {
        return Err(other("other episodes"));
    }
    let mut are_files_there = true;
    for entry in &labels.episodes {
        are_files_there &= store::is_there(&folder.join(&entry.file))?;
    }
    let is_complete = are_files_there && labels.episodes.len() == manifest.episodes.len();
    Ok(is_complete.then_some(labels))
}

fn summary(labels: &LabelManifest, was_complete: bool) -> LabelSummary {
    LabelSummary {
        set: labels.set.clone(),
        was_complete,
        n_episodes: labels.episodes.len(),
        n_samples: labels.episodes.iter().map(|entry| entry.n_samples).sum(),
        lost: Vec::new(),
        counts: labels.counts,
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;
    use std::time::Duration;

    use super::*;
    use crate::dataset::test_data;
    use crate::episode::PartOf;
    use crate::progress::Silent;
    use crate::worker::{Engine, Program};
    use crate::zone::ZoneKind;

    const SET: &str = "again";

    /// A data set of three episodes, of which the second one was broken when it was labelled and is whole again.
    struct Stopped {
        home: tempfile::TempDir,
        /// What a run that nothing stopped leaves.
        unbroken: BTreeMap<PathBuf, Vec<u8>>,
    }

    impl Stopped {
        fn new() -> Self {
            let home = tempfile::tempdir().unwrap();
            test_data::write(home.path(), &[2, 3, 1]);
            let stopped = Self { home, unbroken: BTreeMap::new() };
            stopped.label(None).unwrap();
            let unbroken = stopped.files();
            fs::remove_dir_all(stopped.folder()).unwrap();
            let episode = stopped.home.path().join("episodes/made-1.mcap");
            let whole = fs::read(&episode).unwrap();
            fs::write(&episode, "torn").unwrap();
            let told = stopped.label(None).unwrap_err().to_string();
            assert!(told.contains("made-1.mcap"), "{told}");
            assert!(!stopped.folder().join(LabelManifest::FILE).exists());
            fs::write(&episode, whole).unwrap();
            Self { unbroken, ..stopped }
        }

        fn folder(&self) -> PathBuf {
            LabelManifest::folder(self.home.path(), SET)
        }

        fn label(&self, workers: Option<LabelWorkers<'_>>) -> Result<LabelSummary, LabelError> {
            let options = LabelOptions { workers, ..LabelOptions::default() };
            run_with(self.home.path(), &ZoneConfig::default(), SET, &options, &Silent)
        }

        /// What lies in the set's folder, without the lock.
        fn files(&self) -> BTreeMap<PathBuf, Vec<u8>> {
            let paths = fs::read_dir(self.folder()).unwrap().map(|entry| entry.unwrap().path());
            let paths = paths.filter(|path| path.extension().is_none_or(|suffix| suffix != PARTIAL_SUFFIX));
            paths.map(|path| (path.clone(), fs::read(path).unwrap())).collect()
        }

        /// Which episodes' labels were written since `before`.
        fn written_since(&self, before: std::time::SystemTime) -> Vec<usize> {
            let changed = |i: &usize| {
                let path = self.folder().join(format!("made-{i}.mcap"));
                path.is_file() && fs::metadata(path).unwrap().modified().unwrap() > before
            };
            (0..3).filter(changed).collect()
        }

        /// When the last of the files there was written, some time ago.
        fn last_write(&self) -> std::time::SystemTime {
            let times = self.files().into_keys().map(|path| fs::metadata(path).unwrap().modified().unwrap());
            let last = times.max().unwrap();
            std::thread::sleep(Duration::from_millis(50));
            last
        }
    }

    #[test]
    fn the_same_command_labels_what_is_missing_and_keeps_what_is_whole() {
        let stopped = Stopped::new();
        let before = stopped.last_write();
        let summary = stopped.label(None).unwrap();
        assert!(summary.n_episodes == 3 && summary.lost.is_empty() && !summary.was_complete);
        assert_eq!(stopped.written_since(before), [1]);
        assert_eq!(stopped.files(), stopped.unbroken);
    }

    #[test]
    fn what_a_whole_run_noted_beside_a_part_is_kept_too() {
        let stopped = Stopped::new();
        fs::remove_dir_all(stopped.folder()).unwrap();
        let episode = stopped.home.path().join("episodes/made-1.mcap");
        let whole = fs::read(&episode).unwrap();
        fs::write(&episode, "torn").unwrap();
        let shard: Shard = "0/3".parse().unwrap();
        let options = LabelOptions { shard: Some(shard), ..LabelOptions::default() };
        run_with(stopped.home.path(), &ZoneConfig::default(), SET, &options, &Silent).unwrap();
        stopped.label(None).unwrap_err();
        let before = stopped.last_write();
        stopped.label(None).unwrap_err();
        assert_eq!(stopped.written_since(before), Vec::<usize>::new());
        fs::write(&episode, whole).unwrap();
        stopped.label(None).unwrap();
        assert_eq!(stopped.written_since(before), [1]);
        assert_eq!(stopped.files(), stopped.unbroken);
    }

    #[test]
    fn a_part_of_a_data_set_that_has_grown_gets_the_labels_that_it_lacks() {
        let home = tempfile::tempdir().unwrap();
        test_data::write(home.path(), &[2, 3, 1]);
        let whole = Manifest::read(home.path()).unwrap();
        let options = LabelOptions { shard: Some("0/2".parse().unwrap()), ..LabelOptions::default() };
        let label = || run_with(home.path(), &ZoneConfig::default(), SET, &options, &Silent).unwrap();
        Manifest { episodes: whole.episodes[..2].to_vec(), ..whole.clone() }.write(home.path()).unwrap();
        assert_eq!((label().n_episodes, label().was_complete), (1, true));
        whole.write(home.path()).unwrap();
        let first = LabelManifest::folder(home.path(), SET).join("made-0.mcap");
        let written = || fs::metadata(&first).unwrap().modified().unwrap();
        let before = written();
        let grown = label();
        assert_eq!((grown.n_episodes, grown.n_samples, grown.was_complete), (2, 3, false));
        assert!(label().was_complete && written() == before, "what is there is kept");
    }

    #[test]
    fn a_shard_without_episodes_has_nothing_to_label_and_a_whole_set_without_is_an_error() {
        let home = tempfile::tempdir().unwrap();
        let label = || run(home.path(), &ZoneConfig::default(), SET, false, &Silent);
        let mut manifest = Manifest::new("0".repeat(64), 0, false);
        manifest.write(home.path()).unwrap();
        assert!(matches!(label(), Err(LabelError::NoEpisodes { .. })));
        manifest.part = Some(PartOf { shard: "2/3".parse().unwrap(), n_episodes: 2 });
        manifest.write(home.path()).unwrap();
        let told = label().unwrap().to_string();
        assert_eq!(told, "label set `again`: this part has no episode, so that nothing was labelled");
    }

    #[test]
    fn labels_that_changed_or_are_of_another_zone_are_made_anew() {
        let stopped = Stopped::new();
        let before = stopped.last_write();
        fs::write(stopped.folder().join("made-2.mcap"), "torn").unwrap();
        stopped.label(None).unwrap();
        assert_eq!(stopped.written_since(before), [0, 1, 2]);
        assert_eq!(stopped.files(), stopped.unbroken);

        let stopped = Stopped::new();
        let before = stopped.last_write();
        let other = ZoneConfig { kind: ZoneKind::Ttc, ..ZoneConfig::default() };
        run(stopped.home.path(), &other, SET, false, &Silent).unwrap();
        assert_eq!(stopped.written_since(before), [0, 1, 2]);
    }

    #[test]
    fn an_episode_that_kills_every_worker_is_left_out_and_the_next_call_labels_it() {
        let stopped = Stopped::new();
        let before = stopped.last_write();
        let dies = "import sys; sys.exit('no memory for the road')";
        let program = Program::new("python3".into(), vec!["-c".into(), dies.into()]);
        let engine = Engine::Local { jobs: 1 };
        let workers = LabelWorkers { engine: &engine, program: &program, silence: Duration::from_mins(1) };
        let summary = stopped.label(Some(workers)).unwrap();
        assert_eq!((summary.n_episodes, summary.lost.len()), (2, 1));
        let told = &summary.lost[0];
        let has = |words: &str| told.contains(words);
        assert!(has("made-1") && has("given up after 3 tries") && has("no memory for the road"), "{told}");
        assert!(!stopped.folder().join(LabelManifest::FILE).exists(), "the set is not whole");
        assert_eq!(stopped.label(None).unwrap().n_episodes, 3);
        assert_eq!(stopped.written_since(before), [1]);
        assert_eq!(stopped.files(), stopped.unbroken);
    }
}
