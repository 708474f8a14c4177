//! Prediction files: a detector's boxes for each sample of an episode.

use std::path::{Path, PathBuf};

use super::archive::ArchiveWriter;
use super::archive_reader::Archive;
use super::error::{EpisodeError, MessageFault};
use super::messages::wire;
use super::sidecar::{SidecarReader, SidecarSample};
use super::topics::{self, Topic};
use super::{SourceMeta, drawing, objects};
use crate::object::Detection;

/// The reported boxes of one sample.
#[derive(Debug, Clone, PartialEq)]
pub struct SampleDetections {
    pub time_ns: u64,
    pub detections: Vec<Detection>,
}

impl SidecarSample for SampleDetections {
    type Message = wire::Detections;
    const TOPIC: Topic<wire::Detections> = topics::DETECTIONS;
    const RECORD: &'static str = "detections";

    fn from_message(time_ns: u64, message: wire::Detections) -> Result<Self, MessageFault> {
        let read = |(i, detection): (usize, &wire::Detection)| {
            objects::detection_of(detection).map_err(|fault| fault.of(&i.to_string()))
        };
        let detections = message.detections.iter().enumerate().map(read).collect::<Result<_, _>>()?;
        Ok(Self { time_ns, detections })
    }
}

/// A prediction file, read whole.
pub type DetectionReader = SidecarReader<SampleDetections>;

/// A prediction file being written under a partial name; dropped unfinished, it leaves nothing.
pub struct DetectionWriter {
    archive: ArchiveWriter,
    meta: SourceMeta,
}

impl DetectionWriter {
    /// Starts a prediction file; its folder must exist.
    ///
    /// # Errors
    /// The file cannot be made.
    pub fn create(path: &Path, meta: &SourceMeta) -> Result<Self, EpisodeError> {
        Ok(Self { archive: ArchiveWriter::create(path, topics::OF_DETECTIONS)?, meta: meta.clone() })
    }

    /// Adds the boxes of the next sample.
    ///
    /// # Errors
    /// A number that is not finite, a size that is not above zero, a score outside 0 to 1, a time
    /// that does not advance, or the disk fails.
    pub fn write(&mut self, sample: &SampleDetections) -> Result<(), EpisodeError> {
        write_detections(&mut self.archive, &self.meta, sample)
    }

    /// Writes the metadata and the index, and gives the file its name.
    ///
    /// # Errors
    /// Nothing was written, or the disk fails.
    pub fn finish(self) -> Result<PathBuf, EpisodeError> {
        self.archive.finish([(SampleDetections::RECORD, self.meta.to_record())])
    }
}

/// Whether a file is one of [`DetectionWriter`], with nothing else in it.
#[must_use]
pub fn is_detections_file(path: &Path) -> bool {
    let is_known = |topic: &str| topics::OF_DETECTIONS.iter().any(|known| known.name == topic);
    Archive::open(path, &[topics::DETECTIONS.spec()]).is_ok_and(|archive| {
        archive.topics().all(is_known)
            && archive.metadata(SampleDetections::RECORD).is_ok_and(|record| !record.is_empty())
    })
}

/// Begins a sample with its boxes.
pub(super) fn write_detections(
    archive: &mut ArchiveWriter,
    meta: &SourceMeta,
    sample: &SampleDetections,
) -> Result<(), EpisodeError> {
    let time_ns = sample.time_ns;
    for (i, detection) in sample.detections.iter().enumerate() {
        objects::check_detection(detection)
            .map_err(|fault| fault.of(&i.to_string()))
            .map_err(EpisodeError::invalid(&meta.episode, archive.n_samples, &archive.path))?;
    }
    archive.begin_sample(time_ns)?;
    archive.write(topics::DETECTIONS, &objects::detections_message(time_ns, &sample.detections))?;
    archive.write(topics::DETECTION_MARKERS, &drawing::detection_boxes(time_ns, &sample.detections))
}
