//! MCAP files that others wrote: their topics, and their messages as bytes, a chunk at a time by the index.
//!
//! What the bytes mean is the business of who asked for them. No file stays open between reads, and no length is
//! trusted: `archive_reader` compares each with the file's size before memory is allocated.

use std::path::{Path, PathBuf};

use mcap::McapError;
use mcap::records::Record;
use prost::bytes::Bytes;

use super::archive_reader::{read_records, read_summary};
use super::error::EpisodeError;

/// A file of which only the index has been read.
pub struct ForeignFile {
    path: PathBuf,
    summary: mcap::Summary,
    topics: Vec<ForeignTopic>,
}

/// A topic as the file's index describes it.
#[derive(Debug, Clone)]
pub struct ForeignTopic {
    pub channel_id: u16,
    pub name: String,
    /// How messages are packed: `cdr`, `protobuf`, `ros1`, ..
    pub message_encoding: String,
    /// `None` where the file has no schema for the topic.
    pub schema: Option<ForeignSchema>,
    pub n_messages: u64,
}

/// A message type as the file spells it.
#[derive(Debug, Clone)]
pub struct ForeignSchema {
    /// `sensor_msgs/msg/PointCloud2`.
    pub name: String,
    /// `ros2msg`, `ros2idl`, `protobuf`, ..
    pub encoding: String,
    pub data: Vec<u8>,
}

/// Where a message lies: the `ordinal`-th of its topic in a chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct MessagePlace {
    pub log_time_ns: u64,
    pub chunk_idx: usize,
    pub ordinal: usize,
}

/// A message as it lies in a chunk.
#[derive(Debug, Clone)]
pub struct ForeignMessage {
    pub channel_id: u16,
    pub log_time_ns: u64,
    pub bytes: Bytes,
}

impl ForeignFile {
    /// Reads the index.
    ///
    /// # Errors
    /// The file is cut short, damaged, not MCAP, has no index, or holds messages that no index finds.
    pub fn open(path: &Path) -> Result<Self, EpisodeError> {
        let summary = read_summary(path)?;
        let counts = summary.stats.as_ref().map(|stats| &stats.channel_message_counts);
        let n_messages = |id: u16| counts.and_then(|counts| counts.get(&id)).copied().unwrap_or(0);
        let mut topics: Vec<ForeignTopic> = summary
            .channels
            .values()
            .map(|channel| ForeignTopic {
                channel_id: channel.id,
                name: channel.topic.clone(),
                message_encoding: channel.message_encoding.clone(),
                schema: channel.schema.as_ref().map(|schema| ForeignSchema {
                    name: schema.name.clone(),
                    encoding: schema.encoding.clone(),
                    data: schema.data.to_vec(),
                }),
                n_messages: n_messages(channel.id),
            })
            .collect();
        topics.sort_by(|a, b| (&a.name, a.channel_id).cmp(&(&b.name, b.channel_id)));
        let n_told = summary.stats.as_ref().map_or(0, |stats| stats.message_count);
        let has_index = summary.chunk_indexes.iter().all(|chunk| !chunk.message_index_offsets.is_empty());
        if !has_index || n_told > 0 && summary.chunk_indexes.is_empty() {
            return Err(EpisodeError::NoIndex { path: path.to_owned() });
        }
        Ok(Self { path: path.to_owned(), summary, topics })
    }

    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The topics, by name.
    #[must_use]
    pub fn topics(&self) -> &[ForeignTopic] {
        &self.topics
    }

    #[must_use]
    pub fn n_chunks(&self) -> usize {
        self.summary.chunk_indexes.len()
    }

    /// Whether a chunk holds a message of one of the topics.
    #[must_use]
    pub fn chunk_holds(&self, chunk_idx: usize, channel_ids: &[u16]) -> bool {
        let chunk = self.summary.chunk_indexes.get(chunk_idx);
        chunk.is_some_and(|chunk| channel_ids.iter().any(|id| chunk.message_index_offsets.contains_key(id)))
    }

    /// Where the messages of a topic lie, chunk by chunk, by the index alone.
    ///
    /// # Errors
    /// The file or its index is damaged.
    pub fn places(&self, channel_id: u16) -> Result<Vec<MessagePlace>, EpisodeError> {
        let mut places = Vec::new();
        for (chunk_idx, chunk) in self.summary.chunk_indexes.iter().enumerate() {
            if !chunk.message_index_offsets.contains_key(&channel_id) {
                continue;
            }
            let begin = chunk.chunk_start_offset.saturating_add(chunk.chunk_length);
            let mut entries = Vec::new();
            read_records(&self.path, begin, chunk.message_index_length, 0, |record| match record {
                Record::MessageIndex(index) if index.channel_id == channel_id => {
                    entries.extend(index.records.iter().map(|entry| (entry.offset, entry.log_time)));
                }
                _ => {}
            })?;
            entries.sort_unstable();
            places.extend(entries.into_iter().enumerate().map(|(ordinal, (_, log_time_ns))| MessagePlace {
                log_time_ns,
                chunk_idx,
                ordinal,
            }));
        }
        Ok(places)
    }

    /// The messages of some topics in a chunk, in the order in which they were written.
    ///
    /// # Errors
    /// The chunk is damaged.
    pub fn chunk(&self, chunk_idx: usize, channel_ids: &[u16]) -> Result<Vec<ForeignMessage>, EpisodeError> {
        let Some(chunk) = self.summary.chunk_indexes.get(chunk_idx) else {
            return Err(EpisodeError::Damaged { source: McapError::BadIndex, path: self.path.clone() });
        };
        let mut messages = Vec::new();
        let (begin, n_bytes) = (chunk.chunk_start_offset, chunk.chunk_length);
        read_records(&self.path, begin, n_bytes, chunk.uncompressed_size, |record| match record {
            Record::Message { header, data } if channel_ids.contains(&header.channel_id) => {
                messages.push(ForeignMessage {
                    channel_id: header.channel_id,
                    log_time_ns: header.log_time,
                    bytes: data.into_owned().into(),
                });
            }
            _ => {}
        })?;
        Ok(messages)
    }
}
