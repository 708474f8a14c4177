//! Everything that stands in a filled town: parked cars, the posts of lights, furnishings and props.

use rand::RngExt;

use super::ground::{GRASS_M, PAVEMENT_M};
use super::models::{Faces, Model};
use super::occupancy::Footprint;
use super::path::Vec2;
use super::populate::{Filler, TRAFFIC_LIGHT};
use super::surface::{Strip, StripKind};
use super::world::Motion;
use crate::object::Kind;
use crate::random::{self, Rng};

/// Least way from a parked vehicle to the pavement.
const FROM_KERB_M: f64 = 0.1;

/// How far a model reaches to the street from its origin, and where the middle of its foot is.
fn reach_to_street(model: &Model) -> (f64, f64) {
    if model.facts.faces == Faces::Traffic {
        return (model.width_m() / 2.0, f64::midpoint(model.solid[0].y, model.solid[1].y));
    }
    (model.overhang_m, f64::midpoint(model.solid[0].x, model.solid[1].x))
}

impl Filler<'_> {
    /// Parked cars: in parking lanes where the town has them, in driveways, loading bays and yards.
    pub(super) fn park(&mut self) {
        let mut rng = random::stream(self.seed, "parked", 0);
        let traffic = &self.town.config.traffic;
        let weights = if traffic.parked_weights.is_empty() {
            &traffic.vehicle_weights
        } else {
            &traffic.parked_weights
        };
        let share = traffic.parked_share * self.config.parked_density;
        for strip in self.town.surface.strips.iter().filter(|strip| strip.kind == StripKind::Parking) {
            let length_m = strip.center.length_m();
            let mut station_m = 10.0;
            while station_m < length_m - 10.0 {
                let at = strip.center.at(station_m);
                // Traffic on the right: a parking lane runs with the nearest driving lane.
                let yaw_rad = self.travel_heading(at) + 0.03 * (rng.random::<f64>() - 0.5);
                let model = self.draw_model(Kind::Vehicle, weights, &mut rng);
                let is_taken = rng.random::<f64>() < share;
                if let (true, Some(model), true) = (is_taken, model, self.is_near(at)) {
                    let (length_m, width_m) = (self.models[model].length_m(), self.models[model].width_m());
                    let ends = [-0.5, 0.5].map(|share| strip.width_at_m(station_m + share * length_m));
                    let is_small = length_m < traffic.parking_place_m + 0.3
                        && ends.iter().all(|&wide_m| wide_m > (width_m - 0.3).min(1.7));
                    let at = at + self.off_kerb(strip, station_m, model);
                    if is_small && self.claim(model, at, yaw_rad, 0.4) {
                        self.put(model, at, 0.0, yaw_rad, Motion::Still, &mut rng);
                    }
                }
                station_m += traffic.parking_place_m;
            }
        }
        for stand in &self.town.stands {
            let Footprint { center, yaw_rad, length_m, width_m } = stand.footprint;
            let model = self.draw_model(Kind::Vehicle, weights, &mut rng);
            let is_taken = rng.random::<f64>() < traffic.stand_share;
            let yaw_rad = yaw_rad + 0.05 * (rng.random::<f64>() - 0.5);
            if let (true, Some(model), true) = (is_taken, model, self.is_near(center)) {
                let model_fits = self.models[model].length_m() < length_m + 0.2
                    && self.models[model].width_m() < width_m + 0.2;
                if model_fits && self.claim(model, center, yaw_rad, 0.1) {
                    self.put(model, center, GRASS_M + 0.03, yaw_rad, Motion::Still, &mut rng);
                }
            }
        }
    }

    /// The way from a parking place's middle that keeps a vehicle off the pavement: one that is as wide as the place, or
    /// whose door stands open, reaches over the road.
    fn off_kerb(&self, strip: &Strip, station_m: f64, model: usize) -> Vec2 {
        let road_side = self.kerb_side(strip);
        let half_m = strip.width_at_m(station_m) / 2.0 - FROM_KERB_M;
        let bounds = &self.models[model].bounds;
        // The vehicle's right is at the kerb where traffic keeps right.
        let reach_m = if self.town.graph.kerb_sign() < 0.0 { -bounds[0].y } else { bounds[1].y };
        let middle = strip.center.at(station_m);
        strip.center.beside(station_m, road_side * (reach_m - half_m).max(0.0)) - middle
    }

    /// How far what is seen at a place lies over the ground there.
    pub(super) fn lift_m(&self, at: Vec2) -> f64 {
        self.town.surface.level_m(at) - self.town.surface.ground_m(at)
    }

    fn travel_heading(&self, point: Vec2) -> f64 {
        let lanes = &self.town.graph.lanes;
        let distance = |i: &usize| lanes[*i].path.distance_m(point);
        let nearest = (0..lanes.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        nearest.map_or(0.0, |i| {
            let path = &lanes[i].path;
            path.heading_rad(path.project(point, 0.0, path.length_m()).0)
        })
    }

    /// Which side of a pavement or a parking lane is towards the road: 1 left, -1 right.
    pub(super) fn kerb_side(&self, strip: &Strip) -> f64 {
        let middle_m = strip.center.length_m() / 2.0;
        let clearance =
            |left_m: f64| self.town.surface.road_grid.clearance_m(strip.center.beside(middle_m, left_m));
        if clearance(strip.width_m) < clearance(-strip.width_m) { 1.0 } else { -1.0 }
    }

    /// Props that belong to a place: the same in every episode, but for those that are left out.
    pub(super) fn place_furnishings(&mut self) {
        let mut rng = random::stream(self.seed, "furnishings", 0);
        let index_of = |name: &str| self.models.iter().position(|model| model.name == name);
        for furnishing in &self.town.furnishings {
            let is_wanted = rng.random::<f64>() < self.config.prop_density;
            let at = furnishing.position;
            if let (true, Some(model), true) = (is_wanted, index_of(&furnishing.model), self.is_near(at))
                && self.claim(model, at, furnishing.yaw_rad, 0.2)
            {
                self.put(model, at, self.lift_m(at), furnishing.yaw_rad, Motion::Still, &mut rng);
            }
        }
    }

    /// The posts of lights near the route: where the map has them, or beside the lanes if that is on
    /// the road. Returns the placements with their lights.
    pub(super) fn place_lights(&mut self) -> Vec<(usize, usize)> {
        let mut rng = random::stream(self.seed, "lights", 0);
        let town = self.town;
        let Some(model) = self.models.iter().position(|model| model.facts.category == TRAFFIC_LIGHT) else {
            return Vec::new();
        };
        let mut posts = Vec::new();
        for (i, light) in town.lights.lights.iter().enumerate() {
            let is_off_road = |point: &Vec2| town.surface.road_grid.clearance_m(*point) > 0.35;
            let beside = || {
                let (lane, stop_m) = *light.stops.first()?;
                let lane = &town.graph.lanes[lane];
                let shifts = (0..30).map(|n| lane.width_m / 2.0 + 0.5 * f64::from(n));
                shifts.map(|shift| lane.path.beside(stop_m, town.graph.kerb_sign() * shift)).find(is_off_road)
            };
            let Some(at) = Some(light.position).filter(is_off_road).or_else(beside) else { continue };
            if self.is_near(at) && self.claim(model, at, light.heading_rad, 0.05) {
                posts.push((self.placements.len(), i));
                self.put(model, at, self.lift_m(at), light.heading_rad, Motion::Still, &mut rng);
            }
        }
        posts
    }

    pub(super) fn place_props(&mut self) {
        let mut rng = random::stream(self.seed, "props", 0);
        let config = &self.town.config;
        if !self.town.surface.strips.iter().any(|strip| strip.kind == StripKind::Pavement) {
            self.place_props_on_verges(&mut rng);
            return;
        }
        for strip in self.town.surface.strips.iter().filter(|strip| strip.kind == StripKind::Pavement) {
            let side = self.kerb_side(strip);
            let mut station_m = 2.0 + 5.0 * rng.random::<f64>();
            while station_m < strip.center.length_m() - 2.0 {
                let Some(model) = self.draw_model(Kind::Static, &config.prop_weights, &mut rng) else {
                    return;
                };
                // Crowns keep off the street as far as the pavement is wide; a lamp's arm reaches over it.
                let (reach_m, middle_m) = reach_to_street(&self.models[model]);
                let widest_m = (strip.width_m - 0.7).max(config.prop_kerb_distance_m);
                let from_kerb_m = (reach_m + 0.15).max(config.prop_kerb_distance_m + middle_m).min(widest_m);
                let at = strip.center.beside(station_m, side * (strip.width_m / 2.0 - from_kerb_m));
                let yaw_rad = self.facing_rad(model, strip.center.heading_rad(station_m), side);
                if self.is_near(at) && self.claim(model, at, yaw_rad, 0.3) {
                    self.put(model, at, PAVEMENT_M, yaw_rad, Motion::Still, &mut rng);
                }
                let [low, high] = config.prop_spacing_m;
                station_m += (low + (high - low) * rng.random::<f64>()) / self.config.prop_density.max(0.01);
            }
        }
    }

    /// Heading of a model beside a street: towards the street, or towards the oncoming drivers.
    ///
    /// `street_side` is 1 where the street is to the left of the heading, else -1.
    fn facing_rad(&self, model: usize, heading_rad: f64, street_side: f64) -> f64 {
        if self.models[model].facts.faces == Faces::Street {
            return heading_rad + street_side * std::f64::consts::FRAC_PI_2;
        }
        // For a driver along the heading, this place is on the side away from the street.
        let they_come_along = street_side * self.town.graph.kerb_sign() < 0.0;
        heading_rad + if they_come_along { std::f64::consts::PI } else { 0.0 }
    }

    /// Props on the grass beside roads that have no pavement.
    fn place_props_on_verges(&mut self, rng: &mut Rng) {
        let config = &self.town.config;
        for strip in self.town.surface.strips.iter().filter(|strip| strip.kind == StripKind::Road) {
            for side in [-1.0, 1.0] {
                let [low, high] = config.prop_spacing_m;
                let mut station_m = 2.0 + 5.0 * rng.random::<f64>();
                while station_m < strip.center.length_m() - 2.0 {
                    let Some(model) = self.draw_model(Kind::Static, &config.prop_weights, rng) else {
                        return;
                    };
                    let (reach_m, middle_m) = reach_to_street(&self.models[model]);
                    let from_edge_m = reach_m.max(middle_m) + 0.4 + 0.8 * rng.random::<f64>();
                    let at = strip.center.beside(station_m, side * (strip.width_m / 2.0 + from_edge_m));
                    let yaw_rad = self.facing_rad(model, strip.center.heading_rad(station_m), -side);
                    let is_on_grass = self.town.surface.paved_grid.clearance_m(at) > from_edge_m - 0.3;
                    let is_clear = self.is_off_buildings(at);
                    if is_on_grass && is_clear && self.is_near(at) && self.claim(model, at, yaw_rad, 0.3) {
                        self.put(model, at, self.lift_m(at), yaw_rad, Motion::Still, rng);
                    }
                    station_m +=
                        (low + (high - low) * rng.random::<f64>()) / self.config.prop_density.max(0.01);
                }
            }
        }
    }

    fn is_off_buildings(&self, point: Vec2) -> bool {
        !self.town.buildings.iter().any(|building| building.footprint.grow(0.5).contains(point))
    }
}
