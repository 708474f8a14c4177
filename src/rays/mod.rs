//! Rays of our own: what the beams of a sensor meet first in a world.
//!
//! A [`RayScene`] is made once of all that can be seen ([`Visible`]). Triangles of bodies that stand lie in one tree in the
//! world's frame, those of each body that moves in one of its own frame, and a small tree over the parts is made anew
//! when poses are set. Rays of a sensor have one origin. They go through the trees in packets of neighbours: a node is
//! compared with the pyramid around a packet, a triangle with all its rays. That search is in f32, relative to the
//! origin; range and angle of what was found follow in f64 from the geom's own numbers.
//!
//! The meaning is that of MuJoCo's `mj_multiRay`: both sides of a triangle are met, a ray that starts inside of a thing
//! meets it from within, planes are met from the front only.

#![allow(
    clippy::inline_always,
    reason = "a kernel must be inlined into the function that enables its instruction set"
)]
#![allow(clippy::needless_bitwise_bool, reason = "a lane has no branches")]
#![allow(clippy::needless_range_loop, reason = "loops over lanes, which become vectors")]

mod beams;
mod cast;
mod frustum;
mod packet;
mod scene;
mod solid;
mod tree;
mod visible;

#[cfg(test)]
mod tests;

pub use beams::Beams;
pub use cast::RayHits;
pub use scene::RayScene;
pub use solid::Solid;
pub use visible::{Visible, VisibleGeom, VisibleMesh};
