//! Where the ego goes if speed and steering stay as they are: the circle of the kinematic bicycle.
//!
//! The middle of the rear axle runs along an arc of curvature `k = tan(steering) / wheelbase` (kinematic bicycle model
//! without slip; Rajamani, Vehicle Dynamics and Control, 2012, section 2.2), and the body turns with it about the
//! arc's centre `(0, 1 / k)`. Metres, radians, ego frame of the start; left is positive.

use std::f64::consts::FRAC_PI_2;

use super::error::ZoneError;
use crate::geometry::Point2;
use crate::sample::EgoState;

/// The ego's arc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Course {
    pub curvature_per_m: f64,
    steering_angle_rad: f64,
}

impl Course {
    /// The course of a state whose numbers are finite.
    pub fn of(ego: &EgoState) -> Result<Self, ZoneError> {
        let (steering_angle_rad, wheelbase_m) = (ego.steering_angle_rad, ego.wheelbase_m);
        if !(wheelbase_m > 0.0) {
            return Err(ZoneError::StateNotPositive { field: "wheelbase_m", found: wheelbase_m });
        }
        if steering_angle_rad.abs() >= FRAC_PI_2 {
            return Err(ZoneError::Steering { found: steering_angle_rad });
        }
        Ok(Self { curvature_per_m: steering_angle_rad.tan() / wheelbase_m, steering_angle_rad })
    }

    /// The steering angle whose arc leads the rear axle through a point (pure pursuit; Coulter 1992).
    pub fn steering_towards_rad(ego: &EgoState, to: Point2) -> f64 {
        let squared = to.x_m * to.x_m + to.y_m * to.y_m;
        if squared > 0.0 { (ego.wheelbase_m * 2.0 * to.y_m / squared).atan() } else { 0.0 }
    }

    /// Carries a point of the body along the course: where it is when the rear axle has run `along_m`.
    pub fn carry(&self, point: Point2, along_m: f64) -> Point2 {
        self.motion(along_m).carry(point)
    }

    /// How the body has moved when the rear axle has run `along_m`.
    pub fn motion(&self, along_m: f64) -> Motion {
        let turn = self.curvature_per_m * along_m;
        let (sin, cos) = turn.sin_cos();
        // The rear axle's chord: sin(turn) / k and (1 - cos(turn)) / k, written so that a straight course is
        // not a special case.
        let (ahead_m, left_m) =
            (along_m * sin_over(turn), along_m * sin_over(turn / 2.0) * (turn / 2.0).sin());
        Motion { ahead_m, left_m, sin, cos }
    }

    /// How fast a point of the body runs for each m/s of the rear axle: x, y.
    pub fn velocity_at(&self, point: Point2) -> [f64; 2] {
        [1.0 - self.curvature_per_m * point.y_m, self.curvature_per_m * point.x_m]
    }

    /// The direction in which the course leads past a point, of length 1; straight ahead at the centre of the turn.
    pub fn direction_at(&self, point: Point2) -> [f64; 2] {
        let [x, y] = self.velocity_at(point);
        let length = x.hypot(y);
        if length > 1e-9 { [x / length, y / length] } else { [1.0, 0.0] }
    }

    /// Ends a way where the ego has turned by `max_turn_rad`.
    pub fn cut_m(&self, along_m: f64, max_turn_rad: f64) -> f64 {
        let turn_rad = self.curvature_per_m.abs() * along_m;
        if turn_rad > max_turn_rad { max_turn_rad / self.curvature_per_m.abs() } else { along_m }
    }

    /// How far the zone may reach towards the centre of the turn from the ego's axis, metres.
    pub fn room_inside_m(&self) -> f64 {
        self.radius_m() - CLEARANCE_M
    }

    /// Checks that a zone reaches less far than the centre of the turn.
    pub fn check_room(&self, inside_m: f64) -> Result<(), ZoneError> {
        if inside_m < self.room_inside_m() {
            return Ok(());
        }
        Err(ZoneError::Radius {
            steering_angle_rad: self.steering_angle_rad,
            radius_m: self.radius_m(),
            needed_m: inside_m + CLEARANCE_M,
        })
    }

    fn radius_m(&self) -> f64 {
        1.0 / self.curvature_per_m.abs()
    }
}

/// A turn of the body about the rear axle's middle, and where that has got to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Motion {
    ahead_m: f64,
    left_m: f64,
    sin: f64,
    cos: f64,
}

impl Motion {
    /// Where a point of the body is after it.
    pub fn carry(&self, point: Point2) -> Point2 {
        let Self { ahead_m, left_m, sin, cos } = self;
        Point2 {
            x_m: ahead_m + point.x_m * cos - point.y_m * sin,
            y_m: left_m + point.x_m * sin + point.y_m * cos,
        }
    }
}

/// Radius left free around the centre of the turn, where a swept bar would cross itself, metres.
const CLEARANCE_M: f64 = 0.2;

/// sin(x) / x.
fn sin_over(x: f64) -> f64 {
    if x.abs() < 1e-4 { 1.0 - x * x / 6.0 } else { x.sin() / x }
}

#[cfg(test)]
pub(super) mod tests {
    use proptest::prelude::*;

    use super::*;

    pub fn ego(speed_mps: f64, steering_angle_rad: f64) -> EgoState {
        EgoState {
            speed_mps,
            steering_angle_rad,
            yaw_rate_rps: 0.0,
            acceleration_mps2: 0.0,
            wheelbase_m: 2.7,
            front_bumper_x_m: 3.6,
        }
    }

    pub fn course(steering_angle_rad: f64) -> Course {
        Course::of(&ego(0.0, steering_angle_rad)).unwrap()
    }

    fn distance_m(a: Point2, b: Point2) -> f64 {
        (a.x_m - b.x_m).hypot(a.y_m - b.y_m)
    }

    const REAR_AXLE: Point2 = Point2 { x_m: 0.0, y_m: 0.0 };

    #[test]
    fn a_quarter_circle_ends_a_radius_ahead_and_a_radius_to_the_left() {
        // tan(45 degrees) = 1: the radius is the wheelbase.
        let course = course(std::f64::consts::FRAC_PI_4);
        let quarter_m = FRAC_PI_2 * 2.7;
        assert!(distance_m(course.carry(REAR_AXLE, quarter_m), Point2 { x_m: 2.7, y_m: 2.7 }) < 1e-12);
        // The bumper, 3.6 m before it, now looks along y.
        let bumper = course.carry(Point2 { x_m: 3.6, y_m: 0.0 }, quarter_m);
        assert!(distance_m(bumper, Point2 { x_m: 2.7, y_m: 6.3 }) < 1e-12);
    }

    #[test]
    fn offsets_at_25_metres_are_those_of_the_bicycle_and_not_of_a_turned_ray() {
        // A wheelbase of 2.588 m: 2.10 m at one degree, where a ray turned by the angle is 0.44 m off; 9.95 at five.
        for (deg, expected_m) in [(1.0f64, 2.103), (2.0, 4.177), (5.0, 9.950)] {
            let state = EgoState { wheelbase_m: 2.588, ..ego(0.0, deg.to_radians()) };
            let y_m = Course::of(&state).unwrap().carry(REAR_AXLE, 25.0).y_m;
            assert!((y_m - expected_m).abs() < 0.01, "{deg} degrees: {y_m}");
        }
    }

    #[test]
    fn wheels_at_a_right_angle_are_refused() {
        assert!(matches!(Course::of(&ego(1.0, FRAC_PI_2)), Err(ZoneError::Steering { .. })));
        let flat = EgoState { wheelbase_m: 0.0, ..ego(1.0, 0.1) };
        assert!(Course::of(&flat).unwrap_err().to_string().contains("wheelbase_m is 0"));
    }

    proptest! {
        /// The closed form against steps of the bicycle's differential equation (midpoint rule).
        #[test]
        fn the_arc_solves_the_bicycle_model(steering in -0.7..0.7_f64, along in 0.0..20.0_f64) {
            let (n, rate) = (4000, steering.tan() / 2.7);
            let step = along / f64::from(n);
            let (mut x, mut y, mut heading) = (0.0, 0.0, 0.0_f64);
            for _ in 0..n {
                let middle = heading + rate * step / 2.0;
                (x, y, heading) = (x + step * middle.cos(), y + step * middle.sin(), heading + rate * step);
            }
            let there = course(steering).carry(REAR_AXLE, along);
            prop_assert!(distance_m(there, Point2 { x_m: x, y_m: y }) < 1e-4, "{there:?}, {x} {y}");
        }

        #[test]
        fn the_steering_towards_a_point_leads_through_it(x in 5.0..40.0_f64, y in -4.0..4.0_f64) {
            let to = Point2 { x_m: x, y_m: y };
            let steered = course(Course::steering_towards_rad(&ego(0.0, 0.0), to));
            let nearest = (0..20_000)
                .map(|i| distance_m(steered.carry(REAR_AXLE, f64::from(i) * 0.005), to))
                .fold(f64::INFINITY, f64::min);
            prop_assert!(nearest < 0.01, "{nearest}");
        }

        #[test]
        fn directions_are_those_in_which_points_move(
            steering in -0.6..0.6_f64, x in -1.0..4.0_f64, y in -1.0..1.0_f64,
        ) {
            let (course, point) = (course(steering), Point2 { x_m: x, y_m: y });
            let later = course.carry(point, 1e-6);
            let [vx, vy] = course.velocity_at(point);
            let expected = Point2 { x_m: x + vx * 1e-6, y_m: y + vy * 1e-6 };
            prop_assert!(distance_m(later, expected) < 1e-10);
            let [dx, dy] = course.direction_at(point);
            prop_assert!((dx.hypot(dy) - 1.0).abs() < 1e-12 && (dx * vy - dy * vx).abs() < 1e-12);
        }
    }
}
