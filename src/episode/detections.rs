//! Prediction files: what a detector reports for each sample of an episode.

use std::path::{Path, PathBuf};

use foxglove::messages as fox;
use prost::Message as _;

use super::archive::{Archive, ArchiveWriter};
use super::error::{EpisodeError, Fault};
use super::messages::wire;
use super::{SourceMeta, convert, drawing, topics};
use crate::object::Detection;

const RECORD: &str = "detections";

/// The reported boxes of one sample.
#[derive(Debug, Clone, PartialEq)]
pub struct SampleDetections {
    pub time_ns: u64,
    pub detections: Vec<Detection>,
}

/// A prediction file being written under a partial name; dropped unfinished, it leaves nothing.
pub struct DetectionWriter {
    archive: ArchiveWriter,
    meta: SourceMeta,
    detections: u16,
    markers: u16,
    n_samples: usize,
    last_ns: Option<u64>,
}

impl DetectionWriter {
    /// Starts a prediction file; its folder must exist.
    ///
    /// # Errors
    /// The file cannot be made.
    pub fn create(path: &Path, meta: &SourceMeta) -> Result<Self, EpisodeError> {
        let mut archive = ArchiveWriter::create(path)?;
        Ok(Self {
            meta: meta.clone(),
            detections: archive.channel::<wire::Detections>(topics::DETECTIONS)?,
            markers: archive.channel::<fox::SceneUpdate>(topics::DETECTION_MARKERS)?,
            archive,
            n_samples: 0,
            last_ns: None,
        })
    }

    /// Adds the boxes of the next sample.
    ///
    /// # Errors
    /// A number that is not finite, a size that is not above zero, a score outside 0 to 1, a time
    /// that does not advance, or the disk.
    pub fn write(&mut self, sample: &SampleDetections) -> Result<(), EpisodeError> {
        let (time_ns, idx) = (sample.time_ns, self.n_samples);
        for (i, detection) in sample.detections.iter().enumerate() {
            convert::check_detection(detection).map_err(|fault| EpisodeError::Invalid {
                episode: self.meta.episode.clone(),
                sample_idx: idx,
                fault: Box::new(fault.of(&i.to_string())),
                path: self.archive.path.clone(),
            })?;
        }
        super::check_time_order(&mut self.last_ns, time_ns, idx, &self.archive.path)?;
        let message = convert::detections_message(time_ns, &sample.detections);
        self.archive.message(self.detections, idx, time_ns, &message)?;
        let markers = drawing::detection_boxes(time_ns, &sample.detections);
        self.archive.message(self.markers, idx, time_ns, &markers)?;
        self.n_samples += 1;
        Ok(())
    }

    /// Writes the metadata and the index, and gives the file its name.
    ///
    /// # Errors
    /// Nothing was written, or the disk.
    pub fn finish(mut self) -> Result<PathBuf, EpisodeError> {
        let path = self.archive.path.clone();
        if self.n_samples == 0 {
            return Err(EpisodeError::Empty { path });
        }
        self.archive.metadata(RECORD, self.meta.to_record())?;
        self.archive.finish()?;
        Ok(path)
    }
}

/// A prediction file, read whole.
#[derive(Debug)]
pub struct DetectionReader {
    meta: SourceMeta,
    samples: Vec<SampleDetections>,
    path: PathBuf,
}

impl DetectionReader {
    /// Reads all predictions for an episode.
    ///
    /// # Errors
    /// A truncated or foreign file, or a value that is not usable.
    pub fn open(path: &Path) -> Result<Self, EpisodeError> {
        let archive = Archive::open(path)?;
        let channel = archive.channel::<wire::Detections>(topics::DETECTIONS, &[topics::DETECTIONS])?;
        let meta = SourceMeta::from_record(&archive.metadata(RECORD)?, RECORD, path)?;
        let mut samples = Vec::new();
        for (sample_idx, raw) in archive.messages_of(channel)?.into_iter().enumerate() {
            let path = || path.to_owned();
            let message = wire::Detections::decode(raw.bytes.as_slice())
                .map_err(|source| EpisodeError::Decode { sample_idx, source, path: path() })?;
            let read = |(i, detection)| {
                convert::detection_of(detection).map_err(|fault: Fault| fault.of(&usize::to_string(&i)))
            };
            let detections =
                message.detections.iter().enumerate().map(read).collect::<Result<_, _>>().map_err(
                    |fault| EpisodeError::Invalid {
                        episode: meta.episode.clone(),
                        sample_idx,
                        fault: Box::new(fault),
                        path: path(),
                    },
                )?;
            samples.push(SampleDetections { time_ns: raw.time_ns, detections });
        }
        Ok(Self { meta, samples, path: path.to_owned() })
    }

    #[must_use]
    pub fn meta(&self) -> &SourceMeta {
        &self.meta
    }

    /// The boxes of each sample, in order of time.
    #[must_use]
    pub fn samples(&self) -> &[SampleDetections] {
        &self.samples
    }

    /// Refuses predictions that were made from another episode than the one with this content hash.
    ///
    /// # Errors
    /// [`EpisodeError::OtherEpisode`].
    pub fn check_episode(&self, episode_sha256: &str) -> Result<(), EpisodeError> {
        self.meta.check_episode(episode_sha256, &self.path)
    }
}
