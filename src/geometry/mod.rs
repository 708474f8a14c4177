//! Frames, transforms, boxes, the pinhole camera and polygon overlap: plain geometry, no IO.

mod boxes;
mod frames;
mod hull;
mod pinhole;
mod polygon;

pub use boxes::{Box3, BoxError};
pub use frames::{Camera, Ego, Frame, Lidar, Point, Transform, World};
pub use hull::convex_hull;
pub use pinhole::Pinhole;
pub use polygon::{
    Point2, convex_overlap_area, convex_signed_distance_m, distance_to_convex_m, polygon_area,
};
