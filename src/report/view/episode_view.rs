//! An episode with its labels and predictions, opened once to draw many of its samples.

use std::path::{Path, PathBuf};

use super::Scene;
use super::load::{ViewError, label_reader, predictions_file};
use crate::episode::manifest::{EpisodeEntry, Manifest};
use crate::episode::{DetectionReader, EpisodeReader, LabelReader};
use crate::geometry::Point2;
use crate::object::{Detection, Harm};
use crate::sample::Sample;

/// Which episode, and what of it.
#[derive(Debug, Clone, PartialEq)]
pub struct EpisodeRequest {
    pub dataset: PathBuf,
    /// Its name in the manifest; `None`: the first.
    pub episode: Option<String>,
    /// `None`: `rect`, or no labels where that is not there.
    pub label_set: Option<String>,
    /// A folder with `<episode>.mcap`, or a run that predicted this data set.
    pub predictions: Option<PathBuf>,
    /// Predictions below this score are left out.
    pub min_score: f32,
}

/// An episode, opened.
pub struct EpisodeView {
    pub(super) entry: EpisodeEntry,
    pub(super) episode: EpisodeReader,
    pub(super) labels: Option<LabelReader>,
    pub(super) detections: Option<DetectionReader>,
    pub(super) min_score: f64,
}

/// A sample, ready to be drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewedSample {
    pub sample_idx: usize,
    pub sample: Sample,
    /// One for each of the sample's true objects, in their order; `None` without labels.
    pub harms: Option<Vec<Harm>>,
    /// Corners of the danger zone in the ego frame, metres.
    pub zone: Option<Vec<Point2>>,
    /// `None` without predictions.
    pub detections: Option<Vec<Detection>>,
}

impl ViewedSample {
    /// What is drawn of it.
    #[must_use]
    pub fn scene<'a>(&'a self, episode: &'a str) -> Scene<'a> {
        Scene {
            episode,
            sample_idx: self.sample_idx,
            sample: &self.sample,
            harms: self.harms.as_deref(),
            zone: self.zone.as_deref(),
            detections: self.detections.as_deref(),
        }
    }

    /// How many objects are harmful; 0 without labels.
    #[must_use]
    pub fn n_harmful(&self) -> usize {
        self.harms.iter().flatten().filter(|&&harm| harm == Harm::Harmful).count()
    }
}

impl EpisodeView {
    /// Opens an episode of a data set, with the labels and predictions that belong to it.
    ///
    /// # Errors
    /// [`ViewError`]: no such episode, labels or predictions, those of another episode, or a broken file.
    pub fn open(request: &EpisodeRequest) -> Result<Self, ViewError> {
        let dataset = &request.dataset;
        let manifest = Manifest::read(dataset)?;
        let entry = find(&manifest, request.episode.as_deref(), dataset)?.clone();
        let episode = EpisodeReader::open_entry(dataset, &entry)?;
        let labels = label_reader(dataset, request.label_set.as_deref(), &entry)?;
        let open = |folder: &PathBuf| -> Result<DetectionReader, ViewError> {
            let reader = DetectionReader::open(&predictions_file(folder, dataset, &entry)?)?;
            reader.check_episode(&entry.sha256)?;
            Ok(reader)
        };
        let detections = request.predictions.as_ref().map(open).transpose()?;
        Ok(Self { entry, episode, labels, detections, min_score: request.min_score.into() })
    }

    #[must_use]
    pub fn name(&self) -> &str {
        &self.entry.name
    }

    /// The episode's file.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.episode.path()
    }

    #[must_use]
    pub fn n_samples(&self) -> usize {
        self.episode.len()
    }

    /// Times of the samples, in order.
    #[must_use]
    pub fn times_ns(&self) -> &[u64] {
        self.episode.times_ns()
    }

    /// Reads a sample with all that is drawn of it.
    ///
    /// # Errors
    /// No such sample, labels or predictions that are not of it, or damage.
    pub fn sample(&self, sample_idx: usize) -> Result<ViewedSample, ViewError> {
        let sample = self.episode.sample(sample_idx)?;
        let time_ns = sample.measured.time_ns;
        let not_aligned = |path: &Path| ViewError::NotAligned { time_ns, path: path.to_owned() };
        let labels = match &self.labels {
            None => None,
            Some(reader) => {
                let of_sample = reader.samples().iter().find(|labels| {
                    labels.time_ns == time_ns && labels.labels.len() == sample.objects().len()
                });
                Some(of_sample.ok_or_else(|| not_aligned(reader.path()))?)
            }
        };
        let detections = match &self.detections {
            None => None,
            Some(reader) => {
                let found = reader.samples().iter().find(|found| found.time_ns == time_ns);
                let found = found.ok_or_else(|| not_aligned(reader.path()))?;
                let is_shown = |detection: &&Detection| detection.score >= self.min_score;
                Some(found.detections.iter().filter(is_shown).copied().collect())
            }
        };
        Ok(ViewedSample {
            sample_idx,
            harms: labels.map(|labels| labels.labels.iter().map(|label| label.harm).collect()),
            zone: labels.map(|labels| labels.zone_corners.clone()),
            detections,
            sample,
        })
    }
}

/// The episode of this name, or the first.
fn find<'a>(
    manifest: &'a Manifest,
    wanted: Option<&str>,
    path: &Path,
) -> Result<&'a EpisodeEntry, ViewError> {
    let Some(wanted) = wanted else {
        return manifest.episodes.first().ok_or_else(|| ViewError::Empty { path: path.to_owned() });
    };
    manifest.episodes.iter().find(|entry| entry.name == wanted).ok_or_else(|| {
        let found = manifest.episodes.iter().map(|entry| entry.name.clone()).collect();
        ViewError::NoEpisode { episode: wanted.to_owned(), found, path: path.to_owned() }
    })
}
