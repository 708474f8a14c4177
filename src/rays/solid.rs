//! The kinds of solids that geoms are, and where a ray first meets one, exactly.
//!
//! Everything here is in the geom's own frame, as MuJoCo has it: planes face +z, capsules and cylinders stand along z,
//! sizes are half lengths. A ray that starts inside meets the surface from within; planes are met from the front only.

use nalgebra::Vector3;

/// The shape of a geom; lengths in metres.
#[derive(Debug, Clone, PartialEq)]
pub enum Solid {
    /// A rectangle; a half length of zero is endless.
    Plane {
        half: [f64; 2],
    },
    Sphere {
        radius: f64,
    },
    Capsule {
        radius: f64,
        half: f64,
    },
    Ellipsoid {
        radii: [f64; 3],
    },
    Cylinder {
        radius: f64,
        half: f64,
    },
    Box {
        half: [f64; 3],
    },
    /// Index of its mesh.
    Mesh(usize),
}

/// Where a ray meets a surface: distance in lengths of the direction, and the normal there, of any length and side.
pub(super) type Meeting = (f64, Vector3<f64>);

/// Below this, MuJoCo takes lengths and determinants for zero.
const TINY: f64 = 1e-15;

impl Solid {
    /// Half lengths of the smallest box around it, which is centred on the geom's origin; `None` for planes and meshes.
    pub(super) fn half_extent(&self) -> Option<[f64; 3]> {
        Some(match *self {
            Self::Plane { .. } | Self::Mesh(_) => return None,
            Self::Sphere { radius } => [radius; 3],
            Self::Capsule { radius, half } => [radius, radius, half + radius],
            Self::Ellipsoid { radii } => radii,
            Self::Cylinder { radius, half } => [radius, radius, half],
            Self::Box { half } => half,
        })
    }

    /// Where a ray first meets it; for meshes see [`meet_triangle`].
    pub(super) fn meet(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Meeting> {
        match *self {
            Self::Plane { half } => meet_plane(half, origin, direction),
            Self::Sphere { radius } => meet_ellipsoid([radius; 3], origin, direction),
            Self::Ellipsoid { radii } => meet_ellipsoid(radii, origin, direction),
            Self::Capsule { radius, half } => {
                let side = meet_tube(radius, half, origin, direction);
                let cap = |end: f64| {
                    let shift = Vector3::z() * end * half;
                    roots_of_ball([radius; 3], &(origin - shift), direction).into_iter().find_map(|t| {
                        let at = origin + direction * t;
                        (t >= 0.0 && at.z * end >= half).then(|| (t, at - shift))
                    })
                };
                nearest([side, cap(1.0), cap(-1.0)])
            }
            Self::Cylinder { radius, half } => {
                let lid = |end: f64| {
                    let t = (end * half - origin.z) / direction.z;
                    let at = origin + direction * t;
                    let is_met =
                        direction.z.abs() > TINY && t >= 0.0 && at.xy().norm_squared() <= radius * radius;
                    is_met.then(|| (t, Vector3::z()))
                };
                nearest([meet_tube(radius, half, origin, direction), lid(1.0), lid(-1.0)])
            }
            Self::Box { half } => {
                let faces = [0, 1, 2].into_iter().flat_map(|axis| [(axis, -1.0), (axis, 1.0)]);
                nearest(faces.map(|(axis, side): (usize, f64)| {
                    let t = (side * half[axis] - origin[axis]) / direction[axis];
                    let at = origin + direction * t;
                    let is_within = |other: usize| other == axis || at[other].abs() <= half[other];
                    let is_met = direction[axis].abs() > TINY && t >= 0.0 && (0..3).all(is_within);
                    is_met.then(|| (t, Vector3::ith(axis, 1.0)))
                }))
            }
            Self::Mesh(_) => None,
        }
    }
}

fn nearest(meetings: impl IntoIterator<Item = Option<Meeting>>) -> Option<Meeting> {
    meetings.into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0))
}

/// Solutions of a t^2 + 2 b t + c = 0, rising; none where there is at most one.
fn roots(a: f64, b: f64, c: f64) -> [f64; 2] {
    let determinant = b * b - a * c;
    if determinant < TINY {
        return [-1.0; 2];
    }
    let root = determinant.sqrt();
    [(-b - root) / a, (-b + root) / a]
}

fn meet_plane(half: [f64; 2], origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Meeting> {
    if direction.z > -TINY {
        return None;
    }
    let t = -origin.z / direction.z;
    let at = origin + direction * t;
    let is_within = |axis: usize| half[axis] <= 0.0 || at[axis].abs() <= half[axis];
    (t >= 0.0 && is_within(0) && is_within(1)).then(|| (t, Vector3::z()))
}

fn roots_of_ball(radii: [f64; 3], origin: &Vector3<f64>, direction: &Vector3<f64>) -> [f64; 2] {
    let scale = Vector3::from(radii.map(|radius| 1.0 / radius));
    let (o, d) = (origin.component_mul(&scale), direction.component_mul(&scale));
    roots(d.norm_squared(), o.dot(&d), o.norm_squared() - 1.0)
}

fn meet_ellipsoid(radii: [f64; 3], origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Meeting> {
    let t = roots_of_ball(radii, origin, direction).into_iter().find(|&t| t >= 0.0)?;
    let scale = Vector3::from(radii.map(|radius| 1.0 / (radius * radius)));
    Some((t, (origin + direction * t).component_mul(&scale)))
}

/// The round side of a cylinder.
fn meet_tube(radius: f64, half: f64, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Meeting> {
    let (o, d) = (origin.xy(), direction.xy());
    let both = roots(d.norm_squared(), o.dot(&d), o.norm_squared() - radius * radius);
    both.into_iter().find_map(|t| {
        let at = origin + direction * t;
        (t >= 0.0 && at.z.abs() <= half).then(|| (t, Vector3::new(at.x, at.y, 0.0)))
    })
}

/// Where a ray meets the plane of a triangle, of which it is known that it is met.
pub(super) fn meet_triangle(
    [a, b, c]: [Vector3<f64>; 3],
    origin: &Vector3<f64>,
    direction: &Vector3<f64>,
) -> Option<Meeting> {
    let normal = (b - a).cross(&(c - a));
    let t = normal.dot(&(a - origin)) / normal.dot(direction);
    (t >= 0.0).then_some((t, normal))
}
