//! What of a world can be seen, as its maker describes it.

use nalgebra::{Isometry3, Vector3};

use super::solid::Solid;

/// A geom that can be seen.
#[derive(Debug, Clone, PartialEq)]
pub struct VisibleGeom {
    /// Its id in the world; hits name it.
    pub id: i32,
    pub body: usize,
    pub body_from_geom: Isometry3<f64>,
    pub solid: Solid,
}

/// A mesh in the frame of its geoms.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct VisibleMesh {
    pub vertices: Vec<[f32; 3]>,
    pub faces: Vec<[u32; 3]>,
}

/// All that can be seen of a world.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Visible {
    pub geoms: Vec<VisibleGeom>,
    pub meshes: Vec<VisibleMesh>,
    /// Whether each body can move.
    pub moves: Vec<bool>,
}

impl Visible {
    /// The triangles of a mesh or a box, in the geom's frame; none of round things and planes.
    pub(super) fn triangles(&self, geom: usize) -> Vec<[Vector3<f64>; 3]> {
        match &self.geoms[geom].solid {
            Solid::Mesh(mesh) => {
                (0..self.meshes[*mesh].faces.len()).map(|face| self.face(*mesh, face)).collect()
            }
            Solid::Box { half } => box_triangles(half),
            _ => Vec::new(),
        }
    }

    pub(super) fn face(&self, mesh: usize, face: usize) -> [Vector3<f64>; 3] {
        let VisibleMesh { vertices, faces } = &self.meshes[mesh];
        faces[face].map(|vertex| Vector3::from(vertices[vertex as usize]).cast::<f64>())
    }

    /// Lower and upper corner in the geom's frame; `None` for planes and empty meshes.
    pub(super) fn extent(&self, geom: usize) -> Option<[Vector3<f64>; 2]> {
        let solid = &self.geoms[geom].solid;
        if let Some(half) = solid.half_extent() {
            let half = Vector3::from(half);
            return Some([-half, half]);
        }
        let Solid::Mesh(mesh) = solid else { return None };
        let mut corners =
            self.meshes[*mesh].vertices.iter().map(|&vertex| Vector3::from(vertex).cast::<f64>());
        let first = corners.next()?;
        Some(corners.fold([first, first], |[low, high], corner| [low.inf(&corner), high.sup(&corner)]))
    }
}

/// Two triangles a face.
fn box_triangles(half: &[f64; 3]) -> Vec<[Vector3<f64>; 3]> {
    let mut triangles = Vec::with_capacity(12);
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let corner = |u: f64, v: f64| {
                let mut at = Vector3::zeros();
                at[axis] = side * half[axis];
                at[(axis + 1) % 3] = u * half[(axis + 1) % 3];
                at[(axis + 2) % 3] = v * half[(axis + 2) % 3];
                at
            };
            let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
            triangles.push([corners[0], corners[1], corners[2]]);
            triangles.push([corners[0], corners[2], corners[3]]);
        }
    }
    triangles
}
