//! MCAP files as harmzone writes them: protobuf, zstd chunks, indexes, CRCs.
//!
//! A file is written under a partial name and renamed when it is whole. The same messages give the
//! same bytes: one compression thread, no clock.

use std::collections::BTreeMap;
use std::io::{BufWriter, ErrorKind};
use std::path::{Path, PathBuf};

use fs_err as fs;
use mcap::records::{MessageHeader, Metadata};
use tempfile::TempPath;

use super::error::EpisodeError;
use super::messages::TopicMessage;
use super::topics::{Topic, TopicSpec};
use crate::files::{PARTIAL_SUFFIX, create_partial, keep_as, told_with_room};

/// What is wanted on a full disk at the least: a chunk more.
const LEAST_BYTES: u64 = 1_000_000;

/// An error of writing, which tells of room where the disk is full.
fn write_error(source: mcap::McapError, path: &Path) -> EpisodeError {
    // A record that is written beside the chunks fails as one that could not be parsed would.
    let error = match source {
        mcap::McapError::Io(error) | mcap::McapError::Parse(binrw::Error::Io(error)) => error,
        source => return EpisodeError::Write { source, path: path.to_owned() },
    };
    match error.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            EpisodeError::Io(told_with_room(error, path, LEAST_BYTES))
        }
        _ => EpisodeError::Write { source: mcap::McapError::Io(error), path: path.to_owned() },
    }
}

/// A topic as another file declares it.
pub(super) struct CopiedTopic {
    pub(super) topic: String,
    pub(super) message_encoding: String,
    /// Name, encoding and bytes.
    pub(super) schema: Option<(String, String, Vec<u8>)>,
}

/// A file that is being written, sample by sample; dropped unfinished, it leaves nothing.
pub(super) struct ArchiveWriter {
    pub(super) path: PathBuf,
    writer: mcap::Writer<BufWriter<fs::File>>,
    /// The partial file, removed when this is dropped, which happens after the writer.
    partial: TempPath,
    /// Channel numbers by topic.
    channels: BTreeMap<String, u16>,
    pub(super) n_samples: usize,
    /// Time of the last sample.
    time_ns: u64,
}

impl ArchiveWriter {
    /// Starts `<path>.<process>.partial`, whose folder must exist, and declares its topics.
    pub(super) fn create(path: &Path, topics: &[TopicSpec]) -> Result<Self, EpisodeError> {
        // The name is unique to this process: a worker whose parent was killed may still be writing the same
        // file.
        Self::create_as(path, &format!("{}.{PARTIAL_SUFFIX}", std::process::id()), topics)
    }

    /// Starts `<path>.partial`, where no other process may write the same file; what a killed one left there is written over.
    pub(super) fn create_alone(path: &Path) -> Result<Self, EpisodeError> {
        Self::create_as(path, PARTIAL_SUFFIX, &[])
    }

    fn create_as(path: &Path, suffix: &str, topics: &[TopicSpec]) -> Result<Self, EpisodeError> {
        let mut partial = path.as_os_str().to_owned();
        partial.push(format!(".{suffix}"));
        let partial = TempPath::try_from_path(partial)?;
        let file = BufWriter::new(create_partial(&partial)?);
        let writer = mcap::WriteOptions::new()
            .compression(Some(mcap::Compression::Zstd))
            .compression_threads(0)
            .profile("")
            .library(concat!("harmzone ", env!("CARGO_PKG_VERSION")))
            .create(file)
            .map_err(|source| write_error(source, path))?;
        let (path, channels) = (path.to_owned(), BTreeMap::new());
        let mut archive = Self { path, writer, partial, channels, n_samples: 0, time_ns: 0 };
        for topic in topics {
            archive.declare(topic.name, topic.schema)?;
        }
        Ok(archive)
    }

    /// Declares one more topic.
    pub(super) fn declare(
        &mut self,
        topic: &str,
        schema: fn() -> (String, Vec<u8>),
    ) -> Result<(), EpisodeError> {
        let (name, descriptors) = schema();
        self.declare_copied(&CopiedTopic {
            topic: topic.to_owned(),
            message_encoding: "protobuf".to_owned(),
            schema: Some((name, "protobuf".to_owned(), descriptors)),
        })
    }

    /// Declares a topic of another file.
    pub(super) fn declare_copied(&mut self, copied: &CopiedTopic) -> Result<(), EpisodeError> {
        let CopiedTopic { topic, message_encoding, schema } = copied;
        let channel = self.with(|writer| {
            let schema = match schema {
                Some((name, encoding, bytes)) => writer.add_schema(name, encoding, bytes)?,
                None => 0, // which MCAP keeps for channels without a schema
            };
            writer.add_channel(schema, topic, message_encoding, &BTreeMap::new())
        })?;
        self.channels.insert(topic.clone(), channel);
        Ok(())
    }

    /// Whether a topic is declared.
    pub(super) fn has(&self, topic: &str) -> bool {
        self.channels.contains_key(topic)
    }

    fn with<T>(
        &mut self,
        act: impl FnOnce(&mut mcap::Writer<BufWriter<fs::File>>) -> mcap::McapResult<T>,
    ) -> Result<T, EpisodeError> {
        act(&mut self.writer).map_err(|source| write_error(source, &self.path))
    }

    /// Begins the next sample, whose time must be after the last.
    pub(super) fn begin_sample(&mut self, time_ns: u64) -> Result<(), EpisodeError> {
        if self.n_samples > 0 && time_ns <= self.time_ns {
            return Err(EpisodeError::TimeOrder {
                sample_idx: self.n_samples,
                found_ns: time_ns,
                before_ns: self.time_ns,
                path: self.path.clone(),
            });
        }
        self.time_ns = time_ns;
        self.n_samples += 1;
        Ok(())
    }

    /// Time of the last sample.
    pub(super) fn last_ns(&self) -> Option<u64> {
        (self.n_samples > 0).then_some(self.time_ns)
    }

    /// Adds a message to the current sample.
    pub(super) fn write<M: TopicMessage>(
        &mut self,
        topic: Topic<M>,
        message: &M,
    ) -> Result<(), EpisodeError> {
        self.write_named(topic.name, message)
    }

    /// As [`Self::write`], on a topic that was declared by name.
    pub(super) fn write_named<M: TopicMessage>(
        &mut self,
        topic: &str,
        message: &M,
    ) -> Result<(), EpisodeError> {
        self.write_at(self.time_ns, topic, message)
    }

    /// As [`Self::write_named`], of another time than the sample's.
    pub(super) fn write_at<M: TopicMessage>(
        &mut self,
        time_ns: u64,
        topic: &str,
        message: &M,
    ) -> Result<(), EpisodeError> {
        self.write_bytes(time_ns, topic, &message.encode_to_vec())
    }

    /// As [`Self::write_at`], of a message that is packed already.
    pub(super) fn write_bytes(
        &mut self,
        time_ns: u64,
        topic: &str,
        bytes: &[u8],
    ) -> Result<(), EpisodeError> {
        let header = MessageHeader {
            channel_id: *self.channels.get(topic).expect("a file's topics are declared before messages"),
            sequence: u32::try_from(self.n_samples.saturating_sub(1)).unwrap_or(u32::MAX),
            log_time: time_ns,
            publish_time: time_ns,
        };
        self.with(|writer| writer.write_to_known_channel(&header, bytes))
    }

    /// Ends the chunk, so that everything up to here can be read without what follows.
    pub(super) fn end_chunk(&mut self) -> Result<(), EpisodeError> {
        self.with(mcap::Writer::flush)
    }

    /// Writes the metadata records and the summary, and gives the file its name.
    ///
    /// # Errors
    /// There is no sample, or the disk fails.
    pub(super) fn finish<Name: Into<String>>(
        mut self,
        metadata: impl IntoIterator<Item = (Name, BTreeMap<String, String>)>,
    ) -> Result<PathBuf, EpisodeError> {
        if self.n_samples == 0 {
            return Err(EpisodeError::Empty { path: self.path });
        }
        for (name, metadata) in metadata {
            self.with(|writer| writer.write_metadata(&Metadata { name: name.into(), metadata }))?;
        }
        self.with(|writer| writer.finish().map(drop))?;
        let (writer, partial, path) = (self.writer.into_inner(), self.partial, self.path);
        let finish = || -> std::io::Result<()> {
            let file = writer.into_inner().map_err(std::io::IntoInnerError::into_error)?;
            file.sync_all()?;
            keep_as(partial, &path)
        };
        finish().map_err(|error| told_with_room(error, &path, LEAST_BYTES))?;
        Ok(path)
    }
}

#[cfg(test)]
mod tests {
    use std::io::{self, Cursor, Seek, SeekFrom, Write};

    use super::*;

    /// A disk with so much room.
    struct Narrow {
        inner: Cursor<Vec<u8>>,
        n_bytes: usize,
    }

    impl Write for Narrow {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let left = self.n_bytes.saturating_sub(self.inner.position() as usize);
            if left == 0 && !bytes.is_empty() {
                return Err(ErrorKind::StorageFull.into());
            }
            self.inner.write(&bytes[..left.min(bytes.len())])
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Seek for Narrow {
        fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
            self.inner.seek(to)
        }
    }

    /// All kinds of records that are written; how many bytes they take.
    fn write_all(n_bytes: usize) -> mcap::McapResult<usize> {
        let mut writer = mcap::Writer::new(Narrow { inner: Cursor::new(Vec::new()), n_bytes })?;
        let schema = writer.add_schema("harmzone.Thing", "protobuf", b"schema")?;
        let channel_id = writer.add_channel(schema, "/thing", "protobuf", &BTreeMap::new())?;
        for sequence in 0..3 {
            let header = MessageHeader { channel_id, sequence, log_time: 1, publish_time: 1 };
            writer.write_to_known_channel(&header, b"a message")?;
            writer.flush()?;
        }
        let metadata = BTreeMap::from([("key".to_owned(), "value".to_owned())]);
        writer.write_metadata(&Metadata { name: "about".to_owned(), metadata })?;
        writer.finish()?;
        Ok(writer.into_inner().inner.into_inner().len())
    }

    #[test]
    fn wherever_a_disk_is_full_the_room_and_the_file_are_told() {
        let n_bytes = write_all(usize::MAX).unwrap();
        assert!(n_bytes > 500);
        for room in 0..n_bytes {
            let told = write_error(write_all(room).unwrap_err(), Path::new("some.mcap")).to_string();
            assert!(told.contains("the file wants 1.0 MB") && told.contains("some.mcap"), "{room}: {told}");
        }
        assert!(write_all(n_bytes).is_ok());
        // Any other error is told as it is.
        for source in [
            mcap::McapError::Io(ErrorKind::PermissionDenied.into()),
            mcap::McapError::Parse(binrw::Error::Io(ErrorKind::PermissionDenied.into())),
            mcap::McapError::BadMagic,
        ] {
            let told = write_error(source, Path::new("some.mcap")).to_string();
            assert!(told.contains("cannot write MCAP") && !told.contains("wants"), "{told}");
        }
    }
}
