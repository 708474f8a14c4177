//! Draws a sample, by its number in a data set's folder, into a picture on disk.

use std::path::{Path, PathBuf};

use fs_err as fs;
use serde::Serialize;
use thiserror::Error;

use super::moment::Moment;
use super::rerun_process::RerunError;
use super::{Scene, draw};
use crate::episode::manifest::{EpisodeEntry, LabelManifest, Manifest, ManifestError, label_sets};
use crate::episode::{DetectionReader, EpisodeError, EpisodeReader, LabelReader, label_command, zone_in};
use crate::files::{self, write_atomic};
use crate::geometry::Point2;
use crate::object::{Detection, Harm};
use crate::report::clips::ClipError;
use crate::sample::Sample;
use crate::store;

/// Why a sample could not be drawn.
#[derive(Debug, Error)]
pub enum ViewError {
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    #[error(transparent)]
    Episode(#[from] EpisodeError),
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error("there is no sample {found}; the data set has 0 to {last}: {}", path.display())]
    NoSample { found: usize, last: usize, path: PathBuf },
    #[error("the data set holds no sample: {}", path.display())]
    Empty { path: PathBuf },
    #[error("no episode `{episode}`; the data set has {}: {}", listed(found), path.display())]
    NoEpisode { episode: String, found: Vec<String>, path: PathBuf },
    #[error("no label set `{set}`, found {found:?}; `harmzone label {}` makes labels: {}", path.display(), path.display())]
    NoLabels { set: String, found: Vec<String>, path: PathBuf },
    /// `command`: `harmzone label` with the set's zone.
    #[error("episode `{episode}` has no labels in set `{set}`; `{command}` makes them")]
    NotLabelled { episode: String, set: String, command: String },
    #[error("no predictions for episode `{episode}`; {wanted:?} is needed here; `harmzone predict RUN --data DIR` writes it: {}", path.display())]
    NoPredictions { episode: String, wanted: String, path: PathBuf },
    #[error("no labels or predictions at this sample's time ({time_ns} ns): {}", path.display())]
    NotAligned { time_ns: u64, path: PathBuf },
    #[error("the camera's image cannot be unpacked: {source}: {}", path.display())]
    Image { source: image::ImageError, path: PathBuf },
    #[error("the file exists; --force replaces it: {}", path.display())]
    Exists { path: PathBuf },
    #[error(
        "from {from} to {to} there is no sample; episode `{episode}` has samples 0 to {last}, {seconds:.1} s"
    )]
    NoSpan { episode: String, from: Moment, to: Moment, last: usize, seconds: f64 },
    #[error(transparent)]
    Clip(#[from] ClipError),
    #[error(transparent)]
    Rerun(#[from] RerunError),
}

/// At most so many names are listed.
const MOST_LISTED: usize = 20;

/// Names, of which the first are told.
fn listed(names: &[String]) -> String {
    let told = names.iter().take(MOST_LISTED).map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    match names.len().saturating_sub(MOST_LISTED) {
        0 => told,
        n_more => format!("{told} and {n_more} more"),
    }
}

/// The label set that is drawn where none is named.
const DEFAULT_SET: &str = "rect";

/// What to draw, and where to.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewRequest {
    pub dataset: PathBuf,
    /// Counted through all episodes in the manifest's order, from 0.
    pub sample: usize,
    /// `None`: `rect`, or no labels where that is not there.
    pub label_set: Option<String>,
    /// A folder with `<episode>.mcap`, or a run that predicted this data set.
    pub predictions: Option<PathBuf>,
    /// Predictions below this score are left out.
    pub min_score: f32,
    pub out: PathBuf,
    pub force: bool,
}

/// The result of drawing.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ViewSummary {
    pub episode: String,
    pub sample_idx: usize,
    /// `None` where nobody annotated.
    pub n_objects: Option<usize>,
    /// `None` without labels.
    pub n_harmful: Option<usize>,
    pub n_detections: Option<usize>,
    pub out: PathBuf,
}

/// Draws one sample of a data set into a PNG file.
///
/// # Errors
/// [`ViewError`].
pub fn run(request: &ViewRequest) -> Result<ViewSummary, ViewError> {
    let dataset = &request.dataset;
    if !request.force && files::is_there(&request.out)? {
        return Err(ViewError::Exists { path: request.out.clone() });
    }
    let manifest = Manifest::read(dataset)?;
    let (entry, sample_idx) = locate(&manifest, request.sample, dataset)?;
    let (sample, harms, zone) = read(dataset, request.label_set.as_deref(), entry, sample_idx)?;
    let time_ns = sample.measured.time_ns;
    let detections = request
        .predictions
        .as_deref()
        .map(|folder| read_detections(folder, dataset, entry, time_ns, request.min_score))
        .transpose()?;
    let picture = draw(&Scene {
        episode: &entry.name,
        sample_idx,
        sample: &sample,
        harms: harms.as_deref(),
        zone: zone.as_deref(),
        detections: detections.as_deref(),
    })
    .map_err(|source| ViewError::Image { source, path: dataset.join(&entry.file) })?;
    let mut png = Vec::new();
    picture
        .write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png)
        .map_err(|source| ViewError::Image { source, path: request.out.clone() })?;
    if let Some(folder) = request.out.parent() {
        fs::create_dir_all(folder)?;
    }
    write_atomic(&request.out, &png)?;
    Ok(ViewSummary {
        episode: entry.name.clone(),
        sample_idx,
        n_objects: sample.truth.as_ref().map(|truth| truth.objects.len()),
        n_harmful: harms.map(|harms| harms.iter().filter(|&&harm| harm == Harm::Harmful).count()),
        n_detections: detections.map(|found| found.len()),
        out: request.out.clone(),
    })
}

/// A sample's labels, where it has any: each object's harm, and the corners of the zone.
type Drawn = (Sample, Option<Vec<Harm>>, Option<Vec<Point2>>);

/// Reads a sample with its labels. Without a named set, a data set may have none.
fn read(
    dataset: &Path,
    label_set: Option<&str>,
    entry: &EpisodeEntry,
    sample_idx: usize,
) -> Result<Drawn, ViewError> {
    let Some(set) = label_set.or_else(|| default_set(dataset, entry)) else {
        return Ok((EpisodeReader::open_entry(dataset, entry)?.sample(sample_idx)?, None, None));
    };
    let LabelledView { sample, harms, zone } = LabelledView::read(dataset, set, entry, sample_idx)?;
    Ok((sample, Some(harms), Some(zone)))
}

/// The label set that is drawn where none is named, if it is there; not for an episode that came after it.
fn default_set(dataset: &Path, entry: &EpisodeEntry) -> Option<&'static str> {
    let folder = LabelManifest::folder(dataset, DEFAULT_SET);
    let is_named = || match LabelManifest::read(dataset, DEFAULT_SET) {
        Ok(labels) => labels.episodes.iter().any(|label| label.name == entry.name),
        // Who reads it will tell.
        Err(_) => true,
    };
    // Of what cannot be looked at, who reads it will tell.
    let is_there = files::is_file(&folder.join(LabelManifest::FILE)).unwrap_or(true);
    let has_labels = || store::is_there(&label_file(&folder, entry)).unwrap_or(true);
    (is_there && (has_labels() || is_named())).then_some(DEFAULT_SET)
}

fn label_file(set: &Path, entry: &EpisodeEntry) -> PathBuf {
    set.join(format!("{}.mcap", entry.name))
}

/// The labels of an episode, by a set or by the default one; `None` where none is named and that is not there.
pub(super) fn label_reader(
    dataset: &Path,
    label_set: Option<&str>,
    entry: &EpisodeEntry,
) -> Result<Option<LabelReader>, ViewError> {
    label_set.or_else(|| default_set(dataset, entry)).map(|set| labels_of(dataset, set, entry)).transpose()
}

/// The labels of an episode by a set.
fn labels_of(dataset: &Path, label_set: &str, entry: &EpisodeEntry) -> Result<LabelReader, ViewError> {
    let folder = LabelManifest::folder(dataset, label_set);
    if !files::is_file(&folder.join(LabelManifest::FILE))? {
        let (set, path) = (label_set.to_owned(), dataset.to_owned());
        return Err(ViewError::NoLabels { set, found: label_sets(dataset)?, path });
    }
    let file = label_file(&folder, entry);
    if !store::is_there(&file)? {
        let zone = LabelManifest::read(dataset, label_set).ok().and_then(|labels| zone_in(&labels.zone_toml));
        let command = label_command(dataset, label_set, zone.as_ref());
        let (episode, set) = (entry.name.clone(), label_set.to_owned());
        return Err(ViewError::NotLabelled { episode, set, command });
    }
    let reader = LabelReader::open(&file)?;
    reader.check_episode(&entry.sha256)?;
    Ok(reader)
}

/// A sample with its labels, ready to be drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelledView {
    pub sample: Sample,
    /// One for each of the sample's true objects, in their order.
    pub harms: Vec<Harm>,
    /// Corners of the danger zone in the ego frame, metres.
    pub zone: Vec<Point2>,
}

impl LabelledView {
    /// Reads one sample of an episode of a data set.
    ///
    /// # Errors
    /// [`ViewError`]: no such labels, labels of another episode, a broken file.
    pub fn read(
        dataset: &Path,
        label_set: &str,
        entry: &EpisodeEntry,
        sample_idx: usize,
    ) -> Result<Self, ViewError> {
        let reader = labels_of(dataset, label_set, entry)?;
        let sample = EpisodeReader::open_entry(dataset, entry)?.sample(sample_idx)?;
        let time_ns = sample.measured.time_ns;
        let labels = reader
            .samples()
            .iter()
            .find(|labels| labels.time_ns == time_ns && labels.labels.len() == sample.objects().len())
            .ok_or_else(|| ViewError::NotAligned { time_ns, path: reader.path().to_owned() })?;
        let harms = labels.labels.iter().map(|label| label.harm).collect();
        Ok(Self { harms, zone: labels.zone_corners.clone(), sample })
    }
}

/// The episode that holds a sample of the data set, and the sample's place in it.
pub(in crate::report) fn locate<'a>(
    manifest: &'a Manifest,
    wanted: usize,
    path: &Path,
) -> Result<(&'a EpisodeEntry, usize), ViewError> {
    let mut rest = wanted;
    for entry in &manifest.episodes {
        if rest < entry.n_samples {
            return Ok((entry, rest));
        }
        rest -= entry.n_samples;
    }
    match wanted - rest {
        0 => Err(ViewError::Empty { path: path.to_owned() }),
        n => Err(ViewError::NoSample { found: wanted, last: n - 1, path: path.to_owned() }),
    }
}

/// The detections of one sample of an episode, from this score on.
pub(in crate::report) fn read_detections(
    folder: &Path,
    dataset: &Path,
    entry: &EpisodeEntry,
    time_ns: u64,
    min_score: f32,
) -> Result<Vec<Detection>, ViewError> {
    let path = predictions_file(folder, dataset, entry)?;
    let reader = DetectionReader::open(&path)?;
    reader.check_episode(&entry.sha256)?;
    let found = reader.samples().iter().find(|sample| sample.time_ns == time_ns);
    let found = found.ok_or(ViewError::NotAligned { time_ns, path })?;
    Ok(found.detections.iter().filter(|detection| detection.score >= f64::from(min_score)).copied().collect())
}

/// Where the predictions of an episode lie.
pub(super) fn predictions_file(
    folder: &Path,
    dataset: &Path,
    entry: &EpisodeEntry,
) -> Result<PathBuf, ViewError> {
    let file = format!("{}.mcap", entry.name);
    // A run keeps its predictions by the data set's name.
    let of_run = folder.join("predictions");
    let name = fs::canonicalize(dataset)?.file_name().unwrap_or_default().to_owned();
    let places = [folder.join(&file), of_run.join(name).join(&file), of_run.join(&file)];
    for place in places {
        if store::is_there(&place)? {
            return Ok(place);
        }
    }
    Err({
        let (episode, path) = (entry.name.clone(), folder.to_owned());
        ViewError::NoPredictions { episode, wanted: file, path }
    })
}
