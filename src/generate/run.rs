//! Makes a whole data set with worker processes, and continues an interrupted one.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use serde::Serialize;

use super::worker::{COMMAND, Job, Task};
use super::{CheckedConfig, EpisodePlan, GenerateConfig, GenerateError, folder, plan};
use crate::config::to_toml;
use crate::episode::manifest::ObjectCounts;
use crate::episode::{EpisodeEntry, Manifest, PartOf, Shard, Split};
use crate::object::{Distribution, Kind};
use crate::progress::Progress;
use crate::scene::{OwnModels, Town};
use crate::worker::{Program, Worker};

/// How a data set is made; this does not change its bytes.
#[derive(Debug, Clone)]
pub struct RunOptions {
    /// The `harmzone` program, started as worker.
    pub program: Program,
    /// Worker processes.
    pub jobs: usize,
    /// Whether the episodes of another config may be deleted.
    pub force: bool,
    /// A user's own models, which the config's `scene.own_models` names.
    pub own_models: Option<OwnModels>,
}

/// Which episodes of a config are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Extent {
    /// The first so many.
    pub n_episodes: u32,
    /// Of these, one part; `None`: all.
    pub shard: Option<Shard>,
}

impl From<u32> for Extent {
    fn from(n_episodes: u32) -> Self {
        Self { n_episodes, shard: None }
    }
}

/// The result of a run.
#[derive(Debug, Clone, Serialize)]
pub struct GenerateSummary {
    pub folder: PathBuf,
    pub n_episodes: usize,
    /// Episodes that were there already.
    pub n_kept: usize,
    pub n_samples: usize,
    pub n_by_split: BTreeMap<Split, usize>,
    pub n_objects: ObjectCounts,
}

/// Makes episodes of a config in `out`; whole ones of an earlier, equal run are kept.
///
/// `dataset.json` lists the complete episodes at any time, so a run may be killed and repeated.
///
/// # Errors
/// [`GenerateError`]: a bad config, a folder that holds something else, or the first episode that failed.
pub fn run(
    config: &GenerateConfig,
    extent: impl Into<Extent>,
    out: &Path,
    options: &RunOptions,
    progress: &dyn Progress,
) -> Result<GenerateSummary, GenerateError> {
    let checked = CheckedConfig::try_from(config)?;
    let config = &checked.raw;
    // An unknown town is reported at once, before the folder is touched.
    for town in &config.towns {
        for note in Town::load(town)?.notes {
            tracing::warn!("{town}: {note}");
        }
    }
    let Extent { n_episodes, shard } = extent.into();
    let is_wanted = |number: u32| shard.is_none_or(|shard| shard.holds(number));
    let (numbers, plans): (Vec<u32>, Vec<EpisodePlan>) =
        (0..).zip(plan(&checked, n_episodes)).filter(|(number, _)| is_wanted(*number)).unzip();
    let part = shard.map(|shard| PartOf { shard, n_episodes });
    let ood = config.scene.ood;
    let manifest = folder::open(out, &to_toml(config), config.seed, ood, part, &plans, options.force)?;
    if let Some(models) = &options.own_models {
        models.write(&out.join(folder::OWN_MODELS))?;
    }
    let kept: BTreeSet<&str> = manifest.episodes.iter().map(|entry| entry.name.as_str()).collect();
    let todo: Vec<usize> = (0..plans.len()).filter(|&i| !kept.contains(plans[i].name.as_str())).collect();
    let n_kept = manifest.episodes.len();

    progress.start("generate", todo.len() as u64 * u64::from(config.samples));
    let shared = Shared {
        todo: &todo,
        next: AtomicUsize::new(0),
        plans: &plans,
        numbers: &numbers,
        places: plans.iter().map(|plan| plan.name.as_str()).zip(0..).collect(),
        manifest: Mutex::new(manifest),
        failure: Mutex::new(None),
        folder: out,
        progress,
    };
    // Workers never change their working folder, but a relative path should not depend on that.
    let job = Job { config: config.clone(), folder: fs_err::canonicalize(out)? };
    std::thread::scope(|scope| {
        for _ in 0..options.jobs.clamp(1, todo.len().max(1)) {
            scope.spawn(|| shared.work(&options.program, &job));
        }
    });
    progress.finish();
    if let Some(error) = shared.failure.into_inner().expect("no worker thread panics") {
        return Err(error);
    }
    let manifest = shared.manifest.into_inner().expect("no worker thread panics");
    Ok(summarise(&manifest, out, n_kept))
}

struct Shared<'a> {
    /// Indices in `plans`.
    todo: &'a [usize],
    /// Index in `todo` of the next episode to hand out.
    next: AtomicUsize,
    plans: &'a [EpisodePlan],
    /// Of each plan among all episodes of the config.
    numbers: &'a [u32],
    /// Where each episode stands in `plans`.
    places: BTreeMap<&'a str, usize>,
    manifest: Mutex<Manifest>,
    /// The first failure; it ends the other workers after their present episode.
    failure: Mutex<Option<GenerateError>>,
    folder: &'a Path,
    progress: &'a dyn Progress,
}

impl Shared<'_> {
    fn work(&self, program: &Program, job: &Job) {
        if let Err(error) = self.try_work(program, job) {
            self.failure.lock().expect("no worker thread panics").get_or_insert(error);
        }
    }

    fn try_work(&self, program: &Program, job: &Job) -> Result<(), GenerateError> {
        let mut worker = None;
        while let Some(&plan_idx) = self.todo.get(self.next.fetch_add(1, Ordering::Relaxed)) {
            if self.failure.lock().expect("no worker thread panics").is_some() {
                break;
            }
            let (plan, episode_idx) = (&self.plans[plan_idx], self.numbers[plan_idx]);
            let worker = match &mut worker {
                Some(worker) => worker,
                none => none.insert(Worker::start(program, COMMAND, job, None)?),
            };
            let made = worker.make(&Task { episode_idx }, &|| self.progress.advance(1));
            let entry =
                made.map_err(|message| GenerateError::Worker { episode: plan.name.clone(), message })?;
            self.progress.note(&plan.name);
            self.add(entry)?;
        }
        Ok(())
    }

    /// Adds an entry to `dataset.json`, in the order of the plan.
    fn add(&self, entry: EpisodeEntry) -> Result<(), GenerateError> {
        let mut manifest = self.manifest.lock().expect("no worker thread panics");
        manifest.episodes.push(entry);
        manifest.episodes.sort_by_key(|entry| self.places.get(entry.name.as_str()));
        Ok(manifest.write(self.folder)?)
    }
}

fn summarise(manifest: &Manifest, folder: &Path, n_kept: usize) -> GenerateSummary {
    let mut n_objects = ObjectCounts::default();
    for entry in &manifest.episodes {
        for distribution in [Distribution::Id, Distribution::Ood] {
            for kind in [Kind::Vehicle, Kind::Pedestrian, Kind::Static] {
                *n_objects.get_mut(distribution).get_mut(kind) += entry.n_objects.get(distribution).get(kind);
            }
        }
    }
    GenerateSummary {
        folder: folder.to_owned(),
        n_episodes: manifest.episodes.len(),
        n_kept,
        n_samples: manifest.episodes.iter().map(|entry| entry.n_samples).sum(),
        n_by_split: manifest.n_by_split(),
        n_objects,
    }
}

impl fmt::Display for GenerateSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let splits: Vec<String> =
            self.n_by_split.iter().map(|(split, n)| format!("{n} {}", split.name())).collect();
        writeln!(f, "{}", self.folder.display())?;
        writeln!(f, "  episodes  {} ({}; {} kept)", self.n_episodes, splits.join(", "), self.n_kept)?;
        writeln!(f, "  samples   {}", self.n_samples)?;
        let share = self.n_objects.total() as f64 / (self.n_samples.max(1)) as f64;
        writeln!(f, "  objects   {} ({share:.1} a sample)", self.n_objects.total())?;
        for (name, counts) in [("id", &self.n_objects.id), ("ood", &self.n_objects.ood)] {
            let [vehicles, pedestrians, statics] = counts.values();
            writeln!(
                f,
                "    {name:<4} {vehicles:>7} vehicles {pedestrians:>7} pedestrians {statics:>7} static"
            )?;
        }
        Ok(())
    }
}
