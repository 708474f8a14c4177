//! Messages and records of other files as they lie there, for a file that joins several.

use std::collections::BTreeMap;
use std::path::Path;

use prost::bytes::Bytes;

use crate::episode::archive::{ArchiveWriter, CopiedTopic};
use crate::episode::archive_reader::{Archive, RawMessage};
use crate::episode::error::EpisodeError;
use crate::episode::topics;

/// Metadata records: the name and the entries of each.
pub(super) type Records = Vec<(String, BTreeMap<String, String>)>;

/// A file whose messages are copied in order of time.
pub(super) struct Source {
    archive: Archive,
    /// The messages of a small file, read at once; `None`: read as they are asked for.
    all: Option<Vec<Copied>>,
    /// Everything up to this time has been handed over.
    done_ns: Option<u64>,
}

/// A message with its topic.
#[derive(Clone)]
pub(super) struct Copied {
    pub(super) topic: String,
    pub(super) time_ns: u64,
    pub(super) bytes: Bytes,
}

impl Source {
    /// Opens a file with a chunk for each sample, which is read bit by bit.
    pub(super) fn large(path: &Path) -> Result<Self, EpisodeError> {
        Ok(Self { archive: Archive::open(path, &[])?, all: None, done_ns: None })
    }

    /// Opens a file of a few chunks, which is read at once.
    pub(super) fn small(path: &Path) -> Result<Self, EpisodeError> {
        let source = Self::large(path)?;
        Ok(Self { all: Some(source.read(0, u64::MAX)?), ..source })
    }

    /// Declares the topics that are copied and that no file before had.
    pub(super) fn declare(&self, writer: &mut ArchiveWriter) -> Result<(), EpisodeError> {
        for copied in self.topics() {
            if !writer.has(&copied.topic) {
                writer.declare_copied(&copied)?;
            }
        }
        Ok(())
    }

    /// The messages after those that were handed over, up to a time.
    pub(super) fn up_to(&mut self, end_ns: u64) -> Result<Vec<Copied>, EpisodeError> {
        let begin_ns = self.done_ns.map_or(Some(0), |done_ns| done_ns.checked_add(1));
        let Some(begin_ns) = begin_ns.filter(|&begin_ns| begin_ns <= end_ns) else { return Ok(Vec::new()) };
        self.done_ns = Some(end_ns);
        match &self.all {
            None => self.read(begin_ns, end_ns),
            Some(all) => {
                let is_next = |message: &&Copied| (begin_ns..=end_ns).contains(&message.time_ns);
                Ok(all.iter().filter(is_next).cloned().collect())
            }
        }
    }

    /// The metadata records by their names.
    pub(super) fn records(&self) -> Result<Records, EpisodeError> {
        let names = self.archive.summary.metadata_indexes.iter().map(|index| index.name.clone());
        names.map(|name| self.archive.metadata(&name).map(|record| (name, record))).collect()
    }

    /// The topics that are copied, in the order of their numbers: all but drawings.
    fn topics(&self) -> Vec<CopiedTopic> {
        let channels: BTreeMap<_, _> = self.archive.summary.channels.iter().collect();
        let copied = channels.into_values().filter(|channel| !is_drawing(&channel.topic));
        copied
            .map(|channel| CopiedTopic {
                topic: channel.topic.clone(),
                message_encoding: channel.message_encoding.clone(),
                schema: channel
                    .schema
                    .as_ref()
                    .map(|schema| (schema.name.clone(), schema.encoding.clone(), schema.data.to_vec())),
            })
            .collect()
    }

    fn read(&self, begin_ns: u64, end_ns: u64) -> Result<Vec<Copied>, EpisodeError> {
        let channels = &self.archive.summary.channels;
        let wanted = channels.values().filter(|channel| !is_drawing(&channel.topic));
        let wanted: Vec<u16> = wanted.map(|channel| channel.id).collect();
        let mut messages = self.archive.between(begin_ns, end_ns, &wanted)?;
        messages.sort_by_key(|message| message.time_ns);
        let copied = |RawMessage { channel_id, time_ns, bytes }| Copied {
            topic: channels[&channel_id].topic.clone(),
            time_ns,
            bytes,
        };
        Ok(messages.into_iter().map(copied).collect())
    }
}

fn is_drawing(topic: &str) -> bool {
    topics::DRAWINGS.contains(&topic)
}
