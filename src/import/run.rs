//! The pipeline that all formats share: drives to episodes, one sample in memory, continued where it stopped.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::{Path, PathBuf};

use fs_err as fs;
use serde::Serialize;

use super::config::CheckedImport;
use super::drive::{Task, import_drive};
use super::folder;
use super::samples::NearBoxes;
use super::{ImportConfig, ImportError, Log, LogFormat, Notes};
use crate::config::to_toml;
use crate::episode::manifest::ObjectCounts;
use crate::episode::{EpisodeEntry, EpisodeReader, LogFacts, Manifest, Split};
use crate::files::{self, FolderLock, check_room};
use crate::interrupt;
use crate::object::{Distribution, Kind};
use crate::progress::Progress;
use crate::store;

/// `dataset.json` is written anew when a fiftieth of its episodes are new: with each for small sets, while thousands do not write gigabytes.
const EPISODES_A_WRITE: usize = 50;
/// Of so many kept episodes the drives are opened to see whether they are of this log: bags may take minutes each.
const KEPT_DRIVES_CHECKED: usize = 3;

/// What of a log is imported, and what becomes of bad parts; the content of an episode does not depend on it.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportOptions {
    /// Names of the drives; empty for all.
    pub scenes: Vec<String>,
    pub split: Split,
    /// Whether a torn or missing file costs only its sample or drive.
    pub skip_bad: bool,
    /// Whether the episodes of another config, and drives of the same name of another log, may be deleted.
    pub force: bool,
}

/// The result of an import.
#[derive(Debug, Clone, Serialize)]
pub struct ImportSummary {
    pub folder: PathBuf,
    pub format: &'static str,
    pub n_episodes: usize,
    /// Episodes that were there already.
    pub n_kept: usize,
    pub n_samples: usize,
    pub n_objects: ObjectCounts,
    /// Whether any episode has annotations.
    pub is_labelled: bool,
    /// What was passed over with `--skip-bad`, one sentence each.
    pub skipped: Vec<String>,
    /// What was found and is not as it should be, one sentence each.
    pub notes: Vec<String>,
}

/// Imports drives of a log into `out`; whole episodes of an earlier import with this config are kept.
///
/// An import may be killed and repeated, and further drives may be added: `dataset.json` lists the whole episodes, of thousands all but the
/// last few, which are then made anew.
///
/// # Errors
/// [`ImportError`]: a bad config, a folder that holds something else, or the first part of the log that is not valid.
pub fn run(
    log: &dyn Log,
    format: LogFormat,
    config: &ImportConfig,
    out: &Path,
    options: &ImportOptions,
    progress: &dyn Progress,
) -> Result<ImportSummary, ImportError> {
    let checked = CheckedImport::try_from(config.clone())?;
    let drives = choose(log, &options.scenes)?;
    let config_toml = format!("format = \"{}\"\n{}{}", format.name(), to_toml(config), log.settings_toml());
    let lock = FolderLock::take(out)?;
    let mut list = List::new(folder::open(out, &config_toml, options.force)?, log, out);
    // A second writer to one URL is told now, and what another config has made there is gone before its names are taken.
    store::push(out)?;
    list.check_same_drives(log, &drives, options.force)?;
    if !options.skip_bad {
        list.find_incomplete(&drives)?;
    }
    let (n_kept, n_drives) = (list.keep(&drives, options.split), drives.len());
    let (mut told, mut skipped) = (Vec::new(), Vec::new());
    let mut known = BTreeSet::new();
    let mut boxes = NearBoxes::default();
    progress.start("import", drives.len() as u64);
    let (mut n_bytes, mut n_made, mut n_left) = (0, 0, (drives.len() - n_kept) as u64);
    let mut is_room_told = false;
    for drive in drives {
        if let Err(error) = interrupt::check() {
            list.write()?;
            return Err(error.into());
        }
        if !list.names.contains(&drive) {
            // Drives are of all lengths, so that this is no more than a warning.
            if n_made > 0
                && !is_room_told
                && let Err(error) = check_room(out, n_bytes / n_made * n_left)
            {
                tracing::warn!("if the drives to come are as long as those so far: {error}");
                is_room_told = true;
            }
            n_left = n_left.saturating_sub(1);
            let mut notes = Notes::default();
            let task = Task {
                log,
                format,
                config: &checked,
                config_toml: &config_toml,
                out,
                split: options.split,
                skip_bad: options.skip_bad,
                progress,
            };
            let made = import_drive(&task, &drive, &mut notes, &mut skipped, &mut boxes);
            for note in notes.take_new().into_iter().filter(|note| known.insert(note.clone())) {
                let note = format!("{drive}: {note}");
                tracing::warn!("{note}");
                told.push(note);
            }
            match made {
                Ok(Some(entry)) => {
                    lock.check()?;
                    n_bytes += fs::metadata(out.join(&entry.file)).map_or(0, |of| of.len());
                    n_made += 1;
                    list.add(entry)?;
                }
                Ok(None) => {}
                Err(error) if options.skip_bad && error.is_bad_data() => {
                    let sentence = format!("{drive} was left out: {error}");
                    tracing::warn!("{sentence}");
                    skipped.push(sentence);
                }
                Err(error) => {
                    list.write()?;
                    return Err(error);
                }
            }
        }
        progress.advance(1);
    }
    progress.finish();
    list.write()?;
    // Of an incomplete one, what is here stays.
    if n_kept == 0 && n_made == 0 && list.incomplete.is_empty() {
        return Err(ImportError::NoEpisodes { n_drives, n_skipped: skipped.len(), path: out.to_owned() });
    }
    // Drives of single frames have too few boxes to tell by themselves.
    if let Some(sentence) = boxes.doubt() {
        tracing::warn!("{sentence}");
        told.push(sentence);
    }
    Ok(summarise(&list.manifest, format, out, n_kept, skipped, told))
}

fn choose(log: &dyn Log, scenes: &[String]) -> Result<Vec<String>, ImportError> {
    let valid = log.drives().to_vec();
    let mut names: Vec<&String> = valid.iter().collect();
    names.sort_unstable();
    if let Some((name, _)) = names.iter().zip(names.iter().skip(1)).find(|(name, next)| name == next) {
        return Err(ImportError::TwoDrives { name: (*name).clone() });
    }
    if let Some(found) = scenes.iter().find(|scene| !valid.contains(scene)) {
        return Err(ImportError::NoDrive { found: found.clone(), valid });
    }
    Ok(valid.into_iter().filter(|drive| scenes.is_empty() || scenes.contains(drive)).collect())
}

/// Checks that each sample of an episode was taken when one of the log's drive of its name was, and that the first one's points are
/// the same: stamps may be made up.
fn check_same_drive(log: &dyn Log, entry: &EpisodeEntry, folder: &Path) -> Result<(), ImportError> {
    // A drive that cannot be opened any more has lost nothing of what is here.
    let Ok(drive) = log.open(&entry.name, &mut Notes::default()) else { return Ok(()) };
    let episode = EpisodeReader::open_known(folder, entry)?;
    let wanted: BTreeSet<&u64> = drive.times_ns().iter().collect();
    let first = |times_ns: &[u64]| times_ns.first().copied().unwrap_or_default();
    if episode.times_ns().iter().all(|time_ns| wanted.contains(time_ns)) {
        let known =
            episode.log().map(|log| log.first_cloud_sha256.as_str()).filter(|sha256| !sha256.is_empty());
        let first_ns = first(episode.times_ns());
        let place = drive.times_ns().iter().position(|&time_ns| time_ns == first_ns);
        let (Some(known), Some(place)) = (known, place) else { return Ok(()) };
        return match drive.frame(place, &mut Notes::default()) {
            Ok(frame) if frame.cloud_sha256() != known => {
                Err(ImportError::OtherCloud { name: entry.name.clone(), path: folder.to_owned() })
            }
            _ => Ok(()),
        };
    }
    Err(ImportError::OtherDrive {
        name: entry.name.clone(),
        found_ns: first(episode.times_ns()),
        wanted_ns: first(drive.times_ns()),
        path: folder.to_owned(),
    })
}

/// `dataset.json` while it grows.
struct List<'a> {
    manifest: Manifest,
    names: BTreeSet<String>,
    /// Drives that are here without some of their samples, and are to be imported again.
    incomplete: BTreeSet<String>,
    /// Each drive's place in the log; episodes of other logs come last.
    places: BTreeMap<String, usize>,
    n_unwritten: usize,
    folder: &'a Path,
}

impl<'a> List<'a> {
    fn new(manifest: Manifest, log: &dyn Log, folder: &'a Path) -> Self {
        let names = manifest.episodes.iter().map(|entry| entry.name.clone()).collect();
        let places = log.drives().iter().cloned().zip(0..).collect();
        Self { manifest, names, incomplete: BTreeSet::new(), places, n_unwritten: 0, folder }
    }

    /// Checks that the episodes that are there show this log's drives, not those of the same name of another log; with `force`
    /// others are made anew. Before anything of a log is here, all that is kept of its names is another's: a few tell.
    fn check_same_drives(
        &mut self,
        log: &dyn Log,
        drives: &[String],
        force: bool,
    ) -> Result<(), ImportError> {
        let wanted: BTreeSet<&String> = drives.iter().collect();
        let kept = self.manifest.episodes.iter().filter(|entry| wanted.contains(&entry.name));
        let mut others = BTreeSet::new();
        for entry in kept.take(if force { usize::MAX } else { KEPT_DRIVES_CHECKED }) {
            match check_same_drive(log, entry, self.folder) {
                Err(ImportError::OtherDrive { name, .. } | ImportError::OtherCloud { name, .. }) if force => {
                    others.insert(name);
                }
                checked => checked?,
            }
        }
        self.manifest.episodes.retain(|entry| !others.contains(&entry.name));
        self.names.retain(|name| !others.contains(name));
        Ok(())
    }

    /// Drives of which samples were left out as unreadable are imported again: they may be readable now. What is here stays until
    /// then.
    fn find_incomplete(&mut self, drives: &[String]) -> Result<(), ImportError> {
        let wanted: BTreeSet<&String> = drives.iter().collect();
        for entry in self.manifest.episodes.iter().filter(|entry| wanted.contains(&entry.name)) {
            // Those that lie remotely alone are not fetched for it.
            if !files::is_file(&self.folder.join(&entry.file))? {
                continue;
            }
            let episode = EpisodeReader::open_known(self.folder, entry)?;
            if episode.log().is_some_and(|log| log.methods.contains_key(LogFacts::LEFT_OUT)) {
                self.incomplete.insert(entry.name.clone());
            }
        }
        self.names.retain(|name| !self.incomplete.contains(name));
        Ok(())
    }

    /// Puts the drives that are there into a split; returns how many of them are whole.
    fn keep(&mut self, drives: &[String], split: Split) -> usize {
        let wanted: BTreeSet<&String> = drives.iter().collect();
        let mut n_kept = 0;
        for entry in self.manifest.episodes.iter_mut().filter(|entry| wanted.contains(&entry.name)) {
            entry.split = split;
            n_kept += usize::from(self.names.contains(&entry.name));
        }
        n_kept
    }

    /// Adds an episode. The file is written at once while it is short, and then each time it has grown by a share.
    fn add(&mut self, entry: EpisodeEntry) -> Result<(), ImportError> {
        self.manifest.ood |= entry.ood;
        self.names.insert(entry.name.clone());
        if self.incomplete.remove(&entry.name) {
            self.manifest.episodes.retain(|old| old.name != entry.name);
        }
        self.manifest.episodes.push(entry);
        self.n_unwritten += 1;
        let is_due = self.n_unwritten * EPISODES_A_WRITE >= self.manifest.episodes.len();
        if is_due { self.write() } else { Ok(()) }
    }

    fn write(&mut self) -> Result<(), ImportError> {
        let place = |entry: &EpisodeEntry| self.places.get(&entry.name).copied().unwrap_or(usize::MAX);
        self.manifest.episodes.sort_by_key(place);
        self.n_unwritten = 0;
        Ok(self.manifest.write(self.folder)?)
    }
}

fn summarise(
    manifest: &Manifest,
    format: LogFormat,
    folder: &Path,
    n_kept: usize,
    skipped: Vec<String>,
    notes: Vec<String>,
) -> ImportSummary {
    let mut n_objects = ObjectCounts::default();
    for entry in &manifest.episodes {
        for distribution in [Distribution::Id, Distribution::Ood] {
            for kind in Kind::ALL {
                *n_objects.get_mut(distribution).get_mut(kind) += entry.n_objects.get(distribution).get(kind);
            }
        }
    }
    ImportSummary {
        folder: folder.to_owned(),
        format: format.name(),
        n_episodes: manifest.episodes.len(),
        n_kept,
        n_samples: manifest.episodes.iter().map(|entry| entry.n_samples).sum(),
        is_labelled: n_objects.total() > 0,
        n_objects,
        skipped,
        notes,
    }
}

impl fmt::Display for ImportSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.folder.display())?;
        writeln!(f, "  format    {}", self.format)?;
        writeln!(f, "  episodes  {} ({} kept)", self.n_episodes, self.n_kept)?;
        writeln!(f, "  samples   {}", self.n_samples)?;
        if self.is_labelled {
            let share = self.n_objects.total() as f64 / self.n_samples.max(1) as f64;
            writeln!(f, "  objects   {} ({share:.1} a sample)", self.n_objects.total())?;
            for (name, counts) in [("id", &self.n_objects.id), ("ood", &self.n_objects.ood)] {
                let [vehicles, pedestrians, statics] = counts.values();
                writeln!(
                    f,
                    "    {name:<4} {vehicles:>7} vehicles {pedestrians:>7} pedestrians {statics:>7} static"
                )?;
            }
        } else {
            writeln!(f, "  objects   none are annotated")?;
        }
        if !self.skipped.is_empty() {
            writeln!(f, "  skipped   {}, told on standard error", self.skipped.len())?;
        }
        Ok(())
    }
}
