//! Counts and histograms of made-up samples, checkable by hand.

use super::*;
use crate::dataset::test_data;
use crate::episode::{EpisodeWriter, MapDrawing};
use crate::progress::Silent;
use crate::sample::{Sample, Truth};

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
fn labels_change_no_count_of_objects() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    test_data::write(path, &[2]);
    let mut manifest = Manifest::read(path).unwrap();
    let entry = &mut manifest.episodes[0];
    let mut meta = test_data::episode_meta(&entry.weather, "");
    meta.name.clone_from(&entry.name);
    meta.n_samples = 1;
    let mut writer = EpisodeWriter::create(&path.join(&entry.file), &meta, &MapDrawing::default()).unwrap();
    let mut measured = test_data::dataset(1).samples()[0].measured.clone();
    measured.time_ns = 1_000_000_000;
    // Only the front camera's are counted; the bench stands behind it.
    let mut objects: Vec<Object> = ROWS[3..].iter().map(object).collect();
    objects[0].box_in_ego.center = crate::geometry::Point::new(-20.0, 0.0, 0.8);
    objects[0].id = Some("bench-0".into());
    writer.write(&Sample { measured, truth: Some(Truth { objects, ..Truth::default() }) }).unwrap();
    let done = writer.finish().unwrap();
    (entry.n_samples, entry.n_objects, entry.sha256) = (done.n_samples, done.n_objects, done.sha256);
    manifest.write(path).unwrap();
    crate::label::run(path, &crate::zone::ZoneConfig::default(), "new", false, &Silent).unwrap();
    let [without, with] =
        [None, Some("new")].map(|set| Statistics::of(path, &manifest, set, &Silent).unwrap());
    assert_eq!((without.all.objects.total(), with.all.objects.total()), (1, 1));
    assert_eq!(without.histograms, with.histograms);
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
    assert_eq!([range_m.counts[1], range_m.counts[2], range_m.counts[4], range_m.counts[12]], [3, 1, 1, 1]);
    // 0, 1, 6 to 10 (twice), 11 to 20 and 101 to 200 points.
    assert_eq!(points_per_object.counts, [1, 1, 0, 0, 2, 1, 0, 0, 1, 0, 0, 0, 0, 0]);
    assert_eq!((visible_fraction.counts[9], visible_fraction.counts[19]), (2, 2));
    // From -5 m/s in steps of one: 0, 9.99 and 10 m/s.
    assert_eq!([speed_mps.counts[5], speed_mps.counts[14], speed_mps.counts[15]], [1, 1, 1]);
    assert!((steering_deg.least.unwrap() + 30.0).abs() < 1e-9);
    assert_eq!(steering_deg.counts.iter().sum::<u64>(), 3);
    assert_eq!(objects_per_sample.counts[..6], [1, 1, 0, 0, 0, 1]);
}
