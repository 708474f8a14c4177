//! Coordinate frames as types, points in them, and rigid transforms between them.
//!
//! `World`, `Ego`, `Lidar`: x forward (east for the world), y left, z up. `Camera`: x right, y down,
//! z forward. Ego origin: the rear-axle centre projected to the ground. Metres and radians.
//! `docs/conventions.md` draws the axes.

use std::marker::PhantomData;
use std::ops::Mul;

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// A coordinate frame; `NAME` is its MCAP `frame_id`.
pub trait Frame: Copy + std::fmt::Debug + 'static {
    const NAME: &'static str;
}

macro_rules! frame {
    ($(#[$doc:meta])* $name:ident, $id:literal) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub struct $name;
        impl Frame for $name {
            const NAME: &'static str = $id;
        }
    };
}

frame!(
    /// The town: fixed, z up, ground at z = 0 where the town is flat.
    World, "map"
);
frame!(
    /// The ego car: x forward, y left, z up; origin at the rear-axle centre on the ground.
    Ego, "ego"
);
frame!(
    /// The LiDAR: x forward, y left, z up; origin at the beam origin.
    Lidar, "lidar_top"
);
frame!(
    /// The front camera, optical axes: x right, y down, z forward.
    Camera, "cam_front"
);

/// A point in metres in frame `F`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point<F: Frame> {
    pub coords: Point3<f64>,
    frame: PhantomData<F>,
}

impl<F: Frame> Point<F> {
    #[must_use]
    pub fn new(x_m: f64, y_m: f64, z_m: f64) -> Self {
        Self::from_coords(Point3::new(x_m, y_m, z_m))
    }

    #[must_use]
    pub fn from_coords(coords: Point3<f64>) -> Self {
        Self { coords, frame: PhantomData }
    }

    #[must_use]
    pub fn x(&self) -> f64 {
        self.coords.x
    }

    #[must_use]
    pub fn y(&self) -> f64 {
        self.coords.y
    }

    #[must_use]
    pub fn z(&self) -> f64 {
        self.coords.z
    }
}

/// The rigid transform from coordinates in `From` to coordinates in `To`.
///
/// Name values `<to>_from_<from>`: the inner names of a product meet.
///
/// ```
/// use harmzone::geometry::{Ego, Lidar, Point, Transform, World};
///
/// let world_from_ego = Transform::<World, Ego>::from_xyz_yaw(100.0, 50.0, 0.0, 0.0);
/// let ego_from_lidar = Transform::<Ego, Lidar>::from_xyz_yaw(0.9, 0.0, 1.8, 0.0);
/// let world_from_lidar = world_from_ego * ego_from_lidar; // swapped factors do not compile
/// let point_in_world = world_from_lidar * Point::new(10.0, 0.0, -1.8);
/// assert_eq!((point_in_world.x(), point_in_world.y()), (110.9, 50.0));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transform<To: Frame, From: Frame> {
    pub isometry: Isometry3<f64>,
    frames: PhantomData<(To, From)>,
}

impl<To: Frame, From: Frame> Transform<To, From> {
    #[must_use]
    pub fn from_isometry(isometry: Isometry3<f64>) -> Self {
        Self { isometry, frames: PhantomData }
    }

    #[must_use]
    pub fn new(translation_m: Vector3<f64>, rotation: UnitQuaternion<f64>) -> Self {
        Self::from_isometry(Isometry3::from_parts(Translation3::from(translation_m), rotation))
    }

    /// A pose on the plane: translation in metres and a yaw about +z in radians.
    #[must_use]
    pub fn from_xyz_yaw(x_m: f64, y_m: f64, z_m: f64, yaw_rad: f64) -> Self {
        Self::new(Vector3::new(x_m, y_m, z_m), UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad))
    }

    #[must_use]
    pub fn inverse(&self) -> Transform<From, To> {
        Transform::from_isometry(self.isometry.inverse())
    }

    /// Rotates a direction or velocity, without the translation.
    #[must_use]
    pub fn rotate(&self, vector_in_from: &Vector3<f64>) -> Vector3<f64> {
        self.isometry.rotation * vector_in_from
    }

    /// Heading of `From`'s x axis about `To`'s z axis, in (-pi, pi].
    #[must_use]
    pub fn yaw_rad(&self) -> f64 {
        let x_axis = self.isometry.rotation * Vector3::x();
        x_axis.y.atan2(x_axis.x)
    }
}

impl<To: Frame> Transform<To, Camera> {
    /// A camera at `position_m` that looks along `To`'s x axis, turned down by `pitch_rad`.
    #[must_use]
    pub fn looking_forward(position_m: Vector3<f64>, pitch_rad: f64) -> Self {
        Self::looking_along(position_m, 0.0, pitch_rad, 0.0)
    }

    /// As [`Self::looking_forward`], then turned left by `yaw_rad`; its right side is lowered by `roll_rad` first.
    #[must_use]
    pub fn looking_along(position_m: Vector3<f64>, yaw_rad: f64, pitch_rad: f64, roll_rad: f64) -> Self {
        // Columns: the camera's right, down and forward axes in an x-forward, y-left, z-up frame.
        let axes = Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
        let turn = Rotation3::from_euler_angles(roll_rad, pitch_rad, yaw_rad);
        let rotation = turn * Rotation3::from_matrix_unchecked(axes);
        Self::new(position_m, UnitQuaternion::from_rotation_matrix(&rotation))
    }
}

impl<A: Frame, B: Frame, C: Frame> Mul<Transform<B, C>> for Transform<A, B> {
    type Output = Transform<A, C>;

    fn mul(self, rhs: Transform<B, C>) -> Self::Output {
        Transform::from_isometry(self.isometry * rhs.isometry)
    }
}

impl<To: Frame, From: Frame> Mul<Point<From>> for Transform<To, From> {
    type Output = Point<To>;

    fn mul(self, rhs: Point<From>) -> Self::Output {
        Point::from_coords(self.isometry * rhs.coords)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn camera_looking_forward_sees_what_is_ahead_on_its_optical_axis() {
        let ego_from_camera: Transform<Ego, Camera> =
            Transform::looking_forward(Vector3::new(1.5, 0.0, 1.6), 0.0);
        let ahead: Point<Camera> = ego_from_camera.inverse() * Point::<Ego>::new(11.5, 0.0, 1.6);
        assert!((ahead.coords - Point3::new(0.0, 0.0, 10.0)).norm() < 1e-12);
        let left_low: Point<Camera> = ego_from_camera.inverse() * Point::<Ego>::new(11.5, 2.0, 0.6);
        assert!((left_low.coords - Point3::new(-2.0, 1.0, 10.0)).norm() < 1e-12);
    }

    #[test]
    fn positive_pitch_turns_the_camera_to_the_ground() {
        let ego_from_camera: Transform<Ego, Camera> = Transform::looking_forward(Vector3::zeros(), 0.1);
        assert!(ego_from_camera.rotate(&Vector3::z()).z < 0.0);
    }

    proptest! {
        #[test]
        fn a_transform_and_its_inverse_cancel(
            x in -1e3..1e3, y in -1e3..1e3, yaw in -3.1..3.1, px in -1e2..1e2, py in -1e2..1e2,
        ) {
            let world_from_ego = Transform::<World, Ego>::from_xyz_yaw(x, y, 0.3, yaw);
            let point_in_ego = Point::<Ego>::new(px, py, 1.0);
            let back = world_from_ego.inverse() * (world_from_ego * point_in_ego);
            prop_assert!((back.coords - point_in_ego.coords).norm() < 1e-9);
            prop_assert!((world_from_ego.yaw_rad() - yaw).abs() < 1e-12);
        }
    }
}
