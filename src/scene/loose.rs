//! What events add to a world: bodies that are held until the ego comes, how they start, and balconies for them.
//!
//! A flight is a parabola: `z(t) = z0 + vz t - g t^2 / 2`.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::RngExt;

use super::models::{Model, RollAxis};
use super::path::{Vec2, direction_of};
use crate::object::Event;
use crate::random::Rng;

const GRAVITY_MPS2: f64 = 9.81;

/// A free body that is held until the ego comes near.
#[derive(Debug, Clone, PartialEq)]
pub struct Loose {
    pub event: Event,
    /// Where it is held.
    pub world_from_model: Isometry3<f64>,
    /// The aim: where it comes down, or crosses the ego's lane.
    pub aim: Vec2,
    /// It is let go when the ego's rear axle is nearer to the aim than this.
    pub release_m: f64,
    /// Velocity of the centre of mass when it is let go, in the world frame.
    pub linear_mps: Vector3<f64>,
    pub angular_rps: Vector3<f64>,
}

/// A balcony that an event adds where a building has none: a slab on a wall with a parapet.
#[derive(Debug, Clone, PartialEq)]
pub struct Perch {
    /// On the wall, under the middle of the slab.
    pub foot: Vec2,
    /// Away from the wall.
    pub out_rad: f64,
    /// Top of the slab.
    pub floor_m: f64,
}

impl Perch {
    pub const DEPTH_M: f64 = 1.0;
    pub const WIDTH_M: f64 = 2.2;
    pub const SLAB_M: f64 = 0.14;
    pub const PARAPET_M: f64 = 0.85;
    pub const PARAPET_WIDTH_M: f64 = 0.22;

    pub fn out(&self) -> Vec2 {
        direction_of(self.out_rad)
    }

    /// The middle of the parapet's top.
    pub fn ledge(&self) -> (Vec2, f64) {
        (
            self.foot + self.out() * (Self::DEPTH_M - Self::PARAPET_WIDTH_M / 2.0),
            self.floor_m + Self::PARAPET_M,
        )
    }

    /// Its parts as boxes: centre (x outwards, y along the wall, z), and half sizes.
    pub fn boxes(&self) -> [([f64; 3], [f64; 3]); 4] {
        let (depth, width, wall) = (Self::DEPTH_M / 2.0, Self::WIDTH_M / 2.0, Self::PARAPET_WIDTH_M / 2.0);
        let middle = self.floor_m + Self::PARAPET_M / 2.0;
        let half_m = Self::PARAPET_M / 2.0;
        let cheek = 0.05;
        [
            ([depth, 0.0, self.floor_m - Self::SLAB_M / 2.0], [depth, width, Self::SLAB_M / 2.0]),
            ([2.0 * depth - wall, 0.0, middle], [wall, width, half_m]),
            ([depth - wall, width - cheek, middle], [depth - wall, cheek, half_m]),
            ([depth - wall, cheek - width, middle], [depth - wall, cheek, half_m]),
        ]
    }
}

/// Velocity and time of a flight that starts with `vz_mps` upwards and comes down on the road.
pub fn throw((from, from_m): (Vec2, f64), to: Vec2, vz_mps: f64) -> (Vector3<f64>, f64) {
    let time_s = (vz_mps + (vz_mps * vz_mps + 2.0 * GRAVITY_MPS2 * from_m).sqrt()) / GRAVITY_MPS2;
    let level = (to - from) / time_s;
    (Vector3::new(level.x, level.y, vz_mps), time_s)
}

/// Upright at a place, turned by a yaw.
pub fn standing(at: Vec2, z_m: f64, yaw_rad: f64) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad);
    Isometry3::from_parts(Translation3::new(at.x, at.y, z_m), turn)
}

/// On its round side, the axis along a heading; a model that is not round stands.
pub fn lying(model: &Model, at: Vec2, z_m: f64, heading_rad: f64) -> Isometry3<f64> {
    match model.facts.rolls {
        // The model's y runs along the heading.
        Some(RollAxis::Y) => standing(at, z_m, heading_rad - std::f64::consts::FRAC_PI_2),
        Some(RollAxis::Z) => {
            // The model's z is laid along the heading; its middle comes over the point.
            let about_y = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
            let about_z = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading_rad);
            let turn = about_z * about_y;
            let back = turn * Vector3::new(0.0, 0.0, model.height_m() / 2.0);
            let at = Vector3::new(at.x, at.y, z_m + rolling_radius_m(model)) - back;
            Isometry3::from_parts(Translation3::from(at), turn)
        }
        None => standing(at, z_m, heading_rad),
    }
}

/// Height of the axle when it rolls or tumbles.
pub fn rolling_radius_m(model: &Model) -> f64 {
    match model.facts.rolls {
        Some(RollAxis::Y) => model.height_m() / 2.0,
        Some(RollAxis::Z) => model.length_m().max(model.width_m()) / 2.0,
        None => model.height_m().max(model.width_m()) / 2.0,
    }
}

/// A unit vector, evenly over the sphere.
pub fn any_direction(rng: &mut Rng) -> Vector3<f64> {
    let (z, turn) = (2.0 * rng.random::<f64>() - 1.0, std::f64::consts::TAU * rng.random::<f64>());
    let r = (1.0 - z * z).sqrt();
    Vector3::new(r * turn.cos(), r * turn.sin(), z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thrown_thing_comes_down_on_its_aim() {
        let to = Vec2::new(3.0, -4.0);
        let (velocity, time_s) = throw((Vec2::zeros(), 5.0), to, 2.0);
        assert!((velocity.xy() * time_s - to).norm() < 1e-12);
        assert!((5.0 + 2.0 * time_s - GRAVITY_MPS2 * time_s * time_s / 2.0).abs() < 1e-12);
    }
}
