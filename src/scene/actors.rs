//! Actors of a scenario: things put by hand at a place on the ego's way, with a motion that the ego's coming sets off.

use nalgebra::Vector3;
use rand::RngExt as _;

use super::actor_config::{ActorConfig, ActorMotion};
use super::car;
use super::dash::Dash;
use super::error::SceneError;
use super::events::AIR_M;
use super::loose::{Loose, standing, throw};
use super::models::{self, Model};
use super::occupancy::Footprint;
use super::parties::{actor_name, actor_people};
use super::path::{Vec2, direction_of};
use super::populate::{Filler, PopulateConfig};
use super::route::Route;
use super::solids::draw_solids;
use super::world::{Motion, footprint_of};
use crate::object::{Distribution, Event, Spot};
use crate::random;

/// Wider than this from the ego's way, an actor stands beside the lane.
const LANE_HALF_M: f64 = 1.75;

/// Refuses actors that no model or category is called like, as filling a town with them would.
///
/// # Errors
/// [`SceneError::UnknownModel`] names those that there are; broken models.
pub fn check_actors(config: &PopulateConfig) -> Result<(), SceneError> {
    if config.actors.is_empty() {
        return Ok(());
    }
    let mut models = models::load()?;
    models.retain(|model| config.shipped_kinds || model.facts.distribution == Distribution::Id);
    if config.places_solids() {
        models.extend(draw_solids(config.random_solids, 0)?);
    }
    let is_person = |actor: &ActorConfig| actor_people().any(|person| person == actor.model);
    let mut things = config.actors.iter().filter(|(_, actor)| !is_person(actor));
    things.try_for_each(|(name, actor)| choices(&models, config, name, actor).map(drop))
}

/// The models that an actor may be.
fn choices(
    models: &[Model],
    config: &PopulateConfig,
    name: &str,
    actor: &ActorConfig,
) -> Result<Vec<usize>, SceneError> {
    // What is kept for reporting stays out of worlds to choose by.
    let may_be = |i: &usize| {
        let facts = &models[*i].facts;
        facts.distribution == Distribution::Id || facts.split == config.split
    };
    let named = |by: &dyn Fn(&Model) -> bool| -> Vec<usize> {
        (0..models.len()).filter(may_be).filter(|&i| by(&models[i])).collect()
    };
    let own = actor_name(name);
    let mut found = named(&|model| model.name == own);
    if found.is_empty() {
        found = named(&|model| model.name == actor.model);
    }
    if found.is_empty() {
        found = named(&|model| model.facts.category == actor.model);
    }
    if found.is_empty() {
        let mut categories: Vec<String> =
            named(&|_| true).into_iter().map(|i| models[i].facts.category.clone()).collect();
        categories.extend(actor_people().map(str::to_owned));
        categories.sort_unstable();
        categories.dedup();
        return Err(SceneError::UnknownModel {
            actor: name.to_owned(),
            model: actor.model.clone(),
            found: categories,
        });
    }
    Ok(found)
}

impl Filler<'_> {
    /// Puts the config's actors, before anything else takes their ground.
    pub(super) fn place_actors(&mut self, route: &Route, start_m: f64) -> Result<(), SceneError> {
        let ego = Footprint {
            center: route.path.at(start_m + car::FRONT_BUMPER_X_M - car::EGO_LENGTH_M / 2.0),
            yaw_rad: route.path.heading_rad(start_m),
            length_m: car::EGO_LENGTH_M,
            width_m: car::EGO_WIDTH_M,
        };
        // Who stands on the ground; what comes from above may begin over something.
        let mut placed = vec![("the ego".to_owned(), ego)];
        for (name, actor) in &self.config.actors {
            let mut rng = random::stream(self.seed, &format!("actor {name}"), 0);
            let choices = choices(self.models, self.config, name, actor)?;
            let model = choices[rng.random_range(0..choices.len())];
            let station_m = start_m + actor.ahead_m;
            let end_m = route.path.length_m() - start_m;
            if actor.ahead_m > end_m {
                return Err(SceneError::ActorOffRoute { actor: name.clone(), ahead_m: actor.ahead_m, end_m });
            }
            let at = route.path.beside(station_m, actor.left_m);
            let yaw_rad = route.path.heading_rad(station_m) + actor.yaw_deg.to_radians();
            let (motion, over_m) = self.actor_motion(actor, model, route, (station_m, at, yaw_rad));
            let footprint = footprint_of(&self.models[model], at, yaw_rad);
            if actor.motion != ActorMotion::Flies {
                if let Some((with, _)) = placed.iter().find(|(_, other)| other.meets(&footprint)) {
                    return Err(SceneError::ActorWithin { actor: name.clone(), with: with.clone() });
                }
                placed.push((format!("the actor `{name}`"), footprint));
            }
            self.occupied.take(footprint);
            self.put(model, at, over_m, yaw_rad, motion, &mut rng);
            let placement = self.placements.last_mut().expect("it was just put there");
            placement.id = format!("{}-{name}", self.models[model].facts.category);
            let is_ood = self.models[model].facts.distribution == Distribution::Ood;
            let spot = if actor.left_m.abs() < LANE_HALF_M { Spot::Lane } else { Spot::Beside };
            placement.spot = if is_ood { spot } else { Spot::None };
        }
        Ok(())
    }

    /// The motion, and the height above the ground at which the actor is put.
    fn actor_motion(
        &self,
        actor: &ActorConfig,
        model: usize,
        route: &Route,
        (station_m, at, yaw_rad): (f64, Vec2, f64),
    ) -> (Motion, f64) {
        let along = direction_of(yaw_rad);
        let lift_m = self.lift_m(at);
        let dash = |on_route: Option<(Route, f64, f64)>| {
            let ActorConfig { speed_mps, way_m, trigger_m, .. } = *actor;
            Motion::Dashes(Box::new(Dash { speed_mps, way_m, trigger_m, on_route }))
        };
        match actor.motion {
            ActorMotion::Stands => (Motion::Still, lift_m),
            ActorMotion::Dashes => (dash(None), lift_m),
            ActorMotion::Drives => (dash(Some((route.clone(), station_m, actor.left_m))), lift_m),
            ActorMotion::Flies => {
                let over_m = lift_m + actor.height_m + AIR_M;
                let z_m = self.town.surface.ground_m(at) + over_m;
                let (_, time_s) = throw((at, over_m), at, 0.0);
                let aim = at + along * (actor.speed_mps * time_s);
                let height_m = self.models[model].height_m();
                let event = if actor.height_m > height_m { Event::Falls } else { Event::Thrown };
                let loose = Loose {
                    event,
                    world_from_model: standing(at, z_m, yaw_rad),
                    aim,
                    release_m: actor.trigger_m,
                    linear_mps: Vector3::new(along.x, along.y, 0.0) * actor.speed_mps,
                    angular_rps: Vector3::zeros(),
                };
                (Motion::Loose(Box::new(loose)), over_m)
            }
        }
    }
}
