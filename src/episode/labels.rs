//! Label files `labels/<set>/<episode>.mcap`: which objects are harmful, and drawings of it.

use std::path::{Path, PathBuf};

use super::archive::ArchiveWriter;
use super::error::{EpisodeError, MessageFault};
use super::messages::{own_time, wire};
use super::sidecar::{SidecarReader, SidecarSample};
use super::topics::{self, Topic};
use super::{SourceMeta, convert, drawing, objects};
use crate::geometry::Point2;
use crate::object::{Harm, Object};
use crate::sample::Sample;

/// The label of one object.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectLabel {
    /// The object's id in the episode.
    pub id: String,
    pub harm: Harm,
    /// Area shared by the object's footprint and the zone.
    pub overlap_area_m2: f64,
    /// The shared area over the footprint's area, 0 to 1.
    pub overlap_ratio: f64,
    /// Seconds until contact; only for the zone `ttc`, and only if contact comes within its horizon.
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

impl SidecarSample for SampleLabels {
    type Message = wire::HarmLabels;
    const TOPIC: Topic<wire::HarmLabels> = topics::HARM_LABELS;
    const RECORD: &'static str = "labels";

    fn from_message(time_ns: u64, message: wire::HarmLabels) -> Result<Self, MessageFault> {
        let corner = |corner: wire::Point2| Point2 { x_m: corner.x_m, y_m: corner.y_m };
        let label = |label: wire::HarmLabel| {
            let harm = objects::harm_of(label.harm).map_err(|fault| fault.of(&label.id))?;
            let wire::HarmLabel { id, overlap_area_m2, overlap_ratio, time_to_collision_s, .. } = label;
            Ok(ObjectLabel { id, harm, overlap_area_m2, overlap_ratio, time_to_collision_s })
        };
        let labels = Self {
            time_ns,
            zone_name: message.zone_name,
            zone_corners: message.zone.into_iter().map(corner).collect(),
            labels: message.labels.into_iter().map(label).collect::<Result<_, MessageFault>>()?,
        };
        labels.check()?;
        Ok(labels)
    }
}

impl SampleLabels {
    fn to_message(&self) -> wire::HarmLabels {
        let corner = |corner: &Point2| wire::Point2 { x_m: corner.x_m, y_m: corner.y_m };
        let label = |label: &ObjectLabel| wire::HarmLabel {
            id: label.id.clone(),
            harm: objects::harm_number(label.harm),
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

    fn check(&self) -> Result<(), MessageFault> {
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

    /// Each object of the sample with its label, if the labels are usable and the sample's own.
    pub(super) fn check_against<'a>(
        &self,
        sample: &'a Sample,
    ) -> Result<Vec<(&'a Object, Harm)>, MessageFault> {
        self.check()?;
        if self.time_ns != sample.measured.time_ns {
            return Err(MessageFault::new("time_ns", self.time_ns, "the sample's time is needed"));
        }
        let truths = sample.objects();
        let same_ids = self
            .labels
            .iter()
            .map(|label| Some(&label.id))
            .eq(truths.iter().map(|object| object.id.as_ref()));
        if !same_ids {
            let found = format!("{} labels for {} objects", self.labels.len(), truths.len());
            return Err(MessageFault::new(
                "labels",
                found,
                "one for each object, in the sample's order, is needed",
            ));
        }
        Ok(truths.iter().zip(self.labels.iter().map(|label| label.harm)).collect())
    }
}

/// A label file, read whole.
pub type LabelReader = SidecarReader<SampleLabels>;

/// A label file being written under a partial name; dropped unfinished, it leaves nothing.
pub struct LabelWriter {
    archive: ArchiveWriter,
    meta: SourceMeta,
}

impl LabelWriter {
    /// Starts a label file; its folder must exist.
    ///
    /// # Errors
    /// The file cannot be made.
    pub fn create(path: &Path, meta: &SourceMeta) -> Result<Self, EpisodeError> {
        Ok(Self { archive: ArchiveWriter::create(path, topics::OF_LABELS)?, meta: meta.clone() })
    }

    /// Adds the labels of the next sample; the sample itself is for the drawings.
    ///
    /// # Errors
    /// Labels that are not one for each object in the sample's order, a number that is not finite,
    /// a time that is not the sample's or does not advance, or the disk fails.
    pub fn write(&mut self, labels: &SampleLabels, sample: &Sample) -> Result<(), EpisodeError> {
        let (time_ns, archive) = (sample.measured.time_ns, &mut self.archive);
        let boxes = labels.check_against(sample).map_err(EpisodeError::invalid(
            &self.meta.episode,
            archive.n_samples,
            &archive.path,
        ))?;
        let annotations =
            drawing::image_annotations(&sample.measured, &labels.zone_corners, boxes.iter().copied());
        archive.begin_sample(time_ns)?;
        archive.write(topics::HARM_ZONE, &drawing::zone_update(time_ns, &labels.zone_corners))?;
        archive.write(topics::HARM_OBJECTS, &drawing::harm_boxes(time_ns, boxes.into_iter()))?;
        archive.write(topics::HARM_ANNOTATIONS, &annotations)?;
        archive.write(topics::HARM_LABELS, &labels.to_message())
    }

    /// Writes the metadata and the index, and gives the file its name.
    ///
    /// # Errors
    /// Nothing was written, or the disk fails.
    pub fn finish(self) -> Result<PathBuf, EpisodeError> {
        self.archive.finish([(SampleLabels::RECORD, self.meta.to_record())])
    }
}
