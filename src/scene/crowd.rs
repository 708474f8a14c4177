//! What moves in a filled town: vehicles on their lanes, pedestrians on their pavements.

use rand::RngExt;

use super::occupancy::Footprint;
use super::path::Vec2;
use super::populate::{Filler, Motion, Walk, footprint_of};
use super::route::Route;
use super::surface::{PAVEMENT_M, Strip, StripKind};
use crate::object::Kind;
use crate::random::{self, Rng};

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
        let body = footprint_of(&self.models.models[model], at, yaw_rad);
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
                let body = footprint_of(&self.models.models[model], at, yaw_rad);
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

    pub(super) fn place_pedestrians(&mut self) {
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
            for _ in 0..20 {
                let strip = strips[rng.random_range(0..strips.len())];
                let station_m = strip.center.length_m() * rng.random::<f64>();
                if !self.is_near(strip.center.at(station_m)) {
                    continue;
                }
                let kerb = self.kerb_side(strip);
                // Walkers keep to the side of the houses, clear of the props.
                let left_m = -kerb * (strip.width_m / 2.0 - 0.45 - 0.6 * rng.random::<f64>());
                let sense = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
                let wants_across = rng.random::<f64>() < (5.0 * traffic.pedestrian_crossing_share).min(1.0);
                let crossing =
                    if wants_across { self.crossing(strip, &strips, kerb, &mut rng) } else { None };
                let at = strip.center.beside(station_m, left_m);
                let walk = Walk {
                    footway: strip.center.clone(),
                    left_m,
                    station_m,
                    sense,
                    speed_mps: 1.0 + 0.6 * rng.random::<f64>(),
                    crossing,
                    is_reckless: n % 4 != 0,
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
        // The way must be free of what stands.
        let middle = (from + to) / 2.0;
        let way = Footprint {
            center: middle,
            yaw_rad: (to - from).y.atan2((to - from).x),
            length_m: (to - from).norm(),
            width_m: 1.0,
        };
        self.occupied.is_free(&way, 0.0).then_some((station_m, to))
    }
}
