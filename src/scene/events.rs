//! Events: things that fall from a balcony, roll across the road, or are thrown before the ego.
//!
//! Each is a free body that is held still until the ego comes near the point where their ways cross; from
//! then on physics moves it.

use nalgebra::Vector3;
use rand::RngExt;

use super::buildings::{Balcony, Building, RAILING_M};
use super::loose::{Loose, Perch, any_direction, lying, rolling_radius_m, standing, throw};
use super::models::{Model, SOLID_M};
use super::occupancy::Footprint;
use super::path::{Vec2, direction_of};
use super::populate::Filler;
use super::route::Route;
use super::unfamiliar::strange;
use super::world::Motion;
use crate::object::{Event, Spot};
use crate::random::{self, Rng};

/// Heights of the balconies' floors: the first and second storey over a shop.
const STOREYS_M: [f64; 2] = [4.1, 7.3];
/// Largest and heaviest model that may stand on a parapet.
const LARGEST_M: f64 = 1.1;
const HEAVIEST_KG: f64 = 25.0;
/// Models up to this mass tumble in the wind; heavier ones must be round.
pub(super) const LIGHT_KG: f64 = 6.0;
/// The ego is assumed to approach at most this fast.
const APPROACH_MPS: f64 = 8.0;
/// Nothing comes nearer than this to the ego where it sets out, metres.
const FROM_START_M: f64 = 20.0;
/// Gap between a held thing and what it stands on, so that nothing presses.
pub(super) const AIR_M: f64 = 0.005;
/// Faster than this nobody throws a box.
const FASTEST_THROW_MPS: f64 = 13.0;

/// What one event adds to the world.
pub(super) struct Plan {
    pub model: usize,
    pub loose: Loose,
    pub perch: Option<Perch>,
    pub spot: Spot,
}

/// A place aloft where something may stand: the middle of a balcony's rail or parapet.
struct Ledge {
    at: Vec2,
    z_m: f64,
    /// Away from the wall.
    out_rad: f64,
    /// The balcony, if the building does not have it already.
    perch: Option<Perch>,
}

impl Filler<'_> {
    /// An event for each station, where the surroundings allow one; returns the stations left over.
    pub(super) fn place_events(&mut self, route: &Route, stations_m: &[f64]) -> Vec<f64> {
        let mut left_over = Vec::new();
        for (n, &station_m) in stations_m.iter().enumerate() {
            let mut rng = random::stream(self.seed, "event", n as u64);
            let first = rng.random_range(0..3);
            let emerges = rng.random::<f64>() < self.config.ood_placement.emerge_share;
            let emergence = if emerges { self.plan_emergence(route, station_m, &mut rng) } else { None };
            let plan = emergence.or_else(|| {
                (0..3).find_map(|k| match (first + k) % 3 {
                    0 => self.plan_fall(route, station_m, &mut rng),
                    1 => self.plan_roll(route, station_m, &mut rng),
                    _ => self.plan_throw(route, station_m, &mut rng),
                })
            });
            // The route may come by its start again, but the event would not wait for that.
            let is_later = |plan: &Plan| (plan.loose.aim - route.path.at(0.0)).norm() > FROM_START_M;
            let Some(Plan { model, loose, perch, spot }) = plan.filter(is_later) else {
                left_over.push(station_m);
                continue;
            };
            let pose = loose.world_from_model;
            let position = pose.translation.vector.xy();
            let over_m = pose.translation.z - self.town.surface.ground_m(position);
            let (_, _, yaw_rad) = pose.rotation.euler_angles();
            if over_m < SOLID_M {
                // However it lies.
                let [low, high] = self.models[model].bounds;
                let middle = pose * nalgebra::center(&low, &high);
                self.occupied.take(Footprint::square(middle.coords.xy(), (high - low).max()));
            }
            self.perches.extend(perch);
            self.put(model, position, over_m, yaw_rad, Motion::Loose(Box::new(loose)), &mut rng);
            self.placements.last_mut().expect("it was just put there").spot = spot;
        }
        left_over
    }

    pub(super) fn draw_loose_model(&self, fits: impl Fn(&Model) -> bool, rng: &mut Rng) -> Option<usize> {
        let mut models = strange(self.models, self.config);
        models.retain(|&i| fits(&self.models[i]));
        (!models.is_empty()).then(|| models[rng.random_range(0..models.len())])
    }

    fn draw_small_model(&self, rng: &mut Rng) -> Option<usize> {
        let is_small = |model: &Model| {
            let size_m = model.length_m().max(model.width_m()).max(model.height_m());
            size_m < LARGEST_M && model.mass_kg <= HEAVIEST_KG
        };
        self.draw_loose_model(is_small, rng)
    }

    /// A fall from a balcony onto the kerb's half of the ego's lane.
    fn plan_fall(&self, route: &Route, station_m: f64, rng: &mut Rng) -> Option<Plan> {
        let to_kerb_m = 1.4 * self.town.graph.kerb_sign() * rng.random::<f64>();
        let aim = route.path.beside(station_m, to_kerb_m);
        let ledge = self.ledge_near(aim, aim, rng)?;
        let model = self.draw_small_model(rng)?;
        let (linear_mps, time_s) =
            throw((ledge.at, self.over_m(&ledge, aim)), aim, 0.6 + rng.random::<f64>());
        // An aim farther out than a push reaches: it comes down on the way there.
        let push = 5.0 / linear_mps.xy().norm().max(5.0);
        let linear_mps = Vector3::new(linear_mps.x * push, linear_mps.y * push, linear_mps.z);
        let lead_m = 8.0 + 10.0 * rng.random::<f64>();
        self.flight_from_ledge(Event::Falls, model, ledge, aim, (linear_mps, time_s), lead_m, rng)
    }

    /// A throw from a balcony ahead, or from behind a parked car, to just before the ego.
    fn plan_throw(&self, route: &Route, station_m: f64, rng: &mut Rng) -> Option<Plan> {
        let aim = route.path.beside(station_m, 0.8 * (rng.random::<f64>() - 0.5));
        let model = self.draw_small_model(rng)?;
        let lead_m = 4.0 + 5.0 * rng.random::<f64>();
        if let Some(plan) = self.throw_from_cover(route, model, aim, station_m, lead_m, rng) {
            return Some(plan);
        }
        let ahead = route.path.at(station_m + 4.0 + 8.0 * rng.random::<f64>());
        let ledge = self.ledge_near(ahead, aim, rng)?;
        let (linear_mps, time_s) =
            throw((ledge.at, self.over_m(&ledge, aim)), aim, 1.5 + 2.0 * rng.random::<f64>());
        if linear_mps.norm() > FASTEST_THROW_MPS {
            return None;
        }
        self.flight_from_ledge(Event::Thrown, model, ledge, aim, (linear_mps, time_s), lead_m, rng)
    }

    #[expect(clippy::too_many_arguments, reason = "what a flight is made of")]
    fn flight_from_ledge(
        &self,
        event: Event,
        model: usize,
        ledge: Ledge,
        aim: Vec2,
        (linear_mps, time_s): (Vector3<f64>, f64),
        lead_m: f64,
        rng: &mut Rng,
    ) -> Option<Plan> {
        if !self.is_way_free(ledge.at, aim) {
            return None;
        }
        let yaw_rad = ledge.out_rad + std::f64::consts::FRAC_PI_2 * f64::from(rng.random_range(0..4));
        let loose = Loose {
            event,
            world_from_model: standing(ledge.at, ledge.z_m + AIR_M, yaw_rad),
            aim,
            release_m: APPROACH_MPS * time_s + lead_m,
            linear_mps,
            angular_rps: any_direction(rng) * (1.0 + 4.0 * rng.random::<f64>()),
        };
        Some(Plan { model, loose, perch: ledge.perch, spot: Spot::Aloft })
    }

    /// From beyond a standing vehicle, where the ego cannot see it, across into the lane.
    fn throw_from_cover(
        &self,
        route: &Route,
        model: usize,
        aim: Vec2,
        station_m: f64,
        lead_m: f64,
        rng: &mut Rng,
    ) -> Option<Plan> {
        let shape = &self.models[model];
        let radius_m = shape.length_m().hypot(shape.width_m()) / 2.0;
        let along = route.path.direction(station_m);
        let starts = self.starts_behind(aim, along, radius_m);
        if starts.is_empty() {
            return None;
        }
        let start = starts[rng.random_range(0..starts.len())];
        // Straight across, at the point where the lane passes it.
        let (at_m, left_m) = route.path.project(start, station_m - 15.0, station_m + 15.0);
        let aim = route.path.beside(at_m - 0.8 * rng.random::<f64>(), 0.3 * left_m.signum());
        if !self.is_way_free(start, aim) {
            return None;
        }
        let z_m = self.start_level_m(start) + AIR_M;
        let over_m = z_m - self.town.surface.ground_m(aim);
        let (linear_mps, time_s) = throw((start, over_m), aim, 3.0 + 1.5 * rng.random::<f64>());
        let loose = Loose {
            event: Event::Thrown,
            world_from_model: standing(start, z_m, std::f64::consts::TAU * rng.random::<f64>()),
            aim,
            release_m: APPROACH_MPS * time_s + lead_m,
            linear_mps,
            angular_rps: any_direction(rng) * (1.0 + 4.0 * rng.random::<f64>()),
        };
        Some(Plan { model, loose, perch: None, spot: Spot::Behind })
    }

    /// A thing that crosses the road from one side: round things roll, light ones tumble.
    fn plan_roll(&self, route: &Route, station_m: f64, rng: &mut Rng) -> Option<Plan> {
        let model = self.draw_loose_model(|m| m.facts.rolls.is_some() || m.mass_kg <= LIGHT_KG, rng)?;
        let shape = &self.models[model];
        let along = route.path.direction(station_m);
        let half_lane_m = self.town.graph.lanes[route.span_at(station_m).lane].width_m / 2.0;
        let (pose, start, aim, left_m) = (0..8).find_map(|_| {
            let kerb = self.town.graph.kerb_sign();
            let side = if rng.random_bool(0.7) { kerb } else { -kerb };
            let beyond_m = if side == kerb { half_lane_m } else { 3.0 * half_lane_m };
            let left_m = side * (beyond_m + 0.5 + 2.5 * rng.random::<f64>());
            let start = route.path.beside(station_m + 2.0 * rng.random::<f64>(), left_m);
            let pose = lying(shape, start, self.start_level_m(start) + AIR_M, along.y.atan2(along.x));
            let radius_m = shape.length_m().max(shape.height_m()).max(shape.width_m()) / 2.0;
            let here = Footprint::square(start, 2.0 * radius_m);
            let is_free = self.occupied.is_free(&here, 0.1) && self.is_open(&here);
            let (at_m, left_m) = route.path.project(start, station_m - 15.0, station_m + 15.0);
            let aim = route.path.at(at_m);
            (is_free && self.is_ground_free(start, aim)).then_some((pose, start, aim, left_m))
        })?;
        let way = (aim - start).normalize();
        let speed_mps = if shape.facts.rolls.is_some() { 3.0 } else { 6.5 } + 1.5 * rng.random::<f64>();
        let hop_mps = if shape.facts.rolls.is_some() { 0.0 } else { 1.5 + rng.random::<f64>() };
        // Rolling without slipping: about the axis to the left of the way.
        let radius_m = rolling_radius_m(shape);
        let loose = Loose {
            event: Event::Rolls,
            world_from_model: pose,
            aim,
            release_m: APPROACH_MPS * left_m.abs() / speed_mps + 6.0 + 8.0 * rng.random::<f64>(),
            linear_mps: Vector3::new(way.x * speed_mps, way.y * speed_mps, hop_mps),
            angular_rps: Vector3::new(-way.y, way.x, 0.0) * (speed_mps / radius_m),
        };
        Some(Plan { model, loose, perch: None, spot: Spot::Beside })
    }

    /// A balcony on the front nearest to a point, from which another point can be reached.
    fn ledge_near(&self, point: Vec2, aim: Vec2, rng: &mut Rng) -> Option<Ledge> {
        let before = |building: &Building| {
            let body = building.footprint;
            let (along_m, left_m) = body.place_of(point);
            // The front is on the side of -y.
            let out_m = -left_m - body.width_m / 2.0;
            let room_m = body.length_m / 2.0 - Perch::WIDTH_M / 2.0;
            ((2.2..14.0).contains(&out_m) && along_m.abs() < room_m + 3.0).then(|| {
                let foot = body.at(along_m.clamp(-room_m, room_m), -body.width_m / 2.0);
                (out_m, foot, body.yaw_rad - std::f64::consts::FRAC_PI_2)
            })
        };
        let nearest = self
            .town
            .buildings
            .iter()
            .filter(|building| (building.footprint.center - point).norm() < 40.0)
            .filter_map(|building| before(building).map(|found| (building, found)))
            .min_by(|(_, a), (_, b)| a.0.total_cmp(&b.0));
        let (building, (_, foot, out_rad)) = nearest?;
        let base_m = building.base_m(&|at| self.town.surface.ground_m(at));
        let storey = usize::from(rng.random_bool(0.4));
        let top_m = building.height_m() - 2.2;
        let floor_m = *STOREYS_M[..=storey].iter().rev().find(|&&floor_m| floor_m < top_m)?;
        let ledge = if building.balconies.is_empty() {
            let perch = Perch { foot, out_rad, floor_m: base_m + floor_m };
            let (at, z_m) = perch.ledge();
            Ledge { at, z_m, out_rad, perch: Some(perch) }
        } else {
            let low = building.balconies.iter().filter(|balcony| balcony.z_m < floor_m + 1.0);
            let nearest = low.min_by(|a, b| {
                let distance = |balcony: &Balcony| (balcony.center - foot).norm();
                distance(a).total_cmp(&distance(b))
            })?;
            let out = direction_of(nearest.yaw_rad);
            let at = nearest.center + out * (nearest.depth_m / 2.0);
            Ledge { at, z_m: base_m + nearest.z_m + RAILING_M, out_rad: nearest.yaw_rad, perch: None }
        };
        let is_apart = self.placements.iter().all(|other| {
            !matches!(other.motion, Motion::Loose(_))
                || (other.position - ledge.at).norm() > Perch::WIDTH_M + 0.3
        });
        let out = direction_of(ledge.out_rad);
        (is_apart && (aim - ledge.at).dot(&out) > 0.5).then_some(ledge)
    }

    fn over_m(&self, ledge: &Ledge, aim: Vec2) -> f64 {
        ledge.z_m - self.town.surface.ground_m(aim)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::object::Distribution;
    use crate::scene::{PopulateConfig, Town, World, populate};
    use std::sync::Arc;

    fn world(town: &str, event_share: f64, seed: u64) -> World {
        let town = Arc::new(Town::load(town).unwrap());
        let config = PopulateConfig { ood: true, event_share, ..PopulateConfig::default() };
        populate(&town, &config, seed).unwrap()
    }

    fn events(world: &World) -> Vec<Event> {
        world.loose().map(|(_, loose)| loose.event).collect()
    }

    #[test]
    fn the_share_of_events_is_the_configured_one_and_every_kind_occurs() {
        let (mut n_events, mut n_ood) = (0.0, 0.0);
        let mut all = Vec::new();
        for seed in 0..6 {
            let world = world("downtown", 0.3, seed);
            let found = events(&world);
            n_events += found.len() as f64;
            n_ood += world.objects().iter().filter(|o| o.distribution == Distribution::Ood).count() as f64;
            all.extend(found);
        }
        assert!((0.2..0.4).contains(&(n_events / n_ood)), "{n_events} of {n_ood}");
        for event in [Event::Falls, Event::Rolls, Event::Thrown] {
            assert!(all.iter().filter(|&&found| found == event).count() > 5, "{all:?}");
        }
        assert_eq!(events(&world("downtown", 0.0, 1)), []);
    }

    #[test]
    fn what_stands_aloft_stands_on_a_balcony_and_all_else_on_the_ground() {
        for town in crate::scene::town_names() {
            let world = world(&town, 0.5, 2);
            assert!(events(&world).len() > 3, "{town}: {:?}", events(&world));
            for (_, loose) in world.loose() {
                let at = loose.world_from_model.translation;
                let own = world.perches().iter().map(Perch::ledge);
                let height_m = |at| world.town.surface.ground_m(at);
                let of_buildings = world.town.buildings.iter().flat_map(|building| {
                    let base_m = building.base_m(&height_m);
                    building.balconies.iter().map(move |b| (b.center, base_m + b.z_m + RAILING_M))
                });
                let is_on_a_ledge = own.chain(of_buildings).any(|(ledge, z_m)| {
                    (ledge - at.vector.xy()).norm() < 1.0 && (at.z - z_m - AIR_M).abs() < 1e-9
                });
                let over_m = at.z - height_m(at.vector.xy());
                assert!(is_on_a_ledge || over_m < 1.0, "{town}: {loose:?}");
            }
        }
    }
}
