//! What of a footprint lies before the bumper, and in the strip that the car is about to drive over.

use nalgebra::Vector2;

use super::config::ReflexConfig;
use crate::geometry::{Box3, Ego};

/// Points along an edge of a footprint at which its distance is measured, corners included.
const N_ON_EDGE: usize = 17;

impl ReflexConfig {
    /// Whether any of a footprint lies in the strip right before the bumper.
    pub(super) fn is_near(&self, of: &Box3<Ego>, front_bumper_x_m: f64) -> bool {
        let is_near = |point: &Vector2<f64>| point.x <= self.near_m && point.y.abs() <= self.half_width_m;
        ahead_of(of, front_bumper_x_m).iter().any(is_near)
    }
}

/// Points of a footprint's edges that lie before the bumper, as seen from its middle.
pub(super) fn ahead_of(of: &Box3<Ego>, front_bumper_x_m: f64) -> Vec<Vector2<f64>> {
    let corners = of.footprint();
    let edges = corners.iter().zip(corners.iter().cycle().skip(1));
    let points = edges.flat_map(|(from, to)| {
        (0..N_ON_EDGE).map(move |i| {
            let share = i as f64 / (N_ON_EDGE - 1) as f64;
            let (x_m, y_m) = (from.x_m + share * (to.x_m - from.x_m), from.y_m + share * (to.y_m - from.y_m));
            Vector2::new(x_m - front_bumper_x_m, y_m)
        })
    });
    points.filter(|point| point.x > 0.0).collect()
}
