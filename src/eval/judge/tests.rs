//! Tests of what decides on harm.

use proptest::prelude::*;

use super::*;
use crate::dataset::{SampleFacts, test_data};
use crate::eval::{Columns, EvalSample, Mode, Protocol, score};
use crate::geometry::{Box3, Ego, Point};
use crate::object::Distribution;
use crate::zone::{ZoneConfig, ZoneKind};

fn state(speed_mps: f64, steering_deg: f64) -> EgoState {
    EgoState {
        speed_mps,
        steering_angle_rad: steering_deg.to_radians(),
        yaw_rate_rps: 0.0,
        acceleration_mps2: 0.0,
        wheelbase_m: 2.7,
        front_bumper_x_m: 3.6,
    }
}

fn found(x_m: f64, y_m: f64, harm: Harm, score: f64) -> Detection {
    let box_in_ego = Box3::<Ego> {
        center: Point::new(x_m, y_m, 0.5),
        length_m: 1.0,
        width_m: 1.0,
        height_m: 1.0,
        yaw_rad: 0.0,
    };
    Detection { box_in_ego, velocity_in_ego_mps: [0.0; 2], harm, score, spread: None }
}

/// Class and score of each, in hundredths.
fn told(judge: Judge, detections: &[Detection], state: &EgoState) -> Vec<(Harm, i32)> {
    let zone = Zone::try_from(ZoneConfig::default()).unwrap();
    let judged = judge.judge(detections, state, &zone).unwrap();
    judged.iter().map(|d| (d.harm, (100.0 * d.score).round() as i32)).collect()
}

#[test]
fn both_classes_of_a_query_and_of_near_boxes_are_one_object_whose_harm_the_zone_says() {
    use Harm::{Harmful, Harmless};
    let detections = [
        found(10.0, 0.0, Harmless, 0.6),
        found(10.0, 0.0, Harmful, 0.3),
        // Another object beside it, of one class alone, and a third one with two boxes 0.3 m apart.
        found(10.4, 0.0, Harmless, 0.5),
        found(20.0, 9.0, Harmful, 0.4),
        found(20.3, 9.0, Harmless, 0.05),
    ];
    // At 10 m/s the zone is 25 m deep: both boxes at 10 m lie in it, the one 9 m to the left does not.
    let state = state(10.0, 0.0);
    assert_eq!(told(Judge::Zone, &detections, &state), [(Harmful, 90), (Harmful, 50), (Harmless, 45)]);
    assert_eq!(told(Judge::Network, &detections, &state).len(), 5);
}

#[test]
fn the_rule_by_speed_alone_looks_straight_ahead() {
    let aside = [found(15.0, 5.0, Harm::Harmful, 0.8)];
    // atan(5 / 11.4) is 23.7 degrees.
    let turning = state(10.0, 23.7);
    assert_eq!(told(Judge::Zone, &aside, &turning), [(Harm::Harmful, 80)]);
    assert_eq!(told(Judge::SpeedZone, &aside, &turning), [(Harm::Harmless, 80)]);
    let shares = told(Judge::SpeedZoneSoft, &aside, &turning);
    assert_eq!(shares, told(Judge::ZoneSoft, &aside, &state(10.0, 0.0)));
}

#[test]
fn the_soft_rule_is_in_doubt_at_the_edge_and_sure_away_from_it() {
    // The zone ends at 28.6 m: a box from 28.6 m on touches it, one from 29.1 m on is half a metre away.
    let at =
        |x_m: f64| told(Judge::ZoneSoft, &[found(x_m + 0.5, 0.0, Harm::Harmful, 1.0)], &state(10.0, 0.0));
    assert_eq!(at(28.6), [(Harm::Harmless, 50), (Harm::Harmful, 50)]);
    assert_eq!(at(29.1), [(Harm::Harmless, 73), (Harm::Harmful, 27)]);
    assert_eq!(at(20.0), [(Harm::Harmful, 99), (Harm::Harmless, 1)]);
    assert_eq!(at(40.0), [(Harm::Harmless, 100)]);
}

#[test]
fn both_together_lie_between_the_network_and_the_expected_rule() {
    let detections = [found(20.0, 0.0, Harm::Harmless, 0.6), found(20.0, 0.0, Harm::Harmful, 0.2)];
    let harmful = |judge| {
        let all = told(judge, &detections, &state(10.0, 0.0)).into_iter();
        all.filter(|told| told.0 == Harm::Harmful).map(|told| told.1).sum::<i32>()
    };
    let (network, both, rule) = (harmful(Judge::Network), harmful(Judge::Both), harmful(Judge::ZoneExpected));
    assert!(network < both && both < rule, "{network} {both} {rule}");
}

#[test]
fn names_are_those_of_files() {
    for judge in Judge::ALL {
        assert_eq!(serde_json::to_value(judge).unwrap(), judge.name());
        assert_eq!(Judge::named(judge.name()), Some(judge));
    }
    assert_eq!(Judge::named("oracle"), None);
}

#[test]
fn every_zone_judges_hard_and_only_the_rectangle_softly() {
    for kind in ZoneKind::ALL {
        let zone = Zone::try_from(ZoneConfig { kind, ..ZoneConfig::default() }).unwrap();
        let boxes = [found(10.0, 0.0, Harm::Harmless, 0.9), found(10.0, 9.0, Harm::Harmful, 0.8)];
        let hard = Judge::Zone.judge(&boxes, &state(10.0, 0.0), &zone).unwrap();
        let harms: Vec<Harm> = hard.iter().map(|detection| detection.harm).collect();
        assert_eq!(harms, [Harm::Harmful, Harm::Harmless], "{kind:?}");
        let soft = Judge::ZoneSoft.judge(&boxes, &state(10.0, 0.0), &zone);
        assert_eq!(matches!(soft, Err(ZoneError::NoEdge)), !Judge::ZoneSoft.fits(&zone));
        assert!(Judge::Zone.fits(&zone) && Judge::ZoneSoft.fits(&zone) == (kind == ZoneKind::Rect));
    }
}

/// AP of a judge over perfect boxes of made-up streets, every second object out of distribution.
fn ap_of_perfect_boxes(judge: Judge, scores: &[f64], classes: &[bool]) -> Columns<[f64; 2]> {
    let dataset = test_data::dataset(12);
    let draws = scores.iter().zip(classes).cycle();
    let mut draws = draws.map(|(&score, &is_harmful)| (score, Harm::ALL[usize::from(!is_harmful)]));
    let samples: Vec<EvalSample> = dataset
        .samples()
        .iter()
        .map(|sample| {
            let mut objects = sample.objects.clone();
            for object in objects.iter_mut().skip(1).step_by(2) {
                object.truth.distribution = Some(Distribution::Ood);
            }
            let boxes: Vec<Detection> = objects
                .iter()
                .map(|object| {
                    let (score, harm) = draws.next().unwrap();
                    let box_in_ego = object.truth.box_in_ego;
                    Detection { box_in_ego, velocity_in_ego_mps: [0.0; 2], harm, score, spread: None }
                })
                .collect();
            let detections = judge.judge(&boxes, &sample.measured.ego_state, dataset.zone()).unwrap();
            EvalSample::new(&sample.id, SampleFacts::default(), objects, detections)
        })
        .collect();
    let columns = score(&samples, &Protocol::default(), Mode::Ood).unwrap().columns;
    let both = |scores: &crate::eval::ClassScores| [scores.harmful, scores.harmless].map(Option::unwrap);
    Columns {
        total: both(&columns.total),
        id_matched: columns.id_matched.as_ref().map(both),
        ood_all: columns.ood_all.as_ref().map(both),
        ood_matched: columns.ood_matched.as_ref().map(both),
    }
}

fn lowest(columns: &Columns<[f64; 2]>) -> f64 {
    let others = [&columns.id_matched, &columns.ood_all, &columns.ood_matched];
    let all = others.into_iter().map(|column| column.unwrap()).chain([columns.total]);
    all.flatten().fold(f64::INFINITY, f64::min)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn over_perfect_boxes_the_zone_has_an_ap_of_one_in_every_column_whatever_scores_and_classes_say(
        scores in prop::collection::vec(0.02_f64..1.0, 7),
        classes in prop::collection::vec(any::<bool>(), 11),
    ) {
        let lowest_of = |judge, scores: &[f64]| lowest(&ap_of_perfect_boxes(judge, scores, &classes));
        prop_assert!(lowest_of(Judge::Zone, &scores) > 1.0 - 1e-9);
        // The soft rule ranks by its doubt too: equal scores are needed. The shares of the other class, behind all
        // truths, count at full recall alone, the last of the 90 steps.
        prop_assert!(lowest_of(Judge::ZoneSoft, &[0.9]) > 1.0 - 1.0 / 90.0);
        // On made-up streets the wheels are turned: the rule that ignores this is wrong there.
        prop_assert!(lowest_of(Judge::SpeedZone, &scores) < 1.0 - 1.0 / 90.0);
    }
}
