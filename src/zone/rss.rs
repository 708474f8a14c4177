//! Responsibility-Sensitive Safety: the distances that keep the ego from causing a collision.
//!
//! Shalev-Shwartz, Shammah, Shashua: On a Formal Model of Safe and Self-driving Cars, arXiv 1708.06374. With
//! `v' = v + rho a` the speed after the response time `rho`, and
//! `stop(v, rho, a, b) = (v + v') / 2 * rho + v'^2 / (2 b)` the way to a stop, the safe distances are
//!
//! - along, same direction: `max(0, stop(v_ego, rho, a_max, b_min) - v_other^2 / (2 b_max))`;
//! - along, opposite directions: `stop(v_ego, rho, a_max, b_min_correct) + stop(|v_other|, rho_other, a_max, b_min)`;
//! - aside: `mu + max(0, stop(u_ego, ..) + stop(u_other, ..))` with the lateral `a` and `b`, `u` the speed towards each
//!   other; one that still moves away after its response does not brake (as in Intel's ad-rss-lib).
//!
//! A situation is dangerous where both distances are too small. The ego's course takes the place of the
//! paper's lanes: along is along its arc, aside is across it, and the ego has no speed aside.

use super::config::{RssConfig, ZoneConfig};
use super::corridor::{Body, Corridor};
use super::course::Course;
use super::error::ZoneError;
use super::rule::{Meeting, Seen, ZoneRule};
use crate::geometry::Point2;
use crate::sample::EgoState;

/// Shared ground from which two shapes meet, square metres: above rounding.
const TOUCH_M2: f64 = 1e-6;

/// The ego, and the ground where a standing object is harmful.
#[derive(Debug)]
pub(super) struct Rss {
    standing: Corridor,
    needs: Needs,
}

impl ZoneRule for Rss {
    fn at(config: &ZoneConfig, ego: &EgoState) -> Result<Self, ZoneError> {
        let needs = Needs {
            course: Course::of(ego)?,
            body: config.body_of(ego),
            speed_mps: ego.speed_mps,
            config: config.rss,
            max_turn_rad: config.max_turn_rad(),
        };
        Ok(Self { standing: needs.corridor(0.0, 0.0)?, needs })
    }

    fn describe(_config: &ZoneConfig, _speed_mps: f64) -> String {
        "nearer than the safe distances; drawn for an object that stands".to_owned()
    }

    fn outline(&self) -> &[Point2] {
        self.standing.outline()
    }

    fn uses_velocity(&self) -> bool {
        true
    }

    /// Shared area with the ground for the object's own velocity.
    fn overlap_m2(&self, object: &Seen) -> Result<f64, ZoneError> {
        let center = object.box_in_ego.center;
        let at = Point2 { x_m: center.x(), y_m: center.y() };
        Ok(object.shared_m2(&self.needs.corridor_for(at, object.velocity_mps)?))
    }

    fn is_harmful(&self, meeting: &Meeting) -> bool {
        meeting.overlap_area_m2 > TOUCH_M2
    }
}

/// The facts about the ego that the distances need.
#[derive(Debug)]
struct Needs {
    course: Course,
    body: Body,
    speed_mps: f64,
    config: RssConfig,
    max_turn_rad: f64,
}

impl Needs {
    /// The ground nearer than both safe distances, for an object of this velocity in the course's directions.
    fn corridor(&self, along_mps: f64, leftward_mps: f64) -> Result<Corridor, ZoneError> {
        let Self { course, body, speed_mps, config, max_turn_rad } = self;
        let safe = SafeDistances::of(config, *speed_mps, along_mps, leftward_mps);
        if !safe.ahead_m.is_finite() {
            return Err(ZoneError::Depth { depth_m: safe.ahead_m, speed_mps: *speed_mps });
        }
        // Beyond the turn's centre there is no "aside"; the body itself must fit, or the corridor returns an
        // error.
        let room_m = course.room_inside_m() - 1e-9;
        let widen = |half_m: f64, by_m: f64, is_inside: bool| {
            if is_inside { f64::max(half_m, f64::min(half_m + by_m, room_m)) } else { half_m + by_m }
        };
        let turns_left = course.curvature_per_m >= 0.0;
        let wide = Body {
            left_m: widen(body.left_m, safe.left_m, turns_left),
            right_m: widen(body.right_m, safe.right_m, !turns_left),
            ..*body
        };
        Corridor::of_body(course, &wide, course.cut_m(safe.ahead_m, *max_turn_rad))
    }

    /// The same for an object at a place, with a velocity in the ego's axes.
    fn corridor_for(&self, at: Point2, [vx_mps, vy_mps]: [f64; 2]) -> Result<Corridor, ZoneError> {
        let [along_x, along_y] = self.course.direction_at(at);
        self.corridor(vx_mps * along_x + vy_mps * along_y, vy_mps * along_x - vx_mps * along_y)
    }
}

/// Distances to keep, metres: before the front bumper, and from the ego's sides to an object on the left or right.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::struct_field_names, reason = "units are part of names")]
struct SafeDistances {
    ahead_m: f64,
    left_m: f64,
    right_m: f64,
}

impl SafeDistances {
    /// The distances for an object that moves `along_mps` with the ego's course and `leftward_mps` across it.
    fn of(config: &RssConfig, ego_speed_mps: f64, along_mps: f64, leftward_mps: f64) -> Self {
        let ego_mps = ego_speed_mps.max(0.0);
        let ego_stop_m =
            |brake_mps2| stop_m(ego_mps, config.response_time_s, config.max_accel_mps2, brake_mps2);
        let ahead_m = if along_mps > -config.standing_speed_mps {
            let other_mps = along_mps.max(0.0);
            let other_stop_m = other_mps * other_mps / (2.0 * config.max_brake_mps2);
            f64::max(ego_stop_m(config.min_brake_mps2) - other_stop_m, 0.0)
        } else {
            let (response_s, accel) = (config.other_response_time_s, config.max_accel_mps2);
            ego_stop_m(config.min_brake_correct_mps2)
                + stop_m(-along_mps, response_s, accel, config.min_brake_mps2)
        };
        let (accel, brake) = (config.lateral_max_accel_mps2, config.lateral_min_brake_mps2);
        let ego_aside_m = stop_m(0.0, config.response_time_s, accel, brake);
        let aside_m = |towards_mps| {
            let other_m = stop_m(towards_mps, config.other_response_time_s, accel, brake);
            config.lateral_margin_m + f64::max(ego_aside_m + other_m, 0.0)
        };
        Self { ahead_m, left_m: aside_m(-leftward_mps), right_m: aside_m(leftward_mps) }
    }
}

/// The way to a stop: accelerating through the response time, then braking; negative while it leads away.
fn stop_m(speed_mps: f64, response_s: f64, accel_mps2: f64, brake_mps2: f64) -> f64 {
    let after_mps = speed_mps + response_s * accel_mps2;
    let responding_m = f64::midpoint(speed_mps, after_mps) * response_s;
    responding_m + after_mps.max(0.0).powi(2) / (2.0 * brake_mps2)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn safe(ego_kmh: f64, along_mps: f64, leftward_mps: f64) -> SafeDistances {
        SafeDistances::of(&RssConfig::default(), ego_kmh / 3.6, along_mps, leftward_mps)
    }

    #[test]
    fn before_a_standing_obstacle_it_is_response_and_braking() {
        // At 0: 1.75 m gained and 3.5 m/s to brake away at 4: 3.28 m. Then v + 1.75 + (v + 3.5)^2 / 8.
        for (kmh, expected_m) in [(0.0, 3.28), (20.0, 17.6), (30.0, 27.6), (50.0, 53.4), (70.0, 87.0)] {
            let found = safe(kmh, 0.0, 0.0).ahead_m;
            assert!((found - expected_m).abs() < 0.05, "{kmh} km/h: {found}");
        }
        assert_eq!(safe(-5.0, 0.0, 0.0), safe(0.0, 0.0, 0.0), "rolling back counts as standing");
    }

    #[test]
    fn one_that_drives_ahead_needs_less_and_one_that_comes_needs_much_more() {
        // 36 km/h: 10 + 1.75 + 13.5^2 / 8 = 34.53; the one ahead at 10 m/s brakes in 100 / 16 = 6.25.
        assert!((safe(36.0, 10.0, 0.0).ahead_m - (34.531_25 - 6.25)).abs() < 1e-9);
        assert_eq!(safe(36.0, 30.0, 0.0).ahead_m, 0.0, "it is gone before the ego can reach it");
        // Oncoming: 11.75 + 13.5^2 / 6 = 42.125, and of the other 20 + 7 + 17^2 / 8 = 63.125.
        assert!((safe(36.0, -10.0, 0.0).ahead_m - (42.125 + 63.125)).abs() < 1e-9);
        assert_eq!(safe(36.0, -0.4, 0.0), safe(36.0, 0.0, 0.0), "slower than `standing_speed_mps`");
    }

    #[test]
    fn aside_it_is_the_margin_and_what_both_may_drift() {
        // Ego: 0.1 + 0.2^2 / 1.6 = 0.125; the other in 2 s: 0.4 + 0.4^2 / 1.6 = 0.5.
        let standing = safe(36.0, 0.0, 0.0);
        assert!((standing.left_m - 0.725).abs() < 1e-12 && standing.left_m == standing.right_m);
        // To the right at 1.5 m/s: from the left 3.4 + 1.9^2 / 1.6 more, on the right it only leaves.
        let crossing = safe(36.0, 0.0, -1.5);
        assert!((crossing.left_m - (0.225 + 3.4 + 2.256_25)).abs() < 1e-9, "{crossing:?}");
        assert_eq!(crossing.right_m, 0.1);
    }

    #[test]
    fn stopping_ways_are_those_of_ad_rss_lib() {
        // `RssFormulaTestsCalculateDistanceAfterStatedBrakingPattern`, lateral, -10 m/s, 3.5 and 4 m/s²; theirs are whole metres.
        for (i, expected_m) in [-8.0, -13.0, -14.0, -10.0, 0.0, 18.0, 42.0, 72.0].into_iter().enumerate() {
            let found = stop_m(-10.0, (i + 1) as f64, 3.5, 4.0);
            assert!((found - expected_m).abs() <= 1.0, "{} s: {found}", i + 1);
        }
    }

    proptest! {
        /// Both drive as badly as the model lets them, in small steps of time; at the safe distance they do not meet.
        #[test]
        fn at_the_safe_distance_the_worst_case_ends_in_no_contact(
            ego in 0.0..25.0_f64, ahead in 0.0..25.0_f64,
        ) {
            let config = RssConfig::default();
            let mut gap = SafeDistances::of(&config, ego, ahead, 0.0).ahead_m;
            let start = gap;
            let (mut rear, mut front, mut least) = (ego, ahead, gap);
            for i in 0..40_000 {
                let (step, time) = (1e-3, f64::from(i) * 1e-3);
                let change = if time < config.response_time_s { config.max_accel_mps2 } else { -config.min_brake_mps2 };
                let (rear_next, front_next) =
                    ((rear + change * step).max(0.0), (front - config.max_brake_mps2 * step).max(0.0));
                gap += step * (f64::midpoint(front, front_next) - f64::midpoint(rear, rear_next));
                (rear, front, least) = (rear_next, front_next, least.min(gap));
            }
            prop_assert!(least > -0.05, "{least}");
            // And it is no longer than needed: they end bumper to bumper.
            prop_assert!(start == 0.0 || gap < 0.05, "{gap}");
        }

        #[test]
        fn more_speed_of_the_ego_never_needs_less(
            ego in 0.0..25.0_f64, more in 0.0..10.0_f64, along in -15.0..15.0_f64, aside in -3.0..3.0_f64,
        ) {
            let of = |speed| SafeDistances::of(&RssConfig::default(), speed, along, aside);
            prop_assert!(of(ego + more).ahead_m >= of(ego).ahead_m);
            prop_assert!(of(ego).left_m >= 0.1 && of(ego).right_m >= 0.1);
        }
    }
}
