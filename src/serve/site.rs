//! All that is served, with what has been read of it; independent of sockets.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use fs_err as fs;
use rayon::prelude::*;
use serde::Serialize;
use tokio::sync::{Semaphore, mpsc};

use super::ServeError;
use super::facts::{EpisodeSums, SampleCounts};
use super::folder::{Findings, ServedFolder};
use super::frames::SampleFrame;
use super::scores::ShownScores;
use super::sets::{EpisodeSet, OpenEpisode, SetOptions, SetSummary, find_sets};
use super::shelf::Shelf;
use crate::episode::EpisodeEntry;
use crate::object::{Distribution, Kind};
use crate::progress::Progress;

/// Bytes of samples that stay in memory.
const FRAMES_BYTES: usize = 96 << 20;
/// Episodes whose index stays in memory.
const N_OPEN: usize = 16;
/// Largest report that is served, bytes.
const MOST_REPORT_BYTES: u64 = 256 << 20;

/// A sample's place: set, episode, sample.
type FramePlace = (usize, usize, usize);

/// What is served.
#[derive(Debug)]
pub struct ServedSite {
    pub folder: ServedFolder,
    pub sets: Vec<EpisodeSet>,
    scores: Vec<PathBuf>,
    reports: Vec<PathBuf>,
    is_cut: bool,
    open: Shelf<(usize, usize), OpenEpisode>,
    frames: Shelf<FramePlace, SampleFrame>,
    /// As many reads at a time as there are cores; the others wait.
    workers: Arc<Semaphore>,
    /// The sets whose episodes are to be read through; `None` ends it.
    wanted: mpsc::UnboundedSender<Option<usize>>,
    is_stopped: AtomicBool,
}

/// Sets to read through, in the order in which they were asked for.
pub type WantedSets = mpsc::UnboundedReceiver<Option<usize>>;

/// What the page asks for first.
#[derive(Debug, Serialize)]
pub struct Overview<'a> {
    folder: String,
    version: &'static str,
    sets: Vec<SetSummary<'a>>,
    scores: Vec<String>,
    reports: Vec<String>,
    /// Whether the folder holds more than was looked through.
    is_cut: bool,
}

/// A set's episodes.
#[derive(Debug, Serialize)]
pub struct EpisodeList<'a> {
    /// How many of the episodes have been read for harm and faults.
    n_read: usize,
    episodes: Vec<EpisodeRow<'a>>,
}

#[derive(Debug, Serialize)]
struct EpisodeRow<'a> {
    name: &'a str,
    split: &'static str,
    town: &'a str,
    weather: &'a str,
    n_samples: usize,
    vehicle: u64,
    pedestrian: u64,
    #[serde(rename = "static")]
    static_object: u64,
    unfamiliar: u64,
    is_read: bool,
    #[serde(flatten)]
    sums: EpisodeSums,
    trouble: Option<&'a str>,
}

/// One episode, for the player.
#[derive(Debug, Serialize)]
pub struct EpisodeDetail<'a> {
    #[serde(flatten)]
    row: EpisodeRow<'a>,
    by_sample: SampleCounts,
}

impl ServedSite {
    /// Searches a folder and reads the manifests in it. The receiver tells [`Self::read_through`] what to read.
    ///
    /// # Errors
    /// There is no such folder, or nothing in it to show.
    pub fn open(folder: ServedFolder, options: &SetOptions) -> Result<(Arc<Self>, WantedSets), ServeError> {
        let found = folder.search()?;
        if found.is_empty() {
            return Err(ServeError::Nothing { path: folder.path().to_owned() });
        }
        let sets = find_sets(&folder, &found, options);
        let Findings { scores, reports, is_cut, .. } = found;
        let (wanted, receiver) = mpsc::unbounded_channel();
        let site = Self {
            folder,
            sets,
            scores,
            reports,
            is_cut,
            open: Shelf::new(N_OPEN),
            frames: Shelf::new(FRAMES_BYTES),
            workers: Arc::new(Semaphore::new(n_workers())),
            wanted,
            is_stopped: AtomicBool::new(false),
        };
        Ok((Arc::new(site), receiver))
    }

    #[must_use]
    pub fn overview(&self) -> Overview<'_> {
        let names = |paths: &[PathBuf]| paths.iter().map(|path| self.folder.name_of(path)).collect();
        Overview {
            folder: self.folder.name_of(self.folder.path()),
            version: env!("CARGO_PKG_VERSION"),
            sets: self.sets.iter().map(EpisodeSet::summary).collect(),
            scores: names(&self.scores),
            reports: names(&self.reports),
            is_cut: self.is_cut,
        }
    }

    /// A set's episodes as far as they are known; the rest is read in the background from now on.
    ///
    /// # Errors
    /// There is no such set.
    pub fn episodes(&self, set_idx: usize) -> Result<EpisodeList<'_>, ServeError> {
        let set = self.set(set_idx)?;
        let n_read = set.n_read();
        if n_read < set.entries.len() {
            // Nobody listens any more when the server stops.
            let _ = self.wanted.send(Some(set_idx));
        }
        let rows = set.entries.iter().enumerate().map(|(i, entry)| EpisodeRow::of(set, i, entry));
        Ok(EpisodeList { n_read, episodes: rows.collect() })
    }

    /// One episode, read now if it has not been.
    ///
    /// # Errors
    /// There is no such set or episode.
    pub async fn episode(
        self: &Arc<Self>,
        set_idx: usize,
        name: &str,
    ) -> Result<EpisodeDetail<'_>, ServeError> {
        let (idx, site) = (self.find(set_idx, name)?, self.clone());
        let facts = self.work(move || Ok(site.sets[set_idx].facts(&site.folder, idx))).await?;
        let set = self.set(set_idx)?;
        let entry = &set.entries[idx];
        Ok(EpisodeDetail {
            row: EpisodeRow::of(set, idx, entry),
            by_sample: facts.by_sample(entry.n_samples),
        })
    }

    /// One sample.
    ///
    /// # Errors
    /// There is no such sample, or it cannot be read.
    pub async fn frame(
        self: &Arc<Self>,
        set_idx: usize,
        name: &str,
        sample_idx: usize,
    ) -> Result<Arc<SampleFrame>, ServeError> {
        let idx = self.find(set_idx, name)?;
        if sample_idx >= self.sets[set_idx].entries[idx].n_samples {
            return Err(ServeError::NotThere { what: format!("sample {sample_idx} of `{name}`") });
        }
        let read = async {
            let site = self.clone();
            let open = self.work(move || Ok((site.sets[set_idx].open_episode(&site.folder, idx)?, 1)));
            let episode = self.open.get_or_read((set_idx, idx), open).await?;
            let frame = self.work(move || SampleFrame::read(&episode, sample_idx)).await?;
            let size = frame.size().max(1);
            Ok((frame, size))
        };
        self.frames.get_or_read((set_idx, idx, sample_idx), read).await
    }

    /// The tables of a folder of scores.
    ///
    /// # Errors
    /// There is none of this number, or it cannot be read.
    pub async fn scores(self: &Arc<Self>, idx: usize) -> Result<ShownScores, ServeError> {
        let path =
            self.scores.get(idx).ok_or_else(|| ServeError::NotThere { what: format!("scores {idx}") })?;
        let (site, path) = (self.clone(), path.clone());
        self.work(move || ShownScores::read(&site.folder, &path)).await
    }

    /// A report.
    ///
    /// # Errors
    /// There is none of this number, or it cannot be read.
    pub async fn report(self: &Arc<Self>, idx: usize) -> Result<Vec<u8>, ServeError> {
        let path =
            self.reports.get(idx).ok_or_else(|| ServeError::NotThere { what: format!("report {idx}") })?;
        let (site, path) = (self.clone(), path.clone());
        let read = move || {
            let path = site.folder.inside(&path)?;
            let size = fs::metadata(&path)?.len();
            if size > MOST_REPORT_BYTES {
                let message =
                    format!("{size} bytes, at most {MOST_REPORT_BYTES} are shown: {}", path.display());
                return Err(ServeError::Trouble { message });
            }
            Ok(fs::read(&path)?)
        };
        self.work(read).await
    }

    /// Reads sets through for harm and faults, one after the other, until the site is stopped. For a thread of its own.
    pub fn read_through(&self, mut wanted: WantedSets, progress: &dyn Progress) {
        // Half of the cores, so that the page stays quick meanwhile.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_workers().div_ceil(2)).build();
        let Ok(pool) =
            pool.inspect_err(|error| tracing::warn!("episodes are read only as they are opened: {error}"))
        else {
            return;
        };
        while let Some(Some(set_idx)) = wanted.blocking_recv() {
            let set = &self.sets[set_idx];
            let unread: Vec<usize> =
                (0..set.entries.len()).filter(|&i| set.known_facts(i).is_none()).collect();
            if unread.is_empty() || self.is_stopped.load(Ordering::Relaxed) {
                continue;
            }
            progress.start("read", unread.len() as u64);
            progress.note(&set.name);
            let read = |&idx: &usize| {
                if !self.is_stopped.load(Ordering::Relaxed) {
                    set.facts(&self.folder, idx);
                    progress.advance(1);
                }
            };
            pool.install(|| unread.par_iter().with_max_len(1).for_each(read));
            progress.finish();
        }
    }

    /// Lets [`Self::read_through`] end after the episodes that it is at.
    pub fn stop(&self) {
        self.is_stopped.store(true, Ordering::Relaxed);
        // Where nobody reads through, nobody has to end.
        let _ = self.wanted.send(None);
    }

    fn set(&self, idx: usize) -> Result<&EpisodeSet, ServeError> {
        self.sets.get(idx).ok_or_else(|| ServeError::NotThere { what: format!("data set {idx}") })
    }

    fn find(&self, set_idx: usize, name: &str) -> Result<usize, ServeError> {
        let idx = self.set(set_idx)?.find(name);
        idx.ok_or_else(|| ServeError::NotThere { what: format!("episode `{name}`") })
    }

    /// Does work that waits for the disk or for a core. Work that has begun ends also where nobody waits any more.
    async fn work<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> Result<T, ServeError> + Send + 'static,
    ) -> Result<T, ServeError> {
        let permit = self.workers.clone().acquire_owned().await.expect("nobody closes it");
        let done = tokio::task::spawn_blocking(move || {
            let _permit = permit;
            work()
        });
        done.await.unwrap_or_else(|error| {
            Err(ServeError::Trouble { message: format!("the work broke off: {error}") })
        })
    }
}

impl<'a> EpisodeRow<'a> {
    fn of(set: &'a EpisodeSet, idx: usize, entry: &'a EpisodeEntry) -> Self {
        let facts = set.known_facts(idx);
        let n_of = |kind: Kind| entry.n_objects.id.get(kind) + entry.n_objects.ood.get(kind);
        Self {
            name: &entry.name,
            split: entry.split.name(),
            town: &entry.town,
            weather: &entry.weather,
            n_samples: entry.n_samples,
            vehicle: n_of(Kind::Vehicle),
            pedestrian: n_of(Kind::Pedestrian),
            static_object: n_of(Kind::Static),
            unfamiliar: entry.n_objects.get(Distribution::Ood).values().into_iter().sum(),
            is_read: facts.is_some(),
            sums: facts.map(super::facts::EpisodeFacts::sums).unwrap_or_default(),
            trouble: facts.and_then(|facts| facts.trouble.as_deref()),
        }
    }
}

/// Reads at a time.
fn n_workers() -> usize {
    std::thread::available_parallelism().map_or(2, std::num::NonZero::get)
}
