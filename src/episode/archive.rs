//! MCAP files as harmzone writes and reads them: protobuf, zstd chunks, indexes, CRCs.
//!
//! A file is written under a partial name and renamed when it is whole. The same messages give the
//! same bytes: one compression thread, no clock. Reading keeps no file open, so that thousands of
//! episodes can be at hand; each read takes one chunk.

use std::collections::BTreeMap;
use std::io::{BufWriter, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use fs_err as fs;
use mcap::records::{MessageHeader, Metadata, Record};
use mcap::sans_io::{SummaryReadEvent, SummaryReader, SummaryReaderOptions};

use super::error::EpisodeError;
use super::messages::TopicMessage;
use crate::files::PARTIAL_SUFFIX;

/// A file that is being written.
pub(super) struct ArchiveWriter {
    pub(super) path: PathBuf,
    partial: PathBuf,
    /// `None` once finished.
    writer: Option<mcap::Writer<BufWriter<fs::File>>>,
}

impl ArchiveWriter {
    /// Starts `<path>.<process>.partial`; its folder must exist.
    pub(super) fn create(path: &Path) -> Result<Self, EpisodeError> {
        let mut partial = path.as_os_str().to_owned();
        // A name of this process alone: a worker whose parent was killed may still be writing the same file.
        partial.push(format!(".{}.{PARTIAL_SUFFIX}", std::process::id()));
        let partial = PathBuf::from(partial);
        let file = BufWriter::new(fs::File::create(&partial)?);
        let writer = mcap::WriteOptions::new()
            .compression(Some(mcap::Compression::Zstd))
            .compression_threads(0)
            .profile("")
            .library(concat!("harmzone ", env!("CARGO_PKG_VERSION")))
            .create(file)
            .map_err(|source| EpisodeError::Write { source, path: path.to_owned() })?;
        Ok(Self { path: path.to_owned(), partial, writer: Some(writer) })
    }

    fn with<T>(
        &mut self,
        act: impl FnOnce(&mut mcap::Writer<BufWriter<fs::File>>) -> mcap::McapResult<T>,
    ) -> Result<T, EpisodeError> {
        let writer = self.writer.as_mut().expect("only `finish` takes the writer, and it takes self too");
        act(writer).map_err(|source| EpisodeError::Write { source, path: self.path.clone() })
    }

    /// Declares a topic; its number is what [`Self::message`] wants.
    pub(super) fn channel<M: TopicMessage>(&mut self, topic: &str) -> Result<u16, EpisodeError> {
        let (name, descriptors) = M::schema();
        self.with(|writer| {
            let schema = writer.add_schema(&name, "protobuf", &descriptors)?;
            writer.add_channel(schema, topic, "protobuf", &BTreeMap::new())
        })
    }

    pub(super) fn message<M: TopicMessage>(
        &mut self,
        channel_id: u16,
        sample_idx: usize,
        time_ns: u64,
        message: &M,
    ) -> Result<(), EpisodeError> {
        let sequence = u32::try_from(sample_idx).unwrap_or(u32::MAX);
        let header = MessageHeader { channel_id, sequence, log_time: time_ns, publish_time: time_ns };
        self.with(|writer| writer.write_to_known_channel(&header, &message.encode_to_vec()))
    }

    pub(super) fn metadata(
        &mut self,
        name: &str,
        values: BTreeMap<String, String>,
    ) -> Result<(), EpisodeError> {
        self.with(|writer| writer.write_metadata(&Metadata { name: name.to_owned(), metadata: values }))
    }

    /// Ends the chunk, so that what came so far can be read without what follows.
    pub(super) fn end_chunk(&mut self) -> Result<(), EpisodeError> {
        self.with(mcap::Writer::flush)
    }

    /// Writes the summary and gives the file its name.
    pub(super) fn finish(mut self) -> Result<(), EpisodeError> {
        self.with(|writer| writer.finish().map(drop))?;
        let writer = self.writer.take().expect("only this function takes the writer");
        let file = writer.into_inner().into_inner().map_err(std::io::IntoInnerError::into_error)?;
        file.sync_all()?;
        fs::rename(&self.partial, &self.path)?;
        Ok(())
    }
}

impl Drop for ArchiveWriter {
    fn drop(&mut self) {
        if let Some(writer) = self.writer.take() {
            drop(writer);
            // Not finished, so of no use; a leftover would do no harm.
            let _ = fs::remove_file(&self.partial);
        }
    }
}

/// One message as it lies in a chunk.
pub(super) struct RawMessage {
    pub(super) channel_id: u16,
    pub(super) time_ns: u64,
    pub(super) bytes: Vec<u8>,
}

/// A whole file, of which only the index has been read.
pub(super) struct Archive {
    pub(super) path: PathBuf,
    summary: mcap::Summary,
}

impl Archive {
    pub(super) fn open(path: &Path) -> Result<Self, EpisodeError> {
        let damaged = |source| EpisodeError::Damaged { source, path: path.to_owned() };
        let mut file = fs::File::open(path)?;
        let file_size = file.metadata()?.len();
        let mut reader =
            SummaryReader::new_with_options(SummaryReaderOptions::default().with_file_size(file_size));
        while let Some(event) = reader.next_event() {
            match event.map_err(damaged)? {
                SummaryReadEvent::ReadRequest(n_bytes) => {
                    let n_read = file.read(reader.insert(n_bytes))?;
                    reader.notify_read(n_read);
                }
                SummaryReadEvent::SeekRequest(to) => {
                    // An offset outside the file comes from a file too short for its own footer.
                    let position = file.seek(to).map_err(|_| EpisodeError::Damaged {
                        source: mcap::McapError::BadFooter,
                        path: path.to_owned(),
                    })?;
                    reader.notify_seeked(position);
                }
            }
        }
        let summary = reader.finish().ok_or_else(|| EpisodeError::NoIndex { path: path.to_owned() })?;
        Ok(Self { path: path.to_owned(), summary })
    }

    /// The channel of a topic, or an error that tells which of `all_wanted` are missing.
    pub(super) fn channel<M: TopicMessage>(
        &self,
        topic: &'static str,
        all_wanted: &[&'static str],
    ) -> Result<u16, EpisodeError> {
        let Some((&id, channel)) = self.summary.channels.iter().find(|(_, channel)| channel.topic == topic)
        else {
            let mut found: Vec<String> =
                self.summary.channels.values().map(|channel| channel.topic.clone()).collect();
            found.sort();
            let missing = all_wanted
                .iter()
                .copied()
                .filter(|&wanted| !found.iter().any(|topic| topic == wanted))
                .collect();
            return Err(EpisodeError::ForeignTopics { missing, found, path: self.path.clone() });
        };
        let found = channel.schema.as_ref().map_or_else(String::new, |schema| schema.name.clone());
        let wanted = M::schema().0;
        if found != wanted || channel.message_encoding != "protobuf" {
            let found = format!("{found} ({})", channel.message_encoding);
            return Err(EpisodeError::ForeignSchema { topic, found, wanted, path: self.path.clone() });
        }
        Ok(id)
    }

    /// How many messages a channel holds.
    pub(super) fn count(&self, channel_id: u16) -> u64 {
        let counts = self.summary.stats.as_ref().map(|stats| &stats.channel_message_counts);
        counts.and_then(|counts| counts.get(&channel_id)).copied().unwrap_or(0)
    }

    /// The values of a metadata record; empty if there is none.
    pub(super) fn metadata(&self, name: &str) -> Result<BTreeMap<String, String>, EpisodeError> {
        let Some(index) = self.summary.metadata_indexes.iter().find(|index| index.name == name) else {
            return Ok(BTreeMap::new());
        };
        let bytes = self.read(index.offset, index.length)?;
        for record in mcap::read::LinearReader::sans_magic(&bytes) {
            if let Record::Metadata(metadata) = record.map_err(|source| self.damaged(source))? {
                return Ok(metadata.metadata);
            }
        }
        Err(self.damaged(mcap::McapError::BadIndex))
    }

    /// Times of a channel's messages in order.
    pub(super) fn times(&self, channel_id: u16) -> Result<Vec<u64>, EpisodeError> {
        let mut times = Vec::new();
        for chunk in &self.summary.chunk_indexes {
            let bytes =
                self.read(chunk.chunk_start_offset + chunk.chunk_length, chunk.message_index_length)?;
            for record in mcap::read::LinearReader::sans_magic(&bytes) {
                match record.map_err(|source| self.damaged(source))? {
                    Record::MessageIndex(index) if index.channel_id == channel_id => {
                        times.extend(index.records.iter().map(|entry| entry.log_time));
                    }
                    _ => {}
                }
            }
        }
        times.sort_unstable();
        Ok(times)
    }

    /// All messages at one time; in our own files they fill one chunk.
    pub(super) fn messages_at(&self, time_ns: u64) -> Result<Vec<RawMessage>, EpisodeError> {
        let mut messages = Vec::new();
        for (chunk_idx, chunk) in self.summary.chunk_indexes.iter().enumerate() {
            if (chunk.message_start_time..=chunk.message_end_time).contains(&time_ns) {
                messages
                    .extend(self.chunk(chunk_idx)?.into_iter().filter(|message| message.time_ns == time_ns));
            }
        }
        Ok(messages)
    }

    /// All messages of a channel in order of time.
    pub(super) fn messages_of(&self, channel_id: u16) -> Result<Vec<RawMessage>, EpisodeError> {
        let mut messages = Vec::new();
        for chunk_idx in 0..self.summary.chunk_indexes.len() {
            messages.extend(
                self.chunk(chunk_idx)?.into_iter().filter(|message| message.channel_id == channel_id),
            );
        }
        messages.sort_by_key(|message| message.time_ns);
        Ok(messages)
    }

    fn chunk(&self, chunk_idx: usize) -> Result<Vec<RawMessage>, EpisodeError> {
        let index = &self.summary.chunk_indexes[chunk_idx];
        let bytes = self.read(index.chunk_start_offset, index.chunk_length)?;
        let damaged = |source| self.damaged(source);
        // Nine bytes of opcode and length come before the record's own.
        let record = bytes.get(9..).ok_or(mcap::McapError::BadIndex);
        let record = record.and_then(|body| mcap::parse_record(mcap::records::op::CHUNK, body));
        let Record::Chunk { header, data } = record.map_err(damaged)? else {
            return Err(damaged(mcap::McapError::BadIndex));
        };
        let mut messages = Vec::new();
        for record in mcap::read::ChunkReader::new(header, &data).map_err(damaged)? {
            if let Record::Message { header, data } = record.map_err(damaged)? {
                let (channel_id, time_ns) = (header.channel_id, header.log_time);
                messages.push(RawMessage { channel_id, time_ns, bytes: data.into_owned() });
            }
        }
        Ok(messages)
    }

    fn read(&self, offset: u64, n_bytes: u64) -> Result<Vec<u8>, EpisodeError> {
        let mut file = fs::File::open(&self.path)?;
        if offset.saturating_add(n_bytes) > file.metadata()?.len() {
            return Err(self.damaged(mcap::McapError::BadIndex));
        }
        file.seek(SeekFrom::Start(offset))?;
        let mut bytes = vec![0; usize::try_from(n_bytes).expect("a part of a file fits in memory")];
        file.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    fn damaged(&self, source: mcap::McapError) -> EpisodeError {
        EpisodeError::Damaged { source, path: self.path.clone() }
    }
}
