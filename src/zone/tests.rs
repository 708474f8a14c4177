//! The zones' rules on boxes: hand-worked cases, and what must hold for all of them.

use std::f64::consts::FRAC_PI_2;

use proptest::prelude::*;

use super::course::tests::ego;
use super::*;
use crate::geometry::{Point, convex_overlap_area, polygon_area};
use crate::object::SolidPart;

const STANDING: [f64; 2] = [0.0, 0.0];

fn zone(kind: ZoneKind) -> Zone {
    Zone::try_from(ZoneConfig { kind, ..ZoneConfig::default() }).unwrap()
}

fn at(kind: ZoneKind, speed_mps: f64, steering_angle_rad: f64) -> ZoneAt {
    zone(kind).at(&ego(speed_mps, steering_angle_rad)).unwrap()
}

fn rect(speed_mps: f64, steering_angle_rad: f64) -> ZoneAt {
    at(ZoneKind::Rect, speed_mps, steering_angle_rad)
}

fn block(x_m: f64, y_m: f64, length_m: f64, width_m: f64) -> Box3<Ego> {
    Box3 { center: Point::new(x_m, y_m, 0.5), length_m, width_m, height_m: 1.0, yaw_rad: 0.0 }
}

fn harm(zone: &ZoneAt, object: &Box3<Ego>, velocity: [f64; 2]) -> Harm {
    zone.harm_of(object, velocity).unwrap().harm
}

fn assert_corners(zone: &ZoneAt, expected: [(f64, f64); 4]) {
    assert_eq!(zone.corners().len(), 4);
    for (corner, (x_m, y_m)) in zone.corners().iter().zip(expected) {
        assert!((corner.x_m - x_m).abs() < 1e-12 && (corner.y_m - y_m).abs() < 1e-12, "{corner:?}");
    }
}

#[test]
fn a_box_too_small_or_too_far_for_the_shortcut_is_clipped() {
    let zone = rect(10.0, 0.1);
    let odd = [block(1e5, 1e5, 2.0, 2.0), block(15.0, 9.0, 1e-4, 1.0), block(15.0, 20.0, 2e4, 1.0)];
    for object in odd {
        let clipped = convex_overlap_area(zone.corners(), &object.footprint());
        assert_eq!(zone.harm_of(&object, STANDING).unwrap().overlap_area_m2, clipped);
    }
}

#[test]
fn at_ten_metres_a_second_the_zone_is_twenty_five_metres_deep() {
    let expected = [(3.6, -1.75), (28.6, -1.75), (28.6, 1.75), (3.6, 1.75)];
    assert_corners(&rect(10.0, 0.0), expected);
    assert_corners(&at(ZoneKind::Arc, 10.0, 0.0), expected);
}

#[test]
fn a_car_that_stands_or_rolls_back_keeps_the_safe_distance() {
    assert_eq!(rect(0.0, 0.0).corners(), rect(-3.0, 0.0).corners());
    assert_corners(&rect(0.0, 0.0), [(3.6, -1.75), (8.6, -1.75), (8.6, 1.75), (3.6, 1.75)]);
}

#[test]
fn steering_to_the_left_turns_the_zone_about_the_bumper() {
    assert_corners(&rect(0.0, FRAC_PI_2), [(5.35, 0.0), (5.35, 5.0), (1.85, 5.0), (1.85, 0.0)]);
}

#[test]
fn object_behind_ego_is_harmless() {
    let behind = block(-5.0, 0.0, 4.0, 2.0);
    for kind in ZoneKind::ALL {
        let verdict = at(kind, 10.0, 0.1).harm_of(&behind, STANDING).unwrap();
        assert_eq!((verdict.harm, verdict.overlap_area_m2), (Harm::Harmless, 0.0), "{kind:?}");
    }
}

#[test]
fn one_square_metre_of_a_large_object_is_harmful_and_less_is_not() {
    // A 10 m x 2 m truck whose right metre-fraction reaches into the zone: overlap 10 * reach.
    for kind in [ZoneKind::Rect, ZoneKind::Arc] {
        let reach = |reach_m: f64| {
            at(kind, 10.0, 0.0).harm_of(&block(15.0, 2.75 - reach_m, 10.0, 2.0), STANDING).unwrap()
        };
        assert_eq!(reach(0.125).harm, Harm::Harmful);
        assert!((reach(0.125).overlap_area_m2 - 1.25).abs() < 1e-12);
        assert_eq!(reach(0.09375).harm, Harm::Harmless);
    }
}

#[test]
fn a_quarter_of_a_small_object_is_harmful_and_less_is_not() {
    // A 0.5 m cube: a quarter of it is 0.0625 square metres, far below one.
    for kind in [ZoneKind::Rect, ZoneKind::Arc] {
        let place = |y_m: f64| at(kind, 10.0, 0.0).harm_of(&block(15.0, y_m, 0.5, 0.5), STANDING).unwrap();
        assert!((place(1.875).overlap_ratio - 0.25).abs() < 1e-12);
        assert_eq!(place(1.87).harm, Harm::Harmful);
        assert_eq!(place(1.89).harm, Harm::Harmless);
    }
}

#[test]
fn an_object_that_swallows_the_zone_is_harmful() {
    let verdict = rect(0.0, 0.3).harm_of(&block(5.0, 0.0, 100.0, 100.0), STANDING).unwrap();
    assert!((verdict.overlap_area_m2 - 5.0 * 3.5).abs() < 1e-9);
    assert_eq!(verdict.harm, Harm::Harmful);
}

#[test]
fn five_degrees_of_steering_put_rectangle_and_arc_lanes_apart() {
    // At 10 m/s, 5 degrees, wheelbase 2.7 m (k = 0.0324): 20 m on, the arc is 6.3 m aside, the ray 1.7 m.
    let steering = 5f64.to_radians();
    let (rect, arc) = (rect(10.0, steering), at(ZoneKind::Arc, 10.0, steering));
    let (on_the_ray, on_the_arc) = (block(22.0, 1.7, 1.0, 1.0), block(21.0, 7.6, 1.0, 1.0));
    assert_eq!(
        (harm(&rect, &on_the_ray, STANDING), harm(&arc, &on_the_ray, STANDING)),
        (Harm::Harmful, Harm::Harmless)
    );
    assert_eq!(
        (harm(&rect, &on_the_arc, STANDING), harm(&arc, &on_the_arc, STANDING)),
        (Harm::Harmless, Harm::Harmful)
    );
}

#[test]
fn ttc_tells_the_time_and_the_others_do_not() {
    let car = block(25.6, 0.3, 4.0, 1.8);
    for kind in ZoneKind::ALL {
        let verdict = at(kind, 10.0, 0.0).harm_of(&car, STANDING).unwrap();
        assert_eq!(verdict.harm, Harm::Harmful, "{kind:?}");
        match verdict.time_to_collision_s {
            Some(time_s) => assert!(kind == ZoneKind::Ttc && (time_s - 2.0).abs() < 0.01),
            None => assert_ne!(kind, ZoneKind::Ttc),
        }
    }
    // A car that drives away as fast is harmless by TTC, but not by RSS, which asks what happens if it
    // brakes.
    let away = [10.0, 0.0];
    let kinds = [ZoneKind::Rect, ZoneKind::Arc, ZoneKind::Ttc, ZoneKind::Rss];
    let harms = kinds.map(|kind| harm(&at(kind, 10.0, 0.0), &car, away));
    assert_eq!(harms, [Harm::Harmful, Harm::Harmful, Harm::Harmless, Harm::Harmful]);
}

#[test]
fn no_object_lies_more_than_wholly_in_a_zone_of_many_kilometres() {
    let rss = RssConfig { lateral_min_brake_mps2: 1e-9, ..RssConfig::default() };
    let zone = Zone::try_from(ZoneConfig { kind: ZoneKind::Rss, rss, ..ZoneConfig::default() }).unwrap();
    let object = Box3 { yaw_rad: 0.3, ..block(12.0, 2.0, 4.0, 2.0) };
    for (speed_mps, steering_angle_rad) in [(0.0, 0.0), (14.0, 0.1), (40.0, -0.6)] {
        let Ok(here) = zone.at(&ego(speed_mps, steering_angle_rad)) else { continue };
        let verdict = here.harm_of(&object, [-3.0, 1.0]).unwrap();
        assert!((0.99..=1.0).contains(&verdict.overlap_ratio), "{verdict:?}");
    }
}

#[test]
fn rss_keeps_34_and_a_half_metres_from_a_standing_car_and_7_decimetres_aside() {
    // 10 m/s: 10 + 1.75 + 13.5^2 / 8 = 34.53 m from the bumper at 3.6 m; sides at 0.865 + 0.725 = 1.59 m.
    let zone = at(ZoneKind::Rss, 10.0, 0.0);
    let place = |near_x: f64, near_y: f64, velocity| {
        harm(&zone, &block(near_x + 1.0, near_y + 0.5, 2.0, 1.0), velocity)
    };
    assert_eq!((place(38.1, 0.0, STANDING), place(38.2, 0.0, STANDING)), (Harm::Harmful, Harm::Harmless));
    assert_eq!((place(20.0, 1.58, STANDING), place(20.0, 1.60, STANDING)), (Harm::Harmful, Harm::Harmless));
    // At 1.5 m/s towards the course the distance is 5.88 m: from 6.75 m on it is safe; away, 0.1 m is.
    assert_eq!(
        (place(20.0, 6.7, [0.0, -1.5]), place(20.0, 6.8, [0.0, -1.5])),
        (Harm::Harmful, Harm::Harmless)
    );
    assert_eq!(
        (place(20.0, 0.95, [0.0, 1.5]), place(20.0, 0.98, [0.0, 1.5])),
        (Harm::Harmful, Harm::Harmless)
    );
    // Oncoming at 10 m/s: 105.25 m; ahead at 10 m/s: 28.28 m.
    assert_eq!(
        (place(108.0, 0.0, [-10.0, 0.0]), place(109.0, 0.0, [-10.0, 0.0])),
        (Harm::Harmful, Harm::Harmless)
    );
    assert_eq!(
        (place(31.8, 0.0, [10.0, 0.0]), place(32.0, 0.0, [10.0, 0.0])),
        (Harm::Harmful, Harm::Harmless)
    );
}

#[test]
fn in_a_turn_the_road_is_the_arc() {
    // Radius 13.3 m: an oncoming car on the arc comes along it, though it drives across the ego's x axis.
    let zone = at(ZoneKind::Rss, 4.0, 0.2);
    let car = Box3 { yaw_rad: FRAC_PI_2, ..block(13.3, 13.3, 4.0, 1.8) };
    assert_eq!(harm(&zone, &car, [0.0, -6.0]), Harm::Harmful);
    // 15 m of arc lie between; standing it is farther than 4 + 1.75 + 7.5^2 / 8 = 12.8 m.
    assert_eq!(harm(&zone, &car, STANDING), Harm::Harmless);
}

#[test]
fn a_full_lock_at_speed_ends_after_the_greatest_turn() {
    // 41 m of arc on a radius of 4 m would lead round one and a half times.
    for kind in [ZoneKind::Arc, ZoneKind::Ttc, ZoneKind::Rss] {
        for steering in [0.6, -0.6] {
            let zone = at(kind, 18.0, steering);
            let turned = zone.harm_of(&block(0.0, 9.0 * f64::signum(steering), 0.5, 0.5), STANDING).unwrap();
            assert_eq!(turned.harm, Harm::Harmful, "{kind:?}: half round");
            assert!(zone.corners().iter().all(|corner| corner.x_m > -6.0), "{kind:?}");
            let behind = zone.harm_of(&block(-5.0, 4.0 * f64::signum(steering), 0.5, 0.5), STANDING).unwrap();
            assert_eq!(behind.harm, Harm::Harmless, "{kind:?}: beyond half a turn");
        }
    }
}

#[test]
fn invalid_numbers_are_errors_that_name_the_field() {
    let config = ZoneConfig { width_m: 0.0, ..ZoneConfig::default() };
    assert!(Zone::try_from(config).unwrap_err().to_string().contains("width_m is 0"));
    let config = ZoneConfig { min_overlap_ratio: 1.5, ..ZoneConfig::default() };
    assert!(Zone::try_from(config).unwrap_err().to_string().contains("min_overlap_ratio is 1.5"));
    for kind in ZoneKind::ALL {
        let zone = zone(kind);
        assert!(zone.at(&ego(f64::NAN, 0.0)).unwrap_err().to_string().contains("speed_mps is NaN"));
        assert!(matches!(zone.at(&ego(1e308, 0.0)), Err(ZoneError::Depth { .. })), "{kind:?}");
        let bumper = EgoState { front_bumper_x_m: -1.0, ..ego(1.0, 0.0) };
        assert!(matches!(zone.at(&bumper), Err(ZoneError::StateNotPositive { .. })));
        let here = zone.at(&ego(1.0, 0.0)).unwrap();
        let flat = here.harm_of(&block(1.0, 0.0, 2.0, -1.0), STANDING).unwrap_err();
        assert!(flat.to_string().contains("width_m is -1"));
        let vast = here.harm_of(&block(0.0, 0.0, 1e200, 1e200), STANDING);
        assert!(matches!(vast, Err(ZoneError::Overlap { .. })), "{kind:?}");
        let unknown = here.harm_of(&block(9.0, 0.0, 1.0, 1.0), [f64::NAN, 0.0]);
        let uses_velocity = matches!(kind, ZoneKind::Ttc | ZoneKind::Rss);
        assert_eq!(matches!(unknown, Err(ZoneError::Velocity { .. })), uses_velocity);
    }
    // A turn on 2 m: a lane is wider than that, the car is not.
    assert!(matches!(zone(ZoneKind::Arc).at(&ego(1.0, 0.95)), Err(ZoneError::Radius { .. })));
    assert!(
        zone(ZoneKind::Ttc).at(&ego(1.0, 0.95)).is_ok() && zone(ZoneKind::Rss).at(&ego(1.0, 0.95)).is_ok()
    );
}

/// A file may say anything of an ego and of an object that is finite: a verdict or an error comes, and at once.
#[test]
fn no_finite_number_makes_a_bend_or_a_forecast_without_end() {
    let bends =
        [(1.0, 0.01, 2.7, 1e300), (1e18, 1e-18, 1.0, 3.6), (1e12, 0.3, 2.7, 3.6), (1e15, 1e-4, 2.7, 3.6)];
    for (kind, (speed_mps, steering, wheelbase_m, front_bumper_x_m)) in
        ZoneKind::ALL.into_iter().flat_map(|kind| bends.map(|bend| (kind, bend)))
    {
        let hostile = EgoState { wheelbase_m, front_bumper_x_m, ..ego(speed_mps, steering) };
        if let Ok(here) = zone(kind).at(&hostile) {
            assert!(here.corners().len() < 300_000);
            let _ = here.harm_of(&block(9.0, 0.0, 1.0, 1.0), STANDING);
        }
    }
    let far = zone(ZoneKind::Ttc).at(&EgoState { front_bumper_x_m: 1e300, ..ego(1.0, 0.01) }).unwrap_err();
    assert!(matches!(far, ZoneError::Bend { .. }), "{far}");
    // A metre apart for good: of a car's speeds no contact, of a comet's no answer.
    let beside = |speed| at(ZoneKind::Ttc, speed, 0.0).harm_of(&block(2.0, 2.4, 2.0, 1.0), [speed, 0.0]);
    assert_eq!(beside(90.0).unwrap().time_to_collision_s, None);
    let fast = beside(1e9).unwrap_err();
    assert!(matches!(fast, ZoneError::Closing { .. }), "{fast}");
}

proptest! {
    #[test]
    fn the_zone_has_the_area_of_its_depth_and_width(speed in -5.0..40.0, steering in -0.7..0.7) {
        let depth_m = 2.0 * f64::max(speed, 0.0) + 5.0;
        prop_assert!((polygon_area(rect(speed, steering).corners()) - depth_m * 3.5).abs() < 1e-9);
    }

    #[test]
    fn mirroring_road_and_steering_changes_nothing(
        speed in 0.0..30.0, steering in -0.6..0.6, x in 0.0..60.0, y in -8.0..8.0, yaw in -3.0..3.0,
        vx in -10.0..10.0, vy in -3.0..3.0,
    ) {
        let seen = Box3 { yaw_rad: yaw, ..block(x, y, 4.2, 1.8) };
        let mirrored = Box3 { yaw_rad: -yaw, ..block(x, -y, 4.2, 1.8) };
        for kind in ZoneKind::ALL {
            let verdict = at(kind, speed, steering).harm_of(&seen, [vx, vy]).unwrap();
            let other = at(kind, speed, -steering).harm_of(&mirrored, [vx, -vy]).unwrap();
            prop_assert!((verdict.overlap_area_m2 - other.overlap_area_m2).abs() < 1e-9, "{:?}", kind);
            prop_assert!((0.0..=1.0 + 1e-9).contains(&verdict.overlap_ratio));
            prop_assert_eq!(verdict.time_to_collision_s.is_some(), other.time_to_collision_s.is_some());
        }
    }

    #[test]
    fn more_speed_never_makes_a_standing_object_less_harmful(
        speed in 0.0..20.0, more in 0.0..20.0, steering in -0.6..0.6, x in 4.0..60.0, y in -8.0..8.0,
    ) {
        let object = block(x, y, 1.0, 1.0);
        let of = |kind, speed| at(kind, speed, steering).harm_of(&object, STANDING).unwrap();
        let overlap = |speed| of(ZoneKind::Rect, speed).overlap_area_m2;
        prop_assert!(overlap(speed + more) >= overlap(speed) - 1e-9);
        for kind in [ZoneKind::Arc, ZoneKind::Ttc, ZoneKind::Rss] {
            // Chords of another length leave the arcs by up to 5 mm, along a metre of edge on each side.
            let (slow, fast) = (of(kind, speed), of(kind, speed + more));
            prop_assert!(fast.overlap_area_m2 >= slow.overlap_area_m2 - 0.02, "{:?}", kind);
        }
        // Near misses of less than a centimetre may count or not: a smaller object that is met touches the whole one.
        let smaller = block(x, y, 0.96, 0.96);
        let is_met = |speed, object| harm(&at(ZoneKind::Ttc, speed, steering), object, STANDING) == Harm::Harmful;
        prop_assert!(is_met(speed + more, &object) || !is_met(speed, &smaller));
    }

    #[test]
    fn a_standing_object_ahead_is_met_where_the_body_sweeps_its_ground(
        speed in 0.5..14.0, steering in -0.6..0.6, x in 5.0..60.0, y in -12.0..12.0, yaw in -3.0..3.0,
    ) {
        let object = Box3 { yaw_rad: yaw, ..block(x, y, 2.0, 1.0) };
        let verdict = at(ZoneKind::Ttc, speed, steering).harm_of(&object, STANDING).unwrap();
        // Chords add up to half a centimetre on the inside of the turn, along two metres and a half.
        prop_assert!(verdict.harm == Harm::Harmful || verdict.overlap_area_m2 < 0.02, "{:?}", verdict);
        // Contact begins a centimetre before, and chords cut half of one on the outside.
        if verdict.harm == Harm::Harmful && verdict.overlap_area_m2 == 0.0 {
            let wider = Box3 { length_m: 2.06, width_m: 1.06, ..object };
            let near = at(ZoneKind::Ttc, speed, steering).harm_of(&wider, STANDING).unwrap();
            prop_assert!(near.overlap_area_m2 > 0.0, "{:?}", near);
        }
    }

    #[test]
    fn what_is_told_without_clipping_is_what_clipping_tells(
        speed in 0.0..20.0, steering in -0.6..0.6, x in -10.0..60.0, y in -20.0..20.0, yaw in -3.0..3.0,
        length in 0.01..12.0, width in 0.01..3.0,
    ) {
        let (zone, object) = (rect(speed, steering), Box3 { yaw_rad: yaw, ..block(x, y, length, width) });
        let found = zone.harm_of(&object, STANDING).unwrap().overlap_area_m2;
        let clipped = convex_overlap_area(zone.corners(), &object.footprint());
        prop_assert_eq!(found.to_bits(), clipped.to_bits(), "{} {}", found, clipped);
    }

    #[test]
    fn the_zone_leads_where_the_steering_aims(x in 12.0..30.0, y in -4.0..4.0) {
        for kind in ZoneKind::ALL {
            let steering = zone(kind).steering_towards_rad(&ego(0.0, 0.0), Point2 { x_m: x, y_m: y });
            let aimed = harm(&at(kind, 14.0, steering), &block(x, y, 0.4, 0.4), STANDING);
            prop_assert_eq!(aimed, Harm::Harmful, "{:?} {}", kind, steering);
        }
    }
}

#[test]
fn what_hangs_above_is_harmless_until_it_falls_and_in_the_paper_s_rule_it_is_not() {
    let aloft =
        |lowest_m: f64| Box3 { center: Point::new(10.0, 0.0, lowest_m + 0.5), ..block(10.0, 0.0, 2.0, 2.0) };
    for kind in ZoneKind::ALL {
        let here = at(kind, 10.0, 0.0);
        assert_eq!(harm(&here, &aloft(2.4), STANDING), Harm::Harmful, "{kind:?}");
        let verdict = here.harm_of(&aloft(2.6), STANDING).unwrap();
        assert_eq!((verdict.harm, verdict.time_to_collision_s), (Harm::Harmless, None), "{kind:?}");
        assert!(verdict.overlap_area_m2 > 1.0, "{kind:?}: the ground below it is still told");
        let paper = ZoneConfig { kind, max_clearance_m: 0.0, ..ZoneConfig::default() };
        let paper = Zone::try_from(paper).unwrap().at(&ego(10.0, 0.0)).unwrap();
        assert_eq!(harm(&paper, &aloft(20.0), STANDING), Harm::Harmful, "{kind:?}");
        // On a hill ahead, the ground under a thing counts, not the plane that the ego stands on.
        let on_a_hill = Object { clearance_m: Some(0.0), ..Object::new(aloft(4.0)) };
        let standing = Object { velocity_in_ego_mps: STANDING, ..on_a_hill };
        assert_eq!(here.harm_of_object(&standing).unwrap().harm, Harm::Harmful, "{kind:?}");
    }
}

#[test]
fn a_crown_over_the_lane_is_harmless_where_the_trunk_is_beside_it() {
    // A tree of 5 m across, its trunk 2.2 m to the left of the middle of a lane that reaches to 1.75 m.
    let crown = Box3 { yaw_rad: 0.3, ..block(10.0, 2.0, 5.0, 5.0) };
    let trunk = SolidPart { along_m: 0.0, across_m: 0.2, length_m: 0.4, width_m: 0.4 };
    let standing = Object { velocity_in_ego_mps: STANDING, ..Object::new(crown) };
    let tree = Object { solid: Some(trunk), ..standing.clone() };
    let trunk_in_ego = tree.solid_in_ego();
    // The trunk's middle is 0.2 m along the box's turned y axis.
    assert!((trunk_in_ego.center.y() - (2.0 + 0.2 * 0.3_f64.cos())).abs() < 1e-12);
    assert!((trunk_in_ego.center.x() - (10.0 - 0.2 * 0.3_f64.sin())).abs() < 1e-12);
    for kind in [ZoneKind::Rect, ZoneKind::Arc, ZoneKind::Ttc] {
        let here = at(kind, 10.0, 0.0);
        assert_eq!(here.harm_of_object(&standing).unwrap().harm, Harm::Harmful, "{kind:?}");
        assert_eq!(here.harm_of_object(&tree).unwrap().harm, Harm::Harmless, "{kind:?}");
    }
    let in_the_lane = Object { solid: Some(SolidPart { across_m: -1.5, ..trunk }), ..standing };
    assert_eq!(rect(10.0, 0.0).harm_of_object(&in_the_lane).unwrap().harm, Harm::Harmful);
}
