//! Episodes, labels and predictions as MCAP files, and the data set's manifest.
//!
//! The only module that knows MCAP. `docs/episode_format.md` describes every topic and field.

mod archive;
mod convert;
mod detections;
mod drawing;
mod error;
mod labels;
pub mod manifest;
mod messages;
mod meta;
mod reader;
#[cfg(test)]
mod tests;
pub mod topics;
mod writer;

use std::path::Path;

pub use detections::{DetectionReader, DetectionWriter, SampleDetections};
pub use drawing::MapDrawing;
pub use error::{EpisodeError, Fault};
pub use labels::{LabelReader, LabelWriter, ObjectLabel, SampleLabels};
pub use manifest::{EpisodeEntry, LabelManifest, Manifest, ManifestError, Split};
pub use meta::{EpisodeMeta, SourceMeta};
pub use reader::EpisodeReader;
pub use writer::{EpisodeWriter, FinishedEpisode};

/// Takes the next sample's time if it is after the last.
fn check_time_order(
    last_ns: &mut Option<u64>,
    found_ns: u64,
    sample_idx: usize,
    path: &Path,
) -> Result<(), EpisodeError> {
    match *last_ns {
        Some(before_ns) if found_ns <= before_ns => {
            Err(EpisodeError::TimeOrder { sample_idx, found_ns, before_ns, path: path.to_owned() })
        }
        _ => {
            *last_ns = Some(found_ns);
            Ok(())
        }
    }
}
