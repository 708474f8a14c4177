//! Everything that moves in a filled town: vehicles on their lanes, pedestrians on their pavements.

use std::f64::consts::FRAC_PI_2;

use rand::RngExt;

use super::ground::PAVEMENT_M;
use super::occupancy::Footprint;
use super::parties::{Member, Party, Together};
use super::path::{Vec2, rotate};
use super::populate::Filler;
use super::route::Route;
use super::surface::{Strip, StripKind};
use super::world::{Beside, Motion, Placement, Walk, footprint_of};
use crate::object::Kind;
use crate::random::{self, Rng};

/// Jaywalkers stand beside the first part of the ego's route when the world starts, metres along it: the
/// part that the ego reaches during an episode.
const JAYWALKERS_FROM_M: f64 = 10.0;
const JAYWALKERS_TO_M: f64 = 180.0;
/// The same where obstacles lie on the street and the ego drives more slowly.
const JAYWALKERS_TO_M_SLOW: f64 = 100.0;

/// Share of those who stand that do so at a bus stop, where there is one.
const BUS_STOP_SHARE: f64 = 0.3;
/// What a group keeps from the road beyond its own size, and how often that is looked at along its way.
const TURN_ROOM_M: f64 = 0.5;
const ROOM_STEP_M: f64 = 2.0;
/// Nobody stands nearer to the road than this.
const KERB_M: f64 = 0.9;
/// Places on a bench from its middle to the left, and how far before its middle people sit.
const SEATS_M: [f64; 2] = [-0.42, 0.42];
const SEAT_FORWARD_M: f64 = -0.02;

/// Where people may walk, and where the ego drives.
struct Pavements<'a> {
    strips: &'a [&'a Strip],
    ego_route: &'a Route,
}

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

    pub(super) fn place_pedestrians(&mut self, ego_route: &Route, parties: Vec<Party>) {
        let mut rng = random::stream(self.seed, "pedestrians", 0);
        let strips: Vec<&Strip> = self
            .town
            .surface
            .strips
            .iter()
            .filter(|s| s.kind == StripKind::Pavement && s.center.length_m() > 12.0)
            .collect();
        if strips.is_empty() {
            return;
        }
        // Only who is alone jaywalks, but the share is one of all.
        let n_people: usize = parties.iter().map(|party| party.members.len()).sum();
        let is_lone = |party: &Party| matches!(party.does, Together::Moves(_)) && party.members.len() == 1;
        let n_lone = parties.iter().filter(|party| is_lone(party)).count().max(1);
        let jaywalks_share = self.config.jaywalker_share * n_people as f64 / n_lone as f64;
        for (n, party) in parties.into_iter().enumerate() {
            match party.does {
                Together::Moves(speed_mps) => {
                    let jaywalks = is_lone(&party) && rng.random::<f64>() < jaywalks_share;
                    let strips = Pavements { strips: &strips, ego_route };
                    self.place_walkers(
                        &party,
                        speed_mps,
                        &strips,
                        [jaywalks, jaywalks || n % 4 != 0],
                        &mut rng,
                    );
                }
                Together::Sits => self.seat(&party, &mut rng),
                Together::Stands | Together::Stoops => self.place_standing(&party, &strips, &mut rng),
            }
        }
    }

    /// Puts a party on its way; whether it jaywalks, and whether it is reckless.
    fn place_walkers(
        &mut self,
        party: &Party,
        speed_mps: f64,
        pavements: &Pavements,
        [jaywalks, is_reckless]: [bool; 2],
        rng: &mut Rng,
    ) {
        let Pavements { strips, ego_route } = *pavements;
        let crossing_share = self.town.config.traffic.pedestrian_crossing_share;
        for _ in 0..20 {
            let (strip, station_m) = if jaywalks {
                let to_m = if self.config.ood { JAYWALKERS_TO_M_SLOW } else { JAYWALKERS_TO_M };
                let along_m = JAYWALKERS_FROM_M + (to_m - JAYWALKERS_FROM_M) * rng.random::<f64>();
                let near = beside_route(strips, ego_route, along_m, rng.random_bool(0.5));
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
            // Walkers keep to the side of the houses, clear of the props; a group needs room on both sides.
            let spread_m = party.members.iter().map(|member| member.at.y.abs()).fold(0.0, f64::max);
            let edge_m = (strip.width_m / 2.0 - 0.45 - spread_m - 0.6 * rng.random::<f64>()).max(0.0);
            let left_m = -kerb * edge_m;
            let sense = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
            // A group neither crosses nor turns round where that takes one of it onto the road.
            let is_group = party.members.len() > 1;
            let wants_across = rng.random::<f64>() < (5.0 * crossing_share).min(1.0) && !is_group;
            let crossing = if jaywalks {
                self.way_across(strip, strips, kerb, station_m)
            } else if wants_across {
                self.crossing(strip, strips, kerb, rng)
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
                speed_mps,
                crossing,
                is_reckless,
                is_restless: jaywalks,
            };
            let yaw_rad =
                strip.center.heading_rad(station_m) + if sense < 0.0 { std::f64::consts::PI } else { 0.0 };
            // On narrow pavements a group walks in single file.
            let is_narrow = strip.width_m / 2.0 < 0.4 + spread_m;
            let place = |i: usize, member: &Member| {
                if is_narrow && !member.is_stiff { Vec2::new(-1.15 * i as f64, 0.0) } else { member.at }
            };
            let places: Vec<Vec2> = party.members.iter().enumerate().map(|(i, m)| place(i, m)).collect();
            let reach_m = places.iter().map(Vec2::norm).fold(0.0, f64::max) + TURN_ROOM_M;
            let has_room = |i: usize| {
                let point = strip.center.beside(ROOM_STEP_M * i as f64, left_m);
                self.town.surface.road_grid.clearance_m(point) > reach_m
            };
            if is_group && !(0..=(strip.center.length_m() / ROOM_STEP_M) as usize).all(has_room) {
                continue;
            }
            if !self.claim_for(party, &places, at, yaw_rad) {
                continue;
            }
            let leader = self.placements.len();
            for (member, place) in party.members.iter().zip(&places) {
                let motion = if self.placements.len() == leader {
                    Motion::Walks(walk.clone())
                } else {
                    let is_stiff = member.is_stiff;
                    Motion::Follows(Beside { leader, forward_m: place.x, left_m: place.y, is_stiff })
                };
                self.put(
                    member.model,
                    at + rotate(place.x, place.y, yaw_rad),
                    PAVEMENT_M,
                    yaw_rad,
                    motion,
                    rng,
                );
            }
            return;
        }
    }

    /// Takes the ground of a party's members, if all of it is free.
    fn claim_for(&mut self, party: &Party, places: &[Vec2], at: Vec2, yaw_rad: f64) -> bool {
        let body = |(member, place): (&Member, &Vec2)| {
            let center = at + rotate(place.x, place.y, yaw_rad);
            footprint_of(&self.models[member.model], center, yaw_rad + member.yaw_rad)
        };
        let bodies: Vec<Footprint> = party.members.iter().zip(places).map(body).collect();
        // On narrow streets the sides of long vehicles reach over the kerb.
        let is_free = |body: &Footprint| self.moving.is_free(body, 0.2) && self.occupied.is_free(body, 0.2);
        let all_are_free = bodies.iter().all(is_free);
        if all_are_free {
            bodies.into_iter().for_each(|body| self.occupied.take(body));
        }
        all_are_free
    }

    /// Puts people who stay where they are on a pavement: at a bus stop, at the kerb or by the houses.
    fn place_standing(&mut self, party: &Party, strips: &[&Strip], rng: &mut Rng) {
        let stops: Vec<Vec2> =
            self.placed("bus_stop").chain(self.placed("bus_shelter")).map(|p| p.position).collect();
        let waits = rng.random::<f64>() < BUS_STOP_SHARE && !stops.is_empty();
        for _ in 0..20 {
            let strip = strips[rng.random_range(0..strips.len())];
            let mut station_m = strip.center.length_m() * rng.random::<f64>();
            let kerb = self.kerb_side(strip);
            let share = 2.0 * rng.random::<f64>() - 1.0;
            let mut left_m = kerb * share * (strip.width_m / 2.0 - 0.4).max(0.0);
            // Those who wait to cross or for a bus look over the kerb.
            let mut yaw_rad = strip.center.heading_rad(station_m) + kerb * FRAC_PI_2;
            if waits {
                let stop = stops[rng.random_range(0..stops.len())];
                let (near_m, offset_m) = strip.center.project(stop, 0.0, strip.center.length_m());
                if offset_m.abs() > strip.width_m {
                    continue;
                }
                station_m = (near_m + 6.0 * (rng.random::<f64>() - 0.5)).clamp(0.0, strip.center.length_m());
                left_m = left_m.clamp(-0.8, 0.8);
            } else if share < 0.6 {
                yaw_rad += std::f64::consts::TAU * rng.random::<f64>();
            }
            let at = strip.center.beside(station_m, left_m);
            if !self.is_near(at) {
                continue;
            }
            let places: Vec<Vec2> = party.members.iter().map(|member| member.at).collect();
            // Long vehicles reach over the kerb in bends.
            let is_clear = |place: &Vec2| {
                self.town.surface.road_grid.clearance_m(at + rotate(place.x, place.y, yaw_rad)) > KERB_M
            };
            if !places.iter().all(is_clear) {
                continue;
            }
            if self.claim_for(party, &places, at, yaw_rad) {
                for member in &party.members {
                    let center = at + rotate(member.at.x, member.at.y, yaw_rad);
                    let yaw_rad = yaw_rad + member.yaw_rad;
                    self.put(member.model, center, self.lift_m(center), yaw_rad, Motion::Still, rng);
                }
                return;
            }
        }
    }

    /// Seats a person on a bench, if one has room.
    fn seat(&mut self, party: &Party, rng: &mut Rng) {
        let benches: Vec<(Vec2, f64, f64)> =
            self.placed("bench").map(|bench| (bench.position, bench.z_m, bench.yaw_rad)).collect();
        for _ in 0..20 {
            if benches.is_empty() {
                return;
            }
            let (bench, z_m, yaw_rad) = benches[rng.random_range(0..benches.len())];
            let left_m = SEATS_M[rng.random_range(0..SEATS_M.len())];
            let at = bench + rotate(SEAT_FORWARD_M, left_m, yaw_rad);
            let is_taken = self
                .placements
                .iter()
                .any(|other| (other.position - at).norm() < 0.4 && other.position != bench);
            if !is_taken && self.is_near(at) {
                let over_m = z_m - self.town.surface.ground_m(at);
                self.put(party.members[0].model, at, over_m, yaw_rad, Motion::Still, rng);
                return;
            }
        }
    }

    fn placed<'b>(&'b self, name: &'b str) -> impl Iterator<Item = &'b Placement> {
        self.placements.iter().filter(move |placement| self.models[placement.model].name == name)
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
