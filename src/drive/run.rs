//! Drives every episode with every driver, in several processes, and goes on where a run before was ended.
//!
//! `<out>/<who>/outcomes/<episode>.json` is written when a drive is over, whole or not at all. With episodes recorded, `<out>/<who>`
//! is a data set with predictions, which `view`, `eval` and `report` read. `<out>/drive.json` comes last.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Duration;

use fs_err as fs;

use super::episode::failed;
use super::external::FIRST_FACTOR;
use super::folder::{find_whole, finish_dataset, identity, open, remove_recorded, write_outcome};
use super::origin::origin_of;
use super::scenario::{Scenario, check_all_actors, check_names, course, world_plans};
use super::worker::{COMMAND, DriveJob, Task};
use super::{DriveConfig, DriveError};
use crate::config::{Check as _, InvalidConfig, to_toml};
use crate::device::DeviceName;
use crate::episode::Split;
use crate::episode::folder::remove_unfinished;
use crate::files::{FolderLock, write_sealed};
use crate::generate::{CheckedConfig, EpisodePlan, GenerateConfig};
use crate::outcome::{DriveOutcome, DriveSummary, End, Origin, Source, Who, compare, worst};
use crate::progress::Progress;
use crate::scene::{PopulateConfig, SceneSplit, Town, map_hashes, town_names_of};
use crate::worker::{self, Call, Engine, Errand, Program, TaskError, cannot_draw};

/// Which drives are recorded as episodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RecordedDrives {
    All,
    /// Each driver's worst so many ([`worst`]), driven again for it once all are known.
    Worst(usize),
    None,
}

/// How the drives are made; but for `recording` this does not change their bytes.
#[derive(Debug, Clone)]
pub struct DriveOptions {
    /// The `harmzone` program, started as worker.
    pub program: Program,
    pub jobs: usize,
    pub recording: RecordedDrives,
    pub device: DeviceName,
    /// How long a worker may say nothing, beside the time that an `exec:` detector has, before it is ended and its drive made again.
    pub silence: Duration,
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
/// made. A detector of another program that fails, a world whose physics fails, and a process that dies again and again are no
/// errors: such drives end as failed.
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
    check_all_actors(&config, &courses.scenarios)?;
    let origins = drivers
        .iter()
        .map(|who| origin_of(who, &config, options.device))
        .collect::<Result<Vec<_>, DriveError>>()?;
    let towns = config.world.towns.iter().chain(courses.scenarios.iter().map(|scenario| &scenario.town));
    let mut config_toml =
        to_toml(&config) + &map_hashes(towns).map_err(crate::generate::GenerateError::from)?;
    for scenario in &courses.scenarios {
        config_toml += &format!("\n[[scenario]]\n{}", to_toml(scenario).replace("\n[", "\n[scenario."));
    }
    let _lock = FolderLock::take(out)?;
    let origins = open(out, &config_toml, &origins)?;

    let folders: Vec<PathBuf> = drivers.iter().map(|who| out.join(&who.name)).collect();
    let mut outcomes: Vec<Vec<Option<DriveOutcome>>> = Vec::new();
    for folder in &folders {
        remove_unfinished(folder)?;
        let records_all = options.recording == RecordedDrives::All;
        let kept = plans.iter().map(|plan| find_whole(folder, plan, records_all));
        outcomes.push(kept.collect::<Result<_, _>>()?);
    }
    for (who, outcomes) in drivers.iter().zip(&outcomes) {
        let n_kept = outcomes.iter().flatten().count();
        if n_kept > 0 && matches!(who.source, Source::External { .. }) {
            tracing::warn!(
                "{}: {n_kept} drives of an earlier run are kept; if what the command runs has changed since, give a new folder",
                who.name
            );
        }
    }
    let todo: Vec<Task> = (0..drivers.len())
        .flat_map(|who_idx| (0..plans.len() as u32).map(move |course_idx| Task { who_idx, course_idx }))
        .filter(|task| outcomes[task.who_idx][task.course_idx as usize].is_none())
        .collect();
    let outcomes = Mutex::new(outcomes);
    let drives = Drives {
        config: &config,
        origins: &origins,
        courses,
        plans: &plans,
        folders: &folders,
        options,
        progress,
    };
    drives.make(out, &todo, options.recording == RecordedDrives::All, &|task, outcome| {
        write_outcome(&folders[task.who_idx], &plans[task.course_idx as usize], &outcome)?;
        let mut outcomes = outcomes.lock().expect("no worker thread panics");
        outcomes[task.who_idx][task.course_idx as usize] = Some(outcome);
        Ok(())
    })?;
    let mut outcomes: Vec<Vec<DriveOutcome>> = outcomes
        .into_inner()
        .expect("no worker thread panics")
        .into_iter()
        .map(|of_who| of_who.into_iter().flatten().collect())
        .collect();
    if let RecordedDrives::Worst(most) = options.recording {
        record_worst(&drives, out, most, &mut outcomes)?;
    }
    for (folder, outcomes) in folders.iter().zip(&outcomes) {
        finish_dataset(folder, &config, &config_toml, outcomes)?;
    }
    let drives: Vec<(Who, Vec<DriveOutcome>)> =
        drivers.iter().cloned().zip(outcomes.iter().cloned()).collect();
    let summary = DriveSummary {
        generator_version: env!("CARGO_PKG_VERSION").to_owned(),
        config_sha256: identity(&config_toml),
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

/// What all drives of a command share.
struct Drives<'a> {
    config: &'a DriveConfig,
    /// Who drives, and by what.
    origins: &'a [Origin],
    courses: &'a Courses,
    plans: &'a [EpisodePlan],
    folders: &'a [PathBuf],
    options: &'a DriveOptions,
    progress: &'a dyn Progress,
}

/// Hears of each drive, and keeps it.
type OnDriven<'a> = &'a (dyn Fn(Task, DriveOutcome) -> Result<(), DriveError> + Sync);

impl Drives<'_> {
    /// Makes these drives.
    fn make(
        &self,
        out: &Path,
        todo: &[Task],
        records: bool,
        on_driven: OnDriven<'_>,
    ) -> Result<(), DriveError> {
        let Self { config, origins, courses, plans, folders, options, progress } = *self;
        progress.start(if records { "drive and record" } else { "drive" }, todo.len() as u64);
        let n_jobs = options.jobs.clamp(1, todo.len().max(1));
        let n_cores = std::thread::available_parallelism().map_or(1, usize::from);
        let job = DriveJob {
            config: config.clone(),
            drivers: origins.iter().map(|origin| (origin.who.clone(), origin.sha256.clone())).collect(),
            scenarios: courses.scenarios.clone(),
            folder: fs::canonicalize(out)?,
            records,
            device: options.device.to_string(),
        };
        let call = Call {
            program: &options.program,
            command: COMMAND,
            job: &job,
            folder: &job.folder,
            shared: Vec::new(),
            n_threads: Some((n_cores / n_jobs).max(1)),
            // An `exec:` detector may take its time for an answer.
            silence: options.silence + FIRST_FACTOR * Duration::from_secs_f64(config.reply_s),
            befalls_all: Some(cannot_draw),
        };
        let errands: Vec<Errand<Task>> = todo.iter().copied().map(Errand::from).collect();
        worker::do_all(&Engine::Local { jobs: n_jobs }, &call, &errands, &|| (), &|place, made| {
            let Task { who_idx, course_idx } = todo[place];
            let plan = &plans[course_idx as usize];
            let outcome: DriveOutcome = match made {
                Ok(outcome) => outcome,
                Err(TaskError::Lost(message)) => failed(plan, message),
                Err(TaskError::Failed(message)) => {
                    return Err(DriveError::Worker { episode: plan.name.clone(), message });
                }
            };
            progress.note(&format!("{} {}", origins[who_idx].who.name, plan.name));
            progress.advance(1);
            on_driven(todo[place], outcome)
        })?;
        // What workers that died have left.
        folders.iter().try_for_each(|folder| remove_unfinished(folder))?;
        progress.finish();
        Ok(())
    }
}

/// Drives the worst cases of each driver again, recorded, where they are not.
fn record_worst(
    drives: &Drives<'_>,
    out: &Path,
    most: usize,
    outcomes: &mut [Vec<DriveOutcome>],
) -> Result<(), DriveError> {
    let truth = drives.origins.iter().position(|origin| origin.who.source == Source::Truth);
    let of_who = |who_idx: usize| {
        let truth = truth.filter(|&truth| truth != who_idx).map(|truth| &outcomes[truth][..]);
        let cases = worst(&outcomes[who_idx], truth, most).into_iter();
        let cases = cases.filter(|case| case.outcome.entry.is_none());
        let mut tasks: Vec<Task> = cases.map(|case| Task { who_idx, course_idx: case.idx as u32 }).collect();
        // A drive may hit something after a false stop.
        tasks.sort_by_key(|task| task.course_idx);
        tasks.dedup_by_key(|task| task.course_idx);
        tasks
    };
    let shown = (0..drives.origins.len()).filter(|&who| drives.origins[who].who.source != Source::Blind);
    let todo: Vec<Task> = shown.flat_map(of_who).collect();
    let outcomes = Mutex::new(outcomes);
    drives.make(out, &todo, true, &|task, outcome| {
        let (folder, plan) = (&drives.folders[task.who_idx], &drives.plans[task.course_idx as usize]);
        let mut outcomes = outcomes.lock().expect("no worker thread panics");
        let kept = &mut outcomes[task.who_idx][task.course_idx as usize];
        let (who, episode) = (&drives.origins[task.who_idx].who.name, &outcome.episode);
        if let End::Failed(reason) = &outcome.end {
            tracing::warn!("{who}, {episode}: not recorded: {reason}");
        } else if (DriveOutcome { entry: None, ..outcome.clone() }) == *kept {
            write_outcome(folder, plan, &outcome)?;
            *kept = outcome;
            return Ok(());
        } else {
            // To drive the worst again until they are better would be no figure.
            tracing::warn!(
                "{who}, {episode}: recorded, it drove another way than before; the first drive counts, and has no pictures (without \
                 --record-worst and --no-record every drive is recorded)"
            );
        }
        Ok(remove_recorded(folder, plan)?)
    })
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
    let towns = match config.world.scene.split {
        SceneSplit::Dev => own.towns.clone(),
        SceneSplit::Test => town_names_of(SceneSplit::Test),
    };
    let is_own = (config.world.seed, &config.world.towns, &config.world.weathers, &scene)
        == (own.seed, &towns, &own.weathers, &own.scene)
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
