//! Free space for events in the surroundings: ways, places and the height of the ground there.

use super::ground::PAVEMENT_M;
use super::models::SOLID_M;
use super::occupancy::Footprint;
use super::path::Vec2;
use super::populate::Filler;
use super::world::{Motion, Placement, footprint_of};

impl Filler<'_> {
    /// Whether nothing tall stands within a metre of a straight way over the ground.
    pub(super) fn is_way_free(&self, from: Vec2, to: Vec2) -> bool {
        let way = to - from;
        let strip = Footprint::between(from, to, 1.2);
        let strip = Footprint { length_m: strip.length_m + 0.4, ..strip };
        let is_outdoors = (1..8).all(|i| self.is_outdoors(from + way * (f64::from(i) / 8.0)));
        is_outdoors
            && self.placements.iter().filter(|placement| self.is_in_the_way(placement)).all(|placement| {
                let model = &self.models[placement.model];
                let crown_m = model.length_m().max(model.width_m());
                let body = if model.height_m() > SOLID_M || matches!(placement.motion, Motion::Loose(_)) {
                    Footprint {
                        center: placement.position,
                        yaw_rad: placement.yaw_rad,
                        length_m: crown_m,
                        width_m: crown_m,
                    }
                } else {
                    footprint_of(model, placement.position, placement.yaw_rad)
                };
                !strip.meets(&body)
            })
    }

    /// Whether it stands on the ground, if only until its event.
    fn is_in_the_way(&self, placement: &Placement) -> bool {
        match &placement.motion {
            Motion::Still => true,
            Motion::Loose(loose) => {
                let at = loose.world_from_model.translation.vector;
                at.z - self.town.surface.ground_m(at.xy()) < SOLID_M
            }
            _ => false,
        }
    }

    /// Whether something that rolls along a straight way meets nothing tall or low, and no step up to a pavement.
    pub(super) fn is_ground_free(&self, from: Vec2, to: Vec2) -> bool {
        let way = to - from;
        let strip = Footprint::between(from, to, 1.2);
        let n = (way.norm() / 0.2).ceil();
        let is_raised: Vec<bool> =
            (0..=n as usize).map(|i| self.is_pavement(from + way * (i as f64 / n))).collect();
        let reach_m = strip.radius_m();
        let lines = self.town.lines_where(|at, half_m| (at - strip.center).norm() < reach_m + half_m);
        self.is_way_free(from, to)
            && is_raised.is_sorted_by(|before, after| before >= after)
            && !lines.iter().any(|line| line.footprint.meets(&strip))
    }

    fn is_outdoors(&self, point: Vec2) -> bool {
        let landmarks = self.town.landmarks.iter().map(|landmark| landmark.footprint);
        let buildings = self.town.buildings.iter().map(|building| building.footprint);
        let blocks = self.town.blocks().map(|block| block.footprint);
        self.town.is_land(point)
            && landmarks.chain(buildings).chain(blocks).all(|block| !block.grow(0.3).contains(point))
    }

    /// Whether a place is outdoors, and wholly on the pavement or wholly off it.
    pub(super) fn is_open(&self, place: &Footprint) -> bool {
        let is_raised = self.is_pavement(place.center);
        let corners = place.grow(0.1).corners();
        self.is_outdoors(place.center)
            && corners.iter().all(|corner| self.is_pavement(Vec2::new(corner.x_m, corner.y_m)) == is_raised)
    }

    /// Height at which things that will move begin: on the pavement, or on the plane that they fall on.
    pub(super) fn start_level_m(&self, point: Vec2) -> f64 {
        let raised_m = if self.is_pavement(point) { PAVEMENT_M } else { 0.0 };
        self.town.surface.ground_m(point) + raised_m
    }

    fn is_pavement(&self, point: Vec2) -> bool {
        let surface = &self.town.surface;
        surface.road_grid.clearance_m(point) > 0.0 && surface.paved_grid.clearance_m(point) < 0.0
    }
}
