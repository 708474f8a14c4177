//! Drives every episode with every driver, in several processes, and goes on where a run before was ended.
//!
//! `<out>/<who>/outcomes/<episode>.json` is written when a drive is over, whole or not at all. With episodes recorded, `<out>/<who>`
//! is a data set with predictions, which `view`, `eval` and `report` read. `<out>/drive.json` comes last.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use fs_err as fs;

use super::scenario::{Scenario, check_names, course, world_plans};
use super::worker::{COMMAND, DriveJob, Task};
use super::{DriveConfig, DriveError};
use crate::config::{Check as _, InvalidConfig, to_toml};
use crate::device::DeviceName;
use crate::episode::folder::{first_difference, is_whole, remove_unfinished};
use crate::episode::{Manifest, Split};
use crate::files::{FolderLock, holds_anything, sha256_hex, sha256_of, write_atomic, write_sealed};
use crate::generate::{CheckedConfig, EpisodePlan, GenerateConfig};
use crate::infer::Trained;
use crate::label;
use crate::outcome::{DriveOutcome, DriveSummary, Origin, Source, Who, compare};
use crate::progress::Progress;
use crate::scene::{PopulateConfig, Town};
use crate::worker::{self, Call, Engine, Errand, Program, SILENCE};

/// The resolved config, written before anything else.
const CONFIG_FILE: &str = "drive.toml";
/// Who drove, and by which weights.
const WHO_FILE: &str = "who.json";
const OUTCOMES: &str = "outcomes";

/// How the drives are made; but for `records` this does not change their bytes.
#[derive(Debug, Clone)]
pub struct DriveOptions {
    /// The `harmzone` program, started as worker.
    pub program: Program,
    pub jobs: usize,
    /// Whether episodes are recorded.
    pub records: bool,
    pub device: DeviceName,
}

/// What is driven.
#[derive(Debug, Clone, Default)]
pub struct Courses {
    /// The first so many of the config's worlds, where there are no scenarios.
    pub n_episodes: u32,
    pub scenarios: Vec<Scenario>,
}

/// Drives the courses with each of `drivers`.
///
/// # Errors
/// [`DriveError`]: a bad config, a folder that holds something else, a run that is not there, or the first drive that could not be
/// made. A detector of another program that fails is no error: its drives end as failed.
pub fn run(
    config: &DriveConfig,
    drivers: &[Who],
    courses: &Courses,
    out: &Path,
    options: &DriveOptions,
    progress: &dyn Progress,
) -> Result<DriveSummary, DriveError> {
    config.check()?;
    if !config.world.scene.own_models.is_empty() {
        let wanted = "own meshes cannot be driven among yet; an empty text is needed";
        return Err(
            InvalidConfig::new("world.scene.own_models", &config.world.scene.own_models, wanted).into()
        );
    }
    if let Some(who) =
        drivers.iter().enumerate().find(|(i, who)| drivers[..*i].iter().any(|other| other.name == who.name))
    {
        return Err(DriveError::SameName { name: who.1.name.clone() });
    }
    let checked = CheckedConfig::try_from(&config.world)?;
    let config = DriveConfig { world: checked.raw.clone(), ..config.clone() };
    for town in &config.world.towns {
        for note in Town::load(town).map_err(crate::generate::GenerateError::from)?.notes {
            tracing::warn!("{town}: {note}");
        }
    }
    let plans = plans(&config, &checked, courses)?;
    let origins =
        drivers.iter().map(|who| origin_of(who, options.device)).collect::<Result<Vec<_>, DriveError>>()?;
    let mut config_toml = to_toml(&config);
    for scenario in &courses.scenarios {
        config_toml += &format!("\n[[scenario]]\n{}", to_toml(scenario).replace("\n[", "\n[scenario."));
    }
    let _lock = FolderLock::take(out)?;
    open(out, &config_toml, &origins)?;

    let folders: Vec<PathBuf> = drivers.iter().map(|who| out.join(&who.name)).collect();
    let mut outcomes: Vec<Vec<Option<DriveOutcome>>> = Vec::new();
    for folder in &folders {
        remove_unfinished(folder)?;
        let kept = plans.iter().map(|plan| find_whole(folder, plan, options.records));
        outcomes.push(kept.collect::<Result<_, _>>()?);
    }
    let todo: Vec<Task> = (0..drivers.len())
        .flat_map(|who_idx| (0..plans.len() as u32).map(move |course_idx| Task { who_idx, course_idx }))
        .filter(|task| outcomes[task.who_idx][task.course_idx as usize].is_none())
        .collect();
    progress.start("drive", todo.len() as u64);
    let n_jobs = options.jobs.clamp(1, todo.len().max(1));
    let n_cores = std::thread::available_parallelism().map_or(1, usize::from);
    let outcomes = Mutex::new(outcomes);
    let job = DriveJob {
        config: config.clone(),
        drivers: drivers.to_vec(),
        scenarios: courses.scenarios.clone(),
        folder: fs::canonicalize(out)?,
        records: options.records,
        device: options.device.to_string(),
    };
    let call = Call {
        program: &options.program,
        command: COMMAND,
        job: &job,
        folder: &job.folder,
        shared: Vec::new(),
        n_threads: Some((n_cores / n_jobs).max(1)),
        silence: SILENCE,
    };
    let errands: Vec<Errand<Task>> = todo.iter().copied().map(Errand::from).collect();
    worker::do_all(&Engine::Local { jobs: n_jobs }, &call, &errands, &|| (), &|place, made| {
        let Task { who_idx, course_idx } = todo[place];
        let plan = &plans[course_idx as usize];
        let outcome: DriveOutcome = made
            .map_err(|error| DriveError::Worker { episode: plan.name.clone(), message: error.to_string() })?;
        progress.note(&format!("{} {}", drivers[who_idx].name, plan.name));
        progress.advance(1);
        let json = serde_json::to_string_pretty(&outcome).expect("an outcome has a JSON form");
        write_atomic(&outcome_path(&folders[who_idx], plan), (json + "\n").as_bytes())?;
        let mut outcomes = outcomes.lock().expect("no worker thread panics");
        outcomes[who_idx][course_idx as usize] = Some(outcome);
        Ok::<(), DriveError>(())
    })?;
    // What workers that died have left.
    folders.iter().try_for_each(|folder| remove_unfinished(folder))?;
    progress.finish();
    let outcomes: Vec<Vec<DriveOutcome>> = outcomes
        .into_inner()
        .expect("no worker thread panics")
        .into_iter()
        .map(|of_who| of_who.into_iter().flatten().collect())
        .collect();
    if options.records {
        for (folder, outcomes) in folders.iter().zip(&outcomes) {
            finish_dataset(folder, &config, &config_toml, outcomes)?;
        }
    }
    let drives: Vec<(Who, Vec<DriveOutcome>)> =
        drivers.iter().cloned().zip(outcomes.iter().cloned()).collect();
    let summary = DriveSummary {
        generator_version: env!("CARGO_PKG_VERSION").to_owned(),
        config_sha256: sha256_hex(config_toml.as_bytes()),
        split: plans.first().map_or(Split::Dev, |plan| plan.split),
        ood: config.world.scene.ood,
        seed: config.world.seed,
        labels: config.zone.kind.name().to_owned(),
        origins,
        figures: compare(&drives),
        outcomes,
    };
    write_sealed(&out.join(DriveSummary::FILE), &summary)?;
    Ok(summary)
}

/// Which drives the courses are.
fn plans(
    config: &DriveConfig,
    checked: &CheckedConfig,
    courses: &Courses,
) -> Result<Vec<EpisodePlan>, DriveError> {
    let Courses { n_episodes, scenarios } = courses;
    let own = GenerateConfig { scene: PopulateConfig::default(), ..GenerateConfig::default() };
    let scene = PopulateConfig { split: own.scene.split, ..config.world.scene.clone() };
    let is_own = (config.world.seed, &config.world.towns, &config.world.weathers, &scene)
        == (own.seed, &own.towns, &own.weathers, &own.scene)
        && config.seconds == DriveConfig::default().seconds;
    if !scenarios.is_empty() && !is_own {
        let wanted = "each scenario has its own town, weather, seed, seconds and [scene]; the defaults are needed here";
        return Err(InvalidConfig::new("world", "changed beside scenarios", wanted).into());
    }
    if scenarios.is_empty() {
        return Ok(world_plans(checked, *n_episodes));
    }
    check_names(scenarios)?;
    (0..scenarios.len() as u32).map(|idx| Ok(course(config, scenarios, idx)?.plan)).collect()
}

/// Who a driver is, with the hash of what it drives by.
fn origin_of(who: &Who, device: DeviceName) -> Result<Origin, DriveError> {
    let sha256 = match &who.source {
        Source::Network { run, .. } => sha256_hex(&Trained::find(run)?.bytes()?.1),
        Source::External { command } => {
            let files = command.split_whitespace().map(Path::new).filter(|path| path.is_file());
            let hashes = files.map(sha256_of).collect::<Result<Vec<_>, _>>()?;
            sha256_hex(hashes.concat().as_bytes())
        }
        Source::Blind | Source::Truth => String::new(),
    };
    let generator_version = env!("CARGO_PKG_VERSION").to_owned();
    Ok(Origin { who: who.clone(), sha256, generator_version, device: device.to_string() })
}

/// Prepares the folder, or refuses one that holds something else.
fn open(out: &Path, config_toml: &str, origins: &[Origin]) -> Result<(), DriveError> {
    let config_path = out.join(CONFIG_FILE);
    let other =
        |found: String, wanted: String| Err(DriveError::OtherConfig { found, wanted, path: out.to_owned() });
    if config_path.is_file() {
        let found = fs::read_to_string(&config_path)?;
        if let Some((found, wanted)) = first_difference(&found, config_toml) {
            return other(found, wanted);
        }
    } else if holds_anything(out)? {
        return Err(DriveError::ForeignFolder { path: out.to_owned() });
    }
    let text = |origin: &Origin| serde_json::to_string_pretty(origin).expect("it has a JSON form") + "\n";
    for origin in origins {
        let path = out.join(&origin.who.name).join(WHO_FILE);
        if path.is_file() {
            let found = fs::read_to_string(&path)?;
            if let Some((found, wanted)) = first_difference(&found, &text(origin)) {
                return other(found.trim().to_owned(), wanted.trim().to_owned());
            }
        }
    }
    fs::create_dir_all(out)?;
    write_atomic(&config_path, config_toml.as_bytes())?;
    for origin in origins {
        let folder = out.join(&origin.who.name);
        fs::create_dir_all(folder.join(OUTCOMES))?;
        write_atomic(&folder.join(WHO_FILE), text(origin).as_bytes())?;
    }
    Ok(())
}

/// The outcome of an earlier run, with its episode if that is wanted. A failed drive is made again.
fn find_whole(folder: &Path, plan: &EpisodePlan, records: bool) -> Result<Option<DriveOutcome>, DriveError> {
    let path = outcome_path(folder, plan);
    if !path.is_file() {
        return Ok(None);
    }
    let outcome: DriveOutcome = serde_json::from_str(&fs::read_to_string(&path)?)
        .map_err(|error| DriveError::BadOutcome { message: error.to_string(), path })?;
    let is_there =
        outcome.entry.as_ref().is_some_and(|entry| is_whole(folder, entry).is_ok_and(|is_whole| is_whole));
    Ok((!outcome.is_failed() && (!records || is_there)).then_some(outcome))
}

fn outcome_path(folder: &Path, plan: &EpisodePlan) -> PathBuf {
    folder.join(OUTCOMES).join(format!("{}.json", plan.name))
}

/// Makes the driver's folder a labelled data set.
fn finish_dataset(
    folder: &Path,
    config: &DriveConfig,
    config_toml: &str,
    outcomes: &[DriveOutcome],
) -> Result<(), DriveError> {
    let mut manifest =
        Manifest::new(sha256_hex(config_toml.as_bytes()), config.world.seed, config.world.scene.ood);
    manifest.episodes = outcomes.iter().filter_map(|outcome| outcome.entry.clone()).collect();
    if manifest.episodes.is_empty() {
        return Ok(());
    }
    manifest.write(folder)?;
    let set = config.zone.kind.name();
    label::run(folder, &config.zone, set, true, &crate::progress::Silent)?;
    Ok(())
}
