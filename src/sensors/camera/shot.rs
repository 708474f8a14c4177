//! The camera's input for one picture: the renderer's images, and the car and the lamps at that time.

use image::RgbImage;
use nalgebra::Point3;

use crate::geometry::{Ego, Transform, World};

/// What a pixel shows, as far as light and water depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Material {
    #[default]
    Sky,
    /// Road, pavement, paint: flat ground on which water stands.
    Paved,
    Solid,
    /// A wall whose lit windows shine at night.
    Facade,
    /// Lamps of other vehicles, lit after sunset.
    Headlamp,
    Taillamp,
    /// A signal that shines by itself at any time.
    Signal,
}

/// The renderer's output for one picture; rows from the top.
#[derive(Debug, Clone, Copy)]
pub struct Rendered<'a> {
    pub rgb: &'a RgbImage,
    /// Along the optical axis, metres; infinite for the sky.
    pub depth_m: &'a [f32],
    pub material: &'a [Material],
}

/// Where the car is while it takes a picture.
#[derive(Debug, Clone, Copy)]
pub struct Shot<'a> {
    pub world_from_ego: Transform<World, Ego>,
    /// Speed of the car, along its x axis.
    pub speed_mps: f64,
    /// All lamps that could light the view.
    pub lamps: &'a [StreetLamp],
    pub sample_idx: u64,
}

/// A lamp over the street.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StreetLamp {
    pub position_in_world: Point3<f64>,
}
