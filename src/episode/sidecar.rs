//! Reads files beside an episode that hold one message per sample.

use std::path::{Path, PathBuf};

use super::SourceMeta;
use super::archive_check::check_archive;
use super::archive_reader::Archive;
use super::error::{EpisodeError, MessageFault};
use super::messages::TopicMessage;
use super::topics::Topic;
use crate::store::sha256_of;

/// The content of a file beside an episode for one sample.
pub trait SidecarSample: Sized {
    type Message: TopicMessage;
    const TOPIC: Topic<Self::Message>;
    /// Name of the metadata record that holds the [`SourceMeta`].
    const RECORD: &'static str;

    /// The sample that a message holds, if every value is usable.
    fn from_message(time_ns: u64, message: Self::Message) -> Result<Self, MessageFault>;
}

/// A file beside an episode, read whole.
#[derive(Debug)]
pub struct SidecarReader<S> {
    meta: SourceMeta,
    samples: Vec<S>,
    path: PathBuf,
}

impl<S: SidecarSample> SidecarReader<S> {
    /// Reads the file's content for all samples.
    ///
    /// # Errors
    /// A truncated, damaged or foreign file, or a value that is not usable.
    pub fn open(path: &Path) -> Result<Self, EpisodeError> {
        let archive = Archive::open(path, &[S::TOPIC.spec()])?;
        check_archive(path)?;
        let meta = SourceMeta::from_record(&archive.metadata(S::RECORD)?, S::RECORD, path)?;
        let read = |(sample_idx, (time_ns, message))| {
            S::from_message(time_ns, message).map_err(EpisodeError::invalid(&meta.episode, sample_idx, path))
        };
        let samples =
            archive.messages_of(S::TOPIC)?.into_iter().enumerate().map(read).collect::<Result<_, _>>()?;
        Ok(Self { meta, samples, path: path.to_owned() })
    }

    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    #[must_use]
    pub fn meta(&self) -> &SourceMeta {
        &self.meta
    }

    /// One entry for each sample, in order of time.
    #[must_use]
    pub fn samples(&self) -> &[S] {
        &self.samples
    }

    /// Refuses a file of another content hash.
    ///
    /// # Errors
    /// [`EpisodeError::OtherContent`]; the file cannot be read.
    pub fn check_content(&self, sha256: &str) -> Result<(), EpisodeError> {
        let found = sha256_of(&self.path)?;
        if found == sha256 {
            return Ok(());
        }
        Err(EpisodeError::OtherContent { found, wanted: sha256.to_owned(), path: self.path.clone() })
    }

    /// Refuses a file that was made from another episode than the one with this content hash.
    ///
    /// # Errors
    /// [`EpisodeError::OtherEpisode`].
    pub fn check_episode(&self, episode_sha256: &str) -> Result<(), EpisodeError> {
        self.meta.check_episode(episode_sha256, &self.path)
    }
}
