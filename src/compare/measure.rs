//! Measures a data set, part by part: an episode, or a stretch of the only one.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use thiserror::Error;

use super::{Quantity, SetFacts, Tallies};
use super::{cloud, lidar, objects, picture};
use crate::dataset::keep_in_view;
use crate::episode::manifest::{EpisodeEntry, Manifest, ManifestError};
use crate::episode::{EpisodeError, EpisodeReader, Labelled, LogFacts, Split};
use crate::geometry::{Box3, Ego};
use crate::object::Kind;
use crate::progress::Progress;
use crate::sample::{Measured, Sample};

/// The only episode of a set is cut into this many stretches of samples, or one for each sample.
const N_STRETCHES: usize = 8;

/// Why two data sets could not be compared.
#[derive(Debug, Error)]
pub enum CompareError {
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    #[error(transparent)]
    Episode(#[from] EpisodeError),
    #[error("no sample{}; the data set has {found}: {}", of_split(*.wanted), path.display())]
    Empty { wanted: Option<Split>, found: String, path: PathBuf },
    #[error("the picture of sample {sample_idx} of episode `{episode}` cannot be unpacked: {source}: {}", path.display())]
    Picture { episode: String, sample_idx: usize, source: image::ImageError, path: PathBuf },
}

fn of_split(wanted: Option<Split>) -> String {
    wanted.map_or_else(String::new, |split| format!(" of split {}", split.name()))
}

/// Samples that belong together: drawn together, or not at all.
#[derive(Debug, Clone, Default)]
pub(super) struct Part {
    pub n_samples: usize,
    n_with_truth: usize,
    n_objects: u64,
    pub tallies: Tallies,
    /// Points of its samples, drawn.
    pub cloud: Vec<cloud::CloudPoint>,
    /// What of the world is annotated, where a log says so.
    labelled: Option<String>,
    /// What is odd, and in how many samples.
    odd: BTreeMap<&'static str, usize>,
}

/// A data set, measured.
#[derive(Debug, Clone)]
pub(super) struct MeasuredSet {
    pub facts: SetFacts,
    pub parts: Vec<Part>,
    /// What of the world is annotated, where a log says so.
    pub labelled: Option<String>,
    pub odd: BTreeMap<&'static str, usize>,
}

impl MeasuredSet {
    /// All its parts as one.
    pub fn whole(&self) -> Tallies {
        let mut whole = Tallies::default();
        self.parts.iter().for_each(|part| whole.merge(&part.tallies));
        whole
    }
}

/// Reads a data set's samples, one at a time in each thread.
pub(super) fn measure(
    dataset: &Path,
    split: Option<Split>,
    stage: &str,
    progress: &dyn Progress,
) -> Result<MeasuredSet, CompareError> {
    let manifest = Manifest::read(dataset)?;
    let is_wanted =
        |entry: &&EpisodeEntry| split.is_none_or(|split| entry.split == split) && entry.n_samples > 0;
    let episodes: Vec<&EpisodeEntry> = manifest.episodes.iter().filter(is_wanted).collect();
    let n_samples = episodes.iter().map(|entry| entry.n_samples).sum();
    if n_samples == 0 {
        let count = |split: Split| {
            let n: usize = manifest.of_split(split).map(|entry| entry.n_samples).sum();
            format!("{n} of {}", split.name())
        };
        let found = Split::ALL.map(count).join(", ");
        return Err(CompareError::Empty { wanted: split, found, path: dataset.to_owned() });
    }
    progress.start(stage, n_samples as u64);
    let parts = cut(&episodes)
        .into_par_iter()
        .map(|stretch| measure_part(&dataset.join(&stretch.entry.file), &stretch, n_samples, progress))
        .collect::<Result<Vec<Part>, CompareError>>()?;
    progress.finish();
    let mut odd = BTreeMap::new();
    for (what, n) in parts.iter().flat_map(|part| &part.odd) {
        *odd.entry(*what).or_insert(0) += n;
    }
    let facts = SetFacts {
        dataset: dataset.to_owned(),
        split,
        n_episodes: episodes.len(),
        n_samples,
        n_samples_with_truth: parts.iter().map(|part| part.n_with_truth).sum(),
        n_objects: parts.iter().map(|part| part.n_objects).sum(),
        n_parts: parts.len(),
    };
    let labelled = parts.iter().find_map(|part| part.labelled.clone());
    Ok(MeasuredSet { facts, parts, labelled, odd })
}

/// Samples of an episode that make a part.
struct Stretch<'a> {
    entry: &'a EpisodeEntry,
    samples: Range<usize>,
    /// Samples of the set before the episode's first.
    n_before: usize,
}

/// The parts: each episode, or, of an only one, stretches of about the same length.
fn cut<'a>(episodes: &[&'a EpisodeEntry]) -> Vec<Stretch<'a>> {
    if let [entry] = episodes {
        let (n, n_stretches) = (entry.n_samples, N_STRETCHES.min(entry.n_samples));
        let samples = |i: usize| i * n / n_stretches..(i + 1) * n / n_stretches;
        return (0..n_stretches).map(|i| Stretch { entry, samples: samples(i), n_before: 0 }).collect();
    }
    let mut n_before = 0;
    let whole = |&entry: &&'a EpisodeEntry| {
        let stretch = Stretch { entry, samples: 0..entry.n_samples, n_before };
        n_before += entry.n_samples;
        stretch
    };
    episodes.iter().map(whole).collect()
}

fn measure_part(
    path: &Path,
    stretch: &Stretch<'_>,
    n_samples_of_set: usize,
    progress: &dyn Progress,
) -> Result<Part, CompareError> {
    let reader = EpisodeReader::open(path)?;
    let labelled = reader.log().and_then(|log| log.labelled.as_ref());
    let known = Known::of(reader.log());
    let mut part = Part { labelled: labelled.map(tell_labelled), ..Part::default() };
    for sample_idx in stretch.samples.clone() {
        let mut sample = reader.sample(sample_idx)?;
        if let Some(truth) = &mut sample.truth {
            keep_in_view(reader.log(), &sample.measured, &mut truth.objects, |object| &object.box_in_ego);
        }
        let picture = sample.measured.image.decode().map_err(|source| CompareError::Picture {
            episode: reader.meta().name.clone(),
            sample_idx,
            source,
            path: path.to_owned(),
        })?;
        part.add(&sample, &picture, &known);
        let place = stretch.n_before + sample_idx;
        let n_points = cloud::n_points_of(place, n_samples_of_set);
        part.cloud.extend(cloud::draw_points(&sample.measured, n_points, place));
        progress.advance(1);
    }
    Ok(part)
}

impl Part {
    fn add(&mut self, sample: &Sample, picture: &image::RgbImage, known: &Known) {
        let (measured, tallies) = (&sample.measured, &mut self.tallies);
        self.n_samples += 1;
        let objects = sample.truth.as_ref().map(|truth| &truth.objects);
        if let Some(objects) = objects {
            self.n_with_truth += 1;
            self.n_objects += objects.len() as u64;
            objects::add_objects(tallies, measured, objects, &known.kinds);
        }
        let boxes: Option<Vec<Box3<Ego>>> =
            objects.map(|objects| objects.iter().map(|object| object.box_in_ego).collect());
        lidar::add_points(tallies, measured, boxes.as_deref());
        if known.has_pictures {
            picture::add_picture(tallies, measured, picture);
        }
        if known.has_speed {
            tallies.add(Quantity::Speed, measured.ego_state.speed_mps);
        }
        if known.has_steering {
            tallies.add(Quantity::Steering, measured.ego_state.steering_angle_rad.to_degrees());
        }
        for what in find_odd(measured).into_iter().chain(known.missing()) {
            *self.odd.entry(what).or_insert(0) += 1;
        }
    }
}

/// What an episode knows; an imported one fills in what its log lacks, and that is not compared.
#[derive(Debug)]
struct Known {
    kinds: Vec<Kind>,
    has_pictures: bool,
    has_speed: bool,
    has_steering: bool,
}

impl Known {
    fn of(log: Option<&LogFacts>) -> Self {
        let labelled = log.and_then(|log| log.labelled.as_ref());
        let says = |part: &str, words: &str| {
            log.and_then(|log| log.methods.get(part)).is_some_and(|method| method.contains(words))
        };
        Self {
            kinds: labelled.map_or(Kind::ALL.to_vec(), |labelled| labelled.kinds.clone()),
            has_pictures: !says("camera", "a black picture of a virtual camera"),
            has_speed: !says("speed", "unknown; assumed"),
            has_steering: !says("steering", "unknown; assumed"),
        }
    }

    fn missing(&self) -> impl Iterator<Item = &'static str> {
        let parts = [
            (self.has_pictures, "no picture but a black one that stands for it"),
            (self.has_speed, "an assumed speed, which is not compared"),
            (self.has_steering, "an assumed steering angle, which is not compared"),
        ];
        parts.into_iter().filter(|(is_known, _)| !is_known).map(|(_, what)| what)
    }
}

fn tell_labelled(labelled: &Labelled) -> String {
    let kinds: Vec<&str> = labelled.kinds.iter().map(|kind| kind.name()).collect();
    let mut told =
        format!("annotates {}", if kinds.is_empty() { "no kind".to_owned() } else { kinds.join(", ") });
    told += &labelled.max_range_m.map_or_else(String::new, |range_m| format!(", to {range_m} m"));
    if labelled.in_camera_view {
        told += ", in the camera's view";
    }
    told
}

/// What makes figures mean something else than they seem to.
fn find_odd(measured: &Measured) -> Vec<&'static str> {
    let points = &measured.points;
    let mut odd = Vec::new();
    if points.is_empty() {
        odd.push("no LiDAR point");
    } else if points.iter().all(|point| point.intensity == 0.0) {
        odd.push("every intensity is 0");
    } else if points.iter().all(|point| point.intensity <= 1.0) {
        odd.push("no intensity above 1, as if of a scale of 0 to 1; 0 to 255 is compared");
    }
    if points.len() > 1 && points.iter().all(|point| point.ring == points[0].ring) {
        odd.push("all points are of one ring");
    }
    odd
}
