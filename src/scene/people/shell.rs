//! The surface of a person while it is made: tubes of elliptic rings, and boxes, each part in one of a few tones.

use nalgebra::{Point3, Vector3};

use crate::scene::mesh::TriangleMesh;

pub type Vec3 = Vector3<f64>;

/// What a part shows; each person has a colour for each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hue {
    Skin,
    Hair,
    Top,
    Accent,
    Legs,
    Shoes,
    Bag,
    Hat,
    Thing,
    Dark,
}

/// How many tones there are.
pub const N_TONES: usize = 10;

/// An ellipse by its middle and its two half axes.
#[derive(Debug, Clone, Copy)]
pub struct Ring {
    pub center: Vec3,
    pub a: Vec3,
    pub b: Vec3,
}

impl Ring {
    /// An ellipse at right angles to `along`, whose first axis points nearly to `toward`.
    pub fn new(center: Vec3, along: &Vec3, toward: &Vec3, a_m: f64, b_m: f64) -> Self {
        let b = along.cross(toward).normalize();
        let a = b.cross(along).normalize();
        Self { center, a: a * a_m, b: b * b_m }
    }

    fn points(&self, n: usize) -> impl Iterator<Item = Vec3> + '_ {
        (0..n).map(move |i| {
            let (sin, cos) = (std::f64::consts::TAU * i as f64 / n as f64).sin_cos();
            self.center + self.a * cos + self.b * sin
        })
    }
}

/// Triangles of a person, counter-clockwise seen from outside.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Shell {
    pub vertices: Vec<(Vec3, Hue)>,
    pub triangles: Vec<[usize; 3]>,
}

impl Shell {
    /// A closed tube through rings; `n` corners a ring.
    pub fn tube(&mut self, tone: Hue, n: usize, rings: &[Ring]) {
        let [first, .., last] = rings else { return };
        let start = self.vertices.len();
        for ring in rings {
            self.vertices.extend(ring.points(n).map(|point| (point, tone)));
        }
        // Which side is out depends on the way in which the rings turn.
        let way: Vec3 = rings.windows(2).map(|pair| pair[1].center - pair[0].center).sum();
        let turns: f64 = rings.iter().map(|ring| ring.a.cross(&ring.b).dot(&way)).sum();
        let is_flipped = turns < 0.0;
        let mut quad = |a: usize, b: usize, c: usize, d: usize| {
            let corners = if is_flipped { [[a, c, b], [a, d, c]] } else { [[a, b, c], [a, c, d]] };
            self.triangles.extend(corners);
        };
        for row in 0..rings.len() - 1 {
            for i in 0..n {
                let (from, to) = (start + row * n, start + (row + 1) * n);
                let next = (i + 1) % n;
                quad(from + i, from + next, to + next, to + i);
            }
        }
        self.cap(tone, n, first, !is_flipped);
        self.cap(tone, n, last, is_flipped);
    }

    /// Closes the end of a tube, with corners of its own, so that the edge stays sharp.
    fn cap(&mut self, tone: Hue, n: usize, ring: &Ring, is_flipped: bool) {
        if ring.a.norm().max(ring.b.norm()) < 2e-3 {
            return;
        }
        let start = self.vertices.len();
        self.vertices.extend(ring.points(n).map(|point| (point, tone)));
        for i in 1..n - 1 {
            let corners = if is_flipped { [0, i + 1, i] } else { [0, i, i + 1] };
            self.triangles.push(corners.map(|corner| start + corner));
        }
    }

    /// An ellipsoid by its middle and half axes, which are at right angles.
    pub fn ball(&mut self, tone: Hue, [n, n_rings]: [usize; 2], center: Vec3, [a, b, c]: [Vec3; 3]) {
        let rings: Vec<Ring> = (0..=n_rings)
            .map(|i| {
                let (sin, cos) = (std::f64::consts::PI * (i as f64 / n_rings as f64 - 0.5)).sin_cos();
                let across = cos.max(1e-3);
                Ring { center: center + c * sin, a: a * across, b: b * across }
            })
            .collect();
        self.tube(tone, n, &rings);
    }

    /// A box by its middle and half edges, which are at right angles.
    pub fn slab(&mut self, tone: Hue, center: Vec3, edges: [Vec3; 3]) {
        for axis in 0..3 {
            for side in [-1.0, 1.0] {
                let out = edges[axis] * side;
                let (u, mut v) = (edges[(axis + 1) % 3], edges[(axis + 2) % 3]);
                if u.cross(&v).dot(&out) < 0.0 {
                    v = -v;
                }
                let start = self.vertices.len();
                let corners = [-u - v, u - v, u + v, v - u];
                self.vertices.extend(corners.map(|corner| (center + out + corner, tone)));
                self.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|face| face.map(|i: usize| start + i)));
            }
        }
    }

    /// A thin straight rod.
    pub fn rod(&mut self, tone: Hue, from: Vec3, to: Vec3, radius_m: f64) {
        let along = to - from;
        let toward = if along.z.abs() > 0.9 * along.norm() { Vec3::x() } else { Vec3::z() };
        let ring = |center| Ring::new(center, &along, &toward, radius_m, radius_m);
        self.tube(tone, 4, &[ring(from), ring(to)]);
    }

    /// A wheel with tyre and spokes about the y axis of the person.
    pub fn wheel(&mut self, tone: Hue, center: Vec3, radius_m: f64, width_m: f64) {
        let n: usize = if radius_m > 0.12 { 14 } else { 8 };
        let out = |i: usize| {
            let (sin, cos) = (std::f64::consts::TAU * i as f64 / n as f64).sin_cos();
            Vec3::new(cos, 0.0, sin)
        };
        let (inner_m, half) = (radius_m - width_m, Vec3::y() * (width_m / 2.0));
        for i in 0..n {
            let section = |i: usize| {
                let (inner, outer) = (center + out(i) * inner_m, center + out(i) * radius_m);
                [outer - half, outer + half, inner + half, inner - half]
            };
            let (from, to) = (section(i), section(i + 1));
            for side in 0..4 {
                let next = (side + 1) % 4;
                let start = self.vertices.len();
                let corners = [from[side], from[next], to[next], to[side]];
                self.vertices.extend(corners.map(|corner| (corner, tone)));
                self.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|face| face.map(|i: usize| start + i)));
            }
            if i % 2 == 0 {
                self.rod(Hue::Dark, center, center + out(i) * inner_m, 0.004);
            }
        }
    }

    /// Triangles as the labels and the LiDAR read them.
    pub fn corners(&self) -> Vec<[Point3<f32>; 3]> {
        let at = |i: usize| Point3::from(self.vertices[i].0).cast::<f32>();
        self.triangles.iter().map(|triangle| triangle.map(at)).collect()
    }

    /// The mesh, with the texture coordinates of each vertex's tone in a palette of [`N_TONES`] columns.
    pub fn mesh(&self) -> TriangleMesh {
        let column = |tone: Hue| (f64::from(tone as u8) + 0.5) / N_TONES as f64;
        let vertices = self.vertices.iter().map(|&(at, tone)| (at.into(), [column(tone), 0.5]));
        TriangleMesh::new(vertices.collect(), self.triangles.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six times the volume that triangles enclose, above zero if they face outwards.
    fn volume(shell: &Shell) -> f64 {
        let at = |i: usize| shell.vertices[i].0;
        shell.triangles.iter().map(|&[a, b, c]| at(a).dot(&at(b).cross(&at(c))) / 6.0).sum()
    }

    #[test]
    fn tubes_balls_and_boxes_face_outwards_whichever_way_they_run() {
        let ring = |z: f64, side: f64| Ring {
            center: Vec3::new(1.0, 2.0, z),
            a: Vec3::x() * 0.5,
            b: Vec3::y() * 0.5 * side,
        };
        for rings in [
            [ring(0.0, 1.0), ring(1.0, 1.0)],
            [ring(1.0, 1.0), ring(0.0, 1.0)],
            [ring(0.0, -1.0), ring(1.0, -1.0)],
        ] {
            let mut shell = Shell::default();
            shell.tube(Hue::Top, 64, &rings);
            assert!((volume(&shell) - 0.785).abs() < 0.01, "{}", volume(&shell));
        }
        let mut shell = Shell::default();
        shell.ball(Hue::Skin, [32, 16], Vec3::new(0.0, 1.0, 0.0), [Vec3::x(), Vec3::z(), Vec3::y()]);
        assert!((volume(&shell) - 4.19).abs() < 0.15, "{}", volume(&shell));
        let mut shell = Shell::default();
        shell.wheel(Hue::Dark, Vec3::new(1.0, 2.0, 3.0), 0.3, 0.1);
        // A ring of 14 sides around its spokes.
        let polygon_m2 = 7.0 * (std::f64::consts::TAU / 14.0).sin();
        let (ring, spokes) = (polygon_m2 * 0.1 * (0.09 - 0.04), 7.0 * 2.0 * 0.004 * 0.004 * 0.2);
        assert!((volume(&shell) - ring - spokes).abs() < 1e-9, "{}", volume(&shell));
        let mut shell = Shell::default();
        shell.slab(Hue::Bag, Vec3::new(3.0, 1.0, 0.0), [Vec3::x(), Vec3::y(), -Vec3::z()]);
        assert!((volume(&shell) - 8.0).abs() < 1e-9);
    }
}
