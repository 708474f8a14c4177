//! Ways past what stands on the road: for the ego, and for everybody else.

use crate::scene::car::EGO_WIDTH_M;
use crate::scene::occupancy::Footprint;
use crate::scene::path::{Path, Vec2};
use crate::scene::populate::Filler;
use crate::scene::route::Route;
use crate::scene::swerve;

/// Least distance between two things on the ego's way.
pub(super) const APART_M: f64 = 13.0;
/// Half of a car and the room that its driver keeps.
pub(super) const HALF_WAY_M: f64 = EGO_WIDTH_M / 2.0 + 0.4;
/// Offsets within the lane, in the steps that drivers try.
const WITHIN: [i32; 2] = [-3, 3];
/// How far something may reach over the line between two lanes, metres.
const OVER_LINE_M: f64 = 0.15;

/// Whether the ego meets a place if it keeps to the middle of its lane.
pub(super) fn is_on_way(route: &Route, plan: &Footprint) -> bool {
    route.path.distance_m(plan.center) < plan.radius_m() + HALF_WAY_M
}

impl Filler<'_> {
    /// Whether all can pass a thing on the road, and nothing else on the ego's way is near.
    ///
    /// All keep to their lanes; round a thing that may block its lane, the ego may leave it.
    pub(super) fn leaves_ways(&self, route: &Route, plan: &Footprint, may_block: bool) -> bool {
        let surface = &self.town.surface;
        if surface.road_grid.clearance_m(plan.center) > plan.radius_m() {
            return true;
        }
        let mut own = None;
        if is_on_way(route, plan) {
            if self.on_way.iter().any(|other| (other - plan.center).norm() < APART_M) {
                return false;
            }
            let path = &route.path;
            let lane = route.span_at(path.project(plan.center, 0.0, path.length_m()).0).lane;
            let is_free = if may_block {
                own = Some(lane);
                let line_m = -self.town.graph.kerb_sign() * self.town.graph.lanes[lane].width_m / 2.0;
                self.has_pass(path, plan, swerve::STEPS, Some(line_m))
            } else {
                self.has_pass(path, plan, WITHIN, None)
            };
            if !is_free {
                return false;
            }
        }
        let lanes = self.town.graph.lanes.iter().enumerate();
        let reach_m = plan.radius_m() + HALF_WAY_M;
        let met = lanes.filter(|(i, lane)| Some(*i) != own && lane.path.distance_m(plan.center) < reach_m);
        met.map(|(_, lane)| &lane.path).all(|path| self.has_pass(path, plan, WITHIN, None))
    }

    /// Whether a car on a path can pass at one of the offsets; nothing may reach over the line.
    fn has_pass(&self, path: &Path, plan: &Footprint, [first, last]: [i32; 2], line_m: Option<f64>) -> bool {
        let (station_m, _) = path.project(plan.center, 0.0, path.length_m());
        let (mut low_m, mut high_m) = (f64::INFINITY, f64::NEG_INFINITY);
        for corner in plan.corners() {
            let at = Vec2::new(corner.x_m, corner.y_m);
            let (_, left_m) = path.project(at, station_m - 6.0, station_m + 6.0);
            (low_m, high_m) = (low_m.min(left_m), high_m.max(left_m));
        }
        if line_m.is_some_and(|line_m| low_m < line_m - OVER_LINE_M && high_m > line_m + OVER_LINE_M) {
            return false;
        }
        let mirror = -self.town.graph.kerb_sign();
        let is_road =
            |left_m: f64| self.town.surface.road_grid.clearance_m(path.beside(station_m, left_m)) < 0.1;
        (first..=last).map(|i| mirror * swerve::STEP_M * f64::from(i)).any(|left_m| {
            (left_m + HALF_WAY_M < low_m || left_m - HALF_WAY_M > high_m)
                && is_road(left_m - EGO_WIDTH_M / 2.0)
                && is_road(left_m + EGO_WIDTH_M / 2.0)
        })
    }
}
