//! The four columns of Table III, against a second implementation and as claims.
//!
//! The second implementation shares nothing with the first: it picks the best remaining detection one
//! at a time, searches all truths each time, and samples the curve by scanning.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use harmzone::dataset::SampleFacts;
use harmzone::eval::{
    self, ClassScores, Column, EvalConfig, EvalSample, Metrics, MissingClass, Mode, Protocol,
};
use harmzone::geometry::{Box3, Point};
use harmzone::object::{Detection, Distribution, Harm, LabelledObject, Object};
use harmzone::random;
use proptest::prelude::*;
use rand::RngExt;

const THRESHOLDS_M: [f64; 4] = [0.5, 1.0, 2.0, 4.0];

fn detection(x_m: f64, y_m: f64, harm: Harm, score: f64) -> Detection {
    let center = Point::new(x_m, y_m, 1.0);
    let box_in_ego = Box3 { center, length_m: 4.0, width_m: 2.0, height_m: 1.5, yaw_rad: 0.3 };
    Detection { box_in_ego, velocity_in_ego_mps: [0.0; 2], harm, score, spread: None }
}

fn truth(x_m: f64, y_m: f64, harm: Harm, distribution: Distribution) -> LabelledObject {
    let (distribution, n_lidar_points) = (Some(distribution), None);
    let truth =
        Object { distribution, n_lidar_points, ..Object::new(detection(x_m, y_m, harm, 0.0).box_in_ego) };
    LabelledObject { truth, harm }
}

/// Random samples; positions on a coarse grid and one-digit scores, so that ties abound.
fn random_samples(seed: u64) -> Vec<EvalSample> {
    let mut rng = random::stream(seed, "eval-columns", 0);
    let n_samples = rng.random_range(1..6);
    (0..n_samples)
        .map(|i| {
            let mut objects = Vec::new();
            let mut detections = Vec::new();
            for _ in 0..rng.random_range(0..8) {
                let (x_m, y_m) =
                    (f64::from(rng.random_range(4..40)) / 2.0, f64::from(rng.random_range(-8..8)) / 2.0);
                let harm = Harm::ALL[rng.random_range(0..2)];
                let distribution = [Distribution::Id, Distribution::Ood][rng.random_range(0..2)];
                objects.push(truth(x_m, y_m, harm, distribution));
                for _ in 0..rng.random_range(0..3) {
                    let found_as =
                        if rng.random_bool(0.7) { harm } else { Harm::ALL[rng.random_range(0..2)] };
                    let mut off = || f64::from(rng.random_range(-3..4)) / 4.0;
                    let (x_m, y_m) = (x_m + off(), y_m + off());
                    let score = f64::from(rng.random_range(0..10)) / 10.0;
                    detections.push(detection(x_m, y_m, found_as, score));
                }
            }
            for _ in 0..rng.random_range(0..3) {
                let score = f64::from(rng.random_range(0..10)) / 10.0;
                let x_m = f64::from(rng.random_range(0..40));
                detections.push(detection(x_m, 7.0, Harm::ALL[rng.random_range(0..2)], score));
            }
            EvalSample::new(format!("s{i}"), SampleFacts::default(), objects, detections)
        })
        .collect()
}

/// AP by the words of the specification: (column, class, threshold); `None` where there is nothing to find.
fn second_opinion(samples: &[EvalSample], column: Column, class: Harm, threshold_m: f64) -> Option<f64> {
    let wanted = match column {
        Column::Total => vec![Distribution::Id, Distribution::Ood],
        Column::IdMatched => vec![Distribution::Id],
        Column::OodAll | Column::OodMatched => vec![Distribution::Ood],
    };
    let counts_unmatched = column == Column::Total || column == Column::OodAll;
    let is_wanted = |truth: &LabelledObject| wanted.contains(&truth.truth.distribution.unwrap());
    let mut waiting: Vec<(usize, &Detection)> = Vec::new();
    let mut unclaimed: Vec<(usize, &LabelledObject)> = Vec::new();
    let mut others: Vec<(usize, &LabelledObject)> = Vec::new();
    for (s, sample) in samples.iter().enumerate() {
        waiting.extend(sample.detections.iter().filter(|d| d.harm == class).map(|d| (s, d)));
        unclaimed.extend(sample.objects.iter().filter(|t| t.harm == class).map(|t| (s, t)));
        others.extend(sample.objects.iter().filter(|t| t.harm != class).map(|t| (s, t)));
    }
    let n_positives = unclaimed.iter().filter(|(_, t)| is_wanted(t)).count();
    let mut hits = Vec::new();
    while !waiting.is_empty() {
        let mut best = 0;
        for i in 0..waiting.len() {
            if waiting[i].1.score >= waiting[best].1.score {
                best = i;
            }
        }
        let (s, detection) = waiting.remove(best);
        let nearest = |pool: &[(usize, &LabelledObject)]| -> Option<usize> {
            let mut at = None;
            let mut least = threshold_m;
            for (i, (of, truth)) in pool.iter().enumerate() {
                let offset =
                    detection.box_in_ego.center.coords.xy() - truth.truth.box_in_ego.center.coords.xy();
                if *of == s && offset.norm() < least {
                    least = offset.norm();
                    at = Some(i);
                }
            }
            at
        };
        if let Some(i) = nearest(&unclaimed) {
            let (_, truth) = unclaimed.remove(i);
            if is_wanted(truth) {
                hits.push(true);
            }
        } else if let Some(i) = nearest(&others) {
            if is_wanted(others[i].1) {
                hits.push(false);
            }
        } else if counts_unmatched {
            hits.push(false);
        }
    }
    if n_positives == 0 {
        return None;
    }
    if !hits.contains(&true) {
        return Some(0.0);
    }
    // Curve points (recall, precision), then straight lines between them at recall 0.11, 0.12 .. 1.
    let mut points = Vec::new();
    for n in 1..=hits.len() {
        let n_true = hits[..n].iter().filter(|&&hit| hit).count() as f64;
        points.push((n_true / n_positives as f64, n_true / n as f64));
    }
    let mut area = 0.0;
    for step in 11..=100 {
        let recall = f64::from(step) * 0.01;
        let right = points.iter().position(|point| point.0 > recall);
        let precision = match right {
            Some(0) => points[0].1,
            Some(i) => {
                let (a, b) = (points[i - 1], points[i]);
                a.1 + (b.1 - a.1) * (recall - a.0) / (b.0 - a.0)
            }
            None if points.last().unwrap().0 == recall => points.last().unwrap().1,
            None => 0.0,
        };
        area += f64::max(0.0, precision - 0.1);
    }
    Some(area / 90.0 / 0.9)
}

fn scored(samples: &[EvalSample]) -> Metrics {
    eval::score(samples, &Protocol::default(), Mode::Ood).unwrap()
}

#[test]
fn the_columns_equal_those_of_a_second_implementation() {
    let (mut n_between, mut n_all) = (0, 0);
    for seed in 0..400 {
        let samples = random_samples(seed);
        let metrics = scored(&samples);
        for column in Column::ALL {
            for class in Harm::ALL {
                for (i, threshold_m) in THRESHOLDS_M.into_iter().enumerate() {
                    let ours = metrics.per_threshold.get(column).unwrap().get(class)[i];
                    let theirs = second_opinion(&samples, column, class, threshold_m);
                    assert_eq!(ours.is_some(), theirs.is_some(), "{seed} {column:?} {class:?}");
                    let (Some(ours), Some(theirs)) = (ours, theirs) else { continue };
                    assert!(
                        (ours - theirs).abs() < 1e-9,
                        "{seed} {column:?} {class:?} {threshold_m}: {ours} {theirs}"
                    );
                    n_between += usize::from(ours > 0.0 && ours < 1.0);
                    n_all += 1;
                }
            }
        }
    }
    assert!(n_between * 3 > n_all, "the random sets hardly test anything: {n_between} of {n_all}");
}

/// Both classes in both distributions, far apart.
fn four_truths() -> Vec<LabelledObject> {
    let mut truths = Vec::new();
    for (i, harm) in Harm::ALL.into_iter().enumerate() {
        for (j, distribution) in [Distribution::Id, Distribution::Ood].into_iter().enumerate() {
            truths.push(truth(10.0 + 10.0 * i as f64, 10.0 * j as f64, harm, distribution));
        }
    }
    truths
}

fn perfect(objects: Vec<LabelledObject>) -> EvalSample {
    let detections = objects
        .iter()
        .map(|truth| Detection {
            box_in_ego: truth.truth.box_in_ego,
            velocity_in_ego_mps: [0.0; 2],
            harm: truth.harm,
            score: 0.9,
            spread: None,
        })
        .collect();
    EvalSample::new("s", SampleFacts::default(), objects, detections)
}

fn means(metrics: &Metrics) -> [Option<f64>; 4] {
    Column::ALL.map(|column| metrics.columns.get(column).unwrap().mean)
}

#[test]
fn perfect_detections_score_one_in_every_column() {
    let metrics = scored(&[perfect(four_truths())]);
    for mean in means(&metrics) {
        assert!((mean.unwrap() - 1.0).abs() < 1e-12, "{mean:?}");
    }
    let errors = metrics.tp_errors.harmful.unwrap();
    assert!(errors.ate + errors.ase + errors.aoe < 1e-12, "{errors:?}");
}

#[test]
fn no_detections_score_zero_in_every_column_with_errors_of_one() {
    let mut sample = perfect(four_truths());
    sample.detections.clear();
    let metrics = scored(&[sample]);
    assert_eq!(means(&metrics), [Some(0.0); 4]);
    assert_eq!(metrics.tp_errors.harmless.unwrap().ate, 1.0);
}

#[test]
fn a_class_without_a_truth_is_absent_from_the_mean_unless_nuscenes_zero_is_asked_for() {
    let mut sample = perfect(four_truths());
    // No harmless truth, and none of a harmful object out of distribution.
    sample.objects.truncate(1);
    sample.detections.truncate(1);
    let zero = EvalConfig { missing_class: MissingClass::Zero, ..EvalConfig::default() };
    let zero = eval::score(&[sample.clone()], &Protocol::try_from(zero).unwrap(), Mode::Ood).unwrap();
    let absent = scored(&[sample]);
    let total = absent.columns.total;
    assert_eq!((total.harmful, total.harmless, total.mean), (Some(1.0), None, Some(1.0)));
    assert_eq!(absent.columns.ood_all, Some(ClassScores { harmful: None, harmless: None, mean: None }));
    assert_eq!((&absent.per_threshold.total.harmless, absent.tp_errors.harmless), (&vec![None; 4], None));
    let total = zero.columns.total;
    assert_eq!((total.harmful, total.harmless, total.mean), (Some(1.0), Some(0.0), Some(0.5)));
    assert_eq!(zero.columns.ood_all, Some(ClassScores::new(Some(0.0), Some(0.0))));
    assert_eq!(
        (&zero.per_threshold.total.harmless, zero.tp_errors.harmless.unwrap().ate),
        (&vec![Some(0.0); 4], 1.0)
    );
}

#[test]
fn an_object_given_the_wrong_class_counts_against_its_own_distribution_only() {
    let mut sample = perfect(four_truths());
    // The harmless OOD object is also reported as harmful, above all else.
    let wrong = Detection { harm: Harm::Harmful, score: 0.99, ..sample.detections[3] };
    sample.detections.push(wrong);
    let metrics = scored(&[sample]);
    let harmful = Column::ALL.map(|column| metrics.columns.get(column).unwrap().harmful.unwrap());
    assert!((harmful[1] - 1.0).abs() < 1e-12, "{harmful:?}");
    assert!(harmful[0] < 0.99 && harmful[2] < 0.99 && harmful[3] < 0.99, "{harmful:?}");
}

#[test]
fn filters_drop_far_boxes_and_truths_without_points_but_keep_unknown_counts() {
    let mut sample = perfect(four_truths());
    sample.objects[0].truth.n_lidar_points = Some(0);
    sample.objects.push(truth(30.0, 40.0, Harm::Harmful, Distribution::Id));
    sample.detections.push(detection(50.0, 0.0, Harm::Harmful, 0.9));
    let metrics = scored(&[sample]);
    let filters = metrics.filters;
    assert_eq!(
        (filters.truths_without_points, filters.truths_out_of_range, filters.detections_out_of_range),
        (1, 1, 1)
    );
    assert_eq!(metrics.counts.truths.harmful.all, 1);
}

#[test]
fn metrics_read_back_what_was_written() {
    let metrics = scored(&random_samples(3));
    assert_eq!(serde_json::from_str::<Metrics>(&metrics.to_json()).unwrap(), metrics);
    let of_protocol = eval::score(&random_samples(3), &Protocol::default(), Mode::Id).unwrap();
    assert_eq!(serde_json::from_str::<Metrics>(&of_protocol.to_json()).unwrap(), of_protocol);
    assert_eq!(of_protocol.columns.total, metrics.columns.total);
}

#[test]
fn three_hundred_thousand_detections_are_scored() {
    let mut rng = random::stream(1, "eval-many", 0);
    let samples: Vec<EvalSample> = (0..1000)
        .map(|i| {
            let mut place = || (rng.random_range(1.0..45.0), rng.random_range(-20.0..20.0));
            let objects = (0..40).map(|k| (place(), k)).map(|((x_m, y_m), k)| {
                truth(x_m, y_m, Harm::ALL[k % 2], [Distribution::Id, Distribution::Ood][k / 2 % 2])
            });
            let objects = objects.collect();
            let detections = (0..300)
                .map(|k| {
                    let (x_m, y_m) = place();
                    detection(x_m, y_m, Harm::ALL[k % 2], x_m / 50.0)
                })
                .collect();
            EvalSample::new(format!("s{i}"), SampleFacts::default(), objects, detections)
        })
        .collect();
    assert_eq!(scored(&samples).counts.n_samples, 1000);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn an_unmatched_box_never_changes_the_matched_columns(seed in 0_u64..1000, score in 0.0..1.0_f64, y_m in -40.0..-20.0_f64) {
        let mut samples = random_samples(seed);
        let before = scored(&samples);
        // All truths lie above y = -5 m.
        samples[0].detections.push(detection(5.0, y_m, Harm::Harmful, score));
        let after = scored(&samples);
        prop_assert_eq!(&before.per_threshold.id_matched, &after.per_threshold.id_matched);
        prop_assert_eq!(&before.per_threshold.ood_matched, &after.per_threshold.ood_matched);
        for column in [Column::Total, Column::OodAll] {
            let (before, after) = (before.columns.get(column).unwrap(), after.columns.get(column).unwrap());
            prop_assert_eq!(after.harmful.is_some(), before.harmful.is_some());
            prop_assert!(after.harmful.unwrap_or(0.0) <= before.harmful.unwrap_or(0.0) + 1e-12);
        }
    }

    #[test]
    fn perfect_detections_of_any_scene_score_one_wherever_there_is_a_truth(seed in 0_u64..1000) {
        let mut samples = random_samples(seed);
        for sample in &mut samples {
            // Truths on one another would claim each other's detections.
            sample.objects.dedup_by_key(|truth| truth.truth.box_in_ego.center.x().to_bits());
            *sample = EvalSample { id: sample.id.clone(), ..perfect(std::mem::take(&mut sample.objects)) };
        }
        let metrics = scored(&samples);
        for (column, distributions) in [
            (Column::Total, &[Distribution::Id, Distribution::Ood][..]),
            (Column::IdMatched, &[Distribution::Id]),
            (Column::OodAll, &[Distribution::Ood]),
            (Column::OodMatched, &[Distribution::Ood]),
        ] {
            for class in Harm::ALL {
                let is_positive = |truth: &LabelledObject| {
                    truth.harm == class && distributions.contains(&truth.truth.distribution.unwrap())
                };
                let has_truth = samples.iter().flat_map(|sample| &sample.objects).any(is_positive);
                for ap in metrics.per_threshold.get(column).unwrap().get(class) {
                    prop_assert_eq!(ap.is_some(), has_truth);
                    prop_assert!((ap.unwrap_or(1.0) - 1.0).abs() < 1e-12, "{column:?} {class:?} {ap:?}");
                }
            }
        }
    }

    #[test]
    fn no_detections_of_any_scene_score_zero(seed in 0_u64..1000) {
        let mut samples = random_samples(seed);
        samples.iter_mut().for_each(|sample| sample.detections.clear());
        let metrics = scored(&samples);
        prop_assert!(means(&metrics).into_iter().flatten().all(|mean| mean == 0.0));
        for errors in Harm::ALL.into_iter().filter_map(|class| *metrics.tp_errors.get(class)) {
            prop_assert_eq!([errors.ate, errors.ase, errors.aoe], [1.0; 3]);
        }
    }

    #[test]
    fn turning_the_boxes_changes_only_the_orientation_error(seed in 0_u64..1000, turn in 0.1..3.0_f64) {
        let mut samples = random_samples(seed);
        let before = scored(&samples);
        for detection in samples.iter_mut().flat_map(|sample| &mut sample.detections) {
            detection.box_in_ego.yaw_rad += turn;
        }
        let mut after = scored(&samples);
        for class in Harm::ALL {
            let aoe = |metrics: &Metrics| metrics.tp_errors.get(class).map_or(1.0, |errors| errors.aoe);
            let (old, new) = (aoe(&before), aoe(&after));
            // Found boxes have the true yaw, so the error is the turn, or 1 where nothing is reached.
            prop_assert!((new - turn).abs() < 1e-9 || (old == 1.0 && new == 1.0), "{old} {new}");
        }
        for (after, before) in [
            (&mut after.tp_errors.harmful, before.tp_errors.harmful),
            (&mut after.tp_errors.harmless, before.tp_errors.harmless),
        ] {
            after.iter_mut().zip(before).for_each(|(after, before)| after.aoe = before.aoe);
        }
        prop_assert_eq!(before, after);
    }

    #[test]
    fn scores_lie_between_zero_and_one(seed in 1000_u64..5000) {
        for mean in means(&scored(&random_samples(seed))).into_iter().flatten() {
            prop_assert!((0.0..=1.0 + 1e-12).contains(&mean));
        }
    }
}
