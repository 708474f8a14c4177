//! The stamps inside messages, set beside the times at which a file has the messages.
//!
//! Readers find messages by the file's times alone; the stamp tells of one that was shifted, or exchanged with another sample's.

use std::collections::BTreeMap;
use std::path::Path;

use mcap::records::Record;
use prost::{DecodeError, Message as _};
use prost_types::Timestamp;

use super::archive_check::{ArchiveCounts, read_whole};
use super::error::{EpisodeError, STAMP_TOLERANCE_NS};

const NS_PER_S: i128 = 1_000_000_000;
/// The last time that foxglove's messages can hold, in the year 2106; every later one is written as this.
const LAST_FOXGLOVE_NS: i128 = (1 << 32) * NS_PER_S - 1;

/// The messages of a topic whose own stamps are not their log times.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OffStamps {
    pub topic: String,
    /// Log time of the first of them.
    pub log_time_ns: u64,
    /// The stamp within that one; below zero before 1970.
    pub stamp_ns: i128,
    pub n_messages: usize,
}

/// As [`super::check_archive`]; tells also the topics, sorted, on which messages are stamped otherwise than the file has them. Our
/// own stamps are exact; in files by others they may lie as far beside as readers take messages of a sample.
///
/// # Errors
/// As [`super::check_archive`]. A message that cannot be unpacked is left to who reads it.
pub fn check_stamps(path: &Path, is_ours: bool) -> Result<(ArchiveCounts, Vec<OffStamps>), EpisodeError> {
    let tolerance_ns = if is_ours { 0 } else { STAMP_TOLERANCE_NS };
    let mut stamps = StampCheck { tolerance_ns: tolerance_ns.into(), ..StampCheck::default() };
    let counts = read_whole(path, |record| stamps.add(record))?;
    Ok((counts, stamps.off.into_values().collect()))
}

/// What of a file was read so far.
#[derive(Default)]
struct StampCheck {
    tolerance_ns: u128,
    /// Names of schemas by their numbers.
    schemas: BTreeMap<u16, String>,
    /// The topics of channels whose messages have stamps, by the channels' numbers.
    channels: BTreeMap<u16, (String, StampPlace)>,
    /// By topic.
    off: BTreeMap<String, OffStamps>,
}

impl StampCheck {
    fn add(&mut self, record: &Record<'_>) {
        match record {
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name.clone());
            }
            Record::Channel(channel) if channel.message_encoding == "protobuf" => {
                let schema = self.schemas.get(&channel.schema_id).map_or("", String::as_str);
                if let Some(place) = StampPlace::of(schema) {
                    self.channels.insert(channel.id, (channel.topic.clone(), place));
                }
            }
            Record::Message { header, data } => self.add_message(header.channel_id, header.log_time, data),
            _ => {}
        }
    }

    fn add_message(&mut self, channel_id: u16, log_time_ns: u64, bytes: &[u8]) {
        let Some((topic, place)) = self.channels.get(&channel_id) else { return };
        let stamps = place.stamps_in(bytes).unwrap_or_default();
        let (wanted_ns, tolerance_ns) = (i128::from(log_time_ns), self.tolerance_ns);
        let is_off = |stamp_ns: &i128| {
            let is_last = *stamp_ns == LAST_FOXGLOVE_NS && wanted_ns > LAST_FOXGLOVE_NS;
            stamp_ns.abs_diff(wanted_ns) > tolerance_ns && !is_last
        };
        let Some(stamp_ns) = stamps.iter().map(ns_of).find(is_off) else { return };
        let first = || OffStamps { topic: topic.clone(), log_time_ns, stamp_ns, n_messages: 0 };
        self.off.entry(topic.clone()).or_insert_with(first).n_messages += 1;
    }
}

fn ns_of(stamp: &Timestamp) -> i128 {
    i128::from(stamp.seconds) * NS_PER_S + i128::from(stamp.nanos)
}

/// Where the messages of a schema have their stamps.
#[derive(Debug, Clone, Copy)]
enum StampPlace {
    /// In the first field, as all of harmzone's and most of foxglove's.
    Front,
    /// In each of the parts that the message is made of.
    Parts,
    /// Behind the parts.
    Annotations,
}

/// A message, or a part of one, with its stamp in front; the rest is passed over.
#[derive(Clone, PartialEq, prost::Message)]
struct StampedFront {
    #[prost(message, optional, tag = "1")]
    timestamp: Option<Timestamp>,
}

/// The transforms of `foxglove.FrameTransforms`; deletions and entities of `foxglove.SceneUpdate`.
#[derive(Clone, PartialEq, prost::Message)]
struct StampedParts {
    #[prost(message, repeated, tag = "1")]
    first: Vec<StampedFront>,
    #[prost(message, repeated, tag = "2")]
    second: Vec<StampedFront>,
}

/// `foxglove.ImageAnnotations`, whose own stamp counts for its parts.
#[derive(Clone, PartialEq, prost::Message)]
struct StampedAnnotations {
    #[prost(message, optional, tag = "5")]
    timestamp: Option<Timestamp>,
}

impl StampPlace {
    /// By the schema's full name; `None` where it has no stamp that is known.
    fn of(schema: &str) -> Option<Self> {
        match schema {
            "foxglove.CameraCalibration"
            | "foxglove.CompressedImage"
            | "foxglove.PointCloud"
            | "foxglove.PoseInFrame" => Some(Self::Front),
            "foxglove.FrameTransforms" | "foxglove.SceneUpdate" => Some(Self::Parts),
            "foxglove.ImageAnnotations" => Some(Self::Annotations),
            other => other.starts_with("harmzone.").then_some(Self::Front),
        }
    }

    /// The stamps that a message has.
    fn stamps_in(self, bytes: &[u8]) -> Result<Vec<Timestamp>, DecodeError> {
        Ok(match self {
            Self::Front => StampedFront::decode(bytes)?.timestamp.into_iter().collect(),
            Self::Parts => {
                let StampedParts { first, second } = StampedParts::decode(bytes)?;
                first.into_iter().chain(second).filter_map(|part| part.timestamp).collect()
            }
            Self::Annotations => StampedAnnotations::decode(bytes)?.timestamp.into_iter().collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use foxglove::messages as fox;

    use super::*;
    use crate::episode::archive::ArchiveWriter;
    use crate::episode::messages::fox_time;
    use crate::episode::{drawing, regions, topics};

    /// What is found where a message of each kind has this log time and this stamp.
    fn off(log_time_ns: u64, stamp_ns: u64, is_ours: bool) -> Vec<OffStamps> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("some.mcap");
        let declared = [
            topics::TF.spec(),
            topics::IMAGE.spec(),
            topics::MARKERS.spec(),
            topics::IGNORED.spec(),
            topics::HARM_ANNOTATIONS.spec(),
        ];
        let mut archive = ArchiveWriter::create(&path, &declared).unwrap();
        archive.begin_sample(log_time_ns).unwrap();
        let timestamp = Some(fox_time(stamp_ns));
        let transform = fox::FrameTransform { timestamp, ..fox::FrameTransform::default() };
        archive.write(topics::TF, &fox::FrameTransforms { transforms: vec![transform] }).unwrap();
        let image = fox::CompressedImage { timestamp, ..fox::CompressedImage::default() };
        archive.write(topics::IMAGE, &image).unwrap();
        let entity = drawing::entity(stamp_ns, "ego", "a".to_owned(), 0);
        archive.write(topics::MARKERS, &drawing::update(vec![entity])).unwrap();
        archive.write(topics::IGNORED, &regions::regions_message(stamp_ns, &[])).unwrap();
        let annotations = fox::ImageAnnotations { timestamp, ..fox::ImageAnnotations::default() };
        archive.write(topics::HARM_ANNOTATIONS, &annotations).unwrap();
        archive.finish([("about", BTreeMap::new())]).unwrap();
        let (counts, off) = check_stamps(&path, is_ours).unwrap();
        assert_eq!(counts.n_messages, declared.len());
        off
    }

    #[test]
    fn a_stamp_beside_the_log_time_is_found_in_each_kind_of_message() {
        let time_ns = 1_735_689_600_300_000_000;
        assert!(off(time_ns, time_ns, true).is_empty());
        let found = off(time_ns, time_ns + 1, true);
        let topics: Vec<&str> = found.iter().map(|of| of.topic.as_str()).collect();
        let wanted = [
            "/cam_front/harm_annotations",
            "/cam_front/image_rect_compressed",
            "/tf",
            "/truth/ignored",
            "/truth/markers",
        ];
        assert_eq!(topics, wanted);
        let first = OffStamps {
            topic: wanted[0].to_owned(),
            log_time_ns: time_ns,
            stamp_ns: i128::from(time_ns) + 1,
            n_messages: 1,
        };
        assert_eq!(found[0], first);
    }

    #[test]
    fn files_by_others_may_have_stamps_a_little_beside_the_log_time() {
        let time_ns = 1_735_689_600_300_000_000;
        assert!(off(time_ns, time_ns + STAMP_TOLERANCE_NS, false).is_empty());
        assert_eq!(off(time_ns, time_ns - STAMP_TOLERANCE_NS - 1, false).len(), 5);
    }

    #[test]
    fn times_after_the_year_2106_are_as_right_as_foxglove_can_say_them() {
        let time_ns = 5_000_000_000_000_000_000;
        assert!(off(time_ns, time_ns, true).is_empty());
        assert_eq!(off(time_ns, time_ns + 1, true).len(), 1, "harmzone's own stamp is exact");
    }
}
