//! Triangle meshes with texture coordinates, written in MuJoCo's own binary format (MSH); and triangles of OBJ files.

use nalgebra::Point3;

/// Triangles of one material.
#[derive(Debug, Clone, Default)]
pub struct TriangleMesh {
    /// Position in metres and texture coordinates in tiles.
    vertices: Vec<([f64; 3], [f64; 2])>,
    triangles: Vec<[usize; 3]>,
}

impl TriangleMesh {
    /// Vertices with their texture coordinates, and triangles of their indices; MuJoCo smooths the normals at shared vertices.
    pub fn new(vertices: Vec<([f64; 3], [f64; 2])>, triangles: Vec<[usize; 3]>) -> Self {
        Self { vertices, triangles }
    }

    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    pub fn n_triangles(&self) -> usize {
        self.triangles.len()
    }

    /// The same with tiles `factor` times as large.
    #[must_use]
    pub fn with_tiles(&self, factor: f64) -> Self {
        let mut mesh = self.clone();
        mesh.vertices.iter_mut().for_each(|(_, uv)| *uv = uv.map(|part| part / factor));
        mesh
    }

    /// Adds a convex polygon, counter-clockwise seen from its front; slivers are left out.
    pub fn add_polygon(&mut self, corners: &[([f64; 3], [f64; 2])]) {
        let first = self.vertices.len();
        self.vertices.extend_from_slice(corners);
        for i in 1..corners.len().saturating_sub(1) {
            let [a, b, c] = [corners[0].0, corners[i].0, corners[i + 1].0].map(Point3::from);
            // MuJoCo accepts slivers, but they have no normal.
            if (b - a).cross(&(c - a)).norm() > 1e-5 {
                self.triangles.push([first, first + i, first + i + 1]);
            }
        }
    }

    /// Adds a polygon that lies flat at height `z_m` and is textured by its place in the world.
    pub fn add_flat(&mut self, corners: &[[f64; 2]], z_m: f64, tile_m: f64) {
        let textured: Vec<_> =
            corners.iter().map(|&[x, y]| ([x, y, z_m], [x / tile_m, y / tile_m])).collect();
        self.add_polygon(&textured);
    }

    /// Adds an upright box by its middle, the yaw of its first side, and its sizes; a tile is a metre.
    pub fn add_box(&mut self, [x, y, z]: [f64; 3], yaw_rad: f64, [length_m, width_m, height_m]: [f64; 3]) {
        let (sin, cos) = yaw_rad.sin_cos();
        let at = |i: f64, j: f64, k: f64| {
            let (u, v) = (i * length_m / 2.0, j * width_m / 2.0);
            [x + u * cos - v * sin, y + u * sin + v * cos, z + k * height_m / 2.0]
        };
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        for i in 0..4 {
            let ((x0, y0), (x1, y1)) = (corners[i], corners[(i + 1) % 4]);
            let n = if i % 2 == 0 { length_m } else { width_m };
            self.add_polygon(&[
                (at(x0, y0, -1.0), [0.0, 0.0]),
                (at(x1, y1, -1.0), [n, 0.0]),
                (at(x1, y1, 1.0), [n, height_m]),
                (at(x0, y0, 1.0), [0.0, height_m]),
            ]);
        }
        let flat = |k: f64| corners.map(|(i, j)| (at(i, j, k), [i * length_m / 2.0, j * width_m / 2.0]));
        self.add_polygon(&flat(1.0));
        let mut bottom = flat(-1.0);
        bottom.reverse();
        self.add_polygon(&bottom);
    }

    /// The mesh as MSH: the numbers of vertices, normals, texture coordinates and faces as i32, then positions,
    /// texture coordinates (f32, v downwards) and faces (i32); little-endian. MuJoCo makes the normals.
    pub fn to_msh(&self) -> Vec<u8> {
        let (n_vertices, n_faces) = (self.vertices.len(), self.triangles.len());
        let mut msh = Vec::with_capacity(16 + 20 * n_vertices + 12 * n_faces);
        for n in [n_vertices, 0, n_vertices, n_faces] {
            msh.extend((n as i32).to_le_bytes());
        }
        for (position, _) in &self.vertices {
            msh.extend(position.iter().flat_map(|part| (*part as f32).to_le_bytes()));
        }
        for (_, [u, v]) in &self.vertices {
            msh.extend([*u, 1.0 - v].iter().flat_map(|part| (*part as f32).to_le_bytes()));
        }
        msh.extend(self.triangles.as_flattened().iter().flat_map(|&corner| (corner as i32).to_le_bytes()));
        msh
    }

    #[cfg(test)]
    pub(super) fn corners(&self) -> Vec<[Point3<f32>; 3]> {
        let at = |i: usize| Point3::from(self.vertices[i].0).cast::<f32>();
        self.triangles.iter().map(|triangle| triangle.map(at)).collect()
    }
}

/// Triangles of an OBJ text: faces become fans, everything but positions is ignored.
///
/// `None` if a number or an index is malformed.
pub fn triangles_of_obj(text: &str) -> Option<Vec<[Point3<f32>; 3]>> {
    let mut vertices: Vec<Point3<f32>> = Vec::new();
    let mut triangles = Vec::new();
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let mut next = || words.next()?.parse::<f32>().ok();
                vertices.push(Point3::new(next()?, next()?, next()?));
            }
            Some("f") => {
                let corners: Option<Vec<Point3<f32>>> = words
                    .map(|word| {
                        let index: i64 = word.split('/').next()?.parse().ok()?;
                        let from_start = if index < 0 { index + vertices.len() as i64 } else { index - 1 };
                        vertices.get(usize::try_from(from_start).ok()?).copied()
                    })
                    .collect();
                let corners = corners?;
                for i in 1..corners.len().saturating_sub(1) {
                    triangles.push([corners[0], corners[i], corners[i + 1]]);
                }
            }
            _ => {}
        }
    }
    Some(triangles)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_in_msh_has_its_counts_places_coordinates_and_faces() {
        let mut mesh = TriangleMesh::default();
        mesh.add_flat(&[[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]], 0.5, 1.0);
        let msh = mesh.to_msh();
        let (words, rest) = msh.as_chunks::<4>();
        let number = |i: usize| f32::from_le_bytes(words[i]);
        assert!(rest.is_empty() && words.len() == 4 + 4 * 3 + 4 * 2 + 2 * 3);
        assert_eq!([0, 1, 2, 3].map(|i| i32::from_le_bytes(words[i])), [4, 0, 4, 2]);
        assert_eq!([13, 14, 15].map(number), [0.0, 2.0, 0.5], "the last corner");
        assert_eq!([22, 23].map(number), [0.0, -1.0], "its coordinates: v is 2 upwards");
        assert_eq!([24, 25, 26, 27, 28, 29].map(|i| i32::from_le_bytes(words[i])), [0, 1, 2, 0, 2, 3]);
    }

    #[test]
    fn every_side_of_a_box_faces_outwards() {
        let mut mesh = TriangleMesh::default();
        mesh.add_box([3.0, 4.0, 5.0], 0.7, [2.0, 1.0, 4.0]);
        let triangles = mesh.corners();
        assert_eq!(triangles.len(), 12);
        for [a, b, c] in triangles {
            let out = (a.coords + b.coords + c.coords) / 3.0 - nalgebra::Vector3::new(3.0, 4.0, 5.0);
            assert!((b - a).cross(&(c - a)).dot(&out) > 0.0);
        }
    }

    #[test]
    fn a_face_that_names_a_missing_vertex_is_refused() {
        assert!(triangles_of_obj("v 0 0 0\nf 1 2 3\n").is_none());
    }
}
