//! Writes an episode: every topic of `docs/episode_format.md`, one chunk per sample.

use std::path::{Path, PathBuf};

use fs_err as fs;

use super::archive::ArchiveWriter;
use super::drawing::{self, MapDrawing};
use super::error::{EpisodeError, MessageFault};
use super::manifest::ObjectCounts;
use super::{EpisodeMeta, convert, objects, topics};
use crate::files::sha256_hex;
use crate::sample::Sample;

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
    map: MapDrawing,
    n_objects: ObjectCounts,
}

impl EpisodeWriter {
    /// Starts an episode; the folder must exist, and a file of that name is replaced on finish.
    ///
    /// # Errors
    /// The file cannot be made.
    pub fn create(path: &Path, meta: &EpisodeMeta, map: &MapDrawing) -> Result<Self, EpisodeError> {
        Ok(Self {
            archive: ArchiveWriter::create(path, topics::OF_EPISODE)?,
            meta: meta.clone(),
            map: map.clone(),
            n_objects: ObjectCounts::default(),
        })
    }

    /// Adds a sample; its time must be after the one before.
    ///
    /// # Errors
    /// A number that is not finite, a box without size, two objects of one id, a time that does not
    /// advance, or the disk fails.
    pub fn write(&mut self, sample: &Sample) -> Result<(), EpisodeError> {
        check(sample).map_err(EpisodeError::invalid(
            &self.meta.name,
            self.archive.n_samples,
            &self.archive.path,
        ))?;
        self.write_unchecked(sample)
    }

    pub(super) fn write_unchecked(&mut self, sample: &Sample) -> Result<(), EpisodeError> {
        let (measured, truths) = (&sample.measured, &sample.truth.objects);
        let (time_ns, archive) = (measured.time_ns, &mut self.archive);
        archive.begin_sample(time_ns)?;
        if archive.n_samples == 1 {
            archive.write(topics::MAP, &drawing::map_update(time_ns, &self.map))?;
        }
        archive.write(topics::TF, &convert::transforms_message(measured))?;
        archive.write(topics::EGO_POSE, &convert::pose_message(time_ns, &measured.world_from_ego))?;
        archive.write(topics::EGO_STATE, &convert::state_message(time_ns, &measured.ego_state))?;
        archive.write(topics::IMAGE, &convert::image_message(time_ns, &measured.image))?;
        archive.write(topics::CAMERA_INFO, &convert::camera_message(time_ns, &measured.intrinsics))?;
        archive.write(topics::LIDAR, &convert::cloud_message(time_ns, &measured.points))?;
        archive.write(topics::OBJECTS, &objects::objects_message(time_ns, truths))?;
        archive.write(topics::MARKERS, &drawing::truth_markers(time_ns, truths))?;
        archive.end_chunk()?;
        for object in truths {
            *self.n_objects.of_mut(object).expect("the facts of objects were checked") += 1;
        }
        Ok(())
    }

    /// Writes the metadata and the index, and gives the file its name.
    ///
    /// # Errors
    /// No sample was written, or the disk fails.
    pub fn finish(self) -> Result<FinishedEpisode, EpisodeError> {
        let n_samples = self.archive.n_samples;
        let meta = EpisodeMeta { n_samples, ..self.meta };
        let scene = [
            ("name", meta.name.clone()),
            ("description", format!("{} in {}, seed {}", meta.weather, meta.town, meta.seed)),
            ("location", meta.town.clone()),
            ("vehicle", "harmzone ego".to_owned()),
        ];
        let scene = scene.map(|(key, value)| (key.to_owned(), value)).into();
        let path = self.archive.finish([(EpisodeMeta::RECORD, meta.to_record()), ("scene-info", scene)])?;
        let sha256 = sha256_hex(&fs::read(&path)?);
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

/// Whether a reader will accept the sample.
fn check(sample: &Sample) -> Result<(), MessageFault> {
    convert::check_measured(&sample.measured)?;
    sample.truth.objects.iter().try_for_each(objects::check_object)?;
    check_ids(sample)
}

fn check_ids(sample: &Sample) -> Result<(), MessageFault> {
    let mut ids: Vec<&str> = sample.truth.objects.iter().filter_map(|object| object.id.as_deref()).collect();
    ids.sort_unstable();
    match ids.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(pair) => Err(MessageFault::new("id", "there twice", "each object needs its own").of(pair[0])),
        None => Ok(()),
    }
}
