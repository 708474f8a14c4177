//! MJCF text while it is put together: assets, bodies, constraints, and the files that the assets name.

use nalgebra::UnitQuaternion;

use super::mesh::TriangleMesh;

#[derive(Default)]
pub(super) struct Builder {
    pub(super) asset: String,
    pub(super) body: String,
    pub(super) equality: String,
    pub(super) files: Vec<(String, Vec<u8>)>,
}

impl Builder {
    pub(super) fn texture(&mut self, name: &str, png: Vec<u8>) {
        self.asset += &format!(
            "<texture name=\"{name}\" type=\"2d\" file=\"{name}.png\"/>\n\
             <material name=\"{name}\" texture=\"{name}\" specular=\"0.05\" shininess=\"0.05\"/>\n"
        );
        self.files.push((format!("{name}.png"), png));
    }

    pub(super) fn plain(&mut self, name: &str, [r, g, b]: [f64; 3]) {
        self.asset += &format!(
            "<material name=\"{name}\" rgba=\"{r} {g} {b} 1\" specular=\"0.05\" shininess=\"0.05\"/>\n"
        );
    }

    /// A static mesh.
    pub(super) fn mesh(&mut self, name: &str, material: &str, mesh: &TriangleMesh) {
        self.mesh_in(1, name, material, mesh);
    }

    /// A static mesh of the ground: nothing that is seen lies below it.
    pub(super) fn ground(&mut self, name: &str, material: &str, mesh: &TriangleMesh) {
        self.mesh_in(0, name, material, mesh);
    }

    fn mesh_in(&mut self, group: u8, name: &str, material: &str, mesh: &TriangleMesh) {
        if mesh.is_empty() {
            return;
        }
        self.files.push((format!("{name}.msh"), mesh.to_msh()));
        self.asset += &format!("<mesh name=\"{name}\" file=\"{name}.msh\" inertia=\"shell\"/>\n");
        self.body += &format!(
            "<geom name=\"{name}\" type=\"mesh\" mesh=\"{name}\" material=\"{material}\" group=\"{group}\" contype=\"0\" conaffinity=\"0\"/>\n"
        );
    }
}

/// A turn as MuJoCo writes it: w, x, y, z.
pub(super) fn quaternion_text(turn: &UnitQuaternion<f64>) -> String {
    format!("{:.6} {:.6} {:.6} {:.6}", turn.w, turn.i, turn.j, turn.k)
}
