//! One file of an episode, its labels and a detector's boxes, with drawings of all of it for viewers such as Foxglove.
//!
//! Everything but the drawings of the other files is copied as it lies there, so that the readers of each kind read this one too.
//! The drawings are made anew: in one set of colours, without what a least score leaves out, and so that nothing flickers: an entity
//! stays under its name until it moves or is taken away.

mod annotations;
mod boxes;
mod copy;
mod dashes;
mod numbers;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use self::copy::Source;
use super::archive::ArchiveWriter;
use super::error::{EpisodeError, MessageFault};
use super::{DetectionReader, EpisodeReader, LabelReader, SampleDetections, SampleLabels, topics};
use crate::files::FolderLock;
use crate::geometry::Point2;
use crate::interrupt;
use crate::object::{Detection, Harm};
use crate::progress::Progress;
use crate::sample::Sample;
use crate::scene::ego_glb;

/// What is joined. Labels and boxes must be of this episode, which who opens them checks.
#[derive(Clone, Copy)]
pub struct MergeSources<'a> {
    pub episode: &'a EpisodeReader,
    pub labels: Option<&'a LabelReader>,
    pub detections: Option<&'a DetectionReader>,
}

/// How the drawings look; colours are red, green, blue.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MergedLook {
    pub harmful: [u8; 3],
    pub harmless: [u8; 3],
    /// Truth without labels.
    pub unlabelled: [u8; 3],
    pub predicted_harmful: [u8; 3],
    pub predicted_harmless: [u8; 3],
    pub zone: [u8; 3],
    /// Of words on a coloured ground.
    pub ink: [u8; 3],
    pub text: [u8; 3],
    /// Boxes below this score are not drawn or counted; they are copied.
    pub min_score: f64,
}

impl MergedLook {
    fn of_truth(&self, harm: Option<Harm>) -> [u8; 3] {
        match harm {
            None => self.unlabelled,
            Some(Harm::Harmful) => self.harmful,
            Some(Harm::Harmless) => self.harmless,
        }
    }

    fn of_detection(&self, harm: Harm) -> [u8; 3] {
        match harm {
            Harm::Harmful => self.predicted_harmful,
            Harm::Harmless => self.predicted_harmless,
        }
    }
}

/// A sample with all that is drawn of it.
struct Drawn<'a> {
    sample: &'a Sample,
    /// Where anybody annotated.
    has_truth: bool,
    labels: Option<&'a SampleLabels>,
    /// One for each object, with labels.
    harms: Option<Vec<Harm>>,
    /// From the least score on; `None` without predictions.
    detections: Option<Vec<Detection>>,
}

impl Drawn<'_> {
    fn harm(&self, object_idx: usize) -> Option<Harm> {
        self.harms.as_ref().map(|harms| harms[object_idx])
    }

    fn zone(&self) -> Option<&[Point2]> {
        self.labels.map(|labels| labels.zone_corners.as_slice())
    }
}

/// Writes the joined file; one that is there is replaced.
///
/// # Errors
/// A broken file, labels or boxes that are not of the episode's samples, another process that writes the same file, a signal that
/// asks to end, or the disk fails.
pub fn write_merged(
    path: &Path,
    sources: MergeSources<'_>,
    look: &MergedLook,
    progress: &dyn Progress,
) -> Result<PathBuf, EpisodeError> {
    let MergeSources { episode, labels, detections } = sources;
    let _lock = FolderLock::take_beside(path)?;
    let mut files = vec![Source::large(episode.path())?];
    for path in labels.map(LabelReader::path).into_iter().chain(detections.map(DetectionReader::path)) {
        files.push(Source::small(path)?);
    }
    let mut writer = start(path, sources, &files)?;
    let labels_at = |time_ns| labels.and_then(|labels| by_time(labels.samples(), time_ns, |of| of.time_ns));
    let found_at = |time_ns| detections.and_then(|found| by_time(found.samples(), time_ns, |of| of.time_ns));
    let mut boxes = boxes::Boxes::default();
    progress.start("join", episode.len() as u64);
    for (sample_idx, &time_ns) in episode.times_ns().iter().enumerate() {
        interrupt::check()?;
        let sample = episode.whole_sample(sample_idx)?;
        writer.begin_sample(time_ns)?;
        copy_up_to(time_ns, &mut files, &mut writer)?;
        let fail = EpisodeError::invalid(&episode.meta().name, sample_idx, path);
        let of_sample = labels.map(|_| labels_at(time_ns).ok_or_else(|| missing("labels"))).transpose();
        let of_sample = of_sample.map_err(&fail)?;
        let found = detections.map(|_| found_at(time_ns).ok_or_else(|| missing("detections"))).transpose();
        let drawn = Drawn {
            sample: &sample,
            has_truth: episode.has_truth(),
            labels: of_sample,
            harms: of_sample.map(|labels| harms_of(labels, &sample)).transpose().map_err(&fail)?,
            detections: found.map_err(&fail)?.map(|found| from_score(found, look.min_score)),
        };
        draw(&mut writer, &drawn, look, &mut boxes, sample_idx == 0)?;
        writer.end_chunk()?;
        progress.advance(1);
    }
    copy_up_to(u64::MAX, &mut files, &mut writer)?;
    progress.finish();
    let mut records = BTreeMap::new();
    for file in &files {
        for (name, record) in file.records()? {
            records.entry(name).or_insert(record);
        }
    }
    writer.finish(records)
}

/// Starts the file with the topics of the sources, and those of the drawings that there is something for.
fn start(path: &Path, sources: MergeSources<'_>, files: &[Source]) -> Result<ArchiveWriter, EpisodeError> {
    let mut writer = ArchiveWriter::create_alone(path)?;
    for file in files {
        file.declare(&mut writer)?;
    }
    let kinds = [
        (true, topics::OF_VIEW),
        (sources.episode.has_truth(), topics::OF_VIEW_TRUTH),
        (sources.labels.is_some(), topics::OF_VIEW_LABELS),
        (sources.detections.is_some(), topics::OF_VIEW_DETECTIONS),
    ];
    for topic in kinds.into_iter().filter(|(is_there, _)| *is_there).flat_map(|(_, topics)| topics) {
        writer.declare(topic.name, topic.schema)?;
    }
    Ok(writer)
}

/// Copies what lies up to a time; what lies before the sample goes into a chunk of its own, so that who reads samples does not
/// unpack it.
fn copy_up_to(time_ns: u64, files: &mut [Source], writer: &mut ArchiveWriter) -> Result<(), EpisodeError> {
    let mut messages = Vec::new();
    for file in files {
        messages.extend(file.up_to(time_ns)?);
    }
    messages.sort_by_key(|message| message.time_ns);
    let n_before = messages.partition_point(|message| message.time_ns < time_ns);
    for (i, message) in messages.iter().enumerate() {
        if i == n_before && i > 0 {
            writer.end_chunk()?;
        }
        writer.write_bytes(message.time_ns, &message.topic, &message.bytes)?;
    }
    Ok(())
}

fn draw(
    writer: &mut ArchiveWriter,
    drawn: &Drawn<'_>,
    look: &MergedLook,
    boxes: &mut boxes::Boxes,
    is_first: bool,
) -> Result<(), EpisodeError> {
    if is_first {
        writer.write(topics::VIEW_EGO, &boxes::ego(drawn, ego_glb()))?;
    }
    writer.write(topics::VIEW_NUMBERS, &numbers::numbers(drawn))?;
    if drawn.has_truth {
        writer.write(topics::VIEW_BOXES, &boxes.truth(drawn, look))?;
        writer.write(topics::VIEW_TRUTH_ANNOTATIONS, &annotations::truth(drawn, look))?;
        writer.write(topics::VIEW_OBJECTS, &numbers::objects(drawn))?;
    }
    if let Some(corners) = drawn.zone() {
        writer.write(topics::VIEW_ZONE, &boxes::zone(drawn, corners, look))?;
    }
    if let Some(found) = &drawn.detections {
        writer.write(topics::VIEW_DETECTIONS, &boxes.detections(drawn, found, look))?;
        writer.write(topics::VIEW_DETECTION_ANNOTATIONS, &annotations::detections(drawn, found, look))?;
    }
    Ok(())
}

fn missing(of: &'static str) -> MessageFault {
    MessageFault::new(of, "missing at the sample's time", "those of this episode's samples are needed")
}

fn by_time<S>(samples: &[S], wanted_ns: u64, time_ns: impl Fn(&S) -> u64) -> Option<&S> {
    samples.binary_search_by_key(&wanted_ns, time_ns).ok().map(|i| &samples[i])
}

fn harms_of(labels: &SampleLabels, sample: &Sample) -> Result<Vec<Harm>, MessageFault> {
    Ok(labels.check_against(sample)?.into_iter().map(|(_, harm)| harm).collect())
}

fn from_score(found: &SampleDetections, min_score: f64) -> Vec<Detection> {
    found.detections.iter().filter(|detection| detection.score >= min_score).copied().collect()
}
