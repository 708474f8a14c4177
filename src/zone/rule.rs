//! The interface of a zone for one state of the ego.

use std::fmt::Debug;

use super::config::ZoneConfig;
use super::corridor::Corridor;
use super::course::Course;
use super::error::ZoneError;
use crate::geometry::{Box3, Ego, Point2};
use crate::sample::EgoState;

/// A zone at one instant. Speed, steering angle and bumper of the ego are finite, boxes are checked.
pub(super) trait ZoneRule: Debug + Send + Sync {
    /// The rule for one state of the ego.
    fn at(config: &ZoneConfig, ego: &EgoState) -> Result<Self, ZoneError>
    where
        Self: Sized;

    /// The zone in a few words, for a legend.
    fn describe(config: &ZoneConfig, speed_mps: f64) -> String
    where
        Self: Sized;

    /// The steering angle at which the zone leads to a point on the ground.
    fn steering_towards_rad(ego: &EgoState, to: Point2) -> f64
    where
        Self: Sized,
    {
        Course::steering_towards_rad(ego, to)
    }

    /// Counter-clockwise from the near right corner; where it is not convex, out along the right side and back along the
    /// left, equally many points on each.
    fn outline(&self) -> &[Point2];

    /// The outline, if it is convex and the distance to it says how near an object is to the other verdict.
    fn edge(&self) -> Option<&[Point2]> {
        None
    }

    /// Whether an object's velocity counts; if so, it is finite.
    fn uses_velocity(&self) -> bool {
        false
    }

    /// Area that an object shares with the zone, square metres.
    fn overlap_m2(&self, object: &Seen) -> Result<f64, ZoneError>;

    /// Seconds until contact, if the rule uses it and contact comes.
    fn time_to_collision_s(&self, _object: &Seen) -> Result<Option<f64>, ZoneError> {
        Ok(None)
    }

    /// Whether an object that meets the zone in this way is harmful.
    fn is_harmful(&self, meeting: &Meeting) -> bool;
}

/// An object as rules see it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen<'a> {
    pub box_in_ego: &'a Box3<Ego>,
    /// Velocity over ground, in the ego's axes.
    pub velocity_mps: [f64; 2],
}

impl Seen<'_> {
    /// What it covers of the ground.
    pub fn footprint(&self) -> [Point2; 4] {
        self.box_in_ego.footprint()
    }

    /// The area of that, square metres.
    pub fn area_m2(&self) -> f64 {
        self.box_in_ego.length_m * self.box_in_ego.width_m
    }

    /// Area shared with a corridor, square metres: not more than the object has, as the sum over a corridor of many
    /// kilometres may be.
    pub fn shared_m2(&self, corridor: &Corridor) -> f64 {
        corridor.overlap_m2(&self.footprint()).min(self.area_m2())
    }
}

/// How an object meets the zone.
#[derive(Debug, Clone, Copy)]
pub(super) struct Meeting {
    pub overlap_area_m2: f64,
    pub overlap_ratio: f64,
    pub time_to_collision_s: Option<f64>,
}

/// The overlap from which an object is harmful by `rect` and `arc`: either of the two is enough.
#[derive(Debug, Clone, Copy)]
pub(super) struct MinOverlap {
    area_m2: f64,
    ratio: f64,
}

impl MinOverlap {
    pub fn of(config: &ZoneConfig) -> Self {
        Self { area_m2: config.min_overlap_area_m2, ratio: config.min_overlap_ratio }
    }

    pub fn is_reached(self, meeting: &Meeting) -> bool {
        meeting.overlap_area_m2 >= self.area_m2 || meeting.overlap_ratio >= self.ratio
    }
}
