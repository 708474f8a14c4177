//! The ground that the ego sweeps along its course, as a chain of convex pieces.
//!
//! A bar fixed to the body moves along the course; between two of its places lies a convex quadrangle. The bar's ends
//! run on circles about the centre of the turn, at different radii, so the pieces share no ground up to a full turn.
//! Arcs become chords that deviate from them by at most [`CHORD_M`]. Metres, ego frame.

use super::course::Course;
use super::error::ZoneError;
use crate::geometry::{Point2, convex_overlap_area};

/// Largest distance of a chord from its arc, metres.
const CHORD_M: f64 = 0.005;

/// Most places of a bar along its course: a bend of tens of kilometres has fewer.
const MAX_STEPS: f64 = 100_000.0;

/// A body's extent from the rear axle's middle: to the front, rear, left and right, all positive, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::struct_field_names, reason = "units are part of names")]
pub(super) struct Body {
    pub front_m: f64,
    pub rear_m: f64,
    pub left_m: f64,
    pub right_m: f64,
}

impl Body {
    /// Corners counter-clockwise from the front left one.
    pub fn corners(&self) -> [Point2; 4] {
        [
            point(self.front_m, self.left_m),
            point(-self.rear_m, self.left_m),
            point(-self.rear_m, -self.right_m),
            point(self.front_m, -self.right_m),
        ]
    }
}

/// Swept ground.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Corridor {
    /// Out along the right side, back along the left; equally many points on each.
    outline: Vec<Point2>,
}

impl Corridor {
    /// The ground that a bar across the front bumper sweeps; its area is the bar's width times the way, less
    /// what the chords cut off.
    pub fn of_bar(course: &Course, front_m: f64, half_width_m: f64, along_m: f64) -> Result<Self, ZoneError> {
        course.check_room(half_width_m)?;
        let (right, left) = (point(front_m, -half_width_m), point(front_m, half_width_m));
        Ok(Self::between(sweep(course, [right, left], along_m)?))
    }

    /// The ground that the whole body sweeps, its place at the start included. Left out: the few centimetres
    /// by which the rear corner swings out beside the rear axle.
    pub fn of_body(course: &Course, body: &Body, along_m: f64) -> Result<Self, ZoneError> {
        let turns_left = course.curvature_per_m >= 0.0;
        course.check_room(if turns_left { body.left_m } else { body.right_m })?;
        // Inside, the rear axle's end comes nearest to the centre of the turn; outside, the front corner goes farthest.
        let (right_x_m, left_x_m) = if turns_left { (body.front_m, 0.0) } else { (0.0, body.front_m) };
        let bar = [point(right_x_m, -body.right_m), point(left_x_m, body.left_m)];
        let (mut right, mut left) =
            (vec![point(-body.rear_m, -body.right_m)], vec![point(-body.rear_m, body.left_m)]);
        let (out, back) = sweep(course, bar, along_m)?;
        right.extend(out);
        left.extend(back);
        // The triangle between the bar's last place and the front edge there.
        let front = [point(body.front_m, -body.right_m), point(body.front_m, body.left_m)];
        let [front_right, front_left] = front.map(|corner| course.carry(corner, along_m));
        let middle = point(
            f64::midpoint(front_right.x_m, front_left.x_m),
            f64::midpoint(front_right.y_m, front_left.y_m),
        );
        right.push(if turns_left { middle } else { front_right });
        left.push(if turns_left { front_left } else { middle });
        Ok(Self::between((right, left)))
    }

    fn between((mut right, left): (Vec<Point2>, Vec<Point2>)) -> Self {
        right.extend(left.into_iter().rev());
        Self { outline: right }
    }

    /// Corners, counter-clockwise from the near right one; not convex where the course bends.
    pub fn outline(&self) -> &[Point2] {
        &self.outline
    }

    /// Area shared with a convex footprint, square metres.
    pub fn overlap_m2(&self, footprint: &[Point2; 4]) -> f64 {
        let (n, around) = (self.outline.len(), Bounds::of(footprint));
        let n_pieces = if Bounds::of(&self.outline).meets(&around) { n / 2 - 1 } else { 0 };
        let pieces =
            (0..n_pieces).map(|i| [i, i + 1, n - 2 - i, n - 1 - i].map(|corner| self.outline[corner]));
        pieces
            .filter(|piece| Bounds::of(piece).meets(&around))
            .map(|piece| convex_overlap_area(&piece, footprint))
            .sum()
    }
}

/// Places of a bar's ends, right and left, along the course.
fn sweep(course: &Course, bar: [Point2; 2], along_m: f64) -> Result<(Vec<Point2>, Vec<Point2>), ZoneError> {
    let fastest = bar.map(|end| {
        let [x, y] = course.velocity_at(end);
        x.hypot(y)
    });
    // A chord of a circle of radius r over an angle d deviates from it by r d² / 8; here k r is `fastest` and
    // d = k * step.
    let bend = course.curvature_per_m.abs() * f64::max(fastest[0], fastest[1]);
    let n_steps = (along_m * (bend / (8.0 * CHORD_M)).sqrt()).ceil();
    if !(n_steps <= MAX_STEPS) {
        return Err(ZoneError::Bend { along_m, curvature_per_m: course.curvature_per_m });
    }
    let n_steps = (n_steps as usize).max(1);
    let motion = |i: usize| course.motion(along_m * i as f64 / n_steps as f64);
    Ok((0..=n_steps).map(motion).map(|motion| (motion.carry(bar[0]), motion.carry(bar[1]))).unzip())
}

/// The rectangle along the axes around some points.
struct Bounds {
    low: [f64; 2],
    high: [f64; 2],
}

impl Bounds {
    fn of(points: &[Point2]) -> Self {
        let none = Self { low: [f64::INFINITY; 2], high: [f64::NEG_INFINITY; 2] };
        points.iter().map(|point| [point.x_m, point.y_m]).fold(none, |Self { low, high }, point| Self {
            low: [low[0].min(point[0]), low[1].min(point[1])],
            high: [high[0].max(point[0]), high[1].max(point[1])],
        })
    }

    fn meets(&self, other: &Self) -> bool {
        (0..2).all(|axis| self.low[axis] <= other.high[axis] && other.low[axis] <= self.high[axis])
    }
}

fn point(x_m: f64, y_m: f64) -> Point2 {
    Point2 { x_m, y_m }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_4;

    use proptest::prelude::*;

    use super::super::course::tests::course;
    use super::*;
    use crate::geometry::polygon_area;

    const CAR: Body = Body { front_m: 3.6, rear_m: 0.8, left_m: 0.9, right_m: 0.9 };

    fn square(x_m: f64, y_m: f64, side_m: f64) -> [Point2; 4] {
        Body { front_m: side_m, rear_m: 0.0, left_m: side_m, right_m: 0.0 }
            .corners()
            .map(|corner| point(corner.x_m + x_m, corner.y_m + y_m))
    }

    #[test]
    fn straight_on_both_are_rectangles() {
        let bar = Corridor::of_bar(&course(0.0), 3.6, 1.75, 25.0).unwrap();
        let corners: Vec<(f64, f64)> = bar.outline().iter().map(|corner| (corner.x_m, corner.y_m)).collect();
        assert_eq!(corners, [(3.6, -1.75), (28.6, -1.75), (28.6, 1.75), (3.6, 1.75)]);
        let body = Corridor::of_body(&course(0.0), &CAR, 10.0).unwrap();
        // From -0.8 to 13.6 m.
        assert!((polygon_area(body.outline()) - 14.4 * 1.8).abs() < 1e-9);
        assert!((body.overlap_m2(&square(-5.0, -5.0, 30.0)) - 14.4 * 1.8).abs() < 1e-9);
    }

    #[test]
    fn a_quarter_turn_reaches_the_ground_to_the_left_and_not_ahead() {
        // The radius is 2.7 m, the centre (0, 2.7); the bumper's ends run on circles of 3.72 and 5.73 m about it.
        let bar = Corridor::of_bar(&course(FRAC_PI_4), 3.6, 1.75, std::f64::consts::FRAC_PI_2 * 2.7).unwrap();
        assert!((bar.overlap_m2(&square(4.0, 3.5, 0.5)) - 0.25).abs() < 1e-9, "4.1 to 4.7 m from the centre");
        assert_eq!(bar.overlap_m2(&square(0.0, 2.5, 0.5)), 0.0, "the centre of the turn");
        assert_eq!(bar.overlap_m2(&square(8.0, -0.5, 1.0)), 0.0, "straight ahead");
    }

    #[test]
    fn a_zone_wider_than_the_turn_is_refused() {
        let error = Corridor::of_bar(&course(FRAC_PI_4), 3.6, 2.6, 5.0).unwrap_err();
        assert!(error.to_string().contains("radius of 2.7"), "{error}");
    }

    /// Whether the body covers a point somewhere on the way, by trying many places.
    fn is_swept(body: &Body, steering: f64, along_m: f64, at: Point2) -> bool {
        let course = course(steering);
        (0..=2000).any(|i| {
            let along_m = along_m * f64::from(i) / 2000.0;
            let corners = body.corners().map(|corner| course.carry(corner, along_m));
            crate::geometry::distance_to_convex_m(at, &corners) <= 0.0
        })
    }

    proptest! {
        #[test]
        fn a_bar_sweeps_its_width_times_the_way(steering in -0.6..0.6_f64, along in 0.1..12.0_f64) {
            // At most 3.1 rad of turn.
            let bar = Corridor::of_bar(&course(steering), 3.6, 1.75, along).unwrap();
            let (exact, found) = (3.5 * along, polygon_area(bar.outline()));
            prop_assert!((exact - found).abs() < CHORD_M * 2.0 * along + 1e-9, "{exact} {found}");
            let all = bar.overlap_m2(&square(-50.0, -50.0, 100.0));
            prop_assert!((all - found).abs() < 1e-9, "the pieces share no ground: {all} {found}");
        }

        #[test]
        fn a_body_sweeps_what_its_places_cover(
            steering in -0.6..0.6_f64, along in 0.1..9.0_f64, x in 0.0..12.0_f64, y in -8.0..8.0_f64,
        ) {
            let corridor = Corridor::of_body(&course(steering), &CAR, along).unwrap();
            // A tile so small that it is in or out; at the edge it may be in part.
            let share = corridor.overlap_m2(&square(x - 1e-3, y - 1e-3, 2e-3)) / 4e-6;
            let (wide, narrow) = (
                Body { left_m: 0.91, right_m: 0.91, front_m: 3.61, ..CAR },
                Body { left_m: 0.89, right_m: 0.89, front_m: 3.59, rear_m: 0.0 },
            );
            let at = point(x, y);
            if is_swept(&narrow, steering, along, at) {
                prop_assert!(share > 0.999, "{share}");
            }
            // Without the overhang, whose swing is left out.
            let is_near = is_swept(&Body { rear_m: 0.0, ..wide }, steering, along, at)
                || crate::geometry::distance_to_convex_m(at, &wide.corners()) <= 0.0;
            if !is_near {
                prop_assert!(share < 0.001, "{share}");
            }
        }

        #[test]
        fn left_and_right_turns_are_mirror_images(
            steering in 0.0..0.6_f64, along in 0.1..9.0_f64, x in -2.0..12.0_f64, y in -8.0..8.0_f64,
        ) {
            let of = |steering: f64| Corridor::of_body(&course(steering), &CAR, along).unwrap();
            let (left, right) = (of(steering).overlap_m2(&square(x, y, 0.7)), of(-steering).overlap_m2(&square(x, -y - 0.7, 0.7)));
            prop_assert!((left - right).abs() < 1e-9);
        }
    }
}
