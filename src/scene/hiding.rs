//! Things that stand half hidden: behind a parked vehicle, a post or a tree, or round the corner of a house, as the ego sees
//! them when it comes.

use rand::RngExt;

use super::occupancy::Footprint;
use super::path::{Vec2, direction_of};
use super::populate::Filler;
use super::route::Route;
use super::spots::Thing;
use super::world::{Motion, plan_of};
use crate::object::{Kind, Spot};
use crate::random::{self, Rng};

/// Lower things hide nothing.
const LEAST_HEIGHT_M: f64 = 0.8;
/// How far to the side of the route a cover may be.
const ASIDE_M: [f64; 2] = [1.8, 9.0];
/// The ego comes into sight of the thing this far before the cover.
const VIEW_M: [f64; 2] = [8.0, 18.0];
/// At the view, up to this share of the thing looks out.
const MOST_SEEN: f64 = 0.55;
/// A cover is at least this high, as a share of the thing's height.
const HIGH_ENOUGH: f64 = 0.8;
const TRIES: usize = 16;

/// What something may stand behind.
#[derive(Clone, Copy)]
struct Cover {
    body: Footprint,
    height_m: f64,
    /// A house hides only what is near its corner.
    is_house: bool,
}

impl Filler<'_> {
    /// Puts `n` things behind what stands there already.
    pub(super) fn hide_unfamiliar(&mut self, route: &Route, n: usize) {
        let [vehicles, others] = self.covers(route);
        for i in 0..n {
            let mut rng = random::stream(self.seed, "behind", i as u64);
            (0..TRIES).any(|_| {
                let is_vehicle = others.is_empty() || (!vehicles.is_empty() && rng.random_bool(0.6));
                let covers = if is_vehicle { &vehicles } else { &others };
                if covers.is_empty() {
                    return false;
                }
                let cover = covers[rng.random_range(0..covers.len())];
                let Some(thing) = self.draw_thing(&mut rng) else { return false };
                if cover.height_m < HIGH_ENOUGH * (thing.bounds[1].z - thing.bounds[0].z) {
                    return false;
                }
                let at = behind(route, &cover, &thing, &mut rng);
                self.set_down(&thing, at, Spot::Behind, route, &mut rng)
            });
        }
    }

    /// Covers beside the route: vehicles, and all else.
    fn covers(&self, route: &Route) -> [Vec<Cover>; 2] {
        let is_beside = |body: &Footprint| {
            let aside_m = route.path.distance_m(body.center) - body.width_m.min(body.length_m) / 2.0;
            (ASIDE_M[0]..ASIDE_M[1]).contains(&aside_m)
        };
        let mut found = [Vec::new(), Vec::new()];
        for placement in self.placements.iter().filter(|placement| matches!(placement.motion, Motion::Still))
        {
            let model = &self.models[placement.model];
            let body = plan_of(&model.solid, placement.position, placement.yaw_rad);
            if !model.is_strange() && model.height_m() > LEAST_HEIGHT_M && is_beside(&body) {
                let is_vehicle = model.facts.kind == Kind::Vehicle;
                found[usize::from(!is_vehicle)].push(Cover {
                    body,
                    height_m: model.height_m(),
                    is_house: false,
                });
            }
        }
        let houses = self.town.buildings.iter().map(|building| Cover {
            body: building.footprint,
            height_m: building.height_m(),
            is_house: true,
        });
        found[1].extend(houses.filter(|house| is_beside(&house.body)));
        found
    }
}

/// The place behind a cover at which a part of the thing, from nothing to most of it, looks out on the road's side.
fn behind(route: &Route, cover: &Cover, thing: &Thing, rng: &mut Rng) -> Vec2 {
    let path = &route.path;
    let (station_m, left_m) = path.project(cover.body.center, 0.0, path.length_m());
    let [near, far] = VIEW_M;
    let view = path.at((station_m - near - (far - near) * rng.random::<f64>()).max(0.0));
    let corners = cover.body.corners().map(|corner| Vec2::new(corner.x_m, corner.y_m) - view);
    // Across the line of sight, away from the road.
    let sight = direction_of((cover.body.center - view).y.atan2((cover.body.center - view).x));
    let away = Vec2::new(-sight.y, sight.x) * left_m.signum();
    let edge = corners
        .into_iter()
        .min_by(|a, b| (a.dot(&away) / a.dot(&sight)).total_cmp(&(b.dot(&away) / b.dot(&sight))));
    let edge = edge.unwrap_or_default();
    let rear_m = corners.iter().map(|corner| corner.dot(&sight)).fold(0.0, f64::max);
    let radius_m = thing.radius_m();
    let beyond_m = if cover.is_house { edge.dot(&sight) } else { rear_m };
    let along_m = beyond_m + radius_m + 0.2 + 0.6 * rng.random::<f64>();
    let edge_m = edge.dot(&away) * along_m / edge.dot(&sight).max(1.0);
    let seen = MOST_SEEN * rng.random::<f64>();
    view + sight * along_m + away * (edge_m + radius_m * (1.0 - 2.0 * seen))
}
