//! Fills a town: the ego's route, parked and moving vehicles, pedestrians, props and, if wanted,
//! out-of-distribution objects on the road and beside it. Same town, config and seed: same world.

use std::sync::Arc;

use nalgebra::Point3;
use rand::RngExt;
use serde::{Deserialize, Serialize};

use super::event_scenery::EventBalcony;
use super::events::Loose;
use super::models::{Model, ModelLibrary};
use super::network::LaneGraph;
use super::occupancy::{Footprint, Occupied};
use super::path::{Path, Vec2};
use super::route::Route;
use super::surface::{GRASS_M, PAVEMENT_M, Strip, StripKind};
use super::town::{SceneError, Town};
use crate::object::{Distribution, Event, Kind};
use crate::random::{self, Rng};

/// How much is placed, and how far from the ego's route.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PopulateConfig {
    /// Whether out-of-distribution objects are placed.
    pub ood: bool,
    /// Length of the ego's route, metres; driving goes on by random turns within it.
    pub route_length_m: f64,
    /// Nothing stands farther than this from the route, metres.
    pub reach_m: f64,
    /// Factors on the town's densities.
    pub prop_density: f64,
    pub parked_density: f64,
    pub traffic_density: f64,
    /// Share of the episodes in which a vehicle drives ahead of the ego from the start.
    pub leader_share: f64,
    pub pedestrian_density: f64,
    /// Between one out-of-distribution place and the next along the route, metres: least, most.
    pub ood_spacing_m: [f64; 2],
    /// Share of out-of-distribution objects that stand in the ego's lane or partly in it.
    pub ood_in_lane_share: f64,
    /// Share of out-of-distribution objects that fall, roll or are thrown when the ego comes, 0 to 1.
    pub event_share: f64,
}

impl Default for PopulateConfig {
    fn default() -> Self {
        Self {
            ood: false,
            route_length_m: 700.0,
            reach_m: 60.0,
            prop_density: 0.6,
            parked_density: 0.6,
            traffic_density: 1.0,
            leader_share: 0.75,
            pedestrian_density: 0.6,
            ood_spacing_m: [4.0, 9.0],
            ood_in_lane_share: 0.3,
            event_share: 0.15,
        }
    }
}

/// A walk along a pavement, and the way across the street, if there is one.
#[derive(Debug, Clone)]
pub struct Walk {
    pub footway: Path,
    /// Offset to the left of the footway's line.
    pub left_m: f64,
    pub station_m: f64,
    /// 1 or -1 along the footway.
    pub sense: f64,
    pub speed_mps: f64,
    /// Station at which it crosses, and the far side.
    pub crossing: Option<(f64, Vec2)>,
    /// Crosses without waiting long for a gap.
    pub is_reckless: bool,
}

/// How an object moves.
#[derive(Debug, Clone)]
pub enum Motion {
    Still,
    /// Drives a route from a station on.
    Drives {
        route: Route,
        station_m: f64,
    },
    Walks(Walk),
    /// Held until the ego comes near, then free.
    Loose(Box<Loose>),
}

/// One placed object.
#[derive(Debug, Clone)]
pub struct Placement {
    pub id: String,
    pub model: usize,
    pub position: Vec2,
    pub z_m: f64,
    pub yaw_rad: f64,
    /// Colour of the paint material, if it is recoloured.
    pub paint: Option<[f64; 3]>,
    pub motion: Motion,
    /// Number among the mocap bodies, for what moves.
    pub mocap: Option<usize>,
}

/// What the simulator and the labels need to know of an object.
#[derive(Debug, Clone)]
pub struct SceneObject {
    pub id: String,
    pub category: String,
    pub kind: Kind,
    pub distribution: Distribution,
    pub body_name: String,
    /// Lowest and highest corner in the model frame.
    pub bounds: ([f64; 3], [f64; 3]),
    pub triangles: Arc<Vec<[Point3<f32>; 3]>>,
    pub reflectivity: f64,
    pub event: Event,
}

/// A filled town, ready to be simulated.
#[derive(Debug, Clone)]
pub struct World {
    pub town: Arc<Town>,
    pub models: Arc<ModelLibrary>,
    pub placements: Vec<Placement>,
    pub ego_route: Route,
    /// Where on the route the ego's rear axle starts.
    pub ego_start_m: f64,
    /// Placements that are traffic lights, with the town's light each one is.
    pub lamp_posts: Vec<(usize, usize)>,
    objects: Vec<SceneObject>,
    balconies: Vec<EventBalcony>,
}

impl World {
    /// Things that an event sets free, each with its number among objects and placements.
    pub fn loose(&self) -> impl Iterator<Item = (usize, &Loose)> {
        self.placements.iter().enumerate().filter_map(|(i, placement)| match &placement.motion {
            Motion::Loose(loose) => Some((i, loose.as_ref())),
            _ => None,
        })
    }

    /// Balconies that events need.
    #[must_use]
    pub fn balconies(&self) -> &[EventBalcony] {
        &self.balconies
    }

    #[must_use]
    pub fn objects(&self) -> &[SceneObject] {
        &self.objects
    }

    /// Footprint of a placement at its start, of what stands below a car's roof: of a tree, the trunk.
    #[must_use]
    pub fn footprint(&self, placement: &Placement) -> Footprint {
        footprint_of(&self.models.models[placement.model], placement.position, placement.yaw_rad)
    }

    /// Start pose of the ego: x, y, yaw of the rear axle.
    #[must_use]
    pub fn ego_start(&self) -> (Vec2, f64) {
        let path = &self.ego_route.path;
        (path.at(self.ego_start_m), path.heading_rad(self.ego_start_m))
    }
}

/// Fills a town.
///
/// # Errors
/// [`SceneError`]: broken models, or no lane where the ego could start.
pub fn populate(town: &Arc<Town>, config: &PopulateConfig, seed: u64) -> Result<World, SceneError> {
    let models = Arc::new(ModelLibrary::load()?);
    let mut rng = random::stream(seed, "ego-route", 0);
    let starts = starts(&town.graph);
    // The ego sets out where the way is long.
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
        near: ego_route.path.sampled(8.0),
        occupied: Occupied::default(),
        placements: Vec::new(),
        balconies: Vec::new(),
        seed,
    };
    let start_m = 3.0;
    let ego_center = ego_route.path.at(start_m + 1.3);
    let ego_yaw_rad = ego_route.path.heading_rad(start_m);
    filler
        .occupied
        .claim(Footprint { center: ego_center, yaw_rad: ego_yaw_rad, length_m: 12.0, width_m: 2.6 }, 0.0);
    let lamp_posts = filler.place_lights();
    let event_stations_m = if config.ood { filler.place_ood(&ego_route) } else { Vec::new() };
    filler.park();
    filler.place_furnishings();
    filler.place_props();
    for station_m in filler.place_events(&ego_route, &event_stations_m) {
        filler.lay_in_lane(&ego_route, station_m);
    }
    filler.place_traffic(&starts, ego_center, &ego_route);
    filler.place_pedestrians();
    let (mut placements, balconies) = (filler.placements, filler.balconies);
    let is_mocap = |p: &&mut Placement| matches!(p.motion, Motion::Drives { .. } | Motion::Walks(_));
    for (n, placement) in placements.iter_mut().filter(is_mocap).enumerate() {
        placement.mocap = Some(n);
    }
    let objects = placements.iter().map(|placement| scene_object(placement, &models, town)).collect();
    Ok(World {
        town: Arc::clone(town),
        models,
        placements,
        ego_route,
        ego_start_m: start_m,
        lamp_posts,
        objects,
        balconies,
    })
}

/// Lanes to set out on: outside junctions, and with some length where there are such.
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

fn scene_object(placement: &Placement, models: &ModelLibrary, town: &Town) -> SceneObject {
    let model = &models.models[placement.model];
    SceneObject {
        id: placement.id.clone(),
        category: model.category.clone(),
        kind: model.kind,
        distribution: model.distribution,
        body_name: format!("obj:{}", placement.id),
        bounds: model.bounds,
        triangles: Arc::clone(&model.triangles),
        reflectivity: model.reflectivity,
        event: match &placement.motion {
            Motion::Loose(loose) => loose.event,
            _ if model.distribution == Distribution::Id => Event::None,
            _ if town.surface.road_grid.clearance_m(placement.position) > 0.0 => Event::None,
            _ => Event::Lies,
        },
    }
}

pub(super) fn footprint_of(model: &Model, position: Vec2, yaw_rad: f64) -> Footprint {
    let (low, high) = model.solid;
    let (sin, cos) = yaw_rad.sin_cos();
    let (x, y) = (f64::midpoint(low[0], high[0]), f64::midpoint(low[1], high[1]));
    let center = position + Vec2::new(x * cos - y * sin, x * sin + y * cos);
    Footprint { center, yaw_rad, length_m: high[0] - low[0], width_m: high[1] - low[1] }
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
const TRAFFIC_LIGHT: &str = "traffic_light";

pub(super) struct Filler<'a> {
    pub(super) town: &'a Town,
    config: &'a PopulateConfig,
    pub(super) models: &'a ModelLibrary,
    /// Points along the ego's route.
    near: Vec<Vec2>,
    pub(super) occupied: Occupied,
    pub(super) placements: Vec<Placement>,
    pub(super) balconies: Vec<EventBalcony>,
    pub(super) seed: u64,
}

impl Filler<'_> {
    fn is_near(&self, point: Vec2) -> bool {
        self.near.iter().any(|other| (point - other).norm() < self.config.reach_m)
    }

    /// Draws a model by weight of its name; if no weights are given, by the models' own.
    fn draw_model(
        &self,
        kind: Kind,
        weights: &std::collections::BTreeMap<String, f64>,
        rng: &mut Rng,
    ) -> Option<usize> {
        let choices: Vec<(usize, f64)> = self
            .models
            .indices(kind, Distribution::Id)
            .into_iter()
            .filter(|&i| !matches!(self.models.models[i].category.as_str(), "ego" | TRAFFIC_LIGHT))
            .map(|i| {
                let model = &self.models.models[i];
                let weight = weights.get(&model.name).copied();
                (i, weight.unwrap_or(if weights.is_empty() { model.weight } else { 0.0 }).max(0.0))
            })
            .collect();
        let mut left = rng.random::<f64>() * choices.iter().map(|(_, weight)| weight).sum::<f64>();
        choices
            .iter()
            .find(|(_, weight)| {
                left -= weight;
                left < 0.0
            })
            .map(|(i, _)| *i)
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
        let category = &self.models.models[model].category;
        let id = format!("{category}-{:03}", self.placements.len());
        // A hay bale is yellow and a tree green; only cars and clothes come in any colour.
        let is_recoloured = self.models.models[model].kind != Kind::Static;
        let paint = self.models.models[model].paint.as_ref().filter(|_| is_recoloured).map(|_| {
            PAINTS[rng.random_range(0..PAINTS.len())]
                .map(|c| (c * (0.85 + 0.3 * rng.random::<f64>())).min(1.0))
        });
        self.placements.push(Placement { id, model, position, z_m, yaw_rad, paint, motion, mocap: None });
    }

    fn claim(&mut self, model: usize, position: Vec2, yaw_rad: f64, gap_m: f64) -> bool {
        self.occupied.claim(footprint_of(&self.models.models[model], position, yaw_rad), gap_m)
    }

    /// Parked cars: in parking lanes where the town has them, in driveways, loading bays and yards.
    fn park(&mut self) {
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
                    let (length_m, width_m) =
                        (self.models.models[model].length_m(), self.models.models[model].width_m());
                    let ends = [-0.5, 0.5].map(|share| strip.width_at_m(station_m + share * length_m));
                    let is_small = length_m < traffic.parking_place_m + 0.3
                        && ends.iter().all(|&wide_m| wide_m > (width_m - 0.3).min(1.7));
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
                let model_fits = self.models.models[model].length_m() < length_m + 0.2
                    && self.models.models[model].width_m() < width_m + 0.2;
                if model_fits && self.claim(model, center, yaw_rad, 0.1) {
                    self.put(model, center, GRASS_M + 0.03, yaw_rad, Motion::Still, &mut rng);
                }
            }
        }
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

    /// Which side of a pavement is the kerb: 1 left, -1 right.
    fn kerb_side(&self, strip: &Strip) -> f64 {
        let middle_m = strip.center.length_m() / 2.0;
        let clearance =
            |left_m: f64| self.town.surface.road_grid.clearance_m(strip.center.beside(middle_m, left_m));
        if clearance(strip.width_m) < clearance(-strip.width_m) { 1.0 } else { -1.0 }
    }

    /// Props that belong to a place: the same in every episode, but for those that are left out.
    fn place_furnishings(&mut self) {
        let mut rng = random::stream(self.seed, "furnishings", 0);
        let index_of = |name: &str| self.models.models.iter().position(|model| model.name == name);
        for furnishing in &self.town.furnishings {
            let is_wanted = rng.random::<f64>() < self.config.prop_density;
            let at = furnishing.position;
            if let (true, Some(model), true) = (is_wanted, index_of(&furnishing.model), self.is_near(at)) {
                let is_paved = self.town.surface.paved_grid.clearance_m(at) < 0.0;
                let z_m = if is_paved { PAVEMENT_M } else { GRASS_M };
                if self.claim(model, at, furnishing.yaw_rad, 0.2) {
                    self.put(model, at, z_m, furnishing.yaw_rad, Motion::Still, &mut rng);
                }
            }
        }
    }

    /// The posts of lights near the route: where the map has them, or beside the lanes if that is on
    /// the road. Returns the placements with their lights.
    fn place_lights(&mut self) -> Vec<(usize, usize)> {
        let mut rng = random::stream(self.seed, "lights", 0);
        let town = self.town;
        let Some(model) = self.models.models.iter().position(|model| model.category == TRAFFIC_LIGHT) else {
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
                let is_paved = town.surface.paved_grid.clearance_m(at) < 0.0;
                let over_m = if is_paved { PAVEMENT_M } else { GRASS_M };
                posts.push((self.placements.len(), i));
                self.put(model, at, over_m, light.heading_rad, Motion::Still, &mut rng);
            }
        }
        posts
    }

    fn place_props(&mut self) {
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
                let shape = &self.models.models[model];
                // Crowns keep off the street as far as the pavement is wide; a lamp's arm reaches over it.
                let (reach_m, middle_m) = if shape.faces_traffic {
                    (shape.width_m() / 2.0, f64::midpoint(shape.solid.0[1], shape.solid.1[1]))
                } else {
                    (shape.overhang_m, f64::midpoint(shape.solid.0[0], shape.solid.1[0]))
                };
                let widest_m = (strip.width_m - 0.7).max(config.prop_kerb_distance_m);
                let from_kerb_m = (reach_m + 0.15).max(config.prop_kerb_distance_m + middle_m).min(widest_m);
                let at = strip.center.beside(station_m, side * (strip.width_m / 2.0 - from_kerb_m));
                // Traffic keeps to the right, so that it comes along with the kerb on its right.
                let along_rad =
                    strip.center.heading_rad(station_m) + if side > 0.0 { 0.0 } else { std::f64::consts::PI };
                let yaw_rad = along_rad
                    + if shape.faces_traffic { std::f64::consts::PI } else { std::f64::consts::FRAC_PI_2 };
                if self.is_near(at) && self.claim(model, at, yaw_rad, 0.3) {
                    self.put(model, at, PAVEMENT_M, yaw_rad, Motion::Still, &mut rng);
                }
                let [low, high] = config.prop_spacing_m;
                station_m += (low + (high - low) * rng.random::<f64>()) / self.config.prop_density.max(0.01);
            }
        }
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
                    let from_edge_m =
                        self.models.models[model].width_m() / 2.0 + 0.4 + 0.8 * rng.random::<f64>();
                    let at = strip.center.beside(station_m, side * (strip.width_m / 2.0 + from_edge_m));
                    let street_rad = strip.center.heading_rad(station_m);
                    let yaw_rad = if side < 0.0 { street_rad } else { street_rad + std::f64::consts::PI };
                    let is_on_grass = self.town.surface.paved_grid.clearance_m(at) > from_edge_m - 0.3;
                    let is_clear = self.is_off_buildings(at);
                    if is_on_grass && is_clear && self.is_near(at) && self.claim(model, at, yaw_rad, 0.3) {
                        self.put(model, at, GRASS_M, yaw_rad, Motion::Still, rng);
                    }
                    station_m +=
                        (low + (high - low) * rng.random::<f64>()) / self.config.prop_density.max(0.01);
                }
            }
        }
    }

    fn is_off_buildings(&self, point: Vec2) -> bool {
        !self.town.buildings.iter().any(|building| building.footprint.grown(0.5).contains(point))
    }

    /// A thing in the lane where no event could be.
    fn lay_in_lane(&mut self, route: &Route, station_m: f64) {
        let mut rng = random::stream(self.seed, "no-event", station_m.to_bits());
        let models = self.models.indices(Kind::Static, Distribution::Ood);
        let model = models[rng.random_range(0..models.len())];
        let half_lane_m = self.town.graph.lanes[route.span_at(station_m).lane].width_m / 2.0;
        let at = route.path.beside(station_m, -half_lane_m + rng.random::<f64>() * (half_lane_m - 0.3));
        let yaw_rad = std::f64::consts::TAU * rng.random::<f64>();
        if self.claim(model, at, yaw_rad, 0.3) {
            self.put(model, at, 0.0, yaw_rad, Motion::Still, &mut rng);
        }
    }

    /// Objects out of distribution along the route: some in the lane, most beside it. Returns the
    /// stations that are kept for events.
    fn place_ood(&mut self, route: &Route) -> Vec<f64> {
        let mut rng = random::stream(self.seed, "ood", 0);
        let mut event_rng = random::stream(self.seed, "event-stations", 0);
        let mut event_stations_m = Vec::new();
        let models = self.models.indices(Kind::Static, Distribution::Ood);
        if models.is_empty() {
            return event_stations_m;
        }
        let [low, high] = self.config.ood_spacing_m;
        let mut station_m = 22.0;
        while station_m < route.path.length_m() {
            station_m += low + (high - low) * rng.random::<f64>();
            let model = models[rng.random_range(0..models.len())];
            let half_m = self.models.models[model].width_m() / 2.0;
            let yaw_rad = std::f64::consts::TAU * rng.random::<f64>();
            let is_in_lane = rng.random::<f64>() < self.config.ood_in_lane_share;
            let (draw, side) = (rng.random::<f64>(), if rng.random_bool(0.65) { -1.0 } else { 1.0 });
            let mirror = -self.town.graph.kerb_sign();
            let span = route.span_at(station_m);
            let lane = &self.town.graph.lanes[span.lane];
            let from_ends_m = (station_m - span.start_m).min(span.end_m - station_m);
            if lane.junction.is_some() || from_ends_m < 7.0 {
                continue;
            }
            if event_rng.random::<f64>() < self.config.event_share {
                event_stations_m.push(station_m);
                continue;
            }
            let half_lane_m = lane.width_m / 2.0;
            let left_m = if is_in_lane {
                // The right part of the lane, so that the ego can pass on the left.
                -half_lane_m + draw * (half_lane_m - 0.3)
            } else if side < 0.0 {
                -half_lane_m - half_m - 0.2 - 1.8 * draw
            } else {
                3.0 * half_lane_m + half_m + 0.2 + 1.8 * draw
            };
            let at = route.path.beside(station_m, mirror * left_m);
            let clearance_m = self.town.surface.road_grid.clearance_m(at);
            // On the pavement or on the road, not half on the kerb.
            let z_m = if clearance_m > 0.0 { PAVEMENT_M } else { 0.0 };
            if self.claim(model, at, yaw_rad, 0.3) {
                self.put(model, at, z_m, yaw_rad, Motion::Still, &mut rng);
            }
        }
        event_stations_m
    }

    /// With the configured share, a vehicle ahead of the ego on its route.
    fn place_leader(&mut self, ego_route: &Route, moving: &mut Occupied, rng: &mut Rng) {
        if rng.random::<f64>() >= self.config.leader_share {
            return;
        }
        let weights = &self.town.config.traffic.vehicle_weights;
        let Some(model) = self.draw_model(Kind::Vehicle, weights, rng) else { return };
        let station_m = 16.0 + 14.0 * rng.random::<f64>();
        let (at, yaw_rad) = (ego_route.path.at(station_m), ego_route.path.heading_rad(station_m));
        let body = footprint_of(&self.models.models[model], at, yaw_rad);
        if self.occupied.is_free(&body, 0.3) && moving.claim(body, 0.2) {
            let route = ego_route.clone();
            self.put(model, at, 0.0, yaw_rad, Motion::Drives { route, station_m }, rng);
        }
    }

    fn place_traffic(&mut self, starts: &[usize], ego_center: Vec2, ego_route: &Route) {
        let mut rng = random::stream(self.seed, "traffic", 0);
        let traffic = &self.town.config.traffic;
        let wanted = (f64::from(traffic.n_vehicles) * self.config.traffic_density).round() as u32;
        let mut moving = Occupied::default();
        self.place_leader(ego_route, &mut moving, &mut rng);
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
                if is_free && self.occupied.is_free(&room, 0.3) && moving.claim(room, 0.2) {
                    let route = Route::random(&self.town.graph, lane, 1500.0, &mut rng);
                    self.put(model, at, 0.0, yaw_rad, Motion::Drives { route, station_m }, &mut rng);
                    break;
                }
            }
        }
    }

    fn place_pedestrians(&mut self) {
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
                    is_reckless: n % 4 == 0,
                };
                let yaw_rad = strip.center.heading_rad(station_m)
                    + if sense < 0.0 { std::f64::consts::PI } else { 0.0 };
                let body = Footprint { center: at, yaw_rad, length_m: 0.7, width_m: 0.7 };
                if self.occupied.claim(body, 0.2) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bus_shelter_opens_to_the_road_and_a_sign_faces_the_drivers() {
        let mut town = Town::load("downtown").unwrap();
        town.config.prop_weights = [("bus_shelter".to_owned(), 1.0), ("traffic_sign".to_owned(), 1.0)].into();
        let world = populate(&Arc::new(town), &PopulateConfig::default(), 2).unwrap();
        let (mut n_shelters, mut n_signs) = (0, 0);
        for placement in &world.placements {
            let model = &world.models.models[placement.model];
            let facing = Vec2::new(placement.yaw_rad.cos(), placement.yaw_rad.sin());
            let lanes = world.town.graph.lanes.iter();
            let lane = lanes
                .min_by(|a, b| {
                    let distance = |lane: &crate::scene::GraphLane| lane.path.distance_m(placement.position);
                    distance(a).total_cmp(&distance(b))
                })
                .unwrap();
            let (station_m, _) = lane.path.project(placement.position, 0.0, lane.path.length_m());
            if model.name == "bus_shelter" {
                let to_lane = lane.path.at(station_m) - placement.position;
                assert!(facing.dot(&to_lane.normalize()) > 0.9, "{} looks away", placement.id);
                n_shelters += 1;
            } else if model.name == "traffic_sign" && lane.junction.is_none() {
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
