//! Which detections are neutral, one by one and in every figure.

use proptest::prelude::*;

use super::*;
use crate::dataset::test_data;
use crate::eval::matching::tests::{found, truth};
use crate::eval::{ClassScores, Column, Columns, EvalSample, Mode, Protocol, evaluate, score};
use crate::geometry::Point;
use crate::object::{Detection, Distribution, Harm, Kind};

fn a_box(x_m: f64, y_m: f64, [length_m, width_m, height_m]: [f64; 3]) -> Box3<Ego> {
    Box3 { center: Point::new(x_m, y_m, height_m / 2.0), length_m, width_m, height_m, yaw_rad: 0.0 }
}

const CAR: [f64; 3] = [4.2, 1.8, 1.5];
const POLE: [f64; 3] = [0.3, 0.3, 3.0];

/// Vehicles alone, to 40 m, in the picture.
fn labelled() -> Labelled {
    let sizes = SizeRange { length_m: [2.5, 14.0], width_m: [1.2, 3.0], height_m: [1.0, 4.2] };
    Labelled {
        kinds: vec![Kind::Vehicle],
        categories: vec!["Car".into()],
        max_range_m: Some(40.0),
        in_camera_view: true,
        sizes: [(Kind::Vehicle, sizes)].into(),
    }
}

fn facts() -> SampleFacts {
    let camera = CameraFacts::of(&test_data::dataset(1).samples()[0].measured);
    SampleFacts { labelled: Some(labelled()), camera: Some(camera), ..SampleFacts::default() }
}

fn reason(facts: &SampleFacts, found: &Box3<Ego>, n_points: Option<u32>) -> Option<NeutralReason> {
    let objects = [truth(10.0, Harm::Harmful, Distribution::Id)];
    Gaps::of(facts, &objects).and_then(|gaps| gaps.find_reason(found, n_points))
}

#[test]
fn a_size_that_no_annotated_kind_has_is_neutral_where_the_lidar_hit_something_that_is_no_truth() {
    let told = |x_m, y_m, size, n_points| reason(&facts(), &a_box(x_m, y_m, size), n_points);
    assert_eq!(told(20.0, 3.0, POLE, Some(1)), Some(NeutralReason::Kind));
    assert_eq!(told(20.0, 3.0, POLE, Some(0)), None, "an empty box stays a false positive");
    assert_eq!(told(20.0, 3.0, POLE, None), None, "so does one whose points nobody counted");
    assert_eq!(told(20.0, 3.0, CAR, Some(50)), None, "a car would have been annotated");
    assert_eq!(told(20.0, 3.0, [1.8, 4.2, 1.5], Some(50)), None, "whichever way round");
    assert_eq!(told(11.0, 0.5, POLE, Some(9)), None, "a part of a car is no pole");
}

#[test]
fn where_a_kind_may_have_any_size_no_size_is_neutral() {
    let mut all = facts();
    all.labelled.as_mut().unwrap().kinds = Kind::ALL.to_vec();
    assert!(facts().needs_points() && !all.needs_points());
    let mut any_size = facts();
    any_size.labelled.as_mut().unwrap().sizes.clear();
    for facts in [all, any_size, SampleFacts::default()] {
        assert_eq!(reason(&facts, &a_box(20.0, 3.0, POLE), Some(5)), None);
    }
}

#[test]
fn beyond_the_range_and_beside_the_picture_nothing_is_known() {
    assert_eq!(reason(&facts(), &a_box(40.0, 0.0, CAR), None), Some(NeutralReason::Range));
    assert_eq!(reason(&facts(), &a_box(39.9, 0.0, CAR), None), None);
    assert_eq!(reason(&facts(), &a_box(10.0, 9.0, CAR), None), Some(NeutralReason::View));
    let mut all_round = facts();
    all_round.labelled.as_mut().unwrap().in_camera_view = false;
    assert_eq!(reason(&all_round, &a_box(10.0, 9.0, CAR), None), None);
}

#[test]
fn a_region_of_the_picture_takes_what_lies_in_it_by_half_and_one_of_the_ground_by_its_centre() {
    let with = |region| SampleFacts { ignored: vec![region], ..facts() };
    let at = a_box(20.0, 0.0, CAR);
    let seen = facts().camera.unwrap().rectangle_of(&at).unwrap();
    let up_to = |share: f64| IgnoredRegion::Image {
        left_px: 0.0,
        top_px: 0.0,
        right_px: seen.left_px + share * (seen.right_px - seen.left_px),
        bottom_px: 90.0,
    };
    assert_eq!(reason(&with(up_to(0.51)), &at, None), Some(NeutralReason::Region));
    assert_eq!(reason(&with(up_to(0.49)), &at, None), None);
    let square = |least: f64, most: f64| {
        let corners = [(least, -1.0), (most, -1.0), (most, 1.0), (least, 1.0)];
        let corners_in_ego_m = corners.map(|(x_m, y_m)| Point2 { x_m, y_m }).to_vec();
        IgnoredRegion::Ground { corners_in_ego_m }
    };
    assert_eq!(reason(&with(square(19.0, 21.0)), &at, None), Some(NeutralReason::Region));
    assert_eq!(reason(&with(square(20.5, 25.0)), &at, None), None);
}

/// A found car, and after it in rank a pole and an empty box called by `class`.
fn sample(class: Harm) -> EvalSample {
    let detections: Vec<Detection> = [(20.0, 5.0, POLE, 0.95), (20.0, -5.0, POLE, 0.3)]
        .map(|(x_m, y_m, size, score)| Detection {
            box_in_ego: a_box(x_m, y_m, size),
            velocity_in_ego_mps: [0.0; 2],
            harm: class,
            score,
            spread: None,
        })
        .into_iter()
        .chain([found(10.0, Harm::Harmful, 0.9)])
        .collect();
    EvalSample {
        n_points: vec![Some(4), Some(0), Some(80)],
        ..EvalSample::new("s", facts(), vec![truth(10.0, Harm::Harmful, Distribution::Id)], detections)
    }
}

#[test]
fn neutral_detections_leave_every_figure_but_the_strict_one() {
    let evaluation = evaluate(&[sample(Harm::Harmful)], &Protocol::default(), Mode::Id).unwrap();
    let metrics = &evaluation.metrics;
    // The empty box comes after all truths, and counts at full recall alone: the last of the 90 steps.
    assert!(metrics.columns.total.harmful > Some(1.0 - 1.0 / 90.0));
    assert!(metrics.strict.as_ref().unwrap().total.harmful < Some(0.6));
    let outcomes = metrics.counts.outcomes.harmful[2];
    assert_eq!((outcomes.matched, outcomes.unmatched, outcomes.neutral.kind), (1, 1, 1));
    // The empty box alone is a false alarm, an uncalibrated score and a false positive of its group.
    assert_eq!(evaluation.faults.len(), 1);
    assert_eq!(evaluation.safety.detection_calibration.unwrap().harmful.n, 2);
}

#[test]
fn whether_a_detection_is_neutral_does_not_depend_on_its_class() {
    let count = |class| {
        let metrics = evaluate(&[sample(class)], &Protocol::default(), Mode::Id).unwrap().metrics;
        metrics.counts.outcomes.get(class)[2].neutral
    };
    assert_eq!(count(Harm::Harmful), count(Harm::Harmless));
}

#[test]
fn a_truth_in_a_region_counts_and_one_beyond_the_range_does_not() {
    let corners = [(0.0, -9.0), (50.0, -9.0), (50.0, 9.0), (0.0, 9.0)];
    let corners_in_ego_m = corners.map(|(x_m, y_m)| Point2 { x_m, y_m }).to_vec();
    let facts = SampleFacts { ignored: vec![IgnoredRegion::Ground { corners_in_ego_m }], ..facts() };
    let objects = [10.0, 45.0].map(|x_m| truth(x_m, Harm::Harmful, Distribution::Id)).to_vec();
    let all =
        [found(10.0, Harm::Harmful, 0.5), found(45.0, Harm::Harmful, 0.9), found(30.0, Harm::Harmful, 0.8)];
    let samples = [EvalSample::new("s", facts, objects, all.to_vec())];
    let metrics = evaluate(&samples, &Protocol::default(), Mode::Id).unwrap().metrics;
    assert_eq!((metrics.counts.truths.harmful.all, metrics.filters.truths_beyond_labelled), (1, 1));
    assert_eq!(metrics.columns.total.harmful, Some(1.0));
    assert_eq!(
        metrics.counts.outcomes.harmful[2].neutral,
        NeutralCounts { region: 2, ..NeutralCounts::default() }
    );
}

/// What a property draws for one box: place, class, score, size, points.
type Draw = (f64, f64, bool, f64, bool, u32);

fn draws(n: usize) -> impl Strategy<Value = Vec<Draw>> {
    let score = (1_u8..10).prop_map(|tenths| f64::from(tenths) / 10.0);
    let draw = (4.0..60.0_f64, -12.0..12.0_f64, any::<bool>(), score, any::<bool>(), 0_u32..3);
    prop::collection::vec(draw, 0..n)
}

/// A sample of drawn truths, half of them OOD, with detections on and beside them.
fn drawn(facts: SampleFacts, truths: &[Draw], clutter: &[Draw]) -> EvalSample {
    let class = |is_harmful: bool| Harm::ALL[usize::from(!is_harmful)];
    let object = |&(x_m, y_m, is_harmful, _, is_ood, n): &Draw| {
        let distribution = if is_ood { Distribution::Ood } else { Distribution::Id };
        let mut object = truth(x_m, class(is_harmful), distribution);
        (object.truth.box_in_ego, object.truth.n_lidar_points) = (a_box(x_m, y_m, CAR), Some(n));
        object
    };
    let detection = |off_m: f64| {
        move |&(x_m, y_m, is_harmful, score, is_pole, _): &Draw| Detection {
            box_in_ego: a_box(x_m + off_m, y_m, if is_pole { POLE } else { CAR }),
            ..found(0.0, class(is_harmful), score)
        }
    };
    let detections: Vec<Detection> =
        truths.iter().map(detection(0.4)).chain(clutter.iter().map(detection(0.0))).collect();
    let n_points = truths.iter().chain(clutter).map(|draw| (draw.5 < 2).then_some(draw.5)).collect();
    EvalSample { n_points, ..EvalSample::new("s", facts, truths.iter().map(object).collect(), detections) }
}

fn all_aps(columns: &Columns<ClassScores>) -> Vec<Option<f64>> {
    let columns = Column::ALL.map(|column| columns.get(column).unwrap());
    columns.into_iter().flat_map(|of| [of.harmful, of.harmless, of.mean]).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn where_everything_is_annotated_nothing_changes(truths in draws(9), clutter in draws(9)) {
        let everything = Labelled { kinds: Kind::ALL.to_vec(), max_range_m: None, in_camera_view: false, ..labelled() };
        let facts = SampleFacts { labelled: Some(everything), ..facts() };
        let scored = |facts| score(&[drawn(facts, &truths, &clutter)], &Protocol::default(), Mode::Ood).unwrap();
        let (mut told, plain) = (scored(facts), scored(SampleFacts::default()));
        prop_assert_eq!(told.strict.take(), Some(plain.columns.clone()));
        prop_assert_eq!(told, plain);
    }

    #[test]
    fn a_region_never_lowers_an_ap_and_the_strict_score_is_the_one_without_it(
        truths in draws(9), clutter in draws(9), (x_m, y_m) in (5.0..50.0_f64, -12.0..12.0_f64), half_m in 1.0..20.0_f64,
    ) {
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        let corner = |(along, across)| Point2 { x_m: x_m + half_m * along, y_m: y_m + half_m * across };
        let region = IgnoredRegion::Ground { corners_in_ego_m: corners.map(corner).to_vec() };
        let scored = |ignored| {
            let facts = SampleFacts { ignored, ..SampleFacts::default() };
            score(&[drawn(facts, &truths, &clutter)], &Protocol::default(), Mode::Ood).unwrap()
        };
        let (before, after) = (scored(vec![]), scored(vec![region]));
        prop_assert_eq!(after.strict.as_ref(), Some(&before.columns));
        for (before, after) in all_aps(&before.columns).into_iter().zip(all_aps(&after.columns)) {
            prop_assert_eq!(before.is_some(), after.is_some());
            prop_assert!(after.unwrap_or(0.0) >= before.unwrap_or(0.0) - 1e-12);
        }
    }

    #[test]
    fn the_strict_score_is_never_above_the_fair_one(truths in draws(9), clutter in draws(9)) {
        let metrics = score(&[drawn(facts(), &truths, &clutter)], &Protocol::default(), Mode::Ood).unwrap();
        for (strict, fair) in all_aps(&metrics.strict.unwrap()).into_iter().zip(all_aps(&metrics.columns)) {
            prop_assert_eq!(strict.is_some(), fair.is_some());
            prop_assert!(strict.unwrap_or(0.0) <= fair.unwrap_or(0.0) + 1e-12);
        }
    }
}
