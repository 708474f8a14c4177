//! What a data set holds: counts by split, town, weather, kind and harm, how hard its objects are to see,
//! and the spread of what matters. Every annotated box counts once in each sample it is in.

mod histogram;
#[cfg(test)]
mod tests;
mod unfamiliar;

use std::collections::BTreeMap;
use std::path::Path;

use rayon::prelude::*;
use serde::Serialize;

pub use self::histogram::Histogram;
pub use self::unfamiliar::{SpotCount, Unfamiliar};
use super::split::labels_in_order;
use super::{DatasetError, each_labelled, keep_in_view, labels_of};
use crate::episode::manifest::{EpisodeEntry, HarmCounts, LabelCounts, LabelEntry, Manifest, ObjectCounts};
use crate::episode::{EpisodeReader, Split};
use crate::object::{Distribution, Harm, Kind, Object};
use crate::progress::Progress;
use crate::sample::EgoState;
use crate::store;

/// An object is more than half occluded if its visible share is below this.
pub const HALF_VISIBLE: f64 = 0.5;
/// An object with this many LiDAR points or fewer is thinly covered.
pub const FEW_POINTS: u32 = 10;

/// The statistics of a data set, or of a part of it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Statistics {
    pub all: Group,
    pub by_split: BTreeMap<Split, Group>,
    pub by_town: BTreeMap<String, Group>,
    pub by_weather: BTreeMap<String, Group>,
    pub by_category: BTreeMap<Category, CategoryCount>,
    pub unfamiliar: Unfamiliar,
    /// Objects whose visible share is below [`HALF_VISIBLE`].
    pub n_occluded: u64,
    /// Objects with at most [`FEW_POINTS`] LiDAR points.
    pub n_few_points: u64,
    /// Size of the episodes' files.
    pub n_bytes: u64,
    pub histograms: Histograms,
}

/// Counts of some episodes.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Group {
    pub n_episodes: u64,
    pub n_samples: u64,
    pub objects: ObjectCounts,
    /// Zero where there are no labels.
    pub labels: LabelCounts,
}

/// What objects of one family have in common.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Category {
    pub distribution: Distribution,
    pub kind: Kind,
    pub category: String,
}

impl Category {
    /// `None` where a fact of the object is unknown.
    fn of(object: &Object) -> Option<Self> {
        let (distribution, kind) = (object.distribution?, object.kind?);
        Some(Self { distribution, kind, category: object.category.clone()? })
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CategoryCount {
    pub n_objects: u64,
    /// Zero where there are no labels.
    pub labels: HarmCounts,
}

/// How the numbers spread; the unit is in the name.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Histograms {
    /// From the ego's origin to the box's centre, on the ground.
    pub range_m: Histogram,
    pub points_per_object: Histogram,
    pub visible_fraction: Histogram,
    /// Of the ego, each sample once.
    pub speed_mps: Histogram,
    pub steering_deg: Histogram,
    pub objects_per_sample: Histogram,
}

impl Default for Histograms {
    fn default() -> Self {
        // Whole numbers lie in the middle of their bins, or between the edges of a group of them.
        let points = [
            -0.5, 0.5, 1.5, 2.5, 5.5, 10.5, 20.5, 50.5, 100.5, 200.5, 500.5, 1000.5, 2000.5, 5000.5, 10_000.5,
        ];
        Self {
            range_m: Histogram::even(0.0, 100.0, 20),
            points_per_object: Histogram::new(points.to_vec()),
            visible_fraction: Histogram::even(0.0, 1.0, 20),
            speed_mps: Histogram::even(-5.0, 30.0, 35),
            steering_deg: Histogram::even(-45.0, 45.0, 36),
            objects_per_sample: Histogram::even(-0.5, 60.5, 61),
        }
    }
}

impl Statistics {
    /// Reads a data set's episodes, with the labels of `set` if one is named.
    ///
    /// # Errors
    /// [`DatasetError`]: no such label set, labels of another dataset or of part of it, a broken file.
    pub fn of(
        path: &Path,
        manifest: &Manifest,
        set: Option<&str>,
        progress: &dyn Progress,
    ) -> Result<Self, DatasetError> {
        let in_order = |set: &str| {
            let labels = labels_of(path, set, manifest)?;
            Ok::<_, DatasetError>((labels_in_order(&labels, &manifest.episodes, path)?, labels.set))
        };
        let labels = set.map(in_order).transpose()?;
        progress.start("count", manifest.episodes.iter().map(|entry| entry.n_samples as u64).sum());
        let of_episodes: Vec<Self> = manifest
            .episodes
            .par_iter()
            .enumerate()
            .map(|(i, entry)| {
                let labels = labels.as_ref().map(|(entries, set)| (set.as_str(), &entries[i]));
                let of_episode = Self::of_episode(path, entry, labels);
                progress.advance(entry.n_samples as u64);
                of_episode
            })
            .collect::<Result<_, _>>()?;
        progress.finish();
        let mut sum = Self::default();
        of_episodes.into_iter().for_each(|one| sum.merge(one));
        Ok(sum)
    }

    fn of_episode(
        path: &Path,
        entry: &EpisodeEntry,
        labels: Option<(&str, &LabelEntry)>,
    ) -> Result<Self, DatasetError> {
        let file = path.join(&entry.file);
        let mut of_episode = Self { n_bytes: store::size_of(&file)?, ..Self::default() };
        if let Some((set, labels)) = labels {
            each_labelled(path, set, entry, labels, |_, (_, true_state, objects, _)| {
                let objects = objects.iter().map(|object| (&object.truth, Some(object.harm)));
                of_episode.add(&true_state, objects);
                Ok(())
            })?;
        } else {
            let reader = EpisodeReader::open_entry(path, entry)?;
            for sample in reader.samples() {
                let mut sample = sample?;
                // As where there are labels.
                if let Some(truth) = &mut sample.truth {
                    let objects = &mut truth.objects;
                    keep_in_view(reader.log(), &sample.measured, objects, |object| &object.box_in_ego);
                }
                let objects = sample.objects().iter().map(|object| (object, None));
                of_episode.add(sample.true_state(), objects);
            }
        }
        of_episode.close_episode(entry.split, &entry.town, &entry.weather);
        Ok(of_episode)
    }

    /// Counts one sample.
    fn add<'a>(&mut self, ego_state: &EgoState, objects: impl Iterator<Item = (&'a Object, Option<Harm>)>) {
        let histograms = &mut self.histograms;
        let mut n_objects = 0;
        for (object, harm) in objects {
            n_objects += 1;
            if let (Some(n_objects), Some(labels), Some(category)) =
                (self.all.objects.of_mut(object), self.all.labels.of_mut(object), Category::of(object))
            {
                let of_category = self.by_category.entry(category).or_default();
                *n_objects += 1;
                of_category.n_objects += 1;
                if let Some(harm) = harm {
                    labels.add(harm);
                    of_category.labels.add(harm);
                }
            }
            self.unfamiliar.add(object, harm);
            self.n_occluded += u64::from(object.visible_fraction.is_some_and(|share| share < HALF_VISIBLE));
            self.n_few_points += u64::from(object.n_lidar_points.is_some_and(|n| n <= FEW_POINTS));
            let center = &object.box_in_ego.center;
            histograms.range_m.add(center.x().hypot(center.y()));
            object.n_lidar_points.iter().for_each(|&n| histograms.points_per_object.add(f64::from(n)));
            object.visible_fraction.iter().for_each(|&share| histograms.visible_fraction.add(share));
        }
        histograms.speed_mps.add(ego_state.speed_mps);
        histograms.steering_deg.add(ego_state.steering_angle_rad.to_degrees());
        histograms.objects_per_sample.add(f64::from(n_objects));
        self.all.n_samples += 1;
    }

    /// Counts all that was added as one episode of this split, town and weather.
    fn close_episode(&mut self, split: Split, town: &str, weather: &str) {
        self.all.n_episodes = 1;
        self.by_split.insert(split, self.all.clone());
        self.by_town.insert(town.to_owned(), self.all.clone());
        self.by_weather.insert(weather.to_owned(), self.all.clone());
    }

    fn merge(&mut self, other: Self) {
        self.all.merge(&other.all);
        merge_groups(&mut self.by_split, other.by_split);
        merge_groups(&mut self.by_town, other.by_town);
        merge_groups(&mut self.by_weather, other.by_weather);
        for (category, count) in other.by_category {
            let sum = self.by_category.entry(category).or_default();
            sum.n_objects += count.n_objects;
            merge_harm(&mut sum.labels, &count.labels);
        }
        self.unfamiliar.merge(other.unfamiliar);
        self.n_occluded += other.n_occluded;
        self.n_few_points += other.n_few_points;
        self.n_bytes += other.n_bytes;
        let (to, from) = (&mut self.histograms, &other.histograms);
        to.range_m.merge(&from.range_m);
        to.points_per_object.merge(&from.points_per_object);
        to.visible_fraction.merge(&from.visible_fraction);
        to.speed_mps.merge(&from.speed_mps);
        to.steering_deg.merge(&from.steering_deg);
        to.objects_per_sample.merge(&from.objects_per_sample);
    }
}

fn merge_groups<K: Ord>(to: &mut BTreeMap<K, Group>, from: BTreeMap<K, Group>) {
    for (key, group) in from {
        to.entry(key).or_default().merge(&group);
    }
}

fn merge_harm(to: &mut HarmCounts, from: &HarmCounts) {
    to.harmful += from.harmful;
    to.harmless += from.harmless;
}

impl Group {
    fn merge(&mut self, other: &Self) {
        self.n_episodes += other.n_episodes;
        self.n_samples += other.n_samples;
        for distribution in [Distribution::Id, Distribution::Ood] {
            for kind in [Kind::Vehicle, Kind::Pedestrian, Kind::Static] {
                *self.objects.get_mut(distribution).get_mut(kind) +=
                    other.objects.get(distribution).get(kind);
                merge_harm(
                    self.labels.get_mut(distribution).get_mut(kind),
                    other.labels.get(distribution).get(kind),
                );
            }
        }
    }
}
