//! One drive to one episode: each sample read, brought into form, written.

use std::collections::BTreeMap;
use std::path::Path;

use super::config::{CheckedImport, GroundSource};
use super::ground::{fit_ground, median};
use super::motion::Motion;
use super::samples::{NearBoxes, SampleMaker};
use super::{Drive, DriveFacts, GroundHeight, ImportError, Log, LogFormat, Notes, odometry};
use crate::episode::folder::EPISODES;
use crate::episode::{EpisodeEntry, EpisodeMeta, EpisodeWriter, LogFacts, Split};
use crate::interrupt;
use crate::progress::Progress;

/// Frames to which the ground is fitted, spread over the drive.
const N_GROUND_FRAMES: usize = 10;
/// So many samples that were left out are named.
const MOST_NUMBERS: usize = 20;
/// More slope than this between the ego's axes and the road is told.
const MAX_TILT_RAD: f64 = 0.035;

/// What every drive of a run shares.
pub(super) struct Task<'a> {
    pub(super) log: &'a dyn Log,
    pub(super) format: LogFormat,
    pub(super) config: &'a CheckedImport,
    pub(super) config_toml: &'a str,
    pub(super) out: &'a Path,
    pub(super) split: Split,
    /// Whether a torn or missing file costs only its sample.
    pub(super) skip_bad: bool,
    pub(super) progress: &'a dyn Progress,
}

impl Task<'_> {
    /// A drive's episode, from the data set's folder.
    fn file(drive: &str) -> String {
        format!("{EPISODES}/{drive}.mcap")
    }
}

type Methods = BTreeMap<String, String>;

/// Imports a drive; `None` if every sample was passed over.
pub(super) fn import_drive(
    task: &Task<'_>,
    name: &str,
    notes: &mut Notes,
    skipped: &mut Vec<String>,
    boxes: &mut NearBoxes,
) -> Result<Option<EpisodeEntry>, ImportError> {
    task.progress.note(name);
    let drive = task.log.open(name, notes)?;
    let facts = drive.facts();
    let odometry = drive.odometry();
    let config = task.config;
    let motion = Motion {
        odometry,
        tolerance_ns: (config.stamp_tolerance_s * 1e9) as u64,
        smoothing_ns: (config.smoothing_s * 1e9) as u64,
    };
    check_times(drive.times_ns(), &facts.path)?;
    let wheelbase_m = facts.wheelbase_m.unwrap_or(config.vehicle.wheelbase_m);
    odometry::check(&motion, drive.times_ns(), wheelbase_m, notes);
    let chosen = choose_samples(&*drive, config.every as usize, notes);
    let mut methods = Methods::new();
    methods.extend(facts.methods.iter().map(|(part, sentence)| ((*part).to_owned(), sentence.clone())));
    let ground_z_m = find_ground(&*drive, &chosen, task, &mut methods, notes)?;

    let mut maker = SampleMaker::new(&*drive, config, &motion, ground_z_m);
    let mut writer: Option<EpisodeWriter> = None;
    let mut log = LogFacts {
        format: task.format.name().to_owned(),
        drive: name.to_owned(),
        methods: Methods::new(),
        sample_names: BTreeMap::new(),
        first_cloud_sha256: String::new(),
        labelled: facts.is_labelled.then(|| config.labelled.facts(&config.categories)),
    };
    let (mut sample_names, mut is_empty, mut left_out) = (BTreeMap::new(), true, Vec::new());
    for (n_done, &sample_idx) in chosen.iter().enumerate() {
        interrupt::check()?;
        task.progress.note(&format!("{name}: sample {} of {}", n_done + 1, chosen.len()));
        let of_sample =
            |source| ImportError::Sample { drive: name.to_owned(), sample_idx, source: Box::new(source) };
        let mut write = || -> Result<bool, ImportError> {
            let Some((sample, views)) = maker.sample(sample_idx, notes)? else { return Ok(false) };
            let writer = match &mut writer {
                Some(writer) => writer,
                none => {
                    let cameras: Vec<String> = views.iter().map(|view| view.name.clone()).collect();
                    none.insert(start(task, name, facts, &log, &cameras)?)
                }
            };
            writer.write_with(&sample, &views)?;
            sample_names.extend(
                drive.sample_name(sample_idx).map(|name| (sample.measured.time_ns.to_string(), name)),
            );
            Ok(true)
        };
        match write().map_err(of_sample) {
            Ok(true) => {
                is_empty = false;
                if let Some(sha256) = maker.take_cloud_sha256() {
                    log.first_cloud_sha256 = sha256;
                }
            }
            Ok(false) => notes.tell("samples without annotations in a drive that has them were left out"),
            Err(error) if task.skip_bad && error.is_bad_data() => {
                let sentence = format!("a sample was left out: {error}");
                tracing::warn!("{sentence}");
                skipped.push(sentence);
                left_out.push(sample_idx);
            }
            Err(error) => return Err(error),
        }
    }
    if !left_out.is_empty() {
        let numbers: Vec<String> = left_out.iter().take(MOST_NUMBERS).map(ToString::to_string).collect();
        let more = if left_out.len() > numbers.len() { ", .." } else { "" };
        let sentence = format!(
            "{} of {} samples could not be read (--skip-bad): {}{more}",
            left_out.len(),
            chosen.len(),
            numbers.join(", ")
        );
        methods.insert(LogFacts::LEFT_OUT.into(), sentence);
    }
    let Some(mut writer) = writer.filter(|_| !is_empty) else { return Ok(None) };
    boxes.add(maker.boxes());
    if let Some(sentence) = maker.boxes().doubt() {
        notes.tell(sentence);
    }
    if maker.n_assumed() > 0 {
        notes.tell(format!(
            "the speed is not known at {} of {} samples, neither measured nor by poses close by; {} m/s is assumed (assumed.speed_mps)",
            maker.n_assumed(),
            chosen.len(),
            config.assumed.speed_mps
        ));
    }
    maker.tell_methods(&mut methods);
    let told: Vec<String> = notes.sentences().collect();
    if !told.is_empty() {
        methods.insert("notes".into(), told.join("; "));
    }
    (log.methods, log.sample_names) = (methods, sample_names);
    writer.set_log(&log, &facts.description);
    let finished = writer.finish()?;
    let ood = finished.n_objects.ood.values().into_iter().any(|n| *n > 0);
    Ok(Some(EpisodeEntry {
        name: name.to_owned(),
        file: Task::file(name),
        split: task.split,
        seed: 0,
        town: facts.town.clone(),
        weather: WEATHER.to_owned(),
        ood,
        n_samples: finished.n_samples,
        n_objects: finished.n_objects,
        sha256: finished.sha256,
    }))
}

/// No log says it in a form that all share.
const WEATHER: &str = "unknown";

fn start(
    task: &Task<'_>,
    name: &str,
    facts: &DriveFacts,
    log: &LogFacts,
    cameras: &[String],
) -> Result<EpisodeWriter, ImportError> {
    let meta = EpisodeMeta {
        name: name.to_owned(),
        seed: 0,
        town: facts.town.clone(),
        weather: WEATHER.to_owned(),
        ood: false,
        generator_version: env!("CARGO_PKG_VERSION").to_owned(),
        config_toml: task.config_toml.to_owned(),
        rig_toml: String::new(),
        n_samples: 0,
        background: String::new(),
    };
    Ok(EpisodeWriter::create_log(&task.out.join(Task::file(name)), &meta, log, cameras, &facts.map)?)
}

/// Every so many samples; of a drive with annotations only those that have some are counted.
fn choose_samples(drive: &dyn Drive, every: usize, notes: &mut Notes) -> Vec<usize> {
    let n_samples = drive.times_ns().len();
    let is_labelled = drive.facts().is_labelled;
    let of_use: Vec<usize> = (0..n_samples).filter(|&idx| !is_labelled || drive.is_annotated(idx)).collect();
    if of_use.len() < n_samples {
        let n_out = n_samples - of_use.len();
        notes.tell_share(n_out, n_samples, "samples have no annotations, in a drive that has some: left out");
    }
    of_use.into_iter().step_by(every).collect()
}

fn check_times(times_ns: &[u64], path: &Path) -> Result<(), ImportError> {
    if times_ns.is_empty() {
        return Err(ImportError::at(path, "the drive has no samples"));
    }
    match times_ns.windows(2).find(|pair| pair[0] >= pair[1]) {
        Some(pair) => {
            let message =
                format!("a sample at {} ns follows one at {} ns; rising times are needed", pair[1], pair[0]);
            Err(ImportError::at(path, message))
        }
        None => Ok(()),
    }
}

/// The ground's z in the importer's ego frame.
///
/// # Errors
/// A frame cannot be read, though it may be whole.
fn find_ground(
    drive: &dyn Drive,
    chosen: &[usize],
    task: &Task<'_>,
    methods: &mut Methods,
    notes: &mut Notes,
) -> Result<f64, ImportError> {
    let (guess_m, is_fitted) = match &drive.facts().ground {
        GroundHeight::Known { z_m, source } if task.config.ground == GroundSource::Calibration => {
            methods.insert("ground".into(), source.clone());
            return Ok(*z_m);
        }
        GroundHeight::Known { z_m, .. } => (*z_m, true),
        GroundHeight::Unknown { guess_m } => (*guess_m, false),
    };
    let step = chosen.len().div_ceil(N_GROUND_FRAMES).max(1);
    let (mut heights, mut tilts, mut n_read) = (Vec::new(), Vec::new(), 0);
    for &sample_idx in chosen.iter().step_by(step) {
        interrupt::check()?;
        // What is bad is told when the sample is imported.
        let frame = match drive.frame(sample_idx, &mut Notes::default()) {
            Err(error) if error.is_bad_data() => continue,
            frame => frame?,
        };
        n_read += 1;
        let finite = frame
            .points
            .iter()
            .map(super::RawPoint::position_m)
            .filter(|at| at.iter().all(|part| part.is_finite()));
        let points =
            finite.map(|at| frame.ego_from_lidar.isometry * nalgebra::Point3::from(at)).map(|at| at.coords);
        if let Some(fit) = fit_ground(points, guess_m) {
            heights.push(fit.z_m);
            tilts.push(fit.tilt_rad);
        }
    }
    let n_fitted = heights.len();
    if n_read == 0 {
        return Ok(guess_m);
    }
    let Some(z_m) = median(heights) else {
        let why = if is_fitted { "the calibration's" } else { "a guess" };
        notes.tell(format!("too little road is seen to fit the ground; it is taken at z {guess_m} m, {why}"));
        methods.insert(
            "ground".into(),
            format!("at z {guess_m} m of the log's ego frame, {why}: too little road is seen"),
        );
        return Ok(guess_m);
    };
    let tilt_rad = median(tilts).unwrap_or(0.0);
    if tilt_rad > MAX_TILT_RAD {
        let tilt_deg = tilt_rad.to_degrees();
        notes.tell(format!(
            "the road is tilted by {tilt_deg:.1} degrees against the ego's axes; less than 2 would be right"
        ));
    }
    let sentence = format!(
        "fitted to {n_fitted} clouds: {z_m:.3} m in the log's ego frame (tilted by {:.1} degrees); the origin was shifted to it",
        tilt_rad.to_degrees()
    );
    methods.insert("ground".into(), sentence);
    Ok(z_m)
}
