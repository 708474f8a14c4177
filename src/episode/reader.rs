//! Reads an episode back, sample by sample, and refuses values that no consumer could use.

use std::path::Path;
use std::sync::OnceLock;

use foxglove::messages as fox;

use super::archive_reader::{Archive, SampleMessages};
use super::error::{EpisodeError, MessageFault};
use super::manifest::{EpisodeEntry, Manifest};
use super::messages::wire;
use super::{
    EpisodeMeta, LogFacts, MapDrawing, OtherSensors, checks, convert, drawing, objects, regions, topics,
};
use crate::object::Object;
use crate::sample::{CameraView, LidarView, Measured, Sample, Sweep, Truth};
use crate::store::sha256_of;

/// An episode of which the index has been read; samples are read when asked for.
///
/// No file stays open in between, so that a data set may hold thousands.
///
/// ```
/// # use harmzone::episode::{EpisodeMeta, EpisodeWriter, MapDrawing};
/// # use harmzone::geometry::{Pinhole, Transform};
/// # use harmzone::sample::{EgoState, EncodedImage, ImageFormat, LidarPoint, Measured, Sample, Truth};
/// use harmzone::episode::EpisodeReader;
///
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("oldtown-ClearNoon-7.mcap");
/// # let text = String::new;
/// # let meta = EpisodeMeta {
/// #     name: "oldtown-ClearNoon-7".into(), seed: 7, town: "oldtown".into(), weather: "ClearNoon".into(), ood: false,
/// #     generator_version: text(), config_toml: text(), rig_toml: text(), n_samples: 1, background: text(),
/// # };
/// # let measured = Measured {
/// #     time_ns: 1_700_000_000_000_000_000,
/// #     ego_state: EgoState {
/// #         speed_mps: 8.0, steering_angle_rad: 0.0, yaw_rate_rps: 0.0, acceleration_mps2: 0.0, wheelbase_m: 2.7,
/// #         front_bumper_x_m: 3.6,
/// #     },
/// #     world_from_ego: Transform::from_xyz_yaw(0.0, 0.0, 0.0, 0.0),
/// #     ego_from_lidar: Transform::from_xyz_yaw(1.2, 0.0, 1.9, 0.0),
/// #     ego_from_camera: Transform::looking_forward([1.5, 0.0, 1.6].into(), 0.0),
/// #     intrinsics: Pinhole::from_horizontal_fov(800, 450, 1.2),
/// #     image: EncodedImage { format: ImageFormat::Png, bytes: Vec::new() },
/// #     points: vec![LidarPoint { x_m: 10.0, y_m: 0.0, z_m: -1.0, intensity: 20.0, ring: 3 }],
/// # };
/// # let mut writer = EpisodeWriter::create(&path, &meta, &MapDrawing::default())?;
/// # writer.write(&Sample { measured, truth: Some(Truth::default()) })?;
/// # writer.finish()?;
/// let episode = EpisodeReader::open(&path)?;
/// assert_eq!(episode.meta().town, "oldtown");
/// for sample in episode.samples() {
///     let sample = sample?;
///     let n_points = sample.measured.points.len();
///     println!("{} m/s, {n_points} LiDAR points", sample.measured.ego_state.speed_mps);
///     println!("{} objects around", sample.objects().len());
/// }
/// let third = episode.sample(2);
/// assert_eq!(third.unwrap_err().to_string().split(": ").next(), Some("there is no sample 2; the file has 1"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct EpisodeReader {
    archive: Archive,
    meta: EpisodeMeta,
    log: Option<LogFacts>,
    /// Whether its samples have truth.
    has_truth: bool,
    others: OtherSensors,
    /// Log times of the samples, in order.
    times_ns: Vec<u64>,
    /// What intensities are multiplied by: 255 where they are from 0 to 1.
    intensity_scale: OnceLock<f32>,
}

/// Whether anybody annotated any episode of a data set's folder, so that they can be labelled and scored.
///
/// # Errors
/// As [`EpisodeReader::open`].
pub fn is_any_annotated(dataset: &Path, manifest: &Manifest) -> Result<bool, EpisodeError> {
    for entry in &manifest.episodes {
        if EpisodeReader::open(&dataset.join(&entry.file))?.has_truth() {
            return Ok(true);
        }
    }
    Ok(false)
}

impl EpisodeReader {
    /// Opens an episode and checks its topics, schemas and counts.
    ///
    /// # Errors
    /// A truncated or damaged file, an MCAP that is not an episode, missing metadata, or topics that
    /// do not hold one message per sample.
    pub fn open(path: &Path) -> Result<Self, EpisodeError> {
        let mut archive = Archive::open(path, topics::EACH_SAMPLE)?;
        let meta =
            EpisodeMeta::from_record(&archive.metadata(EpisodeMeta::RECORD)?, EpisodeMeta::RECORD, path)?;
        let log = LogFacts::from_record(&archive.metadata(LogFacts::RECORD)?, path)?;
        let others = OtherSensors::of(&mut archive)?;
        let mut wanted: Vec<String> = topics::EACH_SAMPLE.iter().map(|topic| topic.name.to_owned()).collect();
        for optional in [topics::OBJECTS.spec(), topics::IGNORED.spec()] {
            archive.take(optional.name, optional.schema)?;
            wanted.extend(archive.has(optional.name).then(|| optional.name.to_owned()));
        }
        archive.take(topics::MAP.name, topics::MAP.spec().schema)?;
        wanted.extend(others.each_sample());
        for topic in &wanted {
            archive.check_count(topic, meta.n_samples)?;
        }
        let times_ns = archive.times(topics::EGO_STATE.name)?;
        archive.check_count(topics::EGO_STATE.name, times_ns.len())?;
        let has_truth = archive.has(topics::OBJECTS.name);
        Ok(Self { archive, meta, log, has_truth, others, times_ns, intensity_scale: OnceLock::new() })
    }

    /// Opens an episode of a data set's folder, and checks that it is the file of which the manifest speaks.
    ///
    /// # Errors
    /// As [`Self::open`]; another content hash or number of samples than the manifest's.
    pub fn open_entry(dataset: &Path, entry: &EpisodeEntry) -> Result<Self, EpisodeError> {
        let reader = Self::open(&dataset.join(&entry.file))?;
        let found = sha256_of(reader.path())?;
        if found != entry.sha256 {
            let (wanted, path) = (entry.sha256.clone(), reader.path().to_owned());
            return Err(EpisodeError::OtherContent { found, wanted, path });
        }
        reader.with_samples_of(entry)
    }

    /// The same for an episode whose content was checked before.
    ///
    /// # Errors
    /// As [`Self::open`]; another number of samples than the manifest's.
    pub fn open_known(dataset: &Path, entry: &EpisodeEntry) -> Result<Self, EpisodeError> {
        Self::open(&dataset.join(&entry.file))?.with_samples_of(entry)
    }

    fn with_samples_of(self, entry: &EpisodeEntry) -> Result<Self, EpisodeError> {
        if self.len() == entry.n_samples {
            return Ok(self);
        }
        let (found, wanted, path) = (self.len(), entry.n_samples, self.path().to_owned());
        Err(EpisodeError::SampleCount { found, wanted, path })
    }

    #[must_use]
    pub fn path(&self) -> &Path {
        &self.archive.path
    }

    #[must_use]
    pub fn meta(&self) -> &EpisodeMeta {
        &self.meta
    }

    /// What an imported episode says of its log; `None` for a simulated one.
    #[must_use]
    pub fn log(&self) -> Option<&LogFacts> {
        self.log.as_ref()
    }

    /// Whether the samples have truth, so that they can be labelled and scored.
    #[must_use]
    pub fn has_truth(&self) -> bool {
        self.has_truth
    }

    /// Names of the cameras beside the front one, sorted.
    #[must_use]
    pub fn cameras(&self) -> &[String] {
        &self.others.cameras
    }

    /// Names of the LiDARs beside the top one, sorted.
    #[must_use]
    pub fn lidars(&self) -> &[String] {
        &self.others.lidars
    }

    /// Names of the LiDARs that have sweeps between samples, sorted.
    #[must_use]
    pub fn sweeping(&self) -> &[String] {
        &self.others.sweeping
    }

    /// How many samples there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.times_ns.len()
    }

    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.times_ns.is_empty()
    }

    /// Times of the samples, in order.
    #[must_use]
    pub fn times_ns(&self) -> &[u64] {
        &self.times_ns
    }

    /// Reads one sample, its points cut to the camera's horizontal field of view, and those on objects counted so.
    ///
    /// # Errors
    /// No such sample, damage, or a value that is not usable: the error names episode, sample,
    /// object and field.
    pub fn sample(&self, sample_idx: usize) -> Result<Sample, EpisodeError> {
        let mut sample = self.whole_sample(sample_idx)?;
        checks::cut_to_view(&mut sample);
        Ok(sample)
    }

    /// Reads one sample with all points that the file holds, in an imported episode those of the whole turn.
    ///
    /// # Errors
    /// As [`Self::sample`].
    pub fn whole_sample(&self, sample_idx: usize) -> Result<Sample, EpisodeError> {
        let messages = self.messages(sample_idx)?;
        let tf = messages.one(topics::TF)?;
        let state = messages.one(topics::EGO_STATE)?;
        let image = messages.one(topics::IMAGE)?;
        let camera = messages.one(topics::CAMERA_INFO)?;
        let cloud = messages.one(topics::LIDAR)?;
        let truth = self.has_truth.then(|| messages.one(topics::OBJECTS)).transpose()?;
        let ignored =
            self.archive.has(topics::IGNORED.name).then(|| messages.one(topics::IGNORED)).transpose()?;
        let build = || -> Result<Sample, MessageFault> {
            let (ego_state, true_state) = convert::states_of(&state)?;
            let mut measured = Measured {
                time_ns: self.times_ns[sample_idx],
                ego_state,
                world_from_ego: convert::transform_of(&tf)?,
                ego_from_lidar: convert::transform_of(&tf)?,
                ego_from_camera: convert::transform_of(&tf)?,
                intrinsics: convert::camera_of(&camera)?,
                image: convert::image_of(image)?,
                points: convert::points_of(&cloud)?,
            };
            checks::bring_into_lidar(&cloud, &measured.ego_from_lidar, &mut measured.points)?;
            checks::check_measured(&measured)?;
            let ignored = ignored.map_or_else(Vec::new, |message| message.regions);
            let ignored = ignored.into_iter().map(regions::region_of).collect::<Result<_, _>>()?;
            let objects = truth.map(|truth| truth.objects.into_iter().map(|object| self.object_of(object)));
            let objects = objects.map(Iterator::collect::<Result<Vec<_>, _>>).transpose()?;
            let truth = objects.map(|objects| Truth { objects, ignored, ego_state: true_state });
            Ok(Sample { measured, truth })
        };
        let mut sample = build().map_err(EpisodeError::invalid(&self.meta.name, sample_idx, self.path()))?;
        if checks::has_unit_intensity(&sample.measured.points) {
            let scale = self.intensity_scale()?;
            sample.measured.points.iter_mut().for_each(|point| point.intensity *= scale);
        }
        Ok(sample)
    }

    /// The drawing of the map; empty if the file has none.
    ///
    /// # Errors
    /// Damage.
    pub fn map(&self) -> Result<MapDrawing, EpisodeError> {
        if self.is_empty() || !self.archive.has(topics::MAP.name) {
            return Ok(MapDrawing::default());
        }
        let map = drawing::map_of(&self.messages(0)?.one(topics::MAP)?);
        map.map_err(EpisodeError::invalid(&self.meta.name, 0, self.path()))
    }

    /// The pictures of the cameras beside the front one.
    ///
    /// # Errors
    /// As [`Self::sample`].
    pub fn views(&self, sample_idx: usize) -> Result<Vec<CameraView>, EpisodeError> {
        let messages = self.messages(sample_idx)?;
        let tf = messages.one(topics::TF)?;
        let read = |name: &String| {
            let [image, info] = topics::of_camera(name);
            let (image, info) = (messages.one_named(&image)?, messages.one_named(&info)?);
            let build = || -> Result<CameraView, MessageFault> {
                let (image, intrinsics) = (convert::image_of(image)?, convert::camera_of(&info)?);
                checks::check_picture_size(&image, &intrinsics)?;
                let ego_from_camera = convert::transform_to(&tf, name)?;
                Ok(CameraView { name: name.clone(), ego_from_camera, intrinsics, image })
            };
            build().map_err(EpisodeError::invalid(&self.meta.name, sample_idx, self.path()))
        };
        self.others.cameras.iter().map(read).collect()
    }

    /// The clouds of the LiDARs beside the top one.
    ///
    /// # Errors
    /// As [`Self::sample`].
    pub fn clouds(&self, sample_idx: usize) -> Result<Vec<LidarView>, EpisodeError> {
        let messages = self.messages(sample_idx)?;
        let tf = messages.one(topics::TF)?;
        let read = |name: &String| {
            let cloud: fox::PointCloud = messages.one_named(&topics::of_lidar(name))?;
            let build = || -> Result<LidarView, MessageFault> {
                let (ego_from_lidar, points) =
                    (convert::transform_to(&tf, name)?, convert::points_of(&cloud)?);
                Ok(LidarView { name: name.clone(), ego_from_lidar, points })
            };
            build().map_err(EpisodeError::invalid(&self.meta.name, sample_idx, self.path()))
        };
        self.others.lidars.iter().map(read).collect()
    }

    /// The clouds between the sample before and this one, in order of time; before the first sample there is none.
    ///
    /// # Errors
    /// As [`Self::sample`].
    pub fn sweeps(&self, sample_idx: usize) -> Result<Vec<Sweep>, EpisodeError> {
        let Some(before) = sample_idx.checked_sub(1).filter(|_| sample_idx < self.len()) else {
            return Ok(Vec::new());
        };
        let (begin_ns, end_ns) = (self.times_ns[before], self.times_ns[sample_idx]);
        let topics: Vec<String> = self.others.sweeping.iter().map(|name| topics::of_sweeps(name)).collect();
        let read = |(topic, time_ns, cloud): (String, u64, fox::PointCloud)| {
            let lidar = topics::lidar_of_sweeps(&topic).expect("only such topics are asked for").to_owned();
            let build = || -> Result<Sweep, MessageFault> {
                let world_from_lidar = checks::pose_in_world(&cloud)?;
                Ok(Sweep { lidar, time_ns, world_from_lidar, points: convert::points_of(&cloud)? })
            };
            build().map_err(EpisodeError::invalid(&self.meta.name, sample_idx, self.path()))
        };
        self.archive.all_between(&topics, begin_ns, end_ns)?.into_iter().map(read).collect()
    }

    /// All samples in order.
    pub fn samples(&self) -> impl Iterator<Item = Result<Sample, EpisodeError>> + '_ {
        (0..self.len()).map(|sample_idx| self.sample(sample_idx))
    }

    fn messages(&self, sample_idx: usize) -> Result<SampleMessages<'_>, EpisodeError> {
        let Some(&time_ns) = self.times_ns.get(sample_idx) else {
            let (n_samples, path) = (self.len(), self.path().to_owned());
            return Err(EpisodeError::NoSample { sample_idx, n_samples, path });
        };
        self.archive.sample(sample_idx, time_ns)
    }

    /// The object in a message. Files from before visibility could be unknown leave out zeros.
    fn object_of(&self, message: wire::Object) -> Result<Object, MessageFault> {
        let mut object = objects::object_of(message)?;
        if self.log.is_none() {
            object.visible_px.get_or_insert(0);
            object.visible_fraction.get_or_insert(0.0);
        }
        Ok(object)
    }

    /// Whether a cloud that was read had intensities from 0 to 1, so that they are multiplied by 255.
    #[must_use]
    pub fn scales_intensity(&self) -> bool {
        self.intensity_scale.get().is_some_and(|&scale| scale > 1.0)
    }

    /// What intensities are multiplied by, found once from the first, the middle and the last cloud: those of a dark
    /// scene may be low by chance.
    fn intensity_scale(&self) -> Result<f32, EpisodeError> {
        if let Some(&scale) = self.intensity_scale.get() {
            return Ok(scale);
        }
        let mut is_unit = true;
        for sample_idx in [0, self.len() / 2, self.len() - 1] {
            let cloud = self.messages(sample_idx)?.one(topics::LIDAR)?;
            let points = convert::points_of(&cloud);
            let points = points.map_err(EpisodeError::invalid(&self.meta.name, sample_idx, self.path()))?;
            is_unit &= points.is_empty() || checks::has_unit_intensity(&points);
        }
        let scale = if is_unit { 255.0 } else { 1.0 };
        if is_unit && self.intensity_scale.set(scale).is_ok() {
            tracing::warn!(
                "episode `{}`: intensities are from 0 to 1 and are multiplied by 255: {}",
                self.meta.name,
                self.path().display()
            );
        }
        Ok(scale)
    }
}
