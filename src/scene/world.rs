//! A filled town: everything that stands and moves in it, and where the ego sets out.

use std::sync::Arc;

use nalgebra::Point3;

use super::bounds::Bounds;
use super::dash::Dash;
use super::facing::is_plant;
use super::loose::{Loose, Perch};
use super::models::{Model, Role};
use super::occupancy::Footprint;
use super::path::{Path, Vec2, rotate};
use super::route::Route;
use super::surface::Surface;
use super::tilt::Tilt;
use super::town::Town;
use crate::object::{Distribution, Event, Kind, Spot};

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
    /// Goes back across soon.
    pub is_restless: bool,
}

/// A place that moves with another placement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beside {
    /// Number of the placement that leads.
    pub leader: usize,
    pub forward_m: f64,
    pub left_m: f64,
    /// Turns with the leader, as what is pushed does; people take their own way.
    pub is_stiff: bool,
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
    Follows(Beside),
    /// Stands until the ego comes, then goes its way.
    Dashes(Box<Dash>),
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
    /// If it lies on a side.
    pub tilt: Option<Tilt>,
    /// Where it was put, if it is out of distribution.
    pub spot: Spot,
    /// Number among the mocap bodies, for moving objects; the bodies of its looks come next.
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
    /// In the model frame.
    pub bounds: Bounds,
    /// Of the part that something could hit.
    pub solid: Bounds,
    pub triangles: Arc<Vec<[Point3<f32>; 3]>>,
    /// The same for each look of a thing that changes its shape; empty for all others.
    pub shapes: Vec<Arc<Vec<[Point3<f32>; 3]>>>,
    pub reflectivity: f64,
    pub event: Event,
    pub spot: Spot,
    pub is_tipped: bool,
    /// Never annotated: plants teach detectors what is no object; of heaps the ground is ignored.
    pub is_background: bool,
}

/// A filled town, ready to be simulated.
#[derive(Debug, Clone)]
pub struct World {
    pub town: Arc<Town>,
    pub models: Arc<[Model]>,
    pub placements: Vec<Placement>,
    pub ego_route: Route,
    /// Where on the route the ego's rear axle starts.
    pub ego_start_m: f64,
    /// Placements that are traffic lights, with the town's light each one is.
    pub lamp_posts: Vec<(usize, usize)>,
    pub(super) objects: Vec<SceneObject>,
    pub(super) perches: Vec<Perch>,
    /// Placements that the ego's driver notices late, each with the braking that stopping before it then takes, m/s².
    pub late_notices: Vec<(usize, f64)>,
}

impl World {
    /// Things that an event sets free, each with its number among objects and placements.
    pub fn loose(&self) -> impl Iterator<Item = (usize, &Loose)> {
        self.placements.iter().enumerate().filter_map(|(i, placement)| match &placement.motion {
            Motion::Loose(loose) => Some((i, loose.as_ref())),
            _ => None,
        })
    }

    /// Balconies that events add.
    pub fn perches(&self) -> &[Perch] {
        &self.perches
    }

    pub fn objects(&self) -> &[SceneObject] {
        &self.objects
    }

    /// Footprint of a placement at its start, of its part below a car's roof: for a tree, the trunk.
    pub fn footprint(&self, placement: &Placement) -> Footprint {
        let bounds = placement.tilt.as_ref().map_or(&self.models[placement.model].solid, |tilt| &tilt.bounds);
        plan_of(bounds, placement.position, placement.yaw_rad)
    }

    /// Start pose of the ego: x, y, yaw of the rear axle.
    pub fn ego_start(&self) -> (Vec2, f64) {
        let path = &self.ego_route.path;
        (path.at(self.ego_start_m), path.heading_rad(self.ego_start_m))
    }
}

impl SceneObject {
    /// Background that stops a car: bags, crates, a rack for bicycles. It is akin to what is annotated.
    pub fn is_heap(&self) -> bool {
        self.is_background && !is_plant(&self.category)
    }

    /// Name of the body that shows one of its looks.
    pub fn shape_body_name(&self, shape: usize) -> String {
        format!("{}/{shape}", self.body_name)
    }

    /// What can be seen of it while it has the given look.
    pub fn triangles_as(&self, shape: usize) -> &[[Point3<f32>; 3]] {
        self.shapes.get(shape).unwrap_or(&self.triangles)
    }

    pub(super) fn new(placement: &Placement, model: &Model, surface: &Surface) -> Self {
        Self {
            id: placement.id.clone(),
            category: model.facts.category.clone(),
            kind: model.facts.kind,
            distribution: model.facts.distribution,
            body_name: format!("obj:{}", placement.id),
            bounds: model.bounds,
            solid: model.solid,
            triangles: Arc::clone(&model.triangles),
            shapes: model.shapes.iter().map(|shape| Arc::clone(&shape.triangles)).collect(),
            reflectivity: model.facts.reflectivity,
            event: match &placement.motion {
                Motion::Loose(loose) => loose.event,
                _ if !model.is_strange() => Event::None,
                _ if surface.road_grid.clearance_m(placement.position) > 0.0 => Event::None,
                _ => Event::Lies,
            },
            spot: placement.spot,
            is_tipped: placement.tilt.is_some(),
            is_background: model.facts.role == Role::Background,
        }
    }
}

/// The ground that a model takes.
pub(super) fn footprint_of(model: &Model, position: Vec2, yaw_rad: f64) -> Footprint {
    plan_of(&model.solid, position, yaw_rad)
}

/// The ground that bounds take, the model's origin at a position.
pub(super) fn plan_of([low, high]: &Bounds, position: Vec2, yaw_rad: f64) -> Footprint {
    let (x, y) = (f64::midpoint(low.x, high.x), f64::midpoint(low.y, high.y));
    let center = position + rotate(x, y, yaw_rad);
    Footprint { center, yaw_rad, length_m: high.x - low.x, width_m: high.y - low.y }
}
