//! Episodes, labels and predictions as MCAP files, and the data set's manifest.
//!
//! The only module that knows MCAP. `docs/episode_format.md` describes every topic and field.

mod archive;
mod archive_check;
mod archive_reader;
#[cfg(test)]
mod bomb_tests;
mod checks;
mod convert;
mod counts;
mod detections;
mod drawing;
mod drive_log;
mod error;
pub mod folder;
mod foreign;
#[cfg(test)]
mod foreign_tests;
mod label_command;
mod labels;
mod log;
mod made_with;
pub mod manifest;
#[cfg(test)]
mod manifest_tests;
pub mod merged;
mod messages;
mod meta;
mod objects;
mod others;
mod reader;
mod regions;
pub mod shard;
mod sidecar;
mod stamps;
#[cfg(test)]
mod tests;
mod topics;
mod writer;

pub use archive_check::{ArchiveCounts, check_archive};
pub use detections::{DetectionReader, DetectionWriter, SampleDetections, is_detections_file};
pub use drawing::MapDrawing;
pub use drive_log::{CommandReader, DriveLogWriter, SampleCommand};
pub use error::{EpisodeError, MessageFault, tell_damage};
pub use foreign::{ForeignFile, ForeignMessage, ForeignSchema, ForeignTopic, MessagePlace};
pub use label_command::{label_command, zone_in};
pub use labels::{LabelReader, LabelWriter, ObjectLabel, SampleLabels};
pub use log::{Labelled, LogFacts, SizeRange};
pub use made_with::{MadeWith, cpu};
pub use manifest::{EpisodeEntry, LabelManifest, Manifest, ManifestError, Split};
pub use meta::{EpisodeMeta, SourceMeta};
pub(crate) use objects::check_detection;
pub use others::OtherSensors;
pub use reader::{EpisodeReader, is_any_annotated};
pub use shard::{MAX_EPISODES, PartOf, Shard, ShardError};
pub use sidecar::SidecarReader;
pub use stamps::{OffStamps, check_stamps};
pub use writer::{EpisodeWriter, FinishedEpisode};
