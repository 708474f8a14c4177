//! Things that come out from behind a parked vehicle as the ego comes: round ones roll, light ones tumble.

use nalgebra::Vector3;
use rand::RngExt;

use super::events::{AIR_M, LIGHT_KG, Plan};
use super::loose::{Loose, lying, rolling_radius_m};
use super::models::Model;
use super::occupancy::Footprint;
use super::path::Vec2;
use super::populate::Filler;
use super::route::Route;
use super::world::{Motion, plan_of};
use crate::object::{Event, Kind, Spot};
use crate::random::Rng;

/// Share of the limit at which the ego is expected.
const APPROACH: f64 = 0.75;

impl Filler<'_> {
    /// Open ground just beyond parked vehicles and other large things near a point, as the ego comes.
    pub(super) fn starts_behind(&self, aim: Vec2, along: Vec2, radius_m: f64) -> Vec<Vec2> {
        let covers = self.placements.iter().filter(|placement| {
            let model = &self.models[placement.model];
            let is_large = model.facts.kind == Kind::Vehicle
                || (model.height_m() > 1.1 && model.length_m() > 0.9 && model.width_m() > 0.9);
            let off = placement.position - aim;
            matches!(placement.motion, Motion::Still)
                && is_large
                && off.dot(&along).abs() < 12.0
                && (3.4..9.0).contains(&off.perp(&along).abs())
        });
        covers
            .map(|cover| {
                let body = plan_of(&self.models[cover.model].solid, cover.position, cover.yaw_rad);
                let turn = cover.yaw_rad - along.y.atan2(along.x);
                let half_m = f64::midpoint(body.length_m * turn.cos().abs(), body.width_m * turn.sin().abs());
                body.center + along * (half_m + radius_m + 0.3)
            })
            .filter(|&start| {
                let here = Footprint::square(start, 2.0 * radius_m);
                self.occupied.is_free(&here, 0.05) && self.is_open(&here)
            })
            .collect()
    }

    /// A thing that rolls or is pushed into the lane from behind a parked vehicle.
    pub(super) fn plan_emergence(&self, route: &Route, station_m: f64, rng: &mut Rng) -> Option<Plan> {
        let model = self.draw_loose_model(|m| m.facts.rolls.is_some() || m.mass_kg <= LIGHT_KG, rng)?;
        let shape = &self.models[model];
        let along = route.path.direction(station_m);
        let radius_m = largest_m(shape) / 2.0;
        let starts = self.starts_behind(route.path.at(station_m), along, radius_m);
        if starts.is_empty() {
            return None;
        }
        let start = starts[rng.random_range(0..starts.len())];
        let pose = lying(shape, start, self.start_level_m(start) + AIR_M, along.y.atan2(along.x));
        let (at_m, left_m) = route.path.project(start, station_m - 15.0, station_m + 15.0);
        let aim = route.path.at(at_m);
        if !self.is_ground_free(start, aim) {
            return None;
        }
        let way = (aim - start).normalize();
        let is_round = shape.facts.rolls.is_some();
        let speed_mps = if is_round { 3.0 } else { 6.5 } + 1.5 * rng.random::<f64>();
        let hop_mps = if is_round { 0.0 } else { 1.5 + rng.random::<f64>() };
        let approach_mps = APPROACH * self.town.graph.lanes[route.span_at(at_m).lane].limit_mps;
        let loose = Loose {
            event: Event::Rolls,
            world_from_model: pose,
            aim,
            release_m: approach_mps * left_m.abs() / speed_mps + 5.0 + 8.0 * rng.random::<f64>(),
            linear_mps: Vector3::new(way.x * speed_mps, way.y * speed_mps, hop_mps),
            // Rolling without slipping: about the axis to the left of the way.
            angular_rps: Vector3::new(-way.y, way.x, 0.0) * (speed_mps / rolling_radius_m(shape)),
        };
        Some(Plan { model, loose, perch: None, spot: Spot::Behind })
    }
}

fn largest_m(model: &Model) -> f64 {
    model.length_m().max(model.height_m()).max(model.width_m())
}
