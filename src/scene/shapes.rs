//! Solids of the static scene in the frame of a rectangle on the ground: beams, prisms, towers and gabled houses.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::mesh::TriangleMesh;
use super::occupancy::Footprint;

/// A rectangle on the ground and a level: x along its length, y to the left, z over the level.
#[derive(Debug, Clone, Copy)]
pub struct Site {
    pub footprint: Footprint,
    pub base_m: f64,
}

impl Site {
    pub fn at(&self, x: f64, y: f64, z: f64) -> [f64; 3] {
        let place = self.footprint.at(x, y);
        [place.x, place.y, self.base_m + z]
    }

    /// An upright box by its middle and sizes.
    pub fn add_box(&self, mesh: &mut TriangleMesh, [x, y, z]: [f64; 3], size_m: [f64; 3]) {
        mesh.add_box(self.at(x, y, z), self.footprint.yaw_rad, size_m);
    }

    /// A beam of a square section between two points.
    pub fn add_beam(&self, mesh: &mut TriangleMesh, from: [f64; 3], to: [f64; 3], side_m: f64) {
        let (from, to) = (Vector3::from(from), Vector3::from(to));
        let along = (to - from).normalize();
        let aside = if along.z.abs() > 0.9 { Vector3::x() } else { Vector3::z() };
        let right = along.cross(&aside).normalize() * (side_m / 2.0);
        let up = right.cross(&along).normalize() * (side_m / 2.0);
        let ring = [right - up, right + up, -right + up, -right - up];
        let length_m = (to - from).norm();
        let at = |point: Vector3<f64>| self.at(point.x, point.y, point.z);
        for i in 0..4 {
            let (a, b) = (ring[i], ring[(i + 1) % 4]);
            mesh.add_polygon(&[
                (at(from + b), [0.0, side_m]),
                (at(from + a), [0.0, 0.0]),
                (at(to + a), [length_m, 0.0]),
                (at(to + b), [length_m, side_m]),
            ]);
        }
        let end = |middle: Vector3<f64>, order: [usize; 4]| {
            order.map(|i| (at(middle + ring[i]), [ring[i].x + ring[i].y, ring[i].z]))
        };
        mesh.add_polygon(&end(from, [0, 1, 2, 3]));
        mesh.add_polygon(&end(to, [3, 2, 1, 0]));
    }

    /// Walls over an outline, counter-clockwise from above, and its top if it has one.
    pub fn add_prism(&self, mesh: &mut TriangleMesh, outline: &[[f64; 2]], [low_m, high_m]: [f64; 2]) {
        let mut around_m = 0.0;
        for (i, from) in outline.iter().enumerate() {
            let to = outline[(i + 1) % outline.len()];
            let end_m = around_m + (to[0] - from[0]).hypot(to[1] - from[1]);
            mesh.add_polygon(&[
                (self.at(from[0], from[1], low_m), [around_m, low_m]),
                (self.at(to[0], to[1], low_m), [end_m, low_m]),
                (self.at(to[0], to[1], high_m), [end_m, high_m]),
                (self.at(from[0], from[1], high_m), [around_m, high_m]),
            ]);
            around_m = end_m;
        }
        let top: Vec<_> = outline.iter().map(|&[x, y]| (self.at(x, y, high_m), [x, y])).collect();
        mesh.add_polygon(&top);
    }

    /// A pointed roof over an outline, counter-clockwise from above.
    pub fn add_spire(
        &self,
        mesh: &mut TriangleMesh,
        outline: &[[f64; 2]],
        [low_m, high_m]: [f64; 2],
        tip: [f64; 2],
    ) {
        for (i, from) in outline.iter().enumerate() {
            let to = outline[(i + 1) % outline.len()];
            let width_m = (to[0] - from[0]).hypot(to[1] - from[1]);
            mesh.add_polygon(&[
                (self.at(from[0], from[1], low_m), [0.0, 0.0]),
                (self.at(to[0], to[1], low_m), [width_m, 0.0]),
                (self.at(tip[0], tip[1], high_m), [width_m / 2.0, high_m - low_m]),
            ]);
        }
    }

    /// Two slopes over a rectangle, the ridge along x, with eaves; and the gables below it.
    pub fn add_gable(
        &self,
        [roof, gables]: [&mut TriangleMesh; 2],
        [x, y]: [f64; 2],
        [length_m, width_m]: [f64; 2],
        [low_m, high_m]: [f64; 2],
    ) {
        const EAVES_M: f64 = 0.3;
        let (half_x, half_y) = (length_m / 2.0, width_m / 2.0);
        let drop_m = (high_m - low_m) * EAVES_M / half_y;
        for side in [-1.0, 1.0] {
            let up_m = (high_m - low_m).hypot(half_y);
            let (out_x, out_y) = (side * (half_x + EAVES_M), side * (half_y + EAVES_M));
            roof.add_polygon(&[
                (self.at(x - out_x, y - out_y, low_m - drop_m), [0.0, 0.0]),
                (self.at(x + out_x, y - out_y, low_m - drop_m), [length_m, 0.0]),
                (self.at(x + out_x, y, high_m), [length_m, up_m]),
                (self.at(x - out_x, y, high_m), [0.0, up_m]),
            ]);
            gables.add_polygon(&[
                (self.at(x + side * half_x, y - side * half_y, low_m), [0.0, low_m]),
                (self.at(x + side * half_x, y + side * half_y, low_m), [width_m, low_m]),
                (self.at(x + side * half_x, y, high_m - 0.05), [half_y, high_m]),
            ]);
        }
    }
}

/// A regular polygon about a point.
pub fn round([x, y]: [f64; 2], radius_m: f64, n: usize) -> Vec<[f64; 2]> {
    (0..n)
        .map(|i| {
            let angle_rad = TAU * i as f64 / n as f64;
            [x + radius_m * angle_rad.cos(), y + radius_m * angle_rad.sin()]
        })
        .collect()
}

/// A rectangle about a point.
pub fn rectangle([x, y]: [f64; 2], [length_m, width_m]: [f64; 2]) -> [[f64; 2]; 4] {
    [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)].map(|(i, j)| [x + i * length_m, y + j * width_m])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Vec2;

    fn site() -> Site {
        let center = Vec2::new(4.0, -3.0);
        Site { footprint: Footprint { center, yaw_rad: 0.8, length_m: 10.0, width_m: 6.0 }, base_m: 2.0 }
    }

    fn assert_faces_outwards(mesh: &TriangleMesh, middle: [f64; 3]) {
        let middle = Vector3::from(middle).cast::<f32>();
        for [a, b, c] in mesh.corners() {
            let out = (a.coords + b.coords + c.coords) / 3.0 - middle;
            assert!((b - a).cross(&(c - a)).dot(&out) > 0.0, "{a} {b} {c}");
        }
    }

    #[test]
    fn beams_in_any_direction_and_prisms_face_outwards() {
        let site = site();
        for to in [[3.0, 0.0, 0.0], [0.0, 0.0, 5.0], [0.0, -2.0, 0.1], [1.0, 2.0, 3.0]] {
            let mut mesh = TriangleMesh::default();
            site.add_beam(&mut mesh, [0.0; 3], to, 0.4);
            assert_eq!(mesh.n_triangles(), 12);
            assert_faces_outwards(&mesh, site.at(to[0] / 2.0, to[1] / 2.0, to[2] / 2.0));
        }
        let mut mesh = TriangleMesh::default();
        site.add_prism(&mut mesh, &round([1.0, 1.0], 2.0, 8), [0.0, 3.0]);
        site.add_spire(&mut mesh, &round([1.0, 1.0], 2.0, 8), [3.0, 5.0], [1.0, 1.0]);
        assert_faces_outwards(&mesh, site.at(1.0, 1.0, 1.5));
    }
}
