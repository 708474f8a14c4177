//! Free space for events in the surroundings: ways, places and the height of the ground there.

use super::ground::PAVEMENT_M;
use super::models::SOLID_M;
use super::occupancy::Footprint;
use super::path::Vec2;
use super::populate::Filler;
use super::world::{Motion, footprint_of};

impl Filler<'_> {
    /// Whether nothing tall stands within a metre of a straight way over the ground.
    pub(super) fn is_way_free(&self, from: Vec2, to: Vec2) -> bool {
        let way = to - from;
        let strip = Footprint::between(from, to, 1.2);
        let strip = Footprint { length_m: strip.length_m + 0.4, ..strip };
        let is_outdoors = (1..8).all(|i| self.is_outdoors(from + way * (f64::from(i) / 8.0)));
        is_outdoors
            && self.placements.iter().filter(|placement| matches!(placement.motion, Motion::Still)).all(
                |placement| {
                    let model = &self.models[placement.model];
                    let crown_m = model.length_m().max(model.width_m());
                    let body = if model.height_m() > SOLID_M {
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
                },
            )
    }

    fn is_outdoors(&self, point: Vec2) -> bool {
        self.town.is_land(point)
            && self.town.landmarks.iter().all(|landmark| !landmark.footprint.grow(0.3).contains(point))
            && self.town.buildings.iter().all(|building| !building.footprint.grow(0.3).contains(point))
    }

    /// Whether a place is outdoors, and wholly on the pavement or wholly off it.
    pub(super) fn is_open(&self, place: &Footprint) -> bool {
        let is_raised = self.is_pavement(place.center);
        let corners = place.grow(0.1).corners();
        self.is_outdoors(place.center)
            && corners.iter().all(|corner| self.is_pavement(Vec2::new(corner.x_m, corner.y_m)) == is_raised)
    }

    /// Height at which things that will move begin: on the pavement, or on the plane that they fall on.
    pub(super) fn level_m(&self, point: Vec2) -> f64 {
        let raised_m = if self.is_pavement(point) { PAVEMENT_M } else { 0.0 };
        self.town.surface.ground_m(point) + raised_m
    }

    fn is_pavement(&self, point: Vec2) -> bool {
        let surface = &self.town.surface;
        surface.road_grid.clearance_m(point) > 0.0 && surface.paved_grid.clearance_m(point) < 0.0
    }
}
