//! Scenes: towns, object models, the filled world as MJCF, and how all that moves behaves.

mod buildings;
mod crosswalks;
mod driving;
mod ego;
mod ground;
mod junctions;
mod mesh;
pub mod mjcf;
pub mod models;
mod network;
mod occupancy;
mod opendrive;
mod path;
mod plots;
mod populate;
mod route;
mod scenery;
mod surface;
mod swerve;
mod textures;
mod town;
mod town_config;
mod traffic;
mod walking;

pub use buildings::{Balcony, Building};
pub use mjcf::{EgoCommand, Mjcf};
pub use ground::{Grid, Ground};
pub use network::{GraphLane, LaneGraph, Rank};
pub use occupancy::Footprint;
pub use path::{Path, Vec2};
pub use populate::{Motion, Placement, PopulateConfig, SceneObject, World, populate};
pub use route::{Route, Span};
pub use surface::Surface;
pub use town::{SceneError, Town, town_names};
pub use town_config::{TownConfig, TrafficConfig};
pub use traffic::{Commands, EgoObservation, MocapPose, Traffic};
