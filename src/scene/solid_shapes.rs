//! Surfaces of random solids: superquadrics (Barr 1981), blobs, posts of odd cross-section, and things put together of
//! several. A mesh is a grid of longitude by latitude, drawn from a random stream.

use std::f64::consts::{PI, TAU};

use nalgebra::{UnitQuaternion, Vector3};
use rand::RngExt;

use crate::random::Rng;

/// Longitudes; the seam stands twice, as its texture ends there.
const N_AROUND: usize = 20;
/// Latitudes, both poles among them.
const N_UP: usize = 13;
/// Waves that deform a blob.
const N_WAVES: usize = 6;

/// A closed surface.
#[derive(Debug, Clone)]
pub(super) struct Surface {
    pub positions: Vec<Vector3<f64>>,
    /// Places in a texture, 0 to 1.
    pub places: Vec<[f64; 2]>,
    pub triangles: Vec<[u32; 3]>,
}

impl Surface {
    /// A grid over longitude (0 to 2 pi) and latitude (-pi/2 to pi/2).
    fn over_sphere(at: impl Fn(f64, f64) -> Vector3<f64>) -> Self {
        let (mut positions, mut places, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
        for row in 0..N_UP {
            for column in 0..=N_AROUND {
                let [u, v] = [column as f64 / N_AROUND as f64, row as f64 / (N_UP - 1) as f64];
                positions.push(at(TAU * u, PI * (v - 0.5)));
                places.push([u, v]);
            }
        }
        let index = |row: usize, column: usize| (row * (N_AROUND + 1) + column) as u32;
        for row in 0..N_UP - 1 {
            for column in 0..N_AROUND {
                let [a, b] = [index(row, column), index(row, column + 1)];
                let [c, d] = [index(row + 1, column), index(row + 1, column + 1)];
                // At a pole one of the two has no area.
                if row > 0 {
                    triangles.push([a, b, d]);
                }
                if row < N_UP - 2 {
                    triangles.push([a, d, c]);
                }
            }
        }
        Self { positions, places, triangles }
    }

    /// A superquadric of a given size: 0.2 makes a box of it, 1 an ellipsoid, 1.8 nearly an octahedron.
    pub fn superquadric(size_m: Vector3<f64>, [around, up]: [f64; 2]) -> Self {
        let power = |value: f64, exponent: f64| value.signum() * value.abs().powf(exponent);
        Self::over_sphere(|longitude, latitude| {
            let ring = power(latitude.cos(), up);
            let unit = Vector3::new(
                ring * power(longitude.cos(), around),
                ring * power(longitude.sin(), around),
                power(latitude.sin(), up),
            );
            unit.component_mul(&size_m) / 2.0
        })
    }

    /// An ellipsoid with dents and bumps.
    pub fn blob(size_m: Vector3<f64>, roughness: f64, rng: &mut Rng) -> Self {
        let waves: Vec<(Vector3<f64>, f64)> = (0..N_WAVES)
            .map(|_| {
                let direction = Vector3::from_fn(|_, _| 2.0 * rng.random::<f64>() - 1.0);
                (direction * (2.0 + 5.0 * rng.random::<f64>()), TAU * rng.random::<f64>())
            })
            .collect();
        Self::over_sphere(|longitude, latitude| {
            let unit = Vector3::new(
                latitude.cos() * longitude.cos(),
                latitude.cos() * longitude.sin(),
                latitude.sin(),
            );
            let of_waves: f64 = waves.iter().map(|(along, phase)| (along.dot(&unit) + phase).sin()).sum();
            unit.component_mul(&size_m) / 2.0 * (1.0 + roughness * of_waves / N_WAVES as f64).max(0.2)
        })
    }

    /// A post whose cross-section has corners, and changes from foot to top.
    pub fn post(size_m: Vector3<f64>, rng: &mut Rng) -> Self {
        let n_corners = f64::from(rng.random_range(3..8));
        let [sharpness, taper, twist] =
            [0.35 * rng.random::<f64>(), 1.6 * rng.random::<f64>() - 0.8, 2.0 * rng.random::<f64>() - 1.0];
        let belly = 0.5 * rng.random::<f64>();
        Self::over_sphere(|longitude, latitude| {
            let up = latitude / PI + 0.5;
            let corner = 1.0 + sharpness * ((longitude + twist * up) * n_corners).cos();
            let ring = latitude.cos().powf(0.15) * corner / (1.0 + sharpness);
            let width = (1.0 + taper * (up - 0.5)) * (1.0 + belly * (PI * up).sin()) / (1.5 + belly);
            Vector3::new(
                ring * width * longitude.cos() * size_m.x / 2.0,
                ring * width * longitude.sin() * size_m.y / 2.0,
                (up - 0.5) * size_m.z,
            )
        })
    }

    pub fn placed(mut self, turn: &UnitQuaternion<f64>, shift: Vector3<f64>) -> Self {
        for position in &mut self.positions {
            *position = turn * *position + shift;
        }
        self
    }

    /// Lowest and highest corner of the bound.
    pub fn bounds(&self) -> [Vector3<f64>; 2] {
        let fold = |f: fn(f64, f64) -> f64| {
            self.positions.iter().copied().reduce(|a, b| a.zip_map(&b, f)).unwrap_or_default()
        };
        [fold(f64::min), fold(f64::max)]
    }

    /// Enclosed volume, by the divergence theorem.
    pub fn volume_m3(&self) -> f64 {
        let at = |i: u32| self.positions[i as usize];
        let sixth = |&[a, b, c]: &[u32; 3]| at(a).dot(&at(b).cross(&at(c))) / 6.0;
        self.triangles.iter().map(sixth).sum::<f64>().abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_surfaces_close_around_the_volumes_of_known_solids() {
        let size_m = Vector3::new(2.0, 1.0, 0.6);
        let ball = Surface::superquadric(size_m, [1.0, 1.0]).volume_m3();
        let wanted = PI / 6.0 * 2.0 * 1.0 * 0.6;
        assert!((ball - wanted).abs() < 0.06 * wanted, "{ball} of {wanted}");
        let brick = Surface::superquadric(size_m, [0.1, 0.1]).volume_m3();
        assert!((1.0..1.21).contains(&brick), "{brick} of 1.2");
        let smooth = Surface::blob(size_m, 0.0, &mut crate::random::stream(1, "blob", 0));
        assert!((smooth.volume_m3() - ball).abs() < 1e-9);
    }

    #[test]
    fn every_triangle_but_those_at_poles_looks_outwards() {
        let of = Surface::post(Vector3::new(1.0, 1.0, 2.0), &mut crate::random::stream(1, "post", 0));
        for corners in &of.triangles {
            let [a, b, c] = corners.map(|i| of.positions[i as usize]);
            let normal = (b - a).cross(&(c - a));
            let middle = (a + b + c) / 3.0;
            assert!(
                normal.norm() < 1e-9 || normal.dot(&Vector3::new(middle.x, middle.y, 0.2 * middle.z)) > -1e-6
            );
        }
    }
}
