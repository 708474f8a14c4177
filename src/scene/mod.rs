//! Scenes: towns, object models, the filled world as MJCF, and how all that moves behaves.

mod buildings;
mod driving;
mod ego;
mod event_scenery;
mod events;
mod junctions;
mod mesh;
pub mod mjcf;
pub mod models;
mod network;
mod occupancy;
mod path;
mod populate;
mod route;
mod surface;
mod swerve;
mod textures;
mod town;
mod traffic;
mod walking;

pub use event_scenery::Balcony;
pub use events::Loose;
pub use mjcf::{EgoCommand, Lighting, Mjcf, Sun};
pub use network::{GraphLane, LaneGraph};
pub use occupancy::Footprint;
pub use path::{Path, Vec2};
pub use populate::{Motion, Placement, PopulateConfig, SceneObject, World, populate};
pub use route::{Route, Span};
pub use surface::Surface;
pub use town::{SceneError, Town, TownConfig, TrafficConfig, town_names};
pub use traffic::{Commands, EgoObservation, MocapPose, Traffic};
