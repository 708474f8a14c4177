//! The paper's zone: a rectangle before the bumper, turned by the steering angle.
//!
//! `depth_m = time_gap_s * max(speed_mps, 0) + min_safe_distance_m`; it begins at the middle of the front bumper
//! `p0 = (front_bumper_x_m, 0)` and runs along `u = (cos s, sin s)`, `s` the steering angle, with `n = (-sin s, cos s)` to
//! its left (paper, section on the danger zone). An object is harmful when it shares enough area, or enough of itself.

use super::config::ZoneConfig;
use super::error::ZoneError;
use super::rule::{Meeting, MinOverlap, Seen, ZoneRule};
use crate::geometry::{Point2, convex_overlap_area};
use crate::sample::EgoState;

/// The rectangle.
#[derive(Debug)]
pub(super) struct Rect {
    corners: [Point2; 4],
    min_overlap: MinOverlap,
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
        Ok(Self { corners, min_overlap: MinOverlap::of(config) })
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
        // The box clips the zone, not the zone the box: so the zone's corners stay exact beside a vast box.
        Ok(convex_overlap_area(&self.corners, &object.footprint))
    }

    fn is_harmful(&self, meeting: &Meeting) -> bool {
        self.min_overlap.is_reached(meeting)
    }
}
