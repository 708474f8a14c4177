//! The visible geometry of a world, handed to rays of our own.

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use super::SimError;
use super::simulator::{Simulator, isometry};
use crate::rays::{RayScene, Solid, Visible, VisibleGeom, VisibleMesh};

type Ints<'py> = PyReadonlyArray1<'py, i32>;
type Rows<'py, T> = PyReadonlyArray2<'py, T>;
type Answer<'py> = (
    Ints<'py>,
    Vec<String>,
    Ints<'py>,
    Rows<'py, f64>,
    Rows<'py, f64>,
    Ints<'py>,
    Vec<(Rows<'py, f32>, Rows<'py, i32>)>,
    PyReadonlyArray1<'py, bool>,
);

impl Simulator {
    /// What can be seen of the world, for rays of our own, with all bodies where they are now.
    ///
    /// # Errors
    /// [`SimError::RayKind`]: a geom is of a kind that only [`Self::cast_rays`] knows.
    pub fn ray_scene(&self) -> Result<RayScene, SimError> {
        let (visible, unknown) = self.ask("tell what can be seen", |world| {
            let answer: Answer<'_> =
                world.py().import("harmzone_sim")?.call_method1("visible_geometry", (world,))?.extract()?;
            read(&answer)
        })?;
        match unknown {
            Some((geom, kind)) => {
                Err(SimError::RayKind { kind, geom: self.geom_names()[geom as usize].clone() })
            }
            None => Ok(RayScene::new(visible, &self.body_poses()?)),
        }
    }
}

/// The geometry, and id and kind of a geom that is not known.
fn read(answer: &Answer<'_>) -> PyResult<(Visible, Option<(i32, String)>)> {
    let (ids, kinds, bodies, sizes, poses, meshes_of_geoms, meshes, moves) = answer;
    let (sizes, _) = sizes.as_slice()?.as_chunks::<3>();
    let (poses, _) = poses.as_slice()?.as_chunks::<7>();
    let (ids, bodies, meshes_of_geoms) = (ids.as_slice()?, bodies.as_slice()?, meshes_of_geoms.as_slice()?);
    let mut visible = Visible { moves: moves.as_slice()?.to_vec(), ..Visible::default() };
    for (vertices, faces) in meshes {
        let (vertices, _) = vertices.as_slice()?.as_chunks::<3>();
        let (faces, _) = faces.as_slice()?.as_chunks::<3>();
        let faces = faces.iter().map(|face| face.map(|vertex| vertex as u32)).collect();
        visible.meshes.push(VisibleMesh { vertices: vertices.to_vec(), faces });
    }
    for (geom, kind) in kinds.iter().enumerate() {
        let [a, b, c] = sizes[geom];
        let solid = match kind.as_str() {
            "plane" => Solid::Plane { half: [a, b] },
            "sphere" => Solid::Sphere { radius: a },
            "capsule" => Solid::Capsule { radius: a, half: b },
            "ellipsoid" => Solid::Ellipsoid { radii: [a, b, c] },
            "cylinder" => Solid::Cylinder { radius: a, half: b },
            "box" => Solid::Box { half: [a, b, c] },
            "mesh" => Solid::Mesh(meshes_of_geoms[geom] as usize),
            _ => return Ok((visible, Some((ids[geom], kind.clone())))),
        };
        let body_from_geom = isometry(&poses[geom]);
        visible.geoms.push(VisibleGeom { id: ids[geom], body: bodies[geom] as usize, body_from_geom, solid });
    }
    Ok((visible, None))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Point3, Vector3};

    use super::*;
    use crate::rays::Beams;
    use crate::sim::simulator::tests::{XML, mount};

    #[test]
    fn rays_of_our_own_see_what_mujocos_see_and_follow_what_moves() {
        let mut sim = Simulator::new(XML, &[], &mount()).unwrap();
        let mut scene = sim.ray_scene().unwrap();
        let directions = [Vector3::x(), Vector3::y(), -Vector3::z(), Vector3::new(-0.8, 0.0, 0.6)];
        let pose = Isometry3::translation(0.0, 0.0, 1.0);
        let beams = Beams::new(&directions);
        let hits = sim.cast_rays(&Point3::new(0.0, 0.0, 1.0), &directions, 70.0).unwrap();
        assert_eq!(scene.cast(&pose, &beams, 70.0), hits);
        assert_eq!(scene.cast(&pose, &beams, 8.9).geom[0], -1);
        let mover = sim.body("obj:mover").unwrap();
        let to = (sim.mocap(mover).unwrap(), Isometry3::translation(5.0, 0.0, 1.0));
        sim.step(&[], &[to], 1).unwrap();
        scene.set_poses(&sim.body_poses().unwrap());
        let hits = scene.cast(&pose, &beams, 70.0);
        assert_eq!(sim.geom_bodies()[hits.geom[0] as usize], mover);
        assert!((hits.range_m[0] - 4.0).abs() < 1e-12, "{}", hits.range_m[0]);
    }

    #[test]
    fn what_cannot_be_seen_is_left_out_and_an_unknown_kind_is_named() {
        let clear = XML.replace("name=\"cube\"", "name=\"cube\" rgba=\"1 1 1 0\"");
        let sim = Simulator::new(&clear, &[], &mount()).unwrap();
        let beams = Beams::new(&[Vector3::x()]);
        let scene = sim.ray_scene().unwrap();
        assert_eq!(scene.cast(&Isometry3::translation(0.0, 0.0, 1.0), &beams, 70.0).geom, [-1]);
        let field = XML.replace(
            "<worldbody>",
            "<asset><hfield name=\"hill\" nrow=\"2\" ncol=\"2\" size=\"5 5 1 1\" elevation=\"0 1 1 0\"/></asset><worldbody>\
             <geom name=\"land\" type=\"hfield\" hfield=\"hill\"/>",
        );
        let error = Simulator::new(&field, &[], &mount()).unwrap().ray_scene().unwrap_err().to_string();
        assert!(error.contains("land") && error.contains("hfield") && error.contains("mujoco"), "{error}");
    }
}
