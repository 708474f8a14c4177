//! One drive to one episode: each sample read, brought into form, written.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::Isometry3;

use super::cloud::CloudMaker;
use super::config::GroundSource;
use super::ground::{fit_ground, median};
use super::motion::{Motion, signed_s};
use super::objects::{count_points, truth_of};
use super::pictures::{is_changed, view_of, virtual_view};
use super::run::Task;
use super::state::StateMaker;
use super::{Drive, DriveFacts, Frame, Ground, ImportError, Notes, RawCamera, odometry};
use crate::episode::{EpisodeEntry, EpisodeMeta, EpisodeWriter, LogFacts};
use crate::geometry::{Ego, Transform, World};
use crate::sample::{CameraView, Measured, Sample};

/// Frames to which the ground is fitted, spread over the drive.
const N_GROUND_FRAMES: usize = 10;
/// More slope than this between the ego's axes and the road is told.
const MAX_TILT_RAD: f64 = 0.035;

type Methods = BTreeMap<String, String>;

/// Imports a drive; `None` if every sample was passed over.
pub(super) fn import_drive(
    task: &Task<'_>,
    name: &str,
    notes: &mut Notes,
    skipped: &mut Vec<String>,
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
    let chosen: Vec<usize> = (0..drive.times_ns().len()).step_by(config.every as usize).collect();
    let mut methods = Methods::new();
    methods.insert("description".into(), facts.description.clone());
    methods.extend(facts.methods.iter().map(|(part, sentence)| ((*part).to_owned(), sentence.clone())));
    let ground_z_m = find_ground(&*drive, &chosen, task, &mut methods, notes)?;

    let mut maker = SampleMaker {
        drive: &*drive,
        task,
        motion: &motion,
        ground_z_m,
        states: StateMaker::new(&motion, facts, config),
        clouds: CloudMaker::new(config, &motion, facts.compensated.is_some()),
        picture: "no picture",
    };
    let mut writer: Option<EpisodeWriter> = None;
    let mut log = LogFacts {
        format: task.format.name().to_owned(),
        drive: name.to_owned(),
        methods: Methods::new(),
        sample_names: BTreeMap::new(),
        labelled: facts.is_labelled.then(|| config.labelled.facts(&config.categories)),
    };
    let mut sample_names = BTreeMap::new();
    for (n_done, &sample_idx) in chosen.iter().enumerate() {
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
            Ok(true) => {}
            Ok(false) => notes.tell("samples without annotations in a drive that has them were left out"),
            Err(error) if task.options.skip_bad && error.is_bad_data() => {
                let sentence = format!("a sample was left out: {error}");
                tracing::warn!("{sentence}");
                skipped.push(sentence);
            }
            Err(error) => return Err(error),
        }
    }
    let Some(mut writer) = writer else { return Ok(None) };
    maker.tell_methods(facts, &mut methods);
    let told: Vec<String> = notes.sentences().collect();
    if !told.is_empty() {
        methods.insert("notes".into(), told.join("; "));
    }
    (log.methods, log.sample_names) = (methods, sample_names);
    writer.set_log(&log);
    let finished = writer.finish()?;
    let ood = finished.n_objects.ood.values().into_iter().any(|n| *n > 0);
    Ok(Some(EpisodeEntry {
        name: name.to_owned(),
        file: Task::file(name),
        split: task.options.split,
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
    };
    Ok(EpisodeWriter::create_log(&task.out.join(Task::file(name)), &meta, log, cameras, &facts.map)?)
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
fn find_ground(
    drive: &dyn Drive,
    chosen: &[usize],
    task: &Task<'_>,
    methods: &mut Methods,
    notes: &mut Notes,
) -> Result<f64, ImportError> {
    let (guess_m, is_fitted) = match &drive.facts().ground {
        Ground::Known { z_m, source } if task.config.ground == GroundSource::Calibration => {
            methods.insert("ground".into(), source.clone());
            return Ok(*z_m);
        }
        Ground::Known { z_m, .. } => (*z_m, true),
        Ground::Unknown { guess_m } => (*guess_m, false),
    };
    let step = chosen.len().div_ceil(N_GROUND_FRAMES).max(1);
    let (mut heights, mut tilts) = (Vec::new(), Vec::new());
    for &sample_idx in chosen.iter().step_by(step) {
        // What is bad is told when the sample is imported.
        let Ok(frame) = drive.frame(sample_idx, &mut Notes::default()) else { continue };
        let finite = frame
            .points
            .iter()
            .map(|point| point.position_m())
            .filter(|at| at.iter().all(|part| part.is_finite()));
        let points =
            finite.map(|at| frame.ego_from_lidar.isometry * nalgebra::Point3::from(at)).map(|at| at.coords);
        if let Some(fit) = fit_ground(points, guess_m) {
            heights.push(fit.z_m);
            tilts.push(fit.tilt_rad);
        }
    }
    let n_fitted = heights.len();
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

/// Makes the samples of a drive.
struct SampleMaker<'a> {
    drive: &'a dyn Drive,
    task: &'a Task<'a>,
    motion: &'a Motion<'a>,
    ground_z_m: f64,
    states: StateMaker<'a>,
    clouds: CloudMaker<'a>,
    /// How the front picture came about.
    picture: &'static str,
}

impl SampleMaker<'_> {
    /// A sample and the views of further cameras; `None` where a drive with annotations has none.
    fn sample(
        &mut self,
        sample_idx: usize,
        notes: &mut Notes,
    ) -> Result<Option<(Sample, Vec<CameraView>)>, ImportError> {
        let facts = self.drive.facts();
        let fail = |message: String| ImportError::at(&facts.path, message);
        let time_ns = self.drive.times_ns()[sample_idx];
        let mut frame = self.drive.frame(sample_idx, notes)?;
        if frame.objects.is_none() && facts.is_labelled {
            return Ok(None);
        }
        let world_from_ego = self.world_from_ego(time_ns).map_err(fail)?;
        // Before the shift to the ground, since the poses are of the importer's ego frame.
        let points = std::mem::take(&mut frame.points);
        let (ego_from_lidar, points) =
            self.clouds.cloud(frame.ego_from_lidar, points, time_ns, notes).map_err(fail)?;
        frame.ego_from_lidar = ego_from_lidar;
        self.lower_to_ground(&mut frame);
        let ego_from_lidar = frame.ego_from_lidar;
        let truth = match frame.objects.filter(|_| facts.is_labelled) {
            None => None,
            Some(objects) => {
                let mut truth = truth_of(objects, frame.ignored, self.task.config, &facts.path)?;
                count_points(&mut truth, &ego_from_lidar, &points);
                Some(truth)
            }
        };
        let front = match &frame.camera {
            None => virtual_view(),
            Some(camera) => {
                self.picture = if is_changed(camera) {
                    "rectified or packed as JPEG"
                } else {
                    "the log's, byte by byte"
                };
                self.view(camera, time_ns).map_err(fail)?
            }
        };
        let views = frame.other_cameras.iter().map(|camera| self.view(camera, time_ns));
        let views = views.collect::<Result<Vec<CameraView>, String>>().map_err(fail)?;
        let measured = Measured {
            time_ns,
            ego_state: self.states.state_at(time_ns),
            world_from_ego,
            ego_from_lidar,
            ego_from_camera: front.ego_from_camera,
            intrinsics: front.intrinsics,
            image: front.image,
            points,
        };
        Ok(Some((Sample { measured, truth }, views)))
    }

    /// Shifts a frame so that the ego's z = 0 is the ground.
    fn lower_to_ground(&self, frame: &mut Frame) {
        let lift = self.on_ground_from_ego();
        frame.ego_from_lidar = lift * frame.ego_from_lidar;
        for camera in frame.camera.iter_mut().chain(&mut frame.other_cameras) {
            camera.ego_from_camera = lift * camera.ego_from_camera;
        }
        for object in frame.objects.iter_mut().flatten() {
            object.box_in_ego.center = lift * object.box_in_ego.center;
        }
    }

    fn on_ground_from_ego(&self) -> Transform<Ego, Ego> {
        Transform::from_xyz_yaw(0.0, 0.0, -self.ground_z_m, 0.0)
    }

    /// The pose of the shifted ego frame. An error is a sentence.
    fn world_from_ego(&self, time_ns: u64) -> Result<Transform<World, Ego>, String> {
        if !self.motion.has_poses() {
            return Ok(Transform::from_isometry(Isometry3::identity()));
        }
        let Some(pose) = self.motion.pose_at(time_ns) else {
            let nearest = self.motion.nearest_pose_ns(time_ns).unwrap_or_default();
            return Err(format!(
                "no pose belongs to the sample at {time_ns} ns: the nearest is at {nearest} ns, and at most {} s between them is needed \
                 (stamp_tolerance_s)",
                self.task.config.stamp_tolerance_s
            ));
        };
        Ok(pose * self.on_ground_from_ego().inverse())
    }

    fn view(&self, camera: &RawCamera, time_ns: u64) -> Result<CameraView, String> {
        let config = self.task.config;
        let apart_s = signed_s(time_ns, camera.time_ns);
        if apart_s.abs() > config.stamp_tolerance_s {
            return Err(format!(
                "the picture of `{}` was taken at {} ns, {apart_s:.3} s from the sample at {time_ns} ns; at most {} s is needed \
                 (stamp_tolerance_s)",
                camera.name, camera.time_ns, config.stamp_tolerance_s
            ));
        }
        view_of(camera, config.jpeg_quality)
    }

    /// What was found out on the way.
    fn tell_methods(&self, facts: &DriveFacts, methods: &mut Methods) {
        for (part, sentence) in &self.states.methods {
            methods.insert((*part).to_owned(), sentence.clone());
        }
        let rings = match &facts.rings {
            _ if self.clouds.has_ringed => "computed from the points' elevation".to_owned(),
            Some(sentence) => sentence.clone(),
            None => "the log's".to_owned(),
        };
        let motion = match &facts.compensated {
            _ if self.clouds.has_moved => "each point moved by the poses to the sample's time".to_owned(),
            Some(sentence) => sentence.clone(),
            None => "not compensated: the points have no stamps, or there are no poses".to_owned(),
        };
        let is_unit = self.clouds.is_unit == Some(true);
        let intensity =
            if is_unit { "0 to 1 in the log, scaled by 255" } else { "0 to 255 in the log, as it is" };
        let axes = if self.clouds.has_turned {
            "turned by quarter turns about z, so that x points ahead"
        } else {
            "the log's"
        };
        let camera = match self.picture {
            "no picture" => {
                "none: a black picture of a virtual camera (70 degrees, 800 x 450, at x 1.5 m, z 1.6 m) stands for it"
            }
            picture => picture,
        };
        let parts = [
            ("rings", rings.as_str()),
            ("motion", motion.as_str()),
            ("intensity", intensity),
            ("lidar_axes", axes),
        ];
        for (part, sentence) in parts {
            methods.insert(part.to_owned(), sentence.to_owned());
        }
        let told = methods.entry("camera".to_owned()).or_default();
        *told = if told.is_empty() { camera.to_owned() } else { format!("{told}; {camera}") };
    }
}
