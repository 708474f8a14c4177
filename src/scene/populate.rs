//! Fills a town: the ego's route, parked and moving vehicles, pedestrians, props and, if wanted,
//! out-of-distribution objects on the road and beside it. Same town, config and seed: same world.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::actor_config::ActorConfig;
use super::error::SceneError;
use super::loose::Perch;
use super::models::{self, Model};
use super::network::LaneGraph;
use super::occupancy::{Footprint, Occupied};
use super::ood_placement::OodPlacementConfig;
use super::parties::{PeopleConfig, draw_actor, draw_parties};
use super::path::Vec2;
use super::rebuilding::TownVariation;
use super::route::Route;
use super::solids::draw_solids;
use super::split::SceneSplit;
use super::town::Town;
use super::world::{Motion, Placement, SceneObject, World, footprint_of};
use crate::config::{SHARE, define_config, from_to, part, parts};
use crate::object::{Distribution, Kind, Spot};
use crate::random::{self, Rng};
use rand::RngExt;

define_config! {
    /// How much is placed, and how far from the ego's route.
    pub struct PopulateConfig {
        /// Whether out-of-distribution objects are placed.
        ood: bool = false;
        /// Whose towns are driven through and whose kinds of out-of-distribution objects are placed.
        split: SceneSplit = SceneSplit::Dev;
        /// Length of the ego's route, metres; driving goes on by random turns within it.
        route_length_m: f64 = 700.0, in from_to(10.0, 10_000.0);
        /// Nothing stands farther than this from the route, metres.
        reach_m: f64 = 60.0, in from_to(1.0, 1000.0);
        /// Factor on the town's density of benches, bins, signs and the like.
        prop_density: f64 = 0.32, in from_to(0.0, 20.0);
        /// Factor on the town's density of parked cars.
        parked_density: f64 = 1.65, in from_to(0.0, 20.0);
        /// Factor on the town's density of moving vehicles.
        traffic_density: f64 = 0.8, in from_to(0.0, 20.0);
        /// Size of the vehicles, as a factor on each model that an episode draws anew: least, most.
        vehicle_size: [f64; 2] = [0.95, 1.06], in from_to(0.8, 1.25).pair();
        /// Share of the episodes in which a vehicle drives ahead of the ego from the start.
        leader_share: f64 = 0.36, in SHARE;
        /// Factor on the town's density of pedestrians.
        pedestrian_density: f64 = 0.32, in from_to(0.0, 20.0);
        people: PeopleConfig = PeopleConfig::default(), in part::<PeopleConfig>();
        /// Share of the pedestrians who stand beside the ego's route and cross it again and again.
        jaywalker_share: f64 = 0.07, in SHARE;
        /// Distance from one out-of-distribution place to the next along the route, metres: least, most.
        ood_spacing_m: [f64; 2] = [9.0, 18.0], in from_to(1.0, 1000.0).pair();
        /// Share of out-of-distribution objects that fall, roll or are thrown when the ego comes, 0 to 1.
        event_share: f64 = 0.10, in SHARE;
        /// Where the others stand.
        ood_placement: OodPlacementConfig = OodPlacementConfig::default(), in part::<OodPlacementConfig>();
        /// Different solids of no kind in an episode, which stand and move as out-of-distribution objects do but are in
        /// distribution: for training, without `ood`; 0 for none.
        random_solids: usize = 0, in from_to(0.0, 1000.0);
        /// Share of the episodes whose town is built anew beside its roads, with houses, walls, hedges and land that no other
        /// episode has: for training, so that no town is learnt by heart. Default 0.
        #[serde(skip_serializing_if = "is_zero")]
        rebuilt_share: f64 = 0.0, in SHARE;
        /// Share of the episodes whose town lies on long waves of land, roads included, that no other episode has: for training, so
        /// that slopes are not strange. Default 0.
        #[serde(skip_serializing_if = "is_zero")]
        rolling_share: f64 = 0.0, in SHARE;
        /// Whether the kinds that come with harmzone are placed beside a user's own.
        shipped_kinds: bool = true;
        /// SHA-256 of a user's own models (`gen --models`); empty without any.
        own_models: String = String::new();
        /// Actors of a scenario, by names of one's own.
        #[serde(skip_serializing_if = "BTreeMap::is_empty")]
        actors: BTreeMap<String, ActorConfig> = BTreeMap::new(), in parts::<ActorConfig>();
    }
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
fn is_zero(share: &f64) -> bool {
    *share == 0.0
}

impl PopulateConfig {
    /// What of the town of the episode with this seed is drawn anew.
    pub fn variation(&self, seed: u64) -> TownVariation {
        let drawn =
            |name: &str, share: f64| (random::stream(seed, name, 0).random::<f64>() < share).then_some(seed);
        TownVariation {
            rebuilt: drawn("rebuilds", self.rebuilt_share),
            rolling: drawn("rolls", self.rolling_share),
        }
    }

    /// Whether random solids are placed: where unfamiliar objects are, they are not.
    pub(super) fn places_solids(&self) -> bool {
        !self.ood && self.random_solids > 0
    }
}

/// Fills a town in dry weather.
///
/// # Errors
/// As [`populate_in`].
pub fn populate(town: &Arc<Town>, config: &PopulateConfig, seed: u64) -> Result<World, SceneError> {
    populate_in(town, Vec::new(), config, false, seed)
}

/// Fills a town, with a user's own models beside harmzone's. In rain people carry umbrellas.
///
/// # Errors
/// [`SceneError`]: broken models, or no lane where the ego could start.
pub fn populate_in(
    town: &Arc<Town>,
    own_models: Vec<Model>,
    config: &PopulateConfig,
    is_raining: bool,
    seed: u64,
) -> Result<World, SceneError> {
    let mut models = models::load()?;
    models.retain(|model| config.shipped_kinds || model.facts.distribution == Distribution::Id);
    models.extend(own_models.into_iter().map(|mut model| {
        model.facts.split = config.split;
        model
    }));
    if config.places_solids() {
        models.extend(draw_solids(config.random_solids, seed)?);
    }
    let mut rng = random::stream(seed, "vehicle-size", 0);
    let [least, most] = config.vehicle_size;
    let is_vehicle = |model: &&mut Model| {
        model.facts.kind == Kind::Vehicle
            && model.facts.distribution == Distribution::Id
            && model.facts.category != "ego"
    };
    for model in models.iter_mut().filter(is_vehicle) {
        model.scale_by(least + (most - least) * rng.random::<f64>());
    }
    let n_people = f64::from(town.config.traffic.n_pedestrians) * config.pedestrian_density;
    let parties = draw_parties(&config.people, n_people.round() as usize, is_raining, seed, &mut models);
    for (name, actor) in &config.actors {
        draw_actor(name, &actor.model, actor.speed_mps, is_raining, seed, &mut models);
    }
    let models = Arc::<[Model]>::from(models);
    let mut rng = random::stream(seed, "ego-route", 0);
    let starts = starts(&town.graph);
    // The ego sets out where there is a long way ahead.
    let reach_m = |lane: &usize| town.graph.lanes[*lane].reach_m;
    let longest_m = starts.iter().map(reach_m).fold(0.0, f64::max).min(config.route_length_m / 0.7);
    let ego_starts: Vec<usize> =
        starts.iter().copied().filter(|lane| reach_m(lane) >= 0.7 * longest_m).collect();
    if ego_starts.is_empty() {
        return Err(SceneError::NoStart { town: town.name.clone() });
    }
    let lane = ego_starts[rng.random_range(0..ego_starts.len())];
    let ego_route = Route::random(&town.graph, lane, config.route_length_m, &mut rng);
    let mut filler = Filler {
        town,
        config,
        models: &models,
        near: ego_route.path.points_every(8.0),
        occupied: Occupied::default(),
        moving: Occupied::default(),
        on_way: Vec::new(),
        placements: Vec::new(),
        perches: Vec::new(),
        seed,
    };
    let start_m = 3.0;
    let ego_center = ego_route.path.at(start_m + 1.3);
    let ego_yaw_rad = ego_route.path.heading_rad(start_m);
    filler
        .occupied
        .claim(Footprint { center: ego_center, yaw_rad: ego_yaw_rad, length_m: 12.0, width_m: 2.6 }, 0.0);
    filler.place_actors(&ego_route, start_m)?;
    let lamp_posts = filler.place_lights();
    let places_strange = config.ood || config.places_solids();
    let reserved = places_strange.then(|| filler.place_unfamiliar(&ego_route));
    filler.park();
    filler.place_furnishings();
    filler.place_props();
    filler.place_rows();
    if let Some(reserved) = reserved {
        filler.hide_unfamiliar(&ego_route, reserved.n_behind);
        for station_m in filler.place_events(&ego_route, &reserved.events_m) {
            filler.place_instead(&ego_route, station_m);
        }
    }
    let late_notices = filler.late_notices();
    filler.place_traffic(&starts, ego_center, &ego_route);
    filler.place_pedestrians(&ego_route, parties);
    filler.place_clutter();
    let (mut placements, perches) = (filler.placements, filler.perches);
    let mut n_mocap = 0;
    for placement in &mut placements {
        if matches!(
            placement.motion,
            Motion::Drives { .. } | Motion::Walks(_) | Motion::Follows(_) | Motion::Dashes(_)
        ) {
            placement.mocap = Some(n_mocap);
            n_mocap += 1 + models[placement.model].shapes.len();
        }
    }
    let object = |p: &Placement| SceneObject::new(p, &models[p.model], &town.surface);
    let objects = placements.iter().map(object).collect();
    Ok(World {
        town: Arc::clone(town),
        models,
        placements,
        ego_route,
        ego_start_m: start_m,
        lamp_posts,
        objects,
        perches,
        late_notices,
    })
}

/// Lanes to set out on: outside junctions, and of some length if there are any.
fn starts(graph: &LaneGraph) -> Vec<usize> {
    let of_length = |least_m: f64| -> Vec<usize> {
        let fits = |i: &usize| {
            let lane = &graph.lanes[*i];
            lane.junction.is_none() && lane.path.length_m() > least_m
        };
        (0..graph.lanes.len()).filter(fits).collect()
    };
    let long = of_length(20.0);
    if long.is_empty() { of_length(8.0) } else { long }
}

/// Paints of vehicles and clothes: common colours of European cars, then bolder ones.
const PAINTS: [[f64; 3]; 9] = [
    [0.85, 0.85, 0.84],
    [0.12, 0.12, 0.13],
    [0.45, 0.46, 0.48],
    [0.62, 0.64, 0.66],
    [0.15, 0.22, 0.42],
    [0.55, 0.1, 0.1],
    [0.2, 0.35, 0.22],
    [0.75, 0.6, 0.3],
    [0.2, 0.45, 0.6],
];

/// Category of the models that stand for traffic lights.
pub(super) const TRAFFIC_LIGHT: &str = "traffic_light";

/// A world in the making: what is placed, and the ground it takes.
pub(super) struct Filler<'a> {
    pub(super) town: &'a Town,
    pub(super) config: &'a PopulateConfig,
    pub(super) models: &'a [Model],
    /// Points along the ego's route.
    pub(super) near: Vec<Vec2>,
    pub(super) occupied: Occupied,
    /// Ground of the moving vehicles at the start.
    pub(super) moving: Occupied,
    /// Unfamiliar things on the ego's way.
    pub(super) on_way: Vec<Vec2>,
    pub(super) placements: Vec<Placement>,
    pub(super) perches: Vec<Perch>,
    pub(super) seed: u64,
}

impl Filler<'_> {
    pub(super) fn is_near(&self, point: Vec2) -> bool {
        self.near.iter().any(|other| (point - other).norm() < self.config.reach_m)
    }

    /// Draws a model by weight of its name; if no weights are given, by the models' own.
    pub(super) fn draw_model(
        &self,
        kind: Kind,
        weights: &std::collections::BTreeMap<String, f64>,
        rng: &mut Rng,
    ) -> Option<usize> {
        let weight_of = |&i: &usize| {
            let model = &self.models[i];
            let weight = weights.get(&model.name).copied();
            weight.unwrap_or(if weights.is_empty() { model.facts.weight } else { 0.0 }).max(0.0)
        };
        let mut choices = models::indices_of(self.models, kind, Distribution::Id);
        choices.retain(|&i| !matches!(self.models[i].facts.category.as_str(), "ego" | TRAFFIC_LIGHT));
        random::pick_weighted(choices.iter().map(weight_of), rng).map(|at| choices[at])
    }

    /// Puts a model `over_m` above the ground.
    pub(super) fn put(
        &mut self,
        model: usize,
        position: Vec2,
        over_m: f64,
        yaw_rad: f64,
        motion: Motion,
        rng: &mut Rng,
    ) {
        let z_m = self.town.surface.ground_m(position) + over_m;
        let category = &self.models[model].facts.category;
        let id = format!("{category}-{:03}", self.placements.len());
        // A hay bale is yellow and a tree is green; only cars and clothes come in any colour.
        let is_recoloured = self.models[model].facts.kind != Kind::Static;
        let paint = self.models[model].facts.paint.as_ref().filter(|_| is_recoloured).map(|_| {
            PAINTS[rng.random_range(0..PAINTS.len())]
                .map(|c| (c * (0.85 + 0.3 * rng.random::<f64>())).min(1.0))
        });
        self.placements.push(Placement {
            id,
            model,
            position,
            z_m,
            yaw_rad,
            paint,
            motion,
            tilt: None,
            spot: Spot::None,
            mocap: None,
        });
    }

    pub(super) fn claim(&mut self, model: usize, position: Vec2, yaw_rad: f64, gap_m: f64) -> bool {
        self.occupied.claim(footprint_of(&self.models[model], position, yaw_rad), gap_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Checked;
    use crate::scene::town_config::TownConfig;

    #[test]
    fn a_bus_shelter_opens_to_the_road_and_a_sign_faces_the_drivers() {
        let mut town = Town::load("downtown").unwrap();
        let prop_weights = [("bus_shelter".to_owned(), 1.0), ("traffic_sign".to_owned(), 1.0)].into();
        town.config = Checked::new(TownConfig { prop_weights, ..(*town.config).clone() }).unwrap();
        let config = PopulateConfig { prop_density: 0.5, ..PopulateConfig::default() };
        let world = populate(&Arc::new(town), &config, 2).unwrap();
        let (mut n_shelters, mut n_signs) = (0, 0);
        for placement in &world.placements {
            let model = &world.models[placement.model];
            let facing = Vec2::new(placement.yaw_rad.cos(), placement.yaw_rad.sin());
            let lanes = world.town.graph.lanes.iter();
            let lane = lanes
                .min_by(|a, b| {
                    let distance = |lane: &crate::scene::GraphLane| lane.path.distance_m(placement.position);
                    distance(a).total_cmp(&distance(b))
                })
                .unwrap();
            let (station_m, _) = lane.path.project(placement.position, 0.0, lane.path.length_m());
            // Round a corner, the pavement turns from one street to the other.
            if !(12.0..lane.path.length_m() - 12.0).contains(&station_m) {
                continue;
            }
            if model.name == "bus_shelter" {
                let to_lane = lane.path.at(station_m) - placement.position;
                assert!(facing.dot(&to_lane.normalize()) > 0.9, "{} looks away", placement.id);
                n_shelters += 1;
            } else if model.name == "traffic_sign"
                && lane.junction.is_none()
                // Round a corner the nearest lane may be that of the other street.
                && (5.0..lane.path.length_m() - 5.0).contains(&station_m)
            {
                assert!(
                    facing.dot(&lane.path.direction(station_m)) < -0.9,
                    "{} shows its back",
                    placement.id
                );
                n_signs += 1;
            }
        }
        assert!(n_shelters > 5 && n_signs > 5, "{n_shelters} shelters, {n_signs} signs");
    }
}
