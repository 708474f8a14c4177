//! The paper's zone: a rectangle before the bumper, turned by the steering angle.
//!
//! `depth_m = time_gap_s * max(speed_mps, 0) + min_safe_distance_m`; it begins at the middle of the front bumper
//! `p0 = (front_bumper_x_m, 0)` and runs along `u = (cos s, sin s)`, `s` the steering angle, with `n = (-sin s, cos s)` to
//! its left (paper, section on the danger zone). An object is harmful when it shares enough area, or enough of itself.

use super::config::ZoneConfig;
use super::error::ZoneError;
use super::rule::{Meeting, MinOverlap, Seen, ZoneRule};
use crate::geometry::{Box3, Ego, Point2, convex_overlap_area};
use crate::sample::EgoState;

/// The rectangle.
#[derive(Debug)]
pub(super) struct Rect {
    corners: [Point2; 4],
    /// Of the axis, from the bumper's middle.
    bumper_x_m: f64,
    sin: f64,
    cos: f64,
    depth_m: f64,
    half_width_m: f64,
    min_overlap: MinOverlap,
}

/// From this gap on no rounding of [`convex_overlap_area`] makes an overlap, for boxes of [`ORDINARY_M`], metres.
const CLEAR_M: f64 = 0.01;

/// Sizes, and distances from the ego, of boxes whose corners are exact to far less than [`CLEAR_M`], metres.
const ORDINARY_M: std::ops::RangeInclusive<f64> = 1e-3..=1e4;

impl Rect {
    /// How far a point lies beyond the sides and beyond the ends, metres; negative within.
    fn beyond_m(&self, x_m: f64, y_m: f64) -> f64 {
        let x_m = x_m - self.bumper_x_m;
        let (along_m, left_m) = (x_m * self.cos + y_m * self.sin, y_m * self.cos - x_m * self.sin);
        (left_m.abs() - self.half_width_m).max(-along_m).max(along_m - self.depth_m)
    }

    /// Whether a box lies so far from the zone that the overlap is zero, by the circle around its footprint.
    fn is_clear_of(&self, of: &Box3<Ego>) -> bool {
        let (length_m, width_m) = (of.length_m, of.width_m);
        let (x_m, y_m) = (of.center.x(), of.center.y());
        let beyond_m = self.beyond_m(x_m, y_m) - CLEAR_M;
        let is_apart = beyond_m > 0.0 && 4.0 * beyond_m * beyond_m > length_m * length_m + width_m * width_m;
        let least_m = length_m.min(width_m).min(self.half_width_m).min(self.depth_m);
        let most_m = length_m.max(width_m).max(self.half_width_m).max(self.depth_m);
        let most_m = most_m.max(x_m.abs()).max(y_m.abs()).max(self.bumper_x_m);
        is_apart && ORDINARY_M.contains(&least_m) && ORDINARY_M.contains(&most_m)
    }
}

impl ZoneRule for Rect {
    fn at(config: &ZoneConfig, ego: &EgoState) -> Result<Self, ZoneError> {
        let (depth_m, half_width_m) = (config.depth_m(ego)?, config.width_m / 2.0);
        let (sin, cos) = ego.steering_angle_rad.sin_cos();
        let corner = |along_m: f64, left_m: f64| Point2 {
            x_m: ego.front_bumper_x_m + along_m * cos - left_m * sin,
            y_m: along_m * sin + left_m * cos,
        };
        let corners = [
            corner(0.0, -half_width_m),
            corner(depth_m, -half_width_m),
            corner(depth_m, half_width_m),
            corner(0.0, half_width_m),
        ];
        let bumper_x_m = ego.front_bumper_x_m;
        Ok(Self { corners, bumper_x_m, sin, cos, depth_m, half_width_m, min_overlap: MinOverlap::of(config) })
    }

    fn describe(config: &ZoneConfig, speed_mps: f64) -> String {
        let depth_m = config.depth_at_m(speed_mps);
        format!("{depth_m:.1} m deep, {:.1} m wide, turned by the steering angle", config.width_m)
    }

    fn steering_towards_rad(ego: &EgoState, to: Point2) -> f64 {
        to.y_m.atan2(to.x_m - ego.front_bumper_x_m)
    }

    fn outline(&self) -> &[Point2] {
        &self.corners
    }

    fn edge(&self) -> Option<&[Point2]> {
        Some(&self.corners)
    }

    fn overlap_m2(&self, object: &Seen) -> Result<f64, ZoneError> {
        if self.is_clear_of(object.box_in_ego) {
            return Ok(0.0);
        }
        // The box clips the zone, not the zone the box: so the zone's corners stay exact beside a vast box.
        Ok(convex_overlap_area(&self.corners, &object.footprint()))
    }

    fn is_harmful(&self, meeting: &Meeting) -> bool {
        self.min_overlap.is_reached(meeting)
    }
}
