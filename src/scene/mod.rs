//! Scenes: towns, object models, the filled world as MJCF, and how all that moves behaves.

mod buildings;
mod driver;
mod driving;
mod ego;
mod ground;
mod junctions;
mod lane_change;
mod lights;
mod mesh;
pub mod mjcf;
pub mod models;
mod network;
mod occupancy;
mod opendrive;
mod path;
mod populate;
mod route;
mod surface;
mod swerve;
mod textures;
mod town;
mod traffic;
mod walking;

pub use lights::{Aspect, Light, Lights};
pub use mjcf::{EgoCommand, Mjcf};
pub use ground::{Grid, Ground};
pub use network::{GraphLane, LaneGraph, Rank};
pub use occupancy::Footprint;
pub use path::{Path, Vec2};
pub use populate::{Motion, Placement, PopulateConfig, SceneObject, World, populate};
pub use route::{Route, Span};
pub use surface::Surface;
pub use town::{SceneError, Town, TownConfig, TrafficConfig, town_names};
pub use traffic::{Commands, EgoObservation, MocapPose, Traffic};
