//! Reads MCAP files by their index: a sample costs one chunk, whose CRC is checked before a message is taken.
//!
//! No file stays open between reads, so that thousands of episodes can be at hand. No length is trusted: each
//! is compared with the file's size, or with the index, before memory is allocated.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use mcap::McapError;
use mcap::records::Record;
use mcap::sans_io::{
    LinearReadEvent, LinearReader, LinearReaderOptions, SummaryReadEvent, SummaryReader, SummaryReaderOptions,
};
use prost::bytes::Bytes;

use super::archive_check::overlap;
use super::error::{EpisodeError, MAX_CHUNK_BYTES, STAMP_TOLERANCE_NS};
use super::messages::TopicMessage;
use super::topics::{Topic, TopicSpec};
use crate::store;

// Lengths that MCAP's specification fixes; records have an opcode and a length of 9 bytes before them.
const DATA_END_BYTES: u64 = 9 + 4;
const FOOTER_BYTES: u64 = 8 + 8 + 4;
const MAGIC_BYTES: u64 = 8;

/// A file of which only the index has been read.
pub(super) struct Archive {
    pub(super) path: PathBuf,
    pub(super) summary: mcap::Summary,
    /// Channel numbers by topic, of the topics that the reader takes.
    channels: BTreeMap<String, u16>,
    /// Those of them that belong to no sample.
    aside: BTreeSet<u16>,
}

/// One message as it lies in a chunk.
pub(super) struct RawMessage {
    pub(super) channel_id: u16,
    pub(super) time_ns: u64,
    pub(super) bytes: Bytes,
}

/// Messages of several chunks, and how much memory they take and may take.
struct Held {
    all: Vec<RawMessage>,
    n_bytes: u64,
    most_bytes: u64,
}

/// How many times its chunks' packed bytes a file's messages may take together, where that is more than a chunk may: those of boxes
/// pack to a third or less.
const MOST_UNPACKED: u64 = 32;

impl Archive {
    /// Reads the index.
    ///
    /// # Errors
    /// The file is cut short, damaged, not MCAP, or has no index; a topic of `wanted` is missing or has
    /// another schema.
    pub(super) fn open(path: &Path, wanted: &[TopicSpec]) -> Result<Self, EpisodeError> {
        let summary = read_summary(path)?;
        let mut archive =
            Self { path: path.to_owned(), summary, channels: BTreeMap::new(), aside: BTreeSet::new() };
        let lacks = |topic: &&TopicSpec| !archive.has(topic.name);
        if wanted.iter().any(|topic| lacks(&topic)) {
            let missing = wanted.iter().filter(lacks).map(|topic| topic.name).collect();
            let found = archive.topics().map(str::to_owned).collect();
            return Err(EpisodeError::ForeignTopics { missing, found, path: path.to_owned() });
        }
        wanted.iter().try_for_each(|topic| archive.take(topic.name, topic.schema))?;
        Ok(archive)
    }

    /// All topics of the file, sorted.
    pub(super) fn topics(&self) -> impl Iterator<Item = &str> {
        let topics: BTreeSet<&str> =
            self.summary.channels.values().map(|channel| channel.topic.as_str()).collect();
        topics.into_iter()
    }

    /// Whether the file holds messages on a topic.
    pub(super) fn has(&self, topic: &str) -> bool {
        self.summary.channels.values().any(|channel| channel.topic == topic)
    }

    /// Takes one more topic of the file, if it is there.
    ///
    /// # Errors
    /// The topic has another schema.
    pub(super) fn take(
        &mut self,
        topic: &str,
        schema: fn() -> (String, Vec<u8>),
    ) -> Result<(), EpisodeError> {
        let Some(channel) = self.summary.channels.values().find(|channel| channel.topic == topic) else {
            return Ok(());
        };
        let found = channel.schema.as_ref().map_or("", |schema| schema.name.as_str());
        let wanted = schema().0;
        if found != wanted || channel.message_encoding != "protobuf" {
            let found = format!("{found} ({})", channel.message_encoding);
            let (topic, path) = (topic.to_owned(), self.path.clone());
            return Err(EpisodeError::ForeignSchema { topic, found, wanted, path });
        }
        self.channels.insert(topic.to_owned(), channel.id);
        Ok(())
    }

    /// Keeps the messages of a taken topic out of samples.
    pub(super) fn set_aside(&mut self, topic: &str) {
        self.aside.insert(self.channel(topic));
    }

    /// Number of a topic's channel.
    fn channel(&self, topic: &str) -> u16 {
        *self.channels.get(topic).expect("`open` looks up the topics that a reader takes")
    }

    /// Refuses a topic that holds another number of messages by the index.
    pub(super) fn check_count(&self, topic: &str, wanted: usize) -> Result<(), EpisodeError> {
        let counts = self.summary.stats.as_ref().map(|stats| &stats.channel_message_counts);
        let found = counts.and_then(|counts| counts.get(&self.channel(topic))).copied().unwrap_or(0);
        if found == wanted as u64 {
            return Ok(());
        }
        Err(EpisodeError::Count {
            topic: topic.to_owned(),
            found,
            wanted: wanted as u64,
            path: self.path.clone(),
        })
    }

    /// The values of a metadata record; empty if there is none.
    pub(super) fn metadata(&self, name: &str) -> Result<BTreeMap<String, String>, EpisodeError> {
        let Some(index) = self.summary.metadata_indexes.iter().find(|index| index.name == name) else {
            return Ok(BTreeMap::new());
        };
        let mut found = None;
        read_records(&self.path, index.offset, index.length, 0, |record| {
            if let Record::Metadata(metadata) = record {
                found = Some(metadata.metadata);
            }
        })?;
        found.ok_or_else(|| self.damaged(McapError::BadIndex))
    }

    /// The time of a topic's message that is nearest to a time.
    fn nearest_time_ns(&self, topic: &str, time_ns: u64) -> Result<Option<u64>, EpisodeError> {
        Ok(self.times(topic)?.into_iter().min_by_key(|found_ns| found_ns.abs_diff(time_ns)))
    }

    /// Times of a topic's messages in order.
    pub(super) fn times(&self, topic: &str) -> Result<Vec<u64>, EpisodeError> {
        let (wanted, mut times) = (self.channel(topic), Vec::new());
        for chunk in &self.summary.chunk_indexes {
            let begin = chunk.chunk_start_offset.saturating_add(chunk.chunk_length);
            read_records(&self.path, begin, chunk.message_index_length, 0, |record| match record {
                Record::MessageIndex(index) if index.channel_id == wanted => {
                    times.extend(index.records.iter().map(|entry| entry.log_time));
                }
                _ => {}
            })?;
        }
        times.sort_unstable();
        Ok(times)
    }

    /// The messages of the sample at a time, of which each may be [`STAMP_TOLERANCE_NS`] off; in our own files they
    /// fill one chunk.
    pub(super) fn sample(&self, sample_idx: usize, time_ns: u64) -> Result<SampleMessages<'_>, EpisodeError> {
        let (begin_ns, end_ns) =
            (time_ns.saturating_sub(STAMP_TOLERANCE_NS), time_ns.saturating_add(STAMP_TOLERANCE_NS));
        let of_samples = self.channels.values().filter(|channel| !self.aside.contains(channel));
        let wanted: Vec<u16> = of_samples.copied().collect();
        let messages = self.between(begin_ns, end_ns, &wanted)?;
        // No CRC protects the index from which the time comes, and those of chunks do protect messages.
        if !messages.iter().any(|message| message.time_ns == time_ns) {
            return Err(self.damaged(McapError::BadIndex));
        }
        Ok(SampleMessages { archive: self, sample_idx, time_ns, messages })
    }

    /// The messages on some topics from one time to another, each with its topic and time, in order of time.
    ///
    /// # Errors
    /// Damage, or a topic has another schema.
    pub(super) fn all_between<M: TopicMessage>(
        &self,
        topics: &[String],
        begin_ns: u64,
        end_ns: u64,
    ) -> Result<Vec<(String, u64, M)>, EpisodeError> {
        let channels: BTreeMap<u16, &String> =
            topics.iter().map(|topic| (self.channel(topic), topic)).collect();
        let wanted: Vec<u16> = channels.keys().copied().collect();
        let mut messages = self.between(begin_ns, end_ns, &wanted)?;
        messages.sort_by_key(|message| (message.time_ns, message.channel_id));
        let decode = |(i, raw): (usize, RawMessage)| {
            Ok((channels[&raw.channel_id].clone(), raw.time_ns, self.decode(i, raw.bytes)?))
        };
        messages.into_iter().enumerate().map(decode).collect()
    }

    /// The messages of some channels from one time to another.
    pub(super) fn between(
        &self,
        begin_ns: u64,
        end_ns: u64,
        wanted: &[u16],
    ) -> Result<Vec<RawMessage>, EpisodeError> {
        let mut messages = self.nothing_held();
        for chunk in &self.summary.chunk_indexes {
            // A file without offsets does not tell what its chunks hold.
            let of = &chunk.message_index_offsets;
            let holds = of.is_empty() || wanted.iter().any(|channel| of.contains_key(channel));
            if holds && chunk.message_start_time <= end_ns && begin_ns <= chunk.message_end_time {
                self.read_chunk(chunk, wanted, &mut messages)?;
            }
        }
        messages.all.retain(|message| (begin_ns..=end_ns).contains(&message.time_ns));
        Ok(messages.all)
    }

    /// All messages of a topic with their times, in order of time.
    pub(super) fn messages_of<M: TopicMessage>(
        &self,
        topic: Topic<M>,
    ) -> Result<Vec<(u64, M)>, EpisodeError> {
        let (wanted, mut messages) = (self.channel(topic.name), self.nothing_held());
        for chunk in &self.summary.chunk_indexes {
            self.read_chunk(chunk, &[wanted], &mut messages)?;
        }
        let mut messages = messages.all;
        self.check_count(topic.name, messages.len())?;
        messages.sort_by_key(|message| message.time_ns);
        let decode =
            |(sample_idx, raw): (usize, RawMessage)| Ok((raw.time_ns, self.decode(sample_idx, raw.bytes)?));
        messages.into_iter().enumerate().map(decode).collect()
    }

    /// Where messages of several chunks go: of a long file more than one chunk may take.
    fn nothing_held(&self) -> Held {
        let n_packed = self.summary.chunk_indexes.iter().map(|chunk| chunk.compressed_size);
        let n_packed = n_packed.fold(0, u64::saturating_add);
        let most_bytes = n_packed.saturating_mul(MOST_UNPACKED).max(MAX_CHUNK_BYTES);
        Held { all: Vec::new(), n_bytes: 0, most_bytes }
    }

    /// Adds a chunk's messages of the wanted channels.
    fn read_chunk(
        &self,
        chunk: &mcap::records::ChunkIndex,
        wanted: &[u16],
        messages: &mut Held,
    ) -> Result<(), EpisodeError> {
        let (begin, n_bytes, n_unpacked) =
            (chunk.chunk_start_offset, chunk.chunk_length, chunk.uncompressed_size);
        read_records(&self.path, begin, n_bytes, n_unpacked, |record| match record {
            Record::Message { header, data } if wanted.contains(&header.channel_id) => {
                messages.n_bytes += (data.len() + size_of::<RawMessage>()) as u64;
                messages.all.push(RawMessage {
                    channel_id: header.channel_id,
                    time_ns: header.log_time,
                    bytes: data.into_owned().into(),
                });
            }
            _ => {}
        })?;
        match messages.n_bytes {
            n_bytes if n_bytes > messages.most_bytes => Err(self.damaged(McapError::ChunkTooLarge(n_bytes))),
            _ => Ok(()),
        }
    }

    fn decode<M: TopicMessage>(&self, sample_idx: usize, bytes: Bytes) -> Result<M, EpisodeError> {
        let path = || self.path.clone();
        M::decode(bytes).map_err(|source| EpisodeError::Decode { sample_idx, source, path: path() })
    }

    fn damaged(&self, source: McapError) -> EpisodeError {
        EpisodeError::Damaged { source, path: self.path.clone() }
    }
}

/// The messages of one sample.
pub(super) struct SampleMessages<'a> {
    archive: &'a Archive,
    sample_idx: usize,
    time_ns: u64,
    messages: Vec<RawMessage>,
}

impl SampleMessages<'_> {
    /// The one message of a topic that is nearest to the sample's time.
    pub(super) fn one<M: TopicMessage>(&self, topic: Topic<M>) -> Result<M, EpisodeError> {
        self.one_named(topic.name)
    }

    /// As [`Self::one`], of a topic that the reader took by name.
    pub(super) fn one_named<M: TopicMessage>(&self, topic: &str) -> Result<M, EpisodeError> {
        let wanted = self.archive.channel(topic);
        let distance_ns = |message: &&RawMessage| message.time_ns.abs_diff(self.time_ns);
        let of_topic = || self.messages.iter().filter(|message| message.channel_id == wanted);
        let nearest_ns = of_topic().map(|message| distance_ns(&message)).min();
        let mut found = of_topic().filter(|message| Some(distance_ns(message)) == nearest_ns);
        match (found.next(), found.count()) {
            (Some(message), 0) => self.archive.decode(self.sample_idx, message.bytes.clone()),
            (first, others) => Err(EpisodeError::NotAligned {
                topic: topic.to_owned(),
                sample_idx: self.sample_idx,
                time_ns: self.time_ns,
                found: usize::from(first.is_some()) + others,
                nearest_ns: self.archive.nearest_time_ns(topic, self.time_ns)?,
                path: self.archive.path.clone(),
            }),
        }
    }
}

/// The index of a file.
pub(super) fn read_summary(path: &Path) -> Result<mcap::Summary, EpisodeError> {
    let damaged = |source| EpisodeError::Damaged { source, path: path.to_owned() };
    let mut file = store::open_file(path)?;
    let n_bytes = file.metadata()?.len();
    let mut reader = SummaryReader::new_with_options(SummaryReaderOptions::default().with_file_size(n_bytes));
    while let Some(event) = reader.next_event() {
        match event.map_err(damaged)? {
            SummaryReadEvent::ReadRequest(n_wanted) => {
                let n_read = file.read(reader.insert(n_wanted))?;
                reader.notify_read(n_read);
            }
            SummaryReadEvent::SeekRequest(to) => {
                // The disk refuses an offset only if the footer holds an invalid one.
                let position = file.seek(to).map_err(|_| damaged(McapError::BadFooter))?;
                reader.notify_seeked(position);
            }
        }
    }
    let summary = reader.finish().ok_or_else(|| EpisodeError::NoIndex { path: path.to_owned() })?;
    if overlap(summary.chunk_indexes.iter().map(|chunk| [chunk.chunk_start_offset, chunk.chunk_length])) {
        return Err(damaged(McapError::BadIndex));
    }
    // The summary reader does not check the summary's CRC: it is read once more, from the record before it.
    let mut footer = [0; FOOTER_BYTES as usize];
    file.seek(SeekFrom::Start(n_bytes - MAGIC_BYTES - FOOTER_BYTES))?;
    file.read_exact(&mut footer)?;
    if let Ok(Record::Footer(footer)) = mcap::parse_record(mcap::records::op::FOOTER, &footer) {
        let begin = footer.summary_start.saturating_sub(DATA_END_BYTES);
        read_records(path, begin, n_bytes.saturating_sub(begin), 0, |_| {})?;
    }
    Ok(summary)
}

/// Hands over each record of a part of the file, and for a chunk those inside it once its CRC holds.
///
/// The crate's `IndexedReader` would find the chunks by itself, but it never sees a chunk's CRC.
pub(super) fn read_records(
    path: &Path,
    begin: u64,
    n_bytes: u64,
    n_unpacked: u64,
    mut take: impl FnMut(Record<'_>),
) -> Result<(), EpisodeError> {
    let damaged = |source| EpisodeError::Damaged { source, path: path.to_owned() };
    let mut file = store::open_file(path)?;
    if begin.saturating_add(n_bytes) > file.metadata()?.len() {
        return Err(damaged(McapError::BadIndex));
    }
    if n_unpacked > MAX_CHUNK_BYTES {
        return Err(damaged(McapError::ChunkTooLarge(n_unpacked)));
    }
    file.seek(SeekFrom::Start(begin))?;
    let mut part = file.take(n_bytes);
    let limit = n_bytes.max(n_unpacked).min(MAX_CHUNK_BYTES) as usize;
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_validate_summary_section_crc(true)
        .with_record_length_limit(limit);
    let mut reader = LinearReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event.map_err(damaged)? {
            LinearReadEvent::ReadRequest(n_wanted) => {
                let n_read = part.read(reader.insert(n_wanted))?;
                reader.notify_read(n_read);
            }
            LinearReadEvent::Record { opcode, data } => {
                take(mcap::parse_record(opcode, data).map_err(damaged)?);
            }
        }
    }
    Ok(())
}
