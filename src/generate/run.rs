//! Makes a whole data set with worker processes, and continues an interrupted one.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use serde::Serialize;

use super::episode::Made;
use super::worker::{COMMAND, Job, Task};
use super::{CheckedConfig, EpisodePlan, GenerateConfig, GenerateError, folder, plan};
use crate::config::to_toml;
use crate::episode::folder::{AOV, remove_unfinished, remove_unlisted};
use crate::episode::manifest::ObjectCounts;
use crate::episode::{EpisodeEntry, MAX_EPISODES, MadeWith, Manifest, PartOf, Shard, Split};
use crate::files::{FolderLock, check_room};
use crate::object::{Distribution, Kind};
use crate::progress::Progress;
use crate::scene::{OwnModels, Town, map_hashes};
use crate::sensors::{RigCameraConfig, RigLidarConfig};
use crate::store;
use crate::worker::{self, Call, Engine, Errand, Program, TaskError, cannot_draw};

/// How a data set is made; this does not change its bytes.
#[derive(Debug, Clone)]
pub struct RunOptions {
    /// The `harmzone` program, started as worker.
    pub program: Program,
    pub engine: Engine,
    /// Whether the episodes of another config may be deleted.
    pub force: bool,
    /// How long a worker may say nothing before it is ended and its episode tried again.
    pub silence: Duration,
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
    /// Episodes whose workers died or hung, and how; the same command tries them again.
    pub lost: Vec<String>,
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
    let Extent { n_episodes, shard } = extent.into();
    if n_episodes > MAX_EPISODES {
        return Err(GenerateError::TooMany { n_episodes });
    }
    // An unknown town is reported at once, before the folder is touched.
    for town in &config.towns {
        for note in Town::load(town)?.notes {
            tracing::warn!("{town}: {note}");
        }
    }
    let is_wanted = |number: u32| shard.is_none_or(|shard| shard.holds(number));
    let (numbers, plans): (Vec<u32>, Vec<EpisodePlan>) =
        (0..).zip(plan(&checked, n_episodes)).filter(|(number, _)| is_wanted(*number)).unzip();
    let part = shard.map(|shard| PartOf { shard, n_episodes });
    let lock = FolderLock::take(out)?;
    let config_toml = to_toml(config) + &map_hashes(config.towns.iter())?;
    let manifest = folder::open(out, config, &config_toml, part, &plans, options.force)?;
    if let Some(models) = &options.own_models {
        models.write(&out.join(folder::OWN_MODELS))?;
    }
    // A second writer to one URL is told now, before hours of work.
    store::push(out)?;
    let n_left: u64 = plans.len() as u64 - manifest.episodes.len() as u64;
    check_room(out, n_left * u64::from(config.samples) * least_sample_bytes(config))?;
    let kept: BTreeSet<&str> = manifest.episodes.iter().map(|entry| entry.name.as_str()).collect();
    let todo: Vec<usize> = (0..plans.len()).filter(|&i| !kept.contains(plans[i].name.as_str())).collect();
    let n_kept = manifest.episodes.len();

    let places: BTreeMap<&str, usize> = plans.iter().map(|plan| plan.name.as_str()).zip(0..).collect();
    let keeper = Mutex::new(Keeper { manifest, places, folder: out, rest_until: None });
    // Workers never change their working folder, but a relative path should not depend on that.
    let folder = fs_err::canonicalize(out)?;
    let job = Job { config: config.clone(), folder: folder.clone() };
    let call = Call {
        program: &options.program,
        command: COMMAND,
        job: &job,
        folder: &folder,
        shared: files_in(&folder, Path::new(folder::OWN_MODELS))?,
        n_threads: None,
        silence: options.silence,
        befalls_all: Some(cannot_draw),
    };
    let errands: Vec<Errand<Task>> =
        todo.iter().map(|&i| Errand::from(Task { episode_idx: numbers[i] })).collect();
    let lost: Mutex<Vec<String>> = Mutex::default();
    progress.start("generate", todo.len() as u64 * u64::from(config.samples));
    let done = worker::do_all(&options.engine, &call, &errands, &|| progress.advance(1), &|place, made| {
        let name = &plans[todo[place]].name;
        let Made { entry, made_with } = match made {
            Ok(made) => made,
            Err(TaskError::Lost(message)) => {
                let sentence = format!("episode `{name}` was left out: {message}");
                tracing::warn!("{sentence}");
                lost.lock().expect("no worker thread panics").push(sentence);
                return Ok(());
            }
            Err(TaskError::Failed(message)) => {
                return Err(GenerateError::Worker { episode: name.clone(), message });
            }
        };
        progress.note(name);
        lock.check()?;
        for picture in files_in(&folder, &Path::new(AOV).join(name))? {
            store::push_file(&picture.1)?;
        }
        store::push_file(&folder.join(&entry.file))?;
        keeper.lock().expect("no worker thread panics").add(entry, made_with)
    });
    let manifest = keeper.into_inner().expect("no worker thread panics").manifest;
    // What is whole is kept, also where another episode failed; not what a worker that died has left.
    let written = lock.check().map_err(GenerateError::from).and_then(|()| {
        let planned = plans.iter().map(|plan| plan.name.as_str()).collect();
        let removed = remove_unfinished(out).and_then(|()| remove_unlisted(out, &planned, &manifest));
        manifest.write(out)?;
        store::push_file(&out.join(Manifest::FILE))?;
        Ok(removed?)
    });
    done?;
    written?;
    store::push(out)?;
    progress.finish();
    let lost = lost.into_inner().expect("no worker thread panics");
    Ok(GenerateSummary { lost, ..summarise(&manifest, out, n_kept) })
}

/// Bytes that a sample takes at the least. With JPEG quality 85 a picture has 0.3 bytes a pixel, its further ones 0.46, and a front
/// camera's cloud, of a sweep too, some 55 kB: half of each.
fn least_sample_bytes(config: &GenerateConfig) -> u64 {
    let pixels = |camera: &RigCameraConfig| f64::from(camera.width_px) * f64::from(camera.height_px);
    let n_pixels: f64 = config.rig.cameras.values().map(pixels).sum();
    let of_quality = (f64::from(config.render.jpeg_quality) / 85.0).powi(2);
    let of_further = if config.render.aov { 0.23 } else { 0.0 };
    // Of fewer beams and firings than the default LiDAR's it has fewer points.
    let share =
        |lidar: &RigLidarConfig| (lidar.n_beams() as f64 / 32.0 * 0.33 / lidar.azimuth_step_deg).min(1.0);
    let n_clouds = config.rig.lidars.values().map(share).sum::<f64>() * (1.0 + f64::from(config.sweeps));
    (n_pixels * (0.15 * of_quality + of_further) + 27_000.0 * n_clouds) as u64
}

/// Share of the time that writing `dataset.json` over and over may take: of 100,000 episodes it has 40 MB.
const WRITING_SHARE: u32 = 20;

/// Keeps `dataset.json` while episodes come in.
struct Keeper<'a> {
    manifest: Manifest,
    /// Where each episode stands among all of them.
    places: BTreeMap<&'a str, usize>,
    folder: &'a Path,
    /// When it is written again, if an episode comes.
    rest_until: Option<Instant>,
}

impl Keeper<'_> {
    /// Adds an entry, in the order of the plan. A killed run loses at most what came since the last writing, twenty times as
    /// long ago as that took; it is made again.
    fn add(&mut self, entry: EpisodeEntry, made_with: MadeWith) -> Result<(), GenerateError> {
        let place_of = |entry: &EpisodeEntry| self.places.get(entry.name.as_str());
        let place = place_of(&entry);
        let at = self.manifest.episodes.partition_point(|other| place_of(other) < place);
        self.manifest.episodes.insert(at, entry);
        self.manifest.add_made_with(made_with);
        let begin = Instant::now();
        if self.rest_until.is_none_or(|until| begin >= until) {
            self.manifest.write(self.folder)?;
            store::push_file(&self.folder.join(Manifest::FILE))?;
            self.rest_until = Some(Instant::now() + begin.elapsed() * WRITING_SHARE);
        }
        Ok(())
    }
}

/// The files below a folder of the data set, each with its path from the data set's folder and as it is.
fn files_in(data_set: &Path, inside: &Path) -> io::Result<Vec<(PathBuf, PathBuf)>> {
    let found = store::files_below(&data_set.join(inside))?;
    Ok(found.iter().map(|file| inside.join(file)).map(|file| (file.clone(), data_set.join(file))).collect())
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
        lost: Vec::new(),
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
        if !self.lost.is_empty() {
            writeln!(
                f,
                "  lost      {}, told on standard error; the same command tries them again",
                self.lost.len()
            )?;
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::SimError;
    use crate::worker::{lacks_memory, with_causes};

    #[test]
    fn a_worker_without_opengl_is_known_by_its_words() {
        let no_gl = || GenerateError::from(SimError::NoGl { message: "no display".into() });
        assert!(cannot_draw(&with_causes(&no_gl())));
        assert!(!cannot_draw(&with_causes(&GenerateError::TooMany { n_episodes: 1 })));
        // There is memory here, so that a machine that cannot draw is told as one.
        assert!(!lacks_memory(&with_causes(&no_gl())));
    }
}
