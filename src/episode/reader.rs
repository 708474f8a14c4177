//! Reads an episode back, sample by sample, and refuses what no consumer could use.

use std::path::{Path, PathBuf};

use foxglove::messages as fox;

use super::archive::{Archive, RawMessage};
use super::error::{EpisodeError, Fault};
use super::messages::{TopicMessage, wire};
use super::{EpisodeMeta, convert, topics};
use crate::sample::{Measured, Sample, Truth};

/// An episode of which the index has been read; samples are read when asked for.
///
/// No file stays open in between, so that a data set may hold thousands.
pub struct EpisodeReader {
    archive: Archive,
    meta: EpisodeMeta,
    times_ns: Vec<u64>,
    channels: Channels,
}

struct Channels {
    tf: u16,
    state: u16,
    image: u16,
    camera: u16,
    lidar: u16,
    objects: u16,
}

impl EpisodeReader {
    /// Opens an episode and checks its topics, schemas and counts.
    ///
    /// # Errors
    /// A truncated or damaged file, an MCAP that is no episode, missing metadata, or topics that
    /// do not hold one message a sample.
    pub fn open(path: &Path) -> Result<Self, EpisodeError> {
        let archive = Archive::open(path)?;
        let all = &topics::EACH_SAMPLE;
        let channels = Channels {
            tf: archive.channel::<fox::FrameTransforms>(topics::TF, all)?,
            state: archive.channel::<wire::EgoState>(topics::EGO_STATE, all)?,
            image: archive.channel::<fox::CompressedImage>(topics::IMAGE, all)?,
            camera: archive.channel::<fox::CameraCalibration>(topics::CAMERA_INFO, all)?,
            lidar: archive.channel::<fox::PointCloud>(topics::LIDAR, all)?,
            objects: archive.channel::<wire::Objects>(topics::OBJECTS, all)?,
        };
        let meta = EpisodeMeta::from_record(&archive.metadata(EpisodeMeta::RECORD)?, path)?;
        let counted = [
            (channels.tf, topics::TF),
            (channels.state, topics::EGO_STATE),
            (channels.image, topics::IMAGE),
            (channels.camera, topics::CAMERA_INFO),
            (channels.lidar, topics::LIDAR),
            (channels.objects, topics::OBJECTS),
        ];
        for (channel, topic) in counted {
            let (found, wanted) = (archive.count(channel), meta.n_samples as u64);
            if found != wanted {
                return Err(EpisodeError::Count {
                    topic: topic.to_owned(),
                    found,
                    wanted,
                    path: path.to_owned(),
                });
            }
        }
        let times_ns: Vec<u64> = archive.times(channels.state)?;
        if times_ns.len() != meta.n_samples {
            let (found, wanted) = (times_ns.len() as u64, meta.n_samples as u64);
            let topic = topics::EGO_STATE.to_owned();
            return Err(EpisodeError::Count { topic, found, wanted, path: path.to_owned() });
        }
        Ok(Self { archive, meta, times_ns, channels })
    }

    #[must_use]
    pub fn path(&self) -> &Path {
        &self.archive.path
    }

    #[must_use]
    pub fn meta(&self) -> &EpisodeMeta {
        &self.meta
    }

    /// How many samples there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.times_ns.len()
    }

    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.times_ns.is_empty()
    }

    /// Times of the samples, in order.
    #[must_use]
    pub fn times_ns(&self) -> &[u64] {
        &self.times_ns
    }

    /// Reads one sample.
    ///
    /// # Errors
    /// No such sample, damage, or a value that is not usable: the error names episode, sample,
    /// object and field.
    pub fn sample(&self, sample_idx: usize) -> Result<Sample, EpisodeError> {
        let path: PathBuf = self.archive.path.clone();
        let Some(&time_ns) = self.times_ns.get(sample_idx) else {
            return Err(EpisodeError::NoSample { sample_idx, n_samples: self.len(), path });
        };
        let at = At { messages: &self.archive.messages_at(time_ns)?, sample_idx, path: &path };
        let ids = &self.channels;
        let tf: fox::FrameTransforms = at.one(ids.tf, topics::TF)?;
        let state: wire::EgoState = at.one(ids.state, topics::EGO_STATE)?;
        let image: fox::CompressedImage = at.one(ids.image, topics::IMAGE)?;
        let camera: fox::CameraCalibration = at.one(ids.camera, topics::CAMERA_INFO)?;
        let cloud: fox::PointCloud = at.one(ids.lidar, topics::LIDAR)?;
        let objects: wire::Objects = at.one(ids.objects, topics::OBJECTS)?;
        let build = || -> Result<Sample, Fault> {
            let measured = Measured {
                time_ns,
                ego_state: convert::state_of(&state)?,
                world_from_ego: convert::transform_of(&tf)?,
                ego_from_lidar: convert::transform_of(&tf)?,
                ego_from_camera: convert::transform_of(&tf)?,
                intrinsics: convert::camera_of(&camera)?,
                image: convert::image_of(image)?,
                points: convert::points_of(&cloud)?,
            };
            let objects = objects.objects.into_iter().map(convert::object_of).collect::<Result<_, _>>()?;
            Ok(Sample { measured, truth: Truth { objects } })
        };
        build().map_err(|fault| EpisodeError::Invalid {
            episode: self.meta.name.clone(),
            sample_idx,
            fault: Box::new(fault),
            path: path.clone(),
        })
    }

    /// All samples in order.
    pub fn samples(&self) -> impl Iterator<Item = Result<Sample, EpisodeError>> + '_ {
        (0..self.len()).map(|sample_idx| self.sample(sample_idx))
    }
}

/// The messages of one sample.
struct At<'a> {
    messages: &'a [RawMessage],
    sample_idx: usize,
    path: &'a Path,
}

impl At<'_> {
    fn one<M: TopicMessage>(&self, channel_id: u16, topic: &str) -> Result<M, EpisodeError> {
        let (sample_idx, path) = (self.sample_idx, self.path.to_owned());
        let found: Vec<&RawMessage> =
            self.messages.iter().filter(|message| message.channel_id == channel_id).collect();
        let [message] = found.as_slice() else {
            let topic = topic.to_owned();
            return Err(EpisodeError::NotAligned { topic, sample_idx, found: found.len(), path });
        };
        M::decode(message.bytes.as_slice()).map_err(|source| EpisodeError::Decode {
            sample_idx,
            source,
            path,
        })
    }
}
