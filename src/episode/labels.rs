//! Label files `labels/<set>/<episode>.mcap`: which objects are harmful, and drawings of it.

use std::path::{Path, PathBuf};

use foxglove::messages as fox;
use prost::Message as _;

use super::archive::{Archive, ArchiveWriter};
use super::error::{EpisodeError, Fault};
use super::messages::{own_time, wire};
use super::{SourceMeta, convert, drawing, topics};
use crate::geometry::Point2;
use crate::object::{Harm, ObjectTruth};
use crate::sample::Sample;

const RECORD: &str = "labels";

/// The label of one object.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectLabel {
    /// The object's id in the episode.
    pub id: String,
    pub harm: Harm,
    /// Shared by the object's footprint and the zone.
    pub overlap_area_m2: f64,
    /// The shared area over the footprint's, 0 to 1.
    pub overlap_ratio: f64,
    /// Seconds until contact; only of zone `ttc`, and only where contact comes within its horizon.
    pub time_to_collision_s: Option<f64>,
}

/// The labels of one sample.
#[derive(Debug, Clone, PartialEq)]
pub struct SampleLabels {
    pub time_ns: u64,
    pub zone_name: String,
    /// In the ego frame, in order round the zone; a corridor runs out along one side and back along
    /// the other.
    pub zone_corners: Vec<Point2>,
    /// One for each object of the sample, in its order.
    pub labels: Vec<ObjectLabel>,
}

impl SampleLabels {
    fn to_message(&self) -> wire::HarmLabels {
        let corner = |corner: &Point2| wire::Point2 { x_m: corner.x_m, y_m: corner.y_m };
        let label = |label: &ObjectLabel| wire::HarmLabel {
            id: label.id.clone(),
            harm: convert::harm_number(label.harm),
            overlap_area_m2: label.overlap_area_m2,
            overlap_ratio: label.overlap_ratio,
            time_to_collision_s: label.time_to_collision_s,
        };
        wire::HarmLabels {
            timestamp: Some(own_time(self.time_ns)),
            zone_name: self.zone_name.clone(),
            zone: self.zone_corners.iter().map(corner).collect(),
            labels: self.labels.iter().map(label).collect(),
        }
    }

    fn from_message(time_ns: u64, message: wire::HarmLabels) -> Result<Self, Fault> {
        let corner = |corner: wire::Point2| Point2 { x_m: corner.x_m, y_m: corner.y_m };
        let label = |label: wire::HarmLabel| {
            let harm = convert::harm_of(label.harm).map_err(|fault| fault.of(&label.id))?;
            let wire::HarmLabel { id, overlap_area_m2, overlap_ratio, time_to_collision_s, .. } = label;
            Ok(ObjectLabel { id, harm, overlap_area_m2, overlap_ratio, time_to_collision_s })
        };
        let labels = Self {
            time_ns,
            zone_name: message.zone_name,
            zone_corners: message.zone.into_iter().map(corner).collect(),
            labels: message.labels.into_iter().map(label).collect::<Result<_, Fault>>()?,
        };
        labels.check()?;
        Ok(labels)
    }

    fn check(&self) -> Result<(), Fault> {
        for corner in &self.zone_corners {
            convert::check_finite("zone.x_m", corner.x_m)?;
            convert::check_finite("zone.y_m", corner.y_m)?;
        }
        self.labels.iter().try_for_each(|label| {
            convert::check_finite("overlap_area_m2", label.overlap_area_m2)
                .and_then(|()| convert::check_finite("overlap_ratio", label.overlap_ratio))
                .and_then(|()| {
                    let time_s = label.time_to_collision_s.unwrap_or(0.0);
                    convert::check_finite("time_to_collision_s", time_s)
                })
                .map_err(|fault| fault.of(&label.id))
        })
    }

    /// Each object with its label, if the two lists are of the same objects in the same order.
    fn paired<'a>(&'a self, objects: &'a [ObjectTruth]) -> Result<Vec<(&'a ObjectTruth, Harm)>, Fault> {
        let same_ids = self.labels.iter().map(|label| &label.id).eq(objects.iter().map(|object| &object.id));
        if !same_ids {
            let found = format!("{} labels for {} objects", self.labels.len(), objects.len());
            return Err(Fault::new("labels", found, "one for each object, in the sample's order, is needed"));
        }
        Ok(objects.iter().zip(self.labels.iter().map(|label| label.harm)).collect())
    }
}

/// A label file being written under a partial name; dropped unfinished, it leaves nothing.
pub struct LabelWriter {
    archive: ArchiveWriter,
    meta: SourceMeta,
    zone: u16,
    objects: u16,
    annotations: u16,
    labels: u16,
    n_samples: usize,
    last_ns: Option<u64>,
}

impl LabelWriter {
    /// Starts a label file; its folder must exist.
    ///
    /// # Errors
    /// The file cannot be made.
    pub fn create(path: &Path, meta: &SourceMeta) -> Result<Self, EpisodeError> {
        let mut archive = ArchiveWriter::create(path)?;
        Ok(Self {
            meta: meta.clone(),
            zone: archive.channel::<fox::SceneUpdate>(topics::HARM_ZONE)?,
            objects: archive.channel::<fox::SceneUpdate>(topics::HARM_OBJECTS)?,
            annotations: archive.channel::<fox::ImageAnnotations>(topics::HARM_ANNOTATIONS)?,
            labels: archive.channel::<wire::HarmLabels>(topics::HARM_LABELS)?,
            archive,
            n_samples: 0,
            last_ns: None,
        })
    }

    /// Adds the labels of the next sample; the sample itself serves the drawings.
    ///
    /// # Errors
    /// Labels that are not one for each object in the sample's order, a number that is not finite,
    /// a time that is not the sample's or does not advance, or the disk.
    pub fn write(&mut self, labels: &SampleLabels, sample: &Sample) -> Result<(), EpisodeError> {
        let (time_ns, idx) = (sample.measured.time_ns, self.n_samples);
        let invalid = |fault| EpisodeError::Invalid {
            episode: self.meta.episode.clone(),
            sample_idx: idx,
            fault: Box::new(fault),
            path: self.archive.path.clone(),
        };
        labels.check().map_err(invalid)?;
        if labels.time_ns != time_ns {
            return Err(invalid(Fault::new("time_ns", labels.time_ns, "the sample's time is needed")));
        }
        let boxes = labels.paired(&sample.truth.objects).map_err(invalid)?;
        super::check_time_order(&mut self.last_ns, time_ns, idx, &self.archive.path)?;
        let annotations =
            drawing::image_annotations(&sample.measured, &labels.zone_corners, boxes.iter().copied());
        let archive = &mut self.archive;
        archive.message(self.zone, idx, time_ns, &drawing::zone_update(time_ns, &labels.zone_corners))?;
        archive.message(self.objects, idx, time_ns, &drawing::harm_boxes(time_ns, boxes.into_iter()))?;
        archive.message(self.annotations, idx, time_ns, &annotations)?;
        archive.message(self.labels, idx, time_ns, &labels.to_message())?;
        self.n_samples += 1;
        Ok(())
    }

    /// Writes the metadata and the index, and gives the file its name.
    ///
    /// # Errors
    /// Nothing was written, or the disk.
    pub fn finish(mut self) -> Result<PathBuf, EpisodeError> {
        let path = self.archive.path.clone();
        if self.n_samples == 0 {
            return Err(EpisodeError::Empty { path });
        }
        self.archive.metadata(RECORD, self.meta.to_record())?;
        self.archive.finish()?;
        Ok(path)
    }
}

/// A label file, read whole.
#[derive(Debug)]
pub struct LabelReader {
    meta: SourceMeta,
    samples: Vec<SampleLabels>,
    path: PathBuf,
}

impl LabelReader {
    /// Reads all labels of an episode.
    ///
    /// # Errors
    /// A truncated or foreign file, or a value that is not usable.
    pub fn open(path: &Path) -> Result<Self, EpisodeError> {
        let archive = Archive::open(path)?;
        let channel = archive.channel::<wire::HarmLabels>(topics::HARM_LABELS, &[topics::HARM_LABELS])?;
        let meta = SourceMeta::from_record(&archive.metadata(RECORD)?, RECORD, path)?;
        let mut samples = Vec::new();
        for (sample_idx, raw) in archive.messages_of(channel)?.into_iter().enumerate() {
            let path = || path.to_owned();
            let message = wire::HarmLabels::decode(raw.bytes.as_slice())
                .map_err(|source| EpisodeError::Decode { sample_idx, source, path: path() })?;
            let labels =
                SampleLabels::from_message(raw.time_ns, message).map_err(|fault| EpisodeError::Invalid {
                    episode: meta.episode.clone(),
                    sample_idx,
                    fault: Box::new(fault),
                    path: path(),
                })?;
            samples.push(labels);
        }
        Ok(Self { meta, samples, path: path.to_owned() })
    }

    #[must_use]
    pub fn meta(&self) -> &SourceMeta {
        &self.meta
    }

    /// The labels of each sample, in order of time.
    #[must_use]
    pub fn samples(&self) -> &[SampleLabels] {
        &self.samples
    }

    /// Refuses labels that were made from another episode than the one with this content hash.
    ///
    /// # Errors
    /// [`EpisodeError::OtherEpisode`].
    pub fn check_episode(&self, episode_sha256: &str) -> Result<(), EpisodeError> {
        self.meta.check_episode(episode_sha256, &self.path)
    }
}
