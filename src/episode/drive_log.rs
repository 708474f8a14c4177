//! Logs of closed-loop drives: prediction files that also hold what perception ordered.

use std::path::{Path, PathBuf};

use super::archive::ArchiveWriter;
use super::detections::write_detections;
use super::error::{EpisodeError, MessageFault};
use super::messages::{own_time, wire};
use super::sidecar::{SidecarReader, SidecarSample};
use super::topics::{self, Topic};
use super::{SampleDetections, SourceMeta};

/// What perception ordered at a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampleCommand {
    pub time_ns: u64,
    /// Least braking; `None`: drive on.
    pub braking_mps2: Option<f64>,
    /// The true speed just after.
    pub speed_mps: f64,
    /// Whether anything was truly harmful: in the zone, or about to meet the ego.
    pub is_harmful: bool,
}

impl SidecarSample for SampleCommand {
    type Message = wire::DriveCommand;
    const TOPIC: Topic<wire::DriveCommand> = topics::COMMANDS;
    const RECORD: &'static str = SampleDetections::RECORD;

    fn from_message(time_ns: u64, message: wire::DriveCommand) -> Result<Self, MessageFault> {
        let wire::DriveCommand { braking_mps2, speed_mps, is_harmful, .. } = message;
        Ok(Self { time_ns, braking_mps2, speed_mps, is_harmful })
    }
}

/// The commands of a drive's log, read whole; [`super::DetectionReader`] reads its boxes.
pub type CommandReader = SidecarReader<SampleCommand>;

/// A drive's log being written under a partial name; dropped unfinished, it leaves nothing.
pub struct DriveLogWriter {
    archive: ArchiveWriter,
    meta: SourceMeta,
}

impl DriveLogWriter {
    /// Starts a log; its folder must exist.
    ///
    /// # Errors
    /// The file cannot be made.
    pub fn create(path: &Path, meta: &SourceMeta) -> Result<Self, EpisodeError> {
        let mut archive = ArchiveWriter::create(path, topics::OF_DETECTIONS)?;
        for topic in topics::OF_COMMANDS {
            archive.declare(topic.name, topic.schema)?;
        }
        Ok(Self { archive, meta: meta.clone() })
    }

    /// Adds the boxes of the next sample, and its command; the last sample of a drive that ended at once in a collision has none.
    ///
    /// # Errors
    /// As [`super::DetectionWriter::write`].
    pub fn write(
        &mut self,
        sample: &SampleDetections,
        command: Option<&SampleCommand>,
    ) -> Result<(), EpisodeError> {
        write_detections(&mut self.archive, &self.meta, sample)?;
        let Some(command) = command else { return Ok(()) };
        let message = wire::DriveCommand {
            timestamp: Some(own_time(command.time_ns)),
            braking_mps2: command.braking_mps2,
            speed_mps: command.speed_mps,
            is_harmful: command.is_harmful,
        };
        self.archive.write(topics::COMMANDS, &message)
    }

    /// Writes the metadata and the index, and gives the file its name.
    ///
    /// # Errors
    /// Nothing was written, or the disk fails.
    pub fn finish(self) -> Result<PathBuf, EpisodeError> {
        self.archive.finish([(SampleDetections::RECORD, self.meta.to_record())])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::episode::DetectionReader;

    #[test]
    fn a_log_is_read_as_boxes_and_as_commands() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let meta = SourceMeta {
            episode: "a".into(),
            episode_sha256: "0".into(),
            set: "truth".into(),
            config_toml: String::new(),
            generator_version: "0".into(),
        };
        let sample = SampleDetections { time_ns: 1_000_000_007, detections: Vec::new() };
        let command = SampleCommand {
            time_ns: sample.time_ns,
            braking_mps2: Some(2.5),
            speed_mps: 7.0,
            is_harmful: true,
        };
        let mut log = DriveLogWriter::create(&path, &meta).unwrap();
        log.write(&sample, Some(&command)).unwrap();
        log.finish().unwrap();
        assert_eq!(DetectionReader::open(&path).unwrap().samples(), [sample]);
        assert_eq!(CommandReader::open(&path).unwrap().samples(), [command]);
    }
}
