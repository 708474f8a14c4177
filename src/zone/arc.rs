//! The rectangle's depth and width along the circle that the ego drives.
//!
//! The zone is what a bar across the bumper, as wide as the rectangle, sweeps while the rear axle runs the rectangle's
//! depth along the arc of curvature `tan s / wheelbase`. An object is harmful when it shares enough area, or enough of itself.

use super::config::ZoneConfig;
use super::corridor::Corridor;
use super::course::Course;
use super::error::ZoneError;
use super::rule::{Meeting, MinOverlap, Seen, ZoneRule};
use crate::geometry::Point2;
use crate::sample::EgoState;

/// The corridor that the bar sweeps.
#[derive(Debug)]
pub(super) struct Arc {
    swept: Corridor,
    min_overlap: MinOverlap,
}

impl ZoneRule for Arc {
    fn at(config: &ZoneConfig, ego: &EgoState) -> Result<Self, ZoneError> {
        let course = Course::of(ego)?;
        let along_m = course.cut_m(config.depth_m(ego)?, config.max_turn_rad());
        let swept = Corridor::of_bar(&course, ego.front_bumper_x_m, config.width_m / 2.0, along_m)?;
        Ok(Self { swept, min_overlap: MinOverlap::of(config) })
    }

    fn describe(config: &ZoneConfig, speed_mps: f64) -> String {
        let depth_m = config.depth_at_m(speed_mps);
        format!("{depth_m:.1} m along the arc that is driven, {:.1} m wide", config.width_m)
    }

    fn outline(&self) -> &[Point2] {
        self.swept.outline()
    }

    fn overlap_m2(&self, object: &Seen) -> Result<f64, ZoneError> {
        Ok(object.shared_m2(&self.swept))
    }

    fn is_harmful(&self, meeting: &Meeting) -> bool {
        self.min_overlap.is_reached(meeting)
    }
}
