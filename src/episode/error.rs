//! What can be wrong with an episode, label or prediction file; each error ends with the path.

use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::files;

/// A value that no consumer could use, found before writing or on reading.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("{}`{field}` is {found}; {wanted}", object.as_ref().map(|id| format!("object `{id}`: ")).unwrap_or_default())]
pub struct MessageFault {
    /// The object's id (for detections its index), where the value belongs to one.
    pub object: Option<String>,
    pub field: &'static str,
    pub found: String,
    /// What a valid value would be.
    pub wanted: &'static str,
}

impl MessageFault {
    pub(super) fn new(field: &'static str, found: impl ToString, wanted: &'static str) -> Self {
        Self { object: None, field, found: found.to_string(), wanted }
    }

    pub(super) fn of(self, object: &str) -> Self {
        Self { object: Some(object.to_owned()), ..self }
    }
}

/// How far a message's time may lie from its sample's. Cameras of real cars fire tens of milliseconds beside the LiDAR.
pub(super) const STAMP_TOLERANCE_NS: u64 = 50_000_000;

/// Most bytes of what is read at once: a record, a chunk, packed or not, or the messages that are kept of several. A sample takes a few
/// megabytes, a bag's chunk mostly one, and the largest raw picture of a camera some 100.
pub(super) const MAX_CHUNK_BYTES: u64 = 1 << 28;

/// What is wrong with an MCAP file, with what would be right where a chunk is too large.
#[must_use]
pub fn tell_damage(source: &mcap::McapError) -> String {
    match source {
        mcap::McapError::ChunkTooLarge(n_bytes) | mcap::McapError::RecordTooLarge { len: n_bytes, .. }
            if *n_bytes > MAX_CHUNK_BYTES =>
        {
            format!(
                "a part that is read at once unpacks to {n_bytes} bytes; up to {MAX_CHUNK_BYTES} are read"
            )
        }
        other => other.to_string(),
    }
}

/// Why a file cannot be written or read.
#[derive(Debug, Error)]
pub enum EpisodeError {
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error("cannot write MCAP: {source}: {}", path.display())]
    Write { source: mcap::McapError, path: PathBuf },
    #[error("the file is cut short, damaged or no MCAP ({}); make it again: {}", tell_damage(source), path.display())]
    Damaged { source: mcap::McapError, path: PathBuf },
    #[error("the MCAP has no index; `mcap recover` adds one: {}", path.display())]
    NoIndex { path: PathBuf },
    #[error("not a file of this kind: it has the topics {found:?} and lacks {missing:?}: {}", path.display())]
    ForeignTopics { missing: Vec<&'static str>, found: Vec<String>, path: PathBuf },
    #[error("topic `{topic}` holds `{found}`; `{wanted}` is needed: {}", path.display())]
    ForeignSchema { topic: String, found: String, wanted: String, path: PathBuf },
    #[error(
        "the metadata record `{record}` is of format version `{found}`; this version reads {wanted}: {}", path.display()
    )]
    Version { record: &'static str, found: String, wanted: u32, path: PathBuf },
    #[error("the metadata record `{record}` lacks `{key}` or holds no valid one: {}", path.display())]
    Metadata { record: &'static str, key: &'static str, path: PathBuf },
    #[error("topic `{topic}` holds {found} messages; {wanted} are needed: {}", path.display())]
    Count { topic: String, found: u64, wanted: u64, path: PathBuf },
    #[error(
        "topic `{topic}` has {found} messages at sample {sample_idx}, {time_ns} ns; 1 is needed, within {} ms of it{}: {}",
        STAMP_TOLERANCE_NS / 1_000_000,
        nearest_ns.map(|nearest| format!(" (the nearest is at {nearest} ns)")).unwrap_or_default(),
        path.display()
    )]
    NotAligned {
        topic: String,
        sample_idx: usize,
        time_ns: u64,
        found: usize,
        nearest_ns: Option<u64>,
        path: PathBuf,
    },
    #[error("sample {sample_idx}: a message is no valid protobuf ({source}): {}", path.display())]
    Decode { sample_idx: usize, source: prost::DecodeError, path: PathBuf },
    #[error("episode `{episode}`, sample {sample_idx}: {fault}: {}", path.display())]
    Invalid { episode: String, sample_idx: usize, fault: Box<MessageFault>, path: PathBuf },
    #[error("sample {sample_idx} is at {found_ns} ns, not after {before_ns} ns: {}", path.display())]
    TimeOrder { sample_idx: usize, found_ns: u64, before_ns: u64, path: PathBuf },
    #[error("there is no sample {sample_idx}; the file has {n_samples}: {}", path.display())]
    NoSample { sample_idx: usize, n_samples: usize, path: PathBuf },
    #[error("nothing was written; a file holds at least one sample: {}", path.display())]
    Empty { path: PathBuf },
    #[error(
        "the content hash is {found}, and dataset.json or labels.json says {wanted}; copy or make the file again: {}",
        path.display()
    )]
    OtherContent { found: String, wanted: String, path: PathBuf },
    #[error("the episode has {found} samples, dataset.json says {wanted}; make it again: {}", path.display())]
    SampleCount { found: usize, wanted: usize, path: PathBuf },
    #[error(
        "made from an episode with the content hash {found}, not {wanted}; make it again: {}",
        path.display()
    )]
    OtherEpisode { found: String, wanted: String, path: PathBuf },
}

impl EpisodeError {
    /// Whether it comes of the system and not of what the file holds.
    #[must_use]
    pub fn is_of_system(&self) -> bool {
        match self {
            // It stands for the error within, which is no source of it.
            Self::Io(error) => files::is_of_system(error),
            other => files::is_of_system(other),
        }
    }
}

impl EpisodeError {
    /// Adds the place of a fault.
    pub(super) fn invalid(episode: &str, sample_idx: usize, path: &Path) -> impl Fn(MessageFault) -> Self {
        move |fault| Self::Invalid {
            episode: episode.to_owned(),
            sample_idx,
            fault: Box::new(fault),
            path: path.to_owned(),
        }
    }
}
