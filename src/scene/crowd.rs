//! Everything that moves in a filled town: vehicles on their lanes, pedestrians on their pavements.

use rand::RngExt;

use super::ground::PAVEMENT_M;
use super::occupancy::Footprint;
use super::path::Vec2;
use super::populate::Filler;
use super::route::Route;
use super::surface::{Strip, StripKind};
use super::world::{Motion, Walk, footprint_of};
use crate::object::Kind;
use crate::random::{self, Rng};

/// Jaywalkers stand beside the first part of the ego's route when the world starts, metres along it: the
/// part that the ego reaches during an episode.
const JAYWALKERS_FROM_M: f64 = 10.0;
const JAYWALKERS_TO_M: f64 = 220.0;
/// The same where obstacles lie on the street and the ego drives more slowly.
const JAYWALKERS_TO_M_SLOW: f64 = 45.0;

/// The pavement nearest to a point of a route, on its left or right, and the station there.
fn beside_route<'a>(
    strips: &[&'a Strip],
    route: &Route,
    along_m: f64,
    is_left: bool,
) -> Option<(&'a Strip, f64)> {
    let (at, heading_rad) = (route.path.at(along_m), route.path.heading_rad(along_m));
    let left = Vec2::new(-heading_rad.sin(), heading_rad.cos());
    strips
        .iter()
        .filter_map(|strip| {
            let (station_m, _) = strip.center.project(at, 0.0, strip.center.length_m());
            let offset = strip.center.at(station_m) - at;
            let is_beside = offset.norm() < 14.0 && (offset.dot(&left) > 0.0) == is_left;
            is_beside.then(|| (offset.norm(), *strip, station_m))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, strip, station_m)| (strip, station_m))
}

impl Filler<'_> {
    /// With the configured share, a vehicle ahead of the ego on its route.
    fn place_leader(&mut self, ego_route: &Route, rng: &mut Rng) {
        if rng.random::<f64>() >= self.config.leader_share {
            return;
        }
        let weights = &self.town.config.traffic.vehicle_weights;
        let Some(model) = self.draw_model(Kind::Vehicle, weights, rng) else { return };
        let station_m = 16.0 + 14.0 * rng.random::<f64>();
        let (at, yaw_rad) = (ego_route.path.at(station_m), ego_route.path.heading_rad(station_m));
        let body = footprint_of(&self.models[model], at, yaw_rad);
        if self.occupied.is_free(&body, 0.3) && self.moving.claim(body, 0.2) {
            let route = ego_route.clone();
            self.put(model, at, 0.0, yaw_rad, Motion::Drives { route, station_m }, rng);
        }
    }

    pub(super) fn place_traffic(&mut self, starts: &[usize], ego_center: Vec2, ego_route: &Route) {
        let mut rng = random::stream(self.seed, "traffic", 0);
        let traffic = &self.town.config.traffic;
        let wanted = (f64::from(traffic.n_vehicles) * self.config.traffic_density).round() as u32;
        self.place_leader(ego_route, &mut rng);
        for _ in 0..wanted {
            for _ in 0..20 {
                let lane = starts[rng.random_range(0..starts.len())];
                let length_m = self.town.graph.lanes[lane].path.length_m();
                let station_m = 6.0 + (length_m - 14.0).max(0.0) * rng.random::<f64>();
                let path = &self.town.graph.lanes[lane].path;
                let (at, yaw_rad) = (path.at(station_m), path.heading_rad(station_m));
                let Some(model) = self.draw_model(Kind::Vehicle, &traffic.vehicle_weights, &mut rng) else {
                    return;
                };
                let body = footprint_of(&self.models[model], at, yaw_rad);
                let room = Footprint { length_m: body.length_m + 6.0, ..body };
                let is_free = (at - ego_center).norm() > 14.0 && self.is_near(at);
                if is_free && self.occupied.is_free(&room, 0.3) && self.moving.claim(room, 0.2) {
                    let route = Route::random(&self.town.graph, lane, 1500.0, &mut rng);
                    self.put(model, at, 0.0, yaw_rad, Motion::Drives { route, station_m }, &mut rng);
                    break;
                }
            }
        }
    }

    pub(super) fn place_pedestrians(&mut self, ego_route: &Route) {
        let mut rng = random::stream(self.seed, "pedestrians", 0);
        let traffic = &self.town.config.traffic;
        let strips: Vec<&Strip> = self
            .town
            .surface
            .strips
            .iter()
            .filter(|s| s.kind == StripKind::Pavement && s.center.length_m() > 12.0)
            .collect();
        let wanted = (f64::from(traffic.n_pedestrians) * self.config.pedestrian_density).round() as u32;
        if strips.is_empty() {
            return;
        }
        for n in 0..wanted {
            let Some(model) = self.draw_model(Kind::Pedestrian, &std::collections::BTreeMap::new(), &mut rng)
            else {
                return;
            };
            let jaywalks = rng.random::<f64>() < self.config.jaywalker_share;
            for _ in 0..20 {
                let (strip, station_m) = if jaywalks {
                    let to_m = if self.config.ood { JAYWALKERS_TO_M_SLOW } else { JAYWALKERS_TO_M };
                    let along_m = JAYWALKERS_FROM_M + (to_m - JAYWALKERS_FROM_M) * rng.random::<f64>();
                    let near = beside_route(&strips, ego_route, along_m, rng.random_bool(0.5));
                    let Some(found) = near else { continue };
                    found
                } else {
                    let strip = strips[rng.random_range(0..strips.len())];
                    (strip, strip.center.length_m() * rng.random::<f64>())
                };
                if !self.is_near(strip.center.at(station_m)) {
                    continue;
                }
                let kerb = self.kerb_side(strip);
                // Walkers keep to the side of the houses, clear of the props.
                let left_m = -kerb * (strip.width_m / 2.0 - 0.45 - 0.6 * rng.random::<f64>());
                let sense = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
                let wants_across = rng.random::<f64>() < (5.0 * traffic.pedestrian_crossing_share).min(1.0);
                let crossing = if jaywalks {
                    self.way_across(strip, &strips, kerb, station_m)
                } else if wants_across {
                    self.crossing(strip, &strips, kerb, &mut rng)
                } else {
                    None
                };
                if jaywalks && crossing.is_none() {
                    continue;
                }
                let at = strip.center.beside(station_m, left_m);
                let walk = Walk {
                    footway: strip.center.clone(),
                    left_m,
                    station_m,
                    sense,
                    speed_mps: 1.0 + 0.6 * rng.random::<f64>(),
                    crossing,
                    is_reckless: jaywalks || n % 4 != 0,
                    is_restless: jaywalks,
                };
                let yaw_rad = strip.center.heading_rad(station_m)
                    + if sense < 0.0 { std::f64::consts::PI } else { 0.0 };
                let body = Footprint { center: at, yaw_rad, length_m: 0.7, width_m: 0.7 };
                // On narrow streets the sides of long vehicles reach over the kerb.
                if self.moving.is_free(&body, 0.2) && self.occupied.claim(body, 0.2) {
                    self.put(model, at, PAVEMENT_M, yaw_rad, Motion::Walks(walk), &mut rng);
                    break;
                }
            }
        }
    }

    /// Where to cross from a pavement, and the point on the other side.
    fn crossing(&self, strip: &Strip, strips: &[&Strip], kerb: f64, rng: &mut Rng) -> Option<(f64, Vec2)> {
        let length_m = strip.center.length_m();
        let is_jaywalk = rng.random_bool(0.4);
        let share = rng.random::<f64>();
        let station_m = if is_jaywalk {
            10.0 + (length_m - 20.0).max(0.0) * share
        } else {
            (1.5 + share).min(length_m / 2.0)
        };
        let station_m = if rng.random_bool(0.5) { station_m } else { length_m - station_m };
        self.way_across(strip, strips, kerb, station_m)
    }

    /// The way across the street from a station of a pavement, if nothing stands on it.
    fn way_across(&self, strip: &Strip, strips: &[&Strip], kerb: f64, station_m: f64) -> Option<(f64, Vec2)> {
        let from = strip.center.at(station_m);
        let direction = strip.center.direction(station_m);
        let toward = Vec2::new(-direction.y, direction.x) * kerb;
        let mut best: Option<(f64, Vec2)> = None;
        for other in strips {
            let (s_m, _) = other.center.project(from + toward * 12.0, 0.0, other.center.length_m());
            let far = other.center.at(s_m) - from;
            let (along, across) = (far.dot(&direction).abs(), far.dot(&toward));
            if along < 1.5 && across > 6.0 && across < 24.0 && best.is_none_or(|(least, _)| across < least) {
                best = Some((across, from + far));
            }
        }
        let (_, to) = best?;
        // Nothing may stand on the way.
        self.occupied.is_free(&Footprint::between(from, to, 1.0), 0.0).then_some((station_m, to))
    }
}
