//! How fast generation is: against bare MuJoCo on the same frames, with several processes against one, and
//! whether a worker's memory stays flat.

mod memory;
mod replay;
mod text;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::Serialize;

use self::memory::MemoryWatch;
use self::replay::{BareCalls, StepLog};
use harmzone::episode::Manifest;
use harmzone::generate::Timings;
use harmzone::generate::episode::Recording;
use harmzone::generate::{self, CheckedConfig, EpisodePlan, GenerateConfig, GenerateError, RunOptions, plan};
use harmzone::progress::Progress;

/// What a sample may cost over the bare calls, at most.
pub const MOST_OVER_BARE: f64 = 1.25;
/// How much faster two processes must be than one, at least.
pub const LEAST_SPEED_UP: f64 = 1.7;

#[derive(Debug, Clone)]
pub struct BenchOptions {
    /// This program, started as worker.
    pub program: PathBuf,
    /// Episodes measured against bare MuJoCo, in this process; 0: none.
    pub n_episodes: u32,
    /// Samples, at least, that one process and then `jobs` processes make; 0: none.
    pub n_run_samples: u32,
    pub jobs: usize,
}

/// Milliseconds, each a sample's mean unless its name says otherwise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BenchReport {
    pub towns: Vec<String>,
    pub weathers: Vec<String>,
    pub n_episodes: u32,
    pub samples_per_episode: u32,
    /// The OpenGL that drew; empty where nothing was measured against bare calls.
    pub renderer: String,
    pub stages: Vec<Stage>,
    /// From before the first sample to after the last, over all episodes.
    pub gen_ms: f64,
    pub bare_ms: f64,
    pub over_bare: f64,
    /// The same of the episode where it is least, and of that where it is most.
    pub over_bare_least: f64,
    pub over_bare_most: f64,
    pub set_up_ms_per_episode: f64,
    pub warm_up_ms_per_episode: f64,
    pub finishing_ms_per_episode: f64,
    pub episodes: Vec<EpisodeReport>,
    pub runs: Option<Runs>,
}

/// One episode's times, milliseconds a sample.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EpisodeReport {
    pub town: String,
    pub weather: &'static str,
    pub gen_ms: f64,
    pub bare_ms: f64,
    /// Picture and segmentation.
    pub pictures_ms: f64,
    /// Rays that a sample casts.
    pub n_rays: usize,
    pub rays_ms: f64,
    pub bare_rays_ms: f64,
}

/// One stage of a sample.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stage {
    pub name: &'static str,
    pub gen_ms: f64,
    /// The MuJoCo functions that the stage cannot do without.
    pub calls: Option<&'static str>,
    pub bare_ms: Option<f64>,
}

/// The same episodes made by one process and by several.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Runs {
    pub n_episodes: u32,
    pub n_samples: u64,
    pub jobs: usize,
    /// With everything: starting, set-up, warm-up.
    pub one_job_samples_per_s: f64,
    pub jobs_samples_per_s: f64,
    pub speed_up: f64,
    pub bytes_per_sample: f64,
    /// Of the one process; none where the system does not tell.
    pub memory: Option<Memory>,
}

/// Resident memory of a worker, in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Memory {
    /// After its first sample, and after its last.
    pub first: u64,
    pub last: u64,
    pub most: u64,
    /// Means of the second and of the fourth quarter of the samples.
    pub second_quarter: f64,
    pub fourth_quarter: f64,
}

/// Measures; what is made lies in temporary folders and is deleted.
///
/// # Errors
/// As [`generate::run()`]; or the runs' episodes differ.
pub fn run(
    config: &GenerateConfig,
    options: &BenchOptions,
    progress: &dyn Progress,
) -> Result<BenchReport, GenerateError> {
    let config = CheckedConfig::try_from(config)?;
    let folder = tempfile::tempdir()?;
    fs_err::create_dir_all(folder.path().join("episodes"))?;
    let plans = plan(&config, options.n_episodes);
    progress.start("measure", plans.len() as u64 * u64::from(config.raw.samples));
    let episodes = plans
        .iter()
        .map(|plan| {
            let measured = measure(&config, plan, folder.path(), progress);
            progress.note(&plan.name);
            measured
        })
        .collect::<Result<Vec<_>, _>>()?;
    progress.finish();
    let wants_runs = options.n_run_samples > 0;
    let runs = wants_runs.then(|| compare_runs(&config, options, folder.path(), progress)).transpose()?;
    Ok(report(&config, &plans, &episodes, runs))
}

/// One episode's times.
struct Measured {
    /// From before its first sample to after its last.
    sampling: Duration,
    timings: Timings,
    bare: BareCalls,
    renderer: String,
}

fn measure(
    config: &CheckedConfig,
    plan: &EpisodePlan,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<Measured, GenerateError> {
    let mut recording = Recording::start(config, plan, folder)?;
    let log = StepLog::start(recording.simulator())?;
    let begin = Instant::now();
    recording.record_samples(&mut || {
        progress.advance(1);
        Ok(())
    })?;
    let sampling = begin.elapsed();
    let needs_depth = recording.needs_depth();
    let [_, renderer, _] = recording.simulator().gl_info()?;
    let bare = log.replay(recording.simulator(), &config.rig, config.raw.samples, needs_depth)?;
    let (_, timings) = recording.finish()?;
    Ok(Measured { sampling, timings, bare, renderer })
}

fn compare_runs(
    config: &CheckedConfig,
    options: &BenchOptions,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<Runs, GenerateError> {
    // As many episodes for each process, so that none waits for the others.
    let jobs = options.jobs.max(1) as u32;
    let n_episodes = options.n_run_samples.div_ceil(config.raw.samples).next_multiple_of(jobs);
    let timed = |jobs: usize, out: &Path, progress: &dyn Progress| {
        let run_options = RunOptions {
            program: options.program.clone().into(),
            engine: harmzone::worker::Engine::Local { jobs },
            force: false,
            silence: harmzone::worker::SILENCE,
            own_models: None,
        };
        let begin = Instant::now();
        let summary = generate::run(&config.raw, n_episodes, out, &run_options, progress)?;
        Ok::<_, GenerateError>((begin.elapsed().as_secs_f64(), summary.n_samples as u64))
    };
    let (one, several) = (folder.join("one"), folder.join("several"));
    let watch = MemoryWatch::new(progress);
    let (one_s, n_samples) = timed(1, &one, &watch)?;
    let memory = summarise(&watch.into_bytes());
    let (several_s, _) = timed(options.jobs, &several, progress)?;
    let manifest = Manifest::read(&one)?;
    if manifest != Manifest::read(&several)? {
        return Err(GenerateError::RunsDiffer { path: folder.to_owned() });
    }
    let mut n_bytes = 0;
    for entry in &manifest.episodes {
        n_bytes += fs_err::metadata(one.join(&entry.file))?.len();
    }
    Ok(Runs {
        n_episodes,
        n_samples,
        jobs: options.jobs,
        one_job_samples_per_s: n_samples as f64 / one_s,
        jobs_samples_per_s: n_samples as f64 / several_s,
        speed_up: one_s / several_s,
        bytes_per_sample: n_bytes as f64 / n_samples as f64,
        memory,
    })
}

fn summarise(bytes: &[u64]) -> Option<Memory> {
    let quarter = |i: usize| {
        let part = &bytes[bytes.len() * i / 4..bytes.len() * (i + 1) / 4];
        (!part.is_empty()).then(|| part.iter().sum::<u64>() as f64 / part.len() as f64)
    };
    Some(Memory {
        first: *bytes.first()?,
        last: *bytes.last()?,
        most: *bytes.iter().max()?,
        second_quarter: quarter(1)?,
        fourth_quarter: quarter(3)?,
    })
}

/// One of the times of an episode.
type Time = fn(&Measured) -> Duration;

/// The figures of an episode.
fn report_episode(config: &CheckedConfig, plan: &EpisodePlan, measured: &Measured) -> EpisodeReport {
    let a_sample = |time: Duration| 1e3 * time.as_secs_f64() / f64::from(config.raw.samples);
    EpisodeReport {
        town: plan.town.clone(),
        weather: plan.weather.name(),
        gen_ms: a_sample(measured.sampling),
        bare_ms: a_sample(measured.bare.total()),
        pictures_ms: a_sample(measured.timings.picture),
        n_rays: config.rig.top().pattern.directions.len(),
        rays_ms: a_sample(measured.timings.rays),
        bare_rays_ms: a_sample(measured.bare.rays),
    }
}

fn report(
    config: &CheckedConfig,
    plans: &[EpisodePlan],
    episodes: &[Measured],
    runs: Option<Runs>,
) -> BenchReport {
    let n_samples = episodes.len() as f64 * f64::from(config.raw.samples);
    let sum = |of: Time| -> f64 { 1e3 * episodes.iter().map(of).sum::<Duration>().as_secs_f64() };
    let a_sample = |of: Time| sum(of) / n_samples;
    let an_episode = |of: Time| sum(of) / episodes.len() as f64;
    let stage = |name, of: Time, calls: Option<(&'static str, Time)>| Stage {
        name,
        gen_ms: a_sample(of),
        calls: calls.map(|(name, _)| name),
        bare_ms: calls.map(|(_, of)| a_sample(of)),
    };
    let mut stages = vec![
        stage("motion", |m| m.timings.motion, Some(("mj_step", |m| m.bare.steps))),
        stage(
            "picture, segmentation",
            |m| m.timings.picture,
            Some(("mjv_updateScene, mjr_render, mjr_readPixels", |m| m.bare.pictures)),
        ),
        stage("rays", |m| m.timings.rays, Some(("mj_multiRay", |m| m.bare.rays))),
        stage("packing the picture", |m| m.timings.packing, None),
        stage("points and truth", |m| m.timings.truth, None),
        stage("writing", |m| m.timings.writing, None),
    ];
    let gen_ms = a_sample(|m| m.sampling);
    let known_ms: f64 = stages.iter().map(|stage| stage.gen_ms).sum();
    stages.push(Stage { name: "other", gen_ms: gen_ms - known_ms, calls: None, bare_ms: None });
    let bare_ms = a_sample(|m| m.bare.total());
    let ratios = episodes.iter().map(|m| m.sampling.as_secs_f64() / m.bare.total().as_secs_f64());
    BenchReport {
        towns: config.raw.towns.clone(),
        weathers: config.raw.weathers.clone(),
        n_episodes: episodes.len() as u32,
        samples_per_episode: config.raw.samples,
        renderer: episodes.first().map(|of| of.renderer.clone()).unwrap_or_default(),
        stages,
        gen_ms,
        bare_ms,
        over_bare: gen_ms / bare_ms,
        over_bare_least: ratios.clone().fold(f64::INFINITY, f64::min),
        over_bare_most: ratios.fold(0.0, f64::max),
        set_up_ms_per_episode: an_episode(|m| m.timings.set_up),
        warm_up_ms_per_episode: an_episode(|m| m.timings.warm_up),
        finishing_ms_per_episode: an_episode(|m| m.timings.finishing),
        episodes: plans.iter().zip(episodes).map(|(plan, of)| report_episode(config, plan, of)).collect(),
        runs,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_workers_memory_is_told_by_quarters() {
        let memory = summarise(&[1, 1, 2, 4, 5, 5, 8, 6]).unwrap();
        assert_eq!((memory.first, memory.last, memory.most), (1, 6, 8));
        assert_eq!((memory.second_quarter, memory.fourth_quarter), (3.0, 7.0));
        assert_eq!(summarise(&[]), None);
    }
}
