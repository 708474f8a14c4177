//! Puts out-of-distribution objects where they matter: in the lane, at junctions, in bends, on crossings, beside the road.
//!
//! What stands on the ego's way always leaves it a way round.

#[cfg(test)]
mod tests;
mod ways;

use rand::RngExt;

use self::ways::is_on_way;
use crate::object::Spot;
use crate::random::{self, Rng};
use crate::scene::models::Bounds;
use crate::scene::occupancy::Footprint;
use crate::scene::path::Vec2;
use crate::scene::populate::Filler;
use crate::scene::route::Route;
use crate::scene::tilt::Tilt;
use crate::scene::unfamiliar::strange;
use crate::scene::world::{Motion, plan_of};

/// Nothing stands nearer than this to the route's start.
const START_M: f64 = 22.0;
/// Beside the road means away from junctions, metres from the lane's ends.
const FROM_JUNCTION_M: f64 = 7.0;
/// A junction reaches this far into its roads.
const MOUTH_M: f64 = 8.0;
/// Bends are sharper than this radius, metres.
const BEND_RADIUS_M: f64 = 60.0;
/// Crossings within this distance of the route count.
const CROSSING_M: f64 = 5.0;
/// Share of the things in the lane that take a part of it only.
const PARTLY_SHARE: f64 = 0.75;
const TRIES: usize = 20;

/// A thing ready to be set down.
pub(super) struct Thing {
    pub model: usize,
    pub tilt: Option<Tilt>,
    pub yaw_rad: f64,
    pub bounds: Bounds,
}

impl Thing {
    /// Its ground plan, and the model's origin when the plan's centre lies at a place.
    pub fn plan_at(&self, center: Vec2) -> (Footprint, Vec2) {
        let about_origin = plan_of(&self.bounds, Vec2::zeros(), self.yaw_rad);
        (Footprint { center, ..about_origin }, center - about_origin.center)
    }

    pub fn radius_m(&self) -> f64 {
        plan_of(&self.bounds, Vec2::zeros(), 0.0).radius_m()
    }
}

/// What is left to place once the rest of the world stands.
#[derive(Default)]
pub(super) struct Reserved {
    /// Stations for events.
    pub events_m: Vec<f64>,
    pub n_behind: usize,
}

/// Places of the route that count as more than a straight road.
struct Places {
    /// Start and end of each way through a junction.
    junctions: Vec<(f64, f64)>,
    bends_m: Vec<f64>,
    crossings: Vec<Footprint>,
}

impl Places {
    fn of(route: &Route, filler: &Filler) -> Self {
        let graph = &filler.town.graph;
        let is_junction = |station_m| graph.lanes[route.span_at(station_m).lane].junction.is_some();
        let mut junctions: Vec<(f64, f64)> = Vec::new();
        for span in route.spans.iter().filter(|span| graph.lanes[span.lane].junction.is_some()) {
            match junctions.last_mut() {
                Some(last) if span.start_m < last.1 + 1.0 => last.1 = span.end_m,
                _ => junctions.push((span.start_m, span.end_m)),
            }
        }
        junctions.retain(|&(start_m, _)| start_m > START_M);
        let n = ((route.path.length_m() - START_M) / 2.0).max(0.0) as usize;
        let stations = (0..n).map(|i| START_M + 2.0 * i as f64);
        let is_bend =
            |&s_m: &f64| route.path.curvature_per_m(s_m).abs() > 1.0 / BEND_RADIUS_M && !is_junction(s_m);
        let bends_m = stations.filter(is_bend).collect();
        let is_near = |walk: &&Footprint| {
            let reach_m = CROSSING_M + walk.radius_m();
            filler.near.iter().any(|point| (point - walk.center).norm() < reach_m)
        };
        let crossings = filler.town.surface.crosswalks.iter().filter(is_near).copied().collect();
        Self { junctions, bends_m, crossings }
    }
}

fn pick<T: Copy>(of: &[T], rng: &mut Rng) -> Option<T> {
    (!of.is_empty()).then(|| of[rng.random_range(0..of.len())])
}

impl Filler<'_> {
    /// Places objects along the route, and says what has to wait for the rest of the world.
    pub(super) fn place_unfamiliar(&mut self, route: &Route) -> Reserved {
        let mut rng = random::stream(self.seed, "ood", 0);
        let places = Places::of(route, self);
        let mut reserved = Reserved::default();
        let [low, high] = self.config.ood_spacing_m;
        let mut station_m = START_M;
        while station_m < route.path.length_m() {
            station_m += low + (high - low) * rng.random::<f64>();
            let is_event = rng.random::<f64>() < self.config.event_share;
            let spot = self.config.ood_placement.spot(rng.random::<f64>());
            if is_event {
                reserved.events_m.push(station_m);
            } else if spot == Spot::Behind {
                reserved.n_behind += 1;
            } else if !self.place_at(spot, &places, route, station_m, &mut rng) {
                self.place_at(Spot::Beside, &places, route, station_m, &mut rng);
            }
        }
        reserved
    }

    /// A thing in the lane, where an event was not possible.
    pub(super) fn place_instead(&mut self, route: &Route, station_m: f64) {
        let mut rng = random::stream(self.seed, "no-event", station_m.to_bits());
        let places = Places { junctions: Vec::new(), bends_m: Vec::new(), crossings: Vec::new() };
        if !self.place_at(Spot::Lane, &places, route, station_m, &mut rng) {
            self.place_at(Spot::Beside, &places, route, station_m, &mut rng);
        }
    }

    fn place_at(
        &mut self,
        spot: Spot,
        places: &Places,
        route: &Route,
        station_m: f64,
        rng: &mut Rng,
    ) -> bool {
        (0..TRIES).any(|_| {
            let Some(thing) = self.draw_thing(rng) else { return false };
            let found = match spot {
                Spot::Junction => self.at_junction(places, route, &thing, rng),
                Spot::Bend => {
                    pick(&places.bends_m, rng).map(|bend_m| self.across(route, bend_m, 0.5, &thing, rng))
                }
                Spot::Crossing => pick(&places.crossings, rng).map(|walk| {
                    let [along, across] = [rng.random::<f64>() - 0.5, rng.random::<f64>() - 0.5];
                    walk.at(along * walk.length_m, across * walk.width_m)
                }),
                _ => self.on_the_street(spot, route, station_m, &thing, rng),
            };
            found.is_some_and(|at| self.set_down(&thing, at, spot, route, rng))
        })
    }

    /// Draws a model, and whether it lies.
    pub(super) fn draw_thing(&self, rng: &mut Rng) -> Option<Thing> {
        let model = pick(&strange(self.models, self.config), rng)?;
        let is_tipped = rng.random::<f64>() < self.config.ood_placement.tipped_share;
        let tilt = if is_tipped { Tilt::draw(&self.models[model], rng) } else { None };
        let bounds = tilt.as_ref().map_or(self.models[model].solid, |tilt| tilt.bounds);
        Some(Thing { model, tilt, yaw_rad: std::f64::consts::TAU * rng.random::<f64>(), bounds })
    }

    fn at_junction(&self, places: &Places, route: &Route, thing: &Thing, rng: &mut Rng) -> Option<Vec2> {
        let (start_m, end_m) = pick(&places.junctions, rng)?;
        let share = rng.random::<f64>();
        let station_m = match rng.random_range(0..3) {
            0 => start_m - MOUTH_M * share,
            1 => start_m + (end_m - start_m) * share,
            _ => end_m + MOUTH_M * share,
        };
        Some(self.across(route, station_m, 0.45, thing, rng))
    }

    /// In the lane for a share of the draws, else just beyond one of its sides.
    fn across(&self, route: &Route, station_m: f64, lane_share: f64, thing: &Thing, rng: &mut Rng) -> Vec2 {
        let half_lane_m = self.town.graph.lanes[route.span_at(station_m).lane].width_m / 2.0;
        let draw = rng.random::<f64>();
        let side = if rng.random_bool(0.7) { -1.0 } else { 1.0 };
        let left_m = if rng.random::<f64>() < lane_share {
            (2.0 * draw - 1.0) * half_lane_m
        } else {
            side * (half_lane_m + thing.radius_m() + 2.0 * draw)
        };
        route.path.beside(station_m, -self.town.graph.kerb_sign() * left_m)
    }

    /// In the lane, or on the pavement of either side.
    fn on_the_street(
        &self,
        spot: Spot,
        route: &Route,
        station_m: f64,
        thing: &Thing,
        rng: &mut Rng,
    ) -> Option<Vec2> {
        let [which, draw] = [rng.random::<f64>(), rng.random::<f64>()];
        let side = if rng.random_bool(0.65) { -1.0 } else { 1.0 };
        let station_m = station_m + 3.0 * draw;
        let span = route.span_at(station_m);
        let lane = &self.town.graph.lanes[span.lane];
        let from_ends_m = (station_m - span.start_m).min(span.end_m - station_m);
        if lane.junction.is_some() || from_ends_m < FROM_JUNCTION_M {
            return None;
        }
        let (half_lane_m, out_m) = (lane.width_m / 2.0, thing.radius_m() + 0.2 + 1.8 * draw);
        let left_m = match (spot, side < 0.0) {
            // Mostly a part of the lane's kerb side, which the ego passes without leaving its lane.
            (Spot::Lane, _) if which < PARTLY_SHARE => 0.3 + 0.9 * draw - half_lane_m - thing.radius_m(),
            (Spot::Lane, _) => (2.0 * draw - 1.0) * (half_lane_m - 0.2),
            (_, true) => -half_lane_m - out_m,
            (_, false) => 3.0 * half_lane_m + out_m,
        };
        Some(route.path.beside(station_m, -self.town.graph.kerb_sign() * left_m))
    }

    /// Sets a thing down, its ground plan's centre at a place, if that is free and leaves the ego a way.
    pub(super) fn set_down(
        &mut self,
        thing: &Thing,
        center: Vec2,
        spot: Spot,
        route: &Route,
        rng: &mut Rng,
    ) -> bool {
        let (plan, origin) = thing.plan_at(center);
        let is_in_wall = self.town.buildings.iter().any(|house| house.footprint.meets(&plan));
        if is_in_wall
            || !self.is_open(&plan)
            || !self.leaves_ways(route, &plan, spot == Spot::Lane)
            || !self.occupied.claim(plan, 0.3)
        {
            return false;
        }
        if is_on_way(route, &plan) {
            self.on_way.push(center);
        }
        let surface = &self.town.surface;
        let over_m = surface.level_m(center) - surface.ground_m(origin);
        let lift_m = thing.tilt.as_ref().map_or(0.0, Tilt::lift_m);
        self.put(thing.model, origin, over_m + lift_m, thing.yaw_rad, Motion::Still, rng);
        let placed = self.placements.last_mut().expect("it was just put there");
        (placed.spot, placed.tilt) = (spot, thing.tilt.clone());
        true
    }

    /// Things on the road that the ego's driver notices late: placement, and the braking that it then takes.
    pub(super) fn late_notices(&self) -> Vec<(usize, f64)> {
        let config = &self.config.ood_placement;
        let [low, high] = config.late_braking_mps2;
        let mut rng = random::stream(self.seed, "late-notices", 0);
        let is_on_road = |at: Vec2| self.town.surface.road_grid.clearance_m(at) <= 0.0;
        let unfamiliar = self.placements.iter().enumerate().filter(|(_, placement)| {
            self.models[placement.model].is_strange()
                && matches!(placement.motion, Motion::Still)
                && is_on_road(placement.position)
        });
        unfamiliar
            .filter_map(|(i, _)| {
                let [is_late, braking] = [rng.random::<f64>(), rng.random::<f64>()];
                (is_late < config.late_share).then_some((i, low + (high - low) * braking))
            })
            .collect()
    }
}
