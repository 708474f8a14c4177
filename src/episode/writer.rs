//! Writes an episode: every topic of `docs/episode_format.md`, one chunk per sample.

use std::path::{Path, PathBuf};

use foxglove::messages as fox;

use super::archive::ArchiveWriter;
use super::drawing::{self, MapDrawing};
use super::error::{EpisodeError, MessageFault};
use super::manifest::ObjectCounts;
use super::messages::TopicMessage;
use super::{EpisodeMeta, LogFacts, OtherSensors, checks, convert, objects, regions, topics};
use crate::files::sha256_of;
use crate::geometry::{Camera, Frame, Lidar};
use crate::sample::{Around, CameraView, Sample};

/// The content of a finished episode, counted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FinishedEpisode {
    pub path: PathBuf,
    pub n_samples: usize,
    /// Annotated boxes, each sample counted anew.
    pub n_objects: ObjectCounts,
    /// Content hash of the file.
    pub sha256: String,
}

/// An episode being written under a partial name; dropped unfinished, it leaves nothing.
pub struct EpisodeWriter {
    archive: ArchiveWriter,
    meta: EpisodeMeta,
    /// `None` in a simulated episode.
    log: Option<LogFacts>,
    /// In the order in which they are written.
    others: OtherSensors,
    map: MapDrawing,
    /// Of a log, for the record `scene-info`.
    description: String,
    n_objects: ObjectCounts,
}

impl EpisodeWriter {
    /// Starts an episode; the folder must exist, and a file of that name is replaced on finish.
    ///
    /// # Errors
    /// The file cannot be made.
    pub fn create(path: &Path, meta: &EpisodeMeta, map: &MapDrawing) -> Result<Self, EpisodeError> {
        Self::start(path, meta, None, OtherSensors::default(), map)
    }

    /// Starts an episode of a rig with other sensors beside the front camera and the top LiDAR.
    ///
    /// # Errors
    /// The file cannot be made.
    pub fn create_rig(
        path: &Path,
        meta: &EpisodeMeta,
        others: OtherSensors,
        map: &MapDrawing,
    ) -> Result<Self, EpisodeError> {
        Self::start(path, meta, None, others, map)
    }

    /// Starts an episode that is imported from a log, with these cameras beside the front one.
    ///
    /// # Errors
    /// The file cannot be made.
    pub fn create_log(
        path: &Path,
        meta: &EpisodeMeta,
        log: &LogFacts,
        cameras: &[String],
        map: &MapDrawing,
    ) -> Result<Self, EpisodeError> {
        let others = OtherSensors { cameras: cameras.to_vec(), ..OtherSensors::default() };
        Self::start(path, meta, Some(log), others, map)
    }

    fn start(
        path: &Path,
        meta: &EpisodeMeta,
        log: Option<&LogFacts>,
        others: OtherSensors,
        map: &MapDrawing,
    ) -> Result<Self, EpisodeError> {
        let mut archive = ArchiveWriter::create(path, topics::OF_MEASURED)?;
        let has_truth = log.is_none_or(|log| log.labelled.is_some());
        for topic in has_truth.then_some(topics::OF_TRUTH).into_iter().flatten() {
            archive.declare(topic.name, topic.schema)?;
        }
        for name in &others.cameras {
            let [image, info] = topics::of_camera(name);
            archive.declare(&image, fox::CompressedImage::schema)?;
            archive.declare(&info, fox::CameraCalibration::schema)?;
        }
        for topic in others.clouds() {
            archive.declare(&topic, fox::PointCloud::schema)?;
        }
        Ok(Self {
            archive,
            meta: meta.clone(),
            log: log.cloned(),
            others,
            map: map.clone(),
            description: log.map(|log| format!("{} {}", log.format, log.drive)).unwrap_or_default(),
            n_objects: ObjectCounts::default(),
        })
    }

    /// Adds a sample; its time must be after the one before.
    ///
    /// # Errors
    /// A number that is not finite, a box without size, two objects of one id, a time that does not
    /// advance, a sample without truth in an episode with truth or the other way round, or the disk fails.
    pub fn write(&mut self, sample: &Sample) -> Result<(), EpisodeError> {
        self.write_around(sample, Around::default())
    }

    /// Adds a sample with the pictures of the further cameras, in the order in which the episode was started.
    ///
    /// # Errors
    /// As [`Self::write`]; other cameras than the episode's.
    pub fn write_with(&mut self, sample: &Sample, views: &[CameraView]) -> Result<(), EpisodeError> {
        self.write_around(sample, Around { views, ..Around::default() })
    }

    /// Adds a sample with what all other sensors measured, in the order in which the episode was started.
    ///
    /// # Errors
    /// As [`Self::write`]; other sensors than the episode's, or sweeps that are not between the last sample and this one.
    pub fn write_around(&mut self, sample: &Sample, around: Around<'_>) -> Result<(), EpisodeError> {
        self.check(sample, around).map_err(EpisodeError::invalid(
            &self.meta.name,
            self.archive.n_samples,
            &self.archive.path,
        ))?;
        self.write_unchecked(sample, around)
    }

    pub(super) fn write_unchecked(
        &mut self,
        sample: &Sample,
        around: Around<'_>,
    ) -> Result<(), EpisodeError> {
        let measured = &sample.measured;
        let (time_ns, archive) = (measured.time_ns, &mut self.archive);
        archive.begin_sample(time_ns)?;
        if !around.sweeps.is_empty() {
            // In a chunk of their own, so that who reads samples never unpacks them.
            for sweep in around.sweeps {
                archive.write_at(
                    sweep.time_ns,
                    &topics::of_sweeps(&sweep.lidar),
                    &convert::sweep_message(sweep),
                )?;
            }
            archive.end_chunk()?;
        }
        if archive.n_samples == 1 {
            archive.write(topics::MAP, &drawing::map_update(time_ns, &self.map))?;
        }
        archive.write(topics::TF, &convert::transforms_message(measured, around))?;
        archive.write(topics::EGO_POSE, &convert::pose_message(time_ns, &measured.world_from_ego))?;
        archive.write(topics::EGO_STATE, &convert::state_message(sample))?;
        archive.write(topics::IMAGE, &convert::image_message(time_ns, Camera::NAME, &measured.image))?;
        archive.write(
            topics::CAMERA_INFO,
            &convert::camera_message(time_ns, Camera::NAME, &measured.intrinsics),
        )?;
        archive.write(topics::LIDAR, &convert::cloud_message(time_ns, Lidar::NAME, &measured.points))?;
        if let Some(truth) = &sample.truth {
            archive.write(topics::OBJECTS, &objects::objects_message(time_ns, &truth.objects))?;
            archive.write(topics::MARKERS, &drawing::truth_markers(time_ns, &truth.objects))?;
            archive.write(topics::IGNORED, &regions::regions_message(time_ns, &truth.ignored))?;
        }
        for view in around.views {
            let [image, info] = topics::of_camera(&view.name);
            archive.write_named(&image, &convert::image_message(time_ns, &view.name, &view.image))?;
            archive.write_named(&info, &convert::camera_message(time_ns, &view.name, &view.intrinsics))?;
        }
        for cloud in around.clouds {
            let message = convert::cloud_message(time_ns, &cloud.name, &cloud.points);
            archive.write_named(&topics::of_lidar(&cloud.name), &message)?;
        }
        archive.end_chunk()?;
        for object in sample.objects() {
            *self.n_objects.of_mut(object).expect("the facts of objects were checked") += 1;
        }
        Ok(())
    }

    /// Replaces the facts of a log, of which some are known only when all of it was read. What is annotated stays.
    /// The description is a sentence for the record `scene-info`.
    pub fn set_log(&mut self, log: &LogFacts, description: &str) {
        self.log = Some(log.clone());
        description.clone_into(&mut self.description);
    }

    /// Whether a reader will accept the sample.
    fn check(&self, sample: &Sample, around: Around<'_>) -> Result<(), MessageFault> {
        convert::check_measured(&sample.measured)?;
        checks::check_measured(&sample.measured)?;
        let has_truth = self.log.as_ref().is_none_or(|log| log.labelled.is_some());
        if has_truth != sample.truth.is_some() {
            let wanted = if has_truth { "a log that annotates" } else { "a log that annotates nothing" };
            let found = if has_truth { "missing" } else { "there" };
            return Err(MessageFault::new(
                "truth",
                format!("{found} in the episode of {wanted}"),
                "each sample has truth, or none has",
            ));
        }
        sample.objects().iter().try_for_each(objects::check_object)?;
        if let Some(truth) = &sample.truth {
            truth.ignored.iter().try_for_each(regions::check_region)?;
            truth.ego_state.iter().try_for_each(convert::check_state)?;
        }
        self.others.check(around, self.archive.last_ns(), sample.measured.time_ns)?;
        check_ids(sample)
    }

    /// Writes the metadata and the index, and gives the file its name.
    ///
    /// # Errors
    /// No sample was written, or the disk fails.
    pub fn finish(self) -> Result<FinishedEpisode, EpisodeError> {
        let n_samples = self.archive.n_samples;
        let mut meta = EpisodeMeta { n_samples, ..self.meta };
        let (description, vehicle) = match &self.log {
            None => {
                (format!("{} in {}, seed {}", meta.weather, meta.town, meta.seed), "harmzone ego".to_owned())
            }
            Some(log) => {
                meta.ood = self.n_objects.ood.values().into_iter().any(|n_objects| *n_objects > 0);
                (self.description, format!("{} ego", log.format))
            }
        };
        let scene = [
            ("name", meta.name.clone()),
            ("description", description),
            ("location", meta.town.clone()),
            ("vehicle", vehicle),
        ];
        let scene = scene.map(|(key, value)| (key.to_owned(), value)).into();
        let log = self.log.map(|log| (LogFacts::RECORD, log.to_record()));
        let records = [(EpisodeMeta::RECORD, meta.to_record()), ("scene-info", scene)];
        let path = self.archive.finish(records.into_iter().chain(log))?;
        let sha256 = sha256_of(&path)?;
        Ok(FinishedEpisode { path, n_samples, n_objects: self.n_objects, sha256 })
    }
}

#[cfg(test)]
impl EpisodeWriter {
    /// One message too many on one topic.
    pub(super) fn extra_objects_for_test(&mut self) {
        let message = objects::objects_message(0, &[]);
        self.archive.write(topics::OBJECTS, &message).expect("a test's disk has room");
    }
}

fn check_ids(sample: &Sample) -> Result<(), MessageFault> {
    let mut ids: Vec<&str> = sample.objects().iter().filter_map(|object| object.id.as_deref()).collect();
    ids.sort_unstable();
    match ids.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(pair) => Err(MessageFault::new("id", "there twice", "each object needs its own").of(pair[0])),
        None => Ok(()),
    }
}
