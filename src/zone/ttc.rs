//! Time to collision: when the ego's body and a footprint meet if both keep their motion.
//!
//! "The time required for two vehicles to collide if they continue at their present speed and on the same path"
//! (Hayward, Near-miss determination through use of a scale of danger, Highway Research Record 384, 1972). The ego
//! keeps speed and steering and runs along its [`Course`]; the object keeps its velocity and its yaw.
//!
//! Found by conservative advancement (Mirtich 1996): from a gap `d`, no point can close it sooner than `d` over the sum
//! of the greatest speeds, so time advances by that much until the gap is gone; no contact is missed.

use super::config::ZoneConfig;
use super::corridor::{Body, Corridor};
use super::course::Course;
use super::error::ZoneError;
use super::rule::{Meeting, Seen, ZoneRule};
use crate::geometry::{Box3, Ego, Point2, convex_signed_distance_m};
use crate::sample::EgoState;

/// A gap as small as this is contact, metres.
const TOUCH_M: f64 = 0.01;

/// Most advances until contact: two who pass a few centimetres apart for a minute take fewer.
const MAX_STEPS: usize = 1_000_000;

/// The forecast of the ego.
#[derive(Debug)]
pub(super) struct Ttc {
    /// The ground that the body sweeps within the horizon.
    swept: Corridor,
    course: Course,
    body: Body,
    speed_mps: f64,
    horizon_s: f64,
}

impl ZoneRule for Ttc {
    fn at(config: &ZoneConfig, ego: &EgoState) -> Result<Self, ZoneError> {
        let (course, body, speed_mps) = (Course::of(ego)?, config.body_of(ego), ego.speed_mps);
        let horizon_m = speed_mps.abs() * config.ttc.horizon_s;
        let along_m = course.cut_m(horizon_m, config.max_turn_rad());
        if !along_m.is_finite() {
            return Err(ZoneError::Depth { depth_m: along_m, speed_mps });
        }
        // A course that ends by its turn ends the forecast too.
        let share = if horizon_m > 0.0 { along_m / horizon_m } else { 1.0 };
        let swept = Corridor::of_body(&course, &body, if speed_mps > 0.0 { along_m } else { 0.0 })?;
        Ok(Self { swept, course, body, speed_mps, horizon_s: share * config.ttc.horizon_s })
    }

    fn describe(config: &ZoneConfig, _speed_mps: f64) -> String {
        format!("contact within {:.1} s if both keep their motion", config.ttc.horizon_s)
    }

    fn outline(&self) -> &[Point2] {
        self.swept.outline()
    }

    fn uses_velocity(&self) -> bool {
        true
    }

    fn overlap_m2(&self, object: &Seen) -> Result<f64, ZoneError> {
        Ok(object.shared_m2(&self.swept))
    }

    fn time_to_collision_s(&self, object: &Seen) -> Result<Option<f64>, ZoneError> {
        let Self { course, body, speed_mps, horizon_s, .. } = self;
        time_to_collision_s(course, *speed_mps, body, object.box_in_ego, object.velocity_mps, *horizon_s)
    }

    fn is_harmful(&self, meeting: &Meeting) -> bool {
        meeting.time_to_collision_s.is_some()
    }
}

/// Less than the gap between the ego's body and an object, by a centimetre or more: the gap of the circles around them.
fn least_gap_m(body: &Body, object: &Box3<Ego>) -> f64 {
    let (length_m, width_m) = (body.front_m + body.rear_m, body.left_m + body.right_m);
    let (x_m, y_m) = ((body.front_m - body.rear_m) / 2.0, (body.left_m - body.right_m) / 2.0);
    let center_m = (object.center.x() - x_m).hypot(object.center.y() - y_m);
    let reach_m = f64::midpoint(length_m.hypot(width_m), object.length_m.hypot(object.width_m));
    (center_m - reach_m) * (1.0 - 1e-9) - 0.01
}

/// Seconds until contact, 0 if the two overlap already; `None` if there is no contact within `horizon_s`.
///
/// `velocity_mps` is the object's over ground, in the ego's axes at the start. The ego may roll backwards.
fn time_to_collision_s(
    course: &Course,
    speed_mps: f64,
    body: &Body,
    object: &Box3<Ego>,
    velocity_mps: [f64; 2],
    horizon_s: f64,
) -> Result<Option<f64>, ZoneError> {
    let ego = body.corners();
    let fastest = ego.iter().map(|&corner| {
        let [x, y] = course.velocity_at(corner);
        x.hypot(y)
    });
    let closing_mps = speed_mps.abs() * fastest.fold(0.0, f64::max) + velocity_mps[0].hypot(velocity_mps[1]);
    if least_gap_m(body, object) > closing_mps * horizon_s * (1.0 + 1e-9) {
        return Ok(None);
    }
    let footprint = object.footprint();
    let mut time_s = 0.0;
    for _ in 0..MAX_STEPS {
        if !(time_s <= horizon_s) {
            return Ok(None);
        }
        let motion = course.motion(speed_mps * time_s);
        let ego_then = ego.map(|corner| motion.carry(corner));
        let object_then = footprint.map(|corner| Point2 {
            x_m: corner.x_m + velocity_mps[0] * time_s,
            y_m: corner.y_m + velocity_mps[1] * time_s,
        });
        let gap_m = convex_signed_distance_m(&ego_then, &object_then);
        if gap_m <= TOUCH_M {
            return Ok(Some(time_s));
        }
        // Both at rest: infinite, and the loop ends.
        time_s += gap_m / closing_mps;
    }
    Err(ZoneError::Closing { closing_mps, horizon_s })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::course::tests::course;
    use super::*;
    use crate::geometry::Point;

    const CAR: Body = Body { front_m: 3.6, rear_m: 0.8, left_m: 0.9, right_m: 0.9 };

    fn block(x_m: f64, y_m: f64, length_m: f64, width_m: f64) -> Box3<Ego> {
        Box3 { center: Point::new(x_m, y_m, 0.5), length_m, width_m, height_m: 1.0, yaw_rad: 0.0 }
    }

    fn ttc(speed: f64, steering: f64, object: &Box3<Ego>, velocity: [f64; 2]) -> Option<f64> {
        time_to_collision_s(&course(steering), speed, &CAR, object, velocity, 4.0).unwrap()
    }

    fn assert_near(found: Option<f64>, expected: f64) {
        assert!(
            found.is_some_and(|found| (found - expected).abs() < 0.015),
            "{found:?}, {expected} expected"
        );
    }

    #[test]
    fn straight_ahead_it_is_the_gap_over_the_closing_speed() {
        // The bumper is at 3.6 m, the object's near side at 23.6 m: 20 m.
        let car = block(25.6, 0.3, 4.0, 1.8);
        assert_near(ttc(10.0, 0.0, &car, [0.0, 0.0]), 2.0);
        assert_near(ttc(10.0, 0.0, &car, [-6.0, 0.0]), 1.25);
        assert_near(ttc(10.0, 0.0, &car, [2.0, 0.0]), 2.5);
        assert_eq!(ttc(10.0, 0.0, &car, [6.0, 0.0]), None, "5 s, beyond the horizon");
        assert_eq!(ttc(10.0, 0.0, &car, [10.0, 0.0]), None, "as fast as the ego");
    }

    #[test]
    fn a_pedestrian_who_steps_out_is_met_and_one_who_has_crossed_is_not() {
        // Side at 3 m; the body's side at 0.9 m: 2.1 m at 1.5 m/s are 1.4 s, and the body is there from 1 to 1.49 s.
        let child = block(13.8, 3.2, 0.4, 0.4);
        assert_near(ttc(10.0, 0.0, &child, [0.0, -1.5]), 1.4);
        assert_eq!(ttc(10.0, 0.0, &child, [0.0, 0.0]), None);
        assert_eq!(ttc(10.0, 0.0, &child, [0.0, -5.0]), None, "through before the ego comes");
    }

    #[test]
    fn contact_now_is_zero_and_two_at_rest_never_meet() {
        assert_eq!(ttc(0.0, 0.2, &block(3.5, 0.0, 1.0, 1.0), [0.0, 0.0]), Some(0.0));
        assert_eq!(ttc(0.0, 0.2, &block(6.0, 0.0, 1.0, 1.0), [0.0, 0.0]), None);
        assert_near(ttc(0.0, 0.0, &block(9.6, 0.0, 4.0, 1.0), [-2.0, 0.0]), 2.0);
        assert_near(ttc(-1.0, 0.0, &block(-3.3, 0.0, 1.0, 1.0), [0.0, 0.0]), 2.0);
    }

    #[test]
    fn in_a_turn_what_lies_on_the_arc_is_met_and_what_lies_ahead_is_not() {
        // Radius 13.3 m to the left; 20 m of arc are 1.5 rad: the rear axle is then at (13.3, 12.4).
        let on_the_arc = block(13.5, 13.5, 1.0, 1.0);
        assert!(ttc(6.0, 0.2, &on_the_arc, [0.0, 0.0]).is_some());
        assert_eq!(ttc(6.0, 0.2, &block(24.0, 0.0, 1.0, 1.0), [0.0, 0.0]), None);
        assert_eq!(ttc(6.0, 0.0, &on_the_arc, [0.0, 0.0]), None);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn the_circles_never_are_nearer_than_what_they_are_around(
            x in -30.0..30.0_f64, y in -30.0..30.0_f64, yaw in -3.0..3.0_f64, length in 0.1..12.0_f64,
        ) {
            let object = Box3 { yaw_rad: yaw, ..block(x, y, length, 1.5) };
            let gap_m = convex_signed_distance_m(&CAR.corners(), &object.footprint());
            prop_assert!(least_gap_m(&CAR, &object) < gap_m.max(0.0), "{}", gap_m);
        }

        /// Compares with small steps of time, which may miss a contact but never find a false one.
        #[test]
        fn it_is_the_first_contact_that_small_steps_find(
            speed in -2.0..15.0_f64, steering in -0.5..0.5_f64, x in 4.0..40.0_f64, y in -10.0..10.0_f64,
            yaw in -3.0..3.0_f64, vx in -8.0..8.0_f64, vy in -4.0..4.0_f64,
        ) {
            let object = Box3 { yaw_rad: yaw, ..block(x, y, 3.0, 1.6) };
            let found = ttc(speed, steering, &object, [vx, vy]);
            let course = course(steering);
            let gap = |time: f64| {
                let ego = CAR.corners().map(|corner| course.carry(corner, speed * time));
                let there = Box3 { center: Point::new(x + vx * time, y + vy * time, 0.5), ..object };
                convex_signed_distance_m(&ego, &there.footprint())
            };
            let stepped = (0..=4000).map(|i| f64::from(i) * 1e-3).find(|&time| gap(time) <= 0.0);
            match (found, stepped) {
                // The search ends 1 cm before contact, the steps up to a step after it.
                (Some(found), Some(stepped)) => {
                    prop_assert!(found <= stepped + 1e-9);
                    prop_assert!(gap(found) <= TOUCH_M + 1e-9);
                }
                (None, Some(stepped)) => prop_assert!(false, "steps met it at {stepped} s"),
                (Some(found), None) => prop_assert!(gap(found) <= TOUCH_M + 1e-9, "{found}"),
                (None, None) => {}
            }
        }
    }
}
