//! What a data set holds: counts by split, town, weather, kind and harm, how hard its objects are to see,
//! and the spread of what matters. Every annotated box counts once in each sample it is in.

mod histogram;
mod unfamiliar;

use std::collections::BTreeMap;
use std::path::Path;

use rayon::prelude::*;
use serde::Serialize;

pub use self::histogram::Histogram;
pub use self::unfamiliar::{SpotCount, Unfamiliar};
use super::split::labels_in_order;
use super::{DatasetError, each_labelled, labels_of};
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
            for sample in EpisodeReader::open_entry(path, entry)?.samples() {
                let sample = sample?;
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

#[cfg(test)]
mod tests {
    use super::super::test_data;
    use super::*;

    /// distribution, kind, category, x, y, points, visible fraction, harm
    type Row = (Distribution, Kind, &'static str, f64, f64, u32, f64, Harm);

    const ROWS: [Row; 5] = [
        (Distribution::Id, Kind::Vehicle, "car", 3.0, 4.0, 10, 0.49, Harm::Harmful),
        (Distribution::Id, Kind::Vehicle, "car", 60.0, 0.0, 11, 0.5, Harm::Harmless),
        (Distribution::Id, Kind::Pedestrian, "child", 0.0, -8.0, 0, 1.0, Harm::Harmless),
        (Distribution::Id, Kind::Static, "bench", 12.0, 5.0, 200, 0.1, Harm::Harmless),
        (Distribution::Ood, Kind::Static, "barrel", 20.0, 0.0, 1, 0.96, Harm::Harmful),
    ];

    fn object(row: &Row) -> Object {
        let &(distribution, kind, category, x, y, n_lidar_points, visible_fraction, _) = row;
        let mut truth = test_data::dataset(1).samples()[0].objects[0].truth.clone();
        (truth.distribution, truth.kind) = (Some(distribution), Some(kind));
        truth.category = Some(category.to_owned());
        truth.box_in_ego.center = crate::geometry::Point::new(x, y, 0.8);
        (truth.n_lidar_points, truth.visible_fraction) = (Some(n_lidar_points), Some(visible_fraction));
        truth
    }

    fn sample(statistics: &mut Statistics, speed_mps: f64, steering_deg: f64, rows: &[Row]) {
        let mut ego_state = test_data::dataset(1).samples()[0].measured.ego_state;
        (ego_state.speed_mps, ego_state.steering_angle_rad) = (speed_mps, steering_deg.to_radians());
        let objects: Vec<Object> = rows.iter().map(object).collect();
        statistics.add(&ego_state, objects.iter().zip(rows.iter().map(|row| Some(row.7))));
    }

    /// Two episodes: one of two samples with all rows and with the first, and one of one empty sample.
    fn made() -> Statistics {
        let (mut first, mut second) = (Statistics::default(), Statistics::default());
        sample(&mut first, 0.0, 0.0, &ROWS);
        sample(&mut first, 9.99, -30.0, &ROWS[..1]);
        sample(&mut second, 10.0, 1.0, &[]);
        (first.n_bytes, second.n_bytes) = (100, 23);
        first.close_episode(Split::Train, "market", "FogNight");
        second.close_episode(Split::Val, "market", "ClearNoon");
        let mut sum = Statistics::default();
        sum.merge(first);
        sum.merge(second);
        sum
    }

    #[test]
    fn objects_are_counted_by_distribution_kind_category_and_harm() {
        let Group { n_episodes, n_samples, objects, labels } = made().all;
        assert_eq!((n_episodes, n_samples, objects.total()), (2, 3, 6));
        assert_eq!(objects.id.values(), [&3, &1, &1]);
        assert_eq!(objects.ood.values(), [&0, &0, &1]);
        assert_eq!(labels.id.vehicle, HarmCounts { harmful: 2, harmless: 1 });
        assert_eq!(labels.id.pedestrian, HarmCounts { harmful: 0, harmless: 1 });
        assert_eq!(labels.ood.static_object, HarmCounts { harmful: 1, harmless: 0 });
        let counts: Vec<(String, u64)> = made()
            .by_category
            .into_iter()
            .map(|(category, count)| (category.category, count.n_objects))
            .collect();
        let wanted = [("car", 3), ("child", 1), ("bench", 1), ("barrel", 1)];
        assert_eq!(counts, wanted.map(|(name, count)| (name.to_owned(), count)));
    }

    #[test]
    fn splits_towns_and_weathers_share_the_whole() {
        let made = made();
        assert_eq!(made.by_town.keys().collect::<Vec<_>>(), ["market"]);
        assert_eq!(made.by_town["market"], made.all);
        let n_samples = |group: &Group| group.n_samples;
        assert_eq!(made.by_split.values().map(n_samples).collect::<Vec<_>>(), [2, 1]);
        assert_eq!(made.by_weather["FogNight"].objects.total(), 6);
        assert_eq!(made.by_weather["ClearNoon"].objects.total(), 0);
        assert_eq!(made.n_bytes, 123);
    }

    #[test]
    fn half_visible_is_not_occluded_and_ten_points_are_few() {
        let made = made();
        // 0.49 twice, and 0.1; then 10 twice, 0 and 1 points.
        assert_eq!((made.n_occluded, made.n_few_points), (3, 4));
        let total = made.unfamiliar.total();
        assert_eq!((total.n_objects, total.n_harmful, total.n_occluded), (1, 1, 0));
        assert_eq!(made.histograms.range_m.most, Some(60.0));
    }

    #[test]
    fn the_histograms_hold_every_object_and_every_sample_once() {
        let Histograms {
            range_m,
            points_per_object,
            visible_fraction,
            speed_mps,
            steering_deg,
            objects_per_sample,
        } = made().histograms;
        // 5 m twice in [5, 10), with 8 m; 13 m, 20 m and 60 m.
        assert_eq!(
            [range_m.counts[1], range_m.counts[2], range_m.counts[4], range_m.counts[12]],
            [3, 1, 1, 1]
        );
        // 0, 1, 6 to 10 (twice), 11 to 20 and 101 to 200 points.
        assert_eq!(points_per_object.counts, [1, 1, 0, 0, 2, 1, 0, 0, 1, 0, 0, 0, 0, 0]);
        assert_eq!((visible_fraction.counts[9], visible_fraction.counts[19]), (2, 2));
        // From -5 m/s in steps of one: 0, 9.99 and 10 m/s.
        assert_eq!([speed_mps.counts[5], speed_mps.counts[14], speed_mps.counts[15]], [1, 1, 1]);
        assert!((steering_deg.least.unwrap() + 30.0).abs() < 1e-9);
        assert_eq!(steering_deg.counts.iter().sum::<u64>(), 3);
        assert_eq!(objects_per_sample.counts[..6], [1, 1, 0, 0, 0, 1]);
    }
}
