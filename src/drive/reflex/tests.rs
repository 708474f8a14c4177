//! From boxes to braking.

use super::*;

const STATE: EgoState = EgoState {
    speed_mps: 10.0,
    steering_angle_rad: 0.0,
    yaw_rate_rps: 0.0,
    acceleration_mps2: 0.0,
    wheelbase_m: 2.6,
    front_bumper_x_m: 3.0,
};

/// A cube of one metre, its near side so far before the bumper.
fn crate_at(gap_m: f64, harm: Harm, score: f64) -> Detection {
    let center = Point::new(3.0 + gap_m + 0.5, 0.0, 0.5);
    let box_in_ego = Box3 { center, length_m: 1.0, width_m: 1.0, height_m: 1.0, yaw_rad: 0.0 };
    Detection { box_in_ego, velocity_in_ego_mps: [0.0; 2], harm, score, spread: None }
}

fn at(x_m: f64) -> Transform<World, Ego> {
    Transform::from_xyz_yaw(x_m, 0.0, 0.0, 0.0)
}

fn reflex(config: ReflexConfig) -> Reflex {
    Reflex::new(&config, CountsFrom { sure: 0.3, seen: 0.3 }).unwrap()
}

#[test]
fn one_sample_alone_does_not_brake_and_the_second_brakes_to_stop_before_the_box() {
    let mut reflex = reflex(ReflexConfig::default());
    reflex.see([0.0, 0.0], &at(0.0), &[crate_at(22.0, Harm::Harmful, 0.9)], false);
    assert_eq!(reflex.orders(0.0, &at(0.0), &STATE, &[]).unwrap().braking_mps2, None);
    reflex.see([0.3, 0.0], &at(3.0), &[crate_at(19.0, Harm::Harmful, 0.9)], false);
    // 100 / (2 (19 - 2)).
    let braking_mps2 = reflex.orders(0.3, &at(3.0), &STATE, &[]).unwrap().braking_mps2.unwrap();
    assert!((braking_mps2 - 100.0 / 34.0).abs() < 1e-9, "{braking_mps2}");
}

#[test]
fn what_is_harmless_or_unsure_never_brakes() {
    for found in [crate_at(10.0, Harm::Harmless, 0.9), crate_at(10.0, Harm::Harmful, 0.2)] {
        let mut reflex = reflex(ReflexConfig::default());
        for i in 0..5 {
            let time_s = 0.3 * f64::from(i);
            reflex.see([time_s, 0.0], &at(0.0), &[found], false);
            assert_eq!(reflex.orders(time_s, &at(0.0), &STATE, &[]).unwrap().braking_mps2, None);
        }
    }
}

#[test]
fn a_hazard_is_remembered_where_it_stands_until_the_way_was_free_for_a_second() {
    let mut reflex = reflex(ReflexConfig::default());
    for time_s in [0.0, 0.3] {
        reflex.see([time_s, 0.0], &at(0.0), &[crate_at(22.0, Harm::Harmful, 0.9)], false);
        reflex.orders(time_s, &at(0.0), &STATE, &[]).unwrap();
    }
    // Half a second later, 5 m on, it asks for more, although nobody has seen it since.
    let braking_mps2 = reflex.orders(0.8, &at(5.0), &STATE, &[]).unwrap().braking_mps2.unwrap();
    assert!((braking_mps2 - 100.0 / 30.0).abs() < 1e-9, "{braking_mps2}");
    assert!(reflex.orders(1.3, &at(5.0), &STATE, &[]).unwrap().braking_mps2.is_some());
    assert_eq!(reflex.orders(1.35, &at(5.0), &STATE, &[]).unwrap().braking_mps2, None);
}

#[test]
fn what_stands_right_before_the_bumper_is_not_forgotten() {
    // 2.5 m before the bumper no sensor sees a low box, and a car that stands must not drive over it. What two samples
    // alone have shown may have been an error.
    for (near_m, n_samples, is_kept) in [(3.0, 5, true), (3.0, 2, false), (0.0, 5, false)] {
        let mut reflex = reflex(ReflexConfig { near_m, ..ReflexConfig::default() });
        for i in 0..n_samples {
            let time_s = 0.3 * f64::from(i);
            reflex.see([time_s, 0.0], &at(0.0), &[crate_at(22.0, Harm::Harmful, 0.9)], false);
            reflex.orders(time_s, &at(0.0), &STATE, &[]).unwrap();
        }
        // Nobody sees it any more.
        reflex.see([3.9, 0.0], &at(19.5), &[], false);
        let brakes = reflex.orders(4.0, &at(19.5), &STATE, &[]).unwrap().braking_mps2.is_some();
        assert_eq!(brakes, is_kept, "{near_m} m, {n_samples} samples");
        // Passed, it is.
        assert_eq!(reflex.orders(4.05, &at(26.0), &STATE, &[]).unwrap().braking_mps2, None);
    }
}

#[test]
fn who_stood_before_the_bumper_and_drives_off_is_not_remembered_there() {
    // A leader stands 2.1 m ahead for 1.5 s and then leaves at 1.5 m/s, seen throughout and harmful only while it is near.
    let standing = EgoState { speed_mps: 0.0, ..STATE };
    let mut reflex = reflex(ReflexConfig::default());
    let mut brakes = Vec::new();
    for i in 0..14 {
        let time_s = 0.3 * f64::from(i);
        let gap_m = 2.1 + 0.45 * f64::from((i - 5).max(0));
        let harm = if gap_m < 3.5 { Harm::Harmful } else { Harm::Harmless };
        reflex.see([time_s, 0.0], &at(0.0), &[crate_at(gap_m, harm, 0.9)], false);
        brakes.push(reflex.orders(time_s, &at(0.0), &standing, &[]).unwrap().braking_mps2.is_some());
    }
    // It is last harmful at 2.4 s, and the way is free a second later.
    assert_eq!(brakes[1..12], [true; 11]);
    assert_eq!(brakes[12..], [false; 2]);
}

#[test]
fn of_two_that_stand_close_together_the_nearer_one_brakes_whichever_is_told_last() {
    for gaps_m in [[19.0, 21.0], [21.0, 19.0]] {
        let mut reflex = reflex(ReflexConfig::default());
        for i in 0..4 {
            let time_s = 0.3 * f64::from(i);
            reflex.see(
                [time_s, 0.0],
                &at(0.0),
                &gaps_m.map(|gap_m| crate_at(gap_m, Harm::Harmful, 0.9)),
                false,
            );
            let braking_mps2 = reflex.orders(time_s, &at(0.0), &STATE, &[]).unwrap().braking_mps2;
            // 100 / (2 (19 - 2)).
            assert!(i == 0 || (braking_mps2.unwrap() - 100.0 / 34.0).abs() < 1e-9, "{braking_mps2:?}");
        }
    }
}

#[test]
fn a_box_seen_once_beside_a_known_thing_neither_brakes_nor_takes_its_place() {
    for other_m in [22.0, 17.5] {
        let mut reflex = reflex(ReflexConfig::default());
        for (i, gaps_m) in [&[20.0][..], &[20.0], &[20.0, other_m], &[20.0]].into_iter().enumerate() {
            let time_s = 0.3 * i as f64;
            let found: Vec<Detection> =
                gaps_m.iter().map(|&gap_m| crate_at(gap_m, Harm::Harmful, 0.9)).collect();
            reflex.see([time_s, 0.0], &at(0.0), &found, false);
            let braking_mps2 = reflex.orders(time_s, &at(0.0), &STATE, &[]).unwrap().braking_mps2;
            assert!(i == 0 || (braking_mps2.unwrap() - 100.0 / 36.0).abs() < 1e-9, "{braking_mps2:?}");
        }
    }
}

#[test]
fn latency_delays_the_brake() {
    let config = ReflexConfig { latency_s: 0.2, ..ReflexConfig::default() };
    let mut reflex = reflex(config);
    for time_s in [0.0, 0.3] {
        reflex.see([time_s, 0.0], &at(0.0), &[crate_at(22.0, Harm::Harmful, 0.9)], false);
    }
    assert_eq!(reflex.orders(0.45, &at(0.0), &STATE, &[]).unwrap().braking_mps2, None);
    assert!(reflex.orders(0.5, &at(0.0), &STATE, &[]).unwrap().braking_mps2.is_some());
}

#[test]
fn what_lies_behind_the_bumper_is_past_and_what_is_too_near_takes_all_brakes() {
    let reflex = reflex(ReflexConfig::default());
    assert_eq!(reflex.gap_m(&crate_at(-1.5, Harm::Harmful, 0.9).box_in_ego, 3.0), None);
    assert!((reflex.braking_mps2(1.0, 5.0, true) - 8.0).abs() < 1e-12);
    // Of a long wall beside the car that turns into the strip ahead, the part in the strip counts.
    let wall = Box3 {
        center: Point::new(13.0, 2.0, 0.5),
        length_m: 20.0,
        width_m: 0.2,
        height_m: 1.0,
        yaw_rad: -0.1,
    };
    let gap_m = reflex.gap_m(&wall, 3.0).unwrap();
    assert!((10.0..14.0).contains(&gap_m), "{gap_m}");
}

/// A harmless crate on its way across, 12 m ahead of the bumper and so far to the left.
fn rolling(y_m: f64) -> Detection {
    let mut found = crate_at(12.0, Harm::Harmless, 0.9);
    found.box_in_ego.center = Point::new(15.5, y_m, 0.5);
    found
}

#[test]
fn what_rolls_into_the_way_brakes_before_it_is_harmful_and_what_stands_or_rolls_away_does_not() {
    let braked = |ys_m: [f64; 3], foresight_s: f64| {
        let mut reflex = reflex(ReflexConfig { foresight_s, ..ReflexConfig::default() });
        let mut told = None;
        for (i, y_m) in ys_m.into_iter().enumerate() {
            let time_s = 0.3 * i as f64;
            reflex.see([time_s, 0.0], &at(0.0), &[rolling(y_m)], false);
            told = reflex.orders(time_s, &at(0.0), &STATE, &[]).unwrap().braking_mps2;
        }
        told
    };
    // 3 m/s to the right: in 1.2 s, when the bumper is there, it is in the middle of the lane.
    assert!((braked([5.4, 4.5, 3.6], 2.0).unwrap() - 100.0 / 20.0).abs() < 0.2);
    assert_eq!(braked([5.4, 4.5, 3.6], 0.0), None);
    assert_eq!(braked([3.6, 3.6, 3.6], 2.0), None);
    assert_eq!(braked([3.0, 3.9, 4.8], 2.0), None);
}

#[test]
fn two_that_stand_side_by_side_are_not_taken_for_one_that_moves() {
    let mut reflex = reflex(ReflexConfig { foresight_s: 2.0, ..ReflexConfig::default() });
    let both = [rolling(3.0), rolling(5.0)];
    // The nearer one is seen at every second sample only.
    for (i, seen) in [&both[..], &both[1..], &both[..], &both[1..]].into_iter().enumerate() {
        let time_s = 0.3 * i as f64;
        reflex.see([time_s, 0.0], &at(0.0), seen, false);
        assert_eq!(reflex.orders(time_s, &at(0.0), &STATE, &[]).unwrap().braking_mps2, None, "{time_s} s");
    }
}

#[test]
fn of_who_knows_velocities_what_was_there_before_brakes_as_soon_as_it_moves() {
    let braked = |knows_velocities: bool| {
        let mut reflex = reflex(ReflexConfig::default());
        [(0.0, 4.5, 0.0), (0.3, 4.5, 0.0), (0.6, 4.2, -3.0)].map(|(time_s, y_m, y_mps)| {
            let mut found = rolling(y_m);
            found.velocity_in_ego_mps = [0.0, y_mps];
            reflex.see([time_s, 0.0], &at(0.0), &[found], knows_velocities);
            reflex.orders(time_s, &at(0.0), &STATE, &[]).unwrap().braking_mps2.is_some()
        })
    };
    assert_eq!(braked(true), [false, false, true]);
    assert_eq!(braked(false), [false; 3]);
}

#[test]
fn boxes_below_the_score_for_braking_brake_a_little_until_two_samples_are_surer() {
    let braked = |scores: [f64; 5]| {
        let mut reflex = Reflex::new(&ReflexConfig::default(), CountsFrom { sure: 0.5, seen: 0.3 }).unwrap();
        scores.map(|score| {
            let time_s = reflex.history.front().map_or(0.0, |last| last.time_s + 0.3);
            reflex.see([time_s, 0.0], &at(0.0), &[crate_at(7.0, Harm::Harmful, score)], false);
            reflex.orders(time_s, &at(0.0), &STATE, &[]).unwrap().braking_mps2
        })
    };
    assert_eq!(braked([0.2; 5]), [None; 5]);
    assert_eq!(braked([0.4; 5]), [None, Some(3.0), Some(3.0), Some(3.0), Some(3.0)]);
    assert_eq!(braked([0.6; 5]), [None, Some(8.0), Some(8.0), Some(8.0), Some(8.0)]);
    // Once sure it stays so; one sample of them does not make it so.
    assert_eq!(braked([0.4, 0.6, 0.6, 0.4, 0.4]), [None, Some(3.0), Some(8.0), Some(8.0), Some(8.0)]);
    assert_eq!(braked([0.6, 0.4, 0.4, 0.6, 0.4]), [None, Some(3.0), Some(3.0), Some(3.0), Some(3.0)]);
}

#[test]
fn what_is_foreseen_from_unsure_boxes_brakes_a_little() {
    let braked = |score: f64| {
        let mut reflex = Reflex::new(&ReflexConfig::default(), CountsFrom { sure: 0.95, seen: 0.3 }).unwrap();
        let mut told = None;
        for (i, y_m) in [5.4, 4.5, 3.6].into_iter().enumerate() {
            let time_s = 0.3 * i as f64;
            reflex.see([time_s, 0.0], &at(0.0), &[Detection { score, ..rolling(y_m) }], false);
            told = reflex.orders(time_s, &at(0.0), &STATE, &[]).unwrap().braking_mps2;
        }
        told.unwrap()
    };
    assert!((braked(0.99) - 100.0 / 20.0).abs() < 0.2);
    assert_eq!(braked(0.4), 3.0);
}
