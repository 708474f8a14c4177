//! One compiled world in motion, with its cameras.

use std::collections::HashMap;

use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use super::mount::{CameraMount, Renderer};
use super::python::make_ready;
use super::{SimError, text};
use crate::geometry::{Camera, Ego, Pinhole, Transform};

/// A compiled world, its state and its cameras.
#[derive(Debug)]
pub struct Simulator {
    pub(super) world: Py<PyAny>,
    pub(super) camera: Option<Py<PyAny>>,
    pub(super) renderer: Renderer,
    bodies: HashMap<String, usize>,
    joints: HashMap<String, usize>,
    actuators: HashMap<String, usize>,
    /// Body of each geom.
    geom_bodies: Vec<usize>,
    geom_names: Vec<String>,
    geom_materials: Vec<String>,
    /// Mocap number of each body, -1 for none.
    mocap_of_body: Vec<i32>,
    timestep_s: f64,
}

fn failed(what: &'static str) -> impl Fn(PyErr) -> SimError {
    move |error| SimError::Ask { what, message: text(&error) }
}

impl Simulator {
    /// Compiles an MJCF text with its named assets and mounts the cameras.
    ///
    /// # Errors
    /// [`SimError`]: no Python environment or MuJoCo, or MuJoCo refuses the text.
    pub fn new(xml: &str, assets: &[(String, Vec<u8>)], mount: &CameraMount) -> Result<Self, SimError> {
        make_ready()?;
        Python::attach(|py| {
            let compile = || -> PyResult<Bound<'_, PyAny>> {
                let dict = PyDict::new(py);
                for (name, bytes) in assets {
                    dict.set_item(name, PyBytes::new(py, bytes))?;
                }
                // MuJoCo's cameras look along -z with y up; ours along +z with y down.
                let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
                let camera = |(ego_from_camera, intrinsics): &(Transform<Ego, Camera>, Pinhole)| {
                    let pose = ego_from_camera.isometry;
                    let turn = pose.rotation * half_turn;
                    let position = PyArray1::from_slice(py, pose.translation.vector.as_slice());
                    let quaternion = PyArray1::from_slice(py, &[turn.w, turn.i, turn.j, turn.k]);
                    let fovy_deg = intrinsics.vertical_fov_rad().to_degrees();
                    (position, quaternion, fovy_deg, (intrinsics.width_px, intrinsics.height_px))
                };
                let cameras: Vec<_> = mount.cameras.iter().map(camera).collect();
                py.import("harmzone_sim")?.getattr("World")?.call1((
                    xml,
                    dict,
                    &mount.body,
                    cameras,
                    mount.n_samples,
                    mount.shadow_size_px,
                ))
            };
            let world = compile().map_err(|error| SimError::Compile { message: text(&error) })?;
            let names = |kind: &str| world.call_method1("names", (kind,))?.extract::<Vec<String>>();
            let ids = |kind: &str| -> PyResult<HashMap<String, usize>> {
                let names = names(kind)?;
                let named = names.into_iter().enumerate().filter(|(_, name)| !name.is_empty());
                Ok(named.map(|(i, name)| (name, i)).collect())
            };
            let ints = |method: &str| -> PyResult<Vec<i32>> {
                let array = world.call_method0(method)?.extract::<PyReadonlyArray1<'_, i32>>()?;
                Ok(array.as_slice()?.to_vec())
            };
            let read = || -> PyResult<Self> {
                let body = |id: i32| usize::try_from(id).expect("every geom has a body");
                Ok(Self {
                    camera: None,
                    renderer: mount.renderer,
                    bodies: ids("body")?,
                    joints: ids("joint")?,
                    actuators: ids("actuator")?,
                    geom_bodies: ints("geom_bodies")?.into_iter().map(body).collect(),
                    geom_names: names("geom")?,
                    geom_materials: world.call_method0("geom_materials")?.extract()?,
                    mocap_of_body: ints("mocap_ids")?,
                    timestep_s: world.call_method0("timestep_s")?.extract()?,
                    world: world.clone().unbind(),
                })
            };
            read().map_err(failed("describe the world"))
        })
    }

    /// Lends the Python objects of the world and of its cameras; `what` says in an error what failed.
    ///
    /// # Errors
    /// As [`Simulator::render_rgb`]; [`SimError::Ask`] where `ask` fails.
    pub fn with_python<T>(
        &mut self,
        what: &'static str,
        ask: impl FnOnce(&Bound<'_, PyAny>, &Bound<'_, PyAny>) -> PyResult<T>,
    ) -> Result<T, SimError> {
        Python::attach(|py| {
            let camera = self.camera(py)?;
            ask(self.world.bind(py), &camera).map_err(failed(what))
        })
    }

    /// Asks the world; `what` says in an error what failed.
    pub(super) fn ask<T>(
        &self,
        what: &'static str,
        ask: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<T>,
    ) -> Result<T, SimError> {
        Python::attach(|py| ask(self.world.bind(py)).map_err(failed(what)))
    }

    /// The id of a body by name.
    pub fn body(&self, name: &str) -> Option<usize> {
        self.bodies.get(name).copied()
    }

    /// The id of a joint by name, an index into [`Self::joint_positions`].
    pub fn joint(&self, name: &str) -> Option<usize> {
        self.joints.get(name).copied()
    }

    /// The id of an actuator by name, an index into the controls of [`Self::step`].
    pub fn actuator(&self, name: &str) -> Option<usize> {
        self.actuators.get(name).copied()
    }

    /// How many controls [`Self::step`] takes.
    pub fn n_actuators(&self) -> usize {
        self.actuators.len()
    }

    /// The mocap number of a body, if it is one that is moved by hand.
    pub fn mocap(&self, body: usize) -> Option<usize> {
        self.mocap_of_body.get(body).and_then(|&id| usize::try_from(id).ok())
    }

    /// Body of each geom.
    pub fn geom_bodies(&self) -> &[usize] {
        &self.geom_bodies
    }

    /// Name of each geom, empty for none.
    pub fn geom_names(&self) -> &[String] {
        &self.geom_names
    }

    /// Name of each geom's material, empty for none.
    pub fn geom_materials(&self) -> &[String] {
        &self.geom_materials
    }

    pub fn timestep_s(&self) -> f64 {
        self.timestep_s
    }

    /// Gives geoms other materials, both by name.
    ///
    /// # Errors
    /// [`SimError::Ask`]: there is no such geom or material.
    pub fn set_materials(&mut self, materials: &[(String, String)]) -> Result<(), SimError> {
        let (geoms, materials): (Vec<&str>, Vec<&str>) =
            materials.iter().map(|(geom, material)| (geom.as_str(), material.as_str())).unzip();
        self.ask("change materials", |world| {
            world.call_method1("set_materials", (geoms, materials)).map(drop)
        })
    }

    /// Lets a body go that a weld holds, with the velocity of its centre of mass and its spin, both
    /// along the world's axes.
    ///
    /// # Errors
    /// The body is not held, or is not free to move.
    pub fn release(
        &mut self,
        body: usize,
        linear_mps: &Vector3<f64>,
        angular_rps: &Vector3<f64>,
    ) -> Result<(), SimError> {
        self.ask("release a body", |world| {
            let linear = PyArray1::from_slice(world.py(), linear_mps.as_slice());
            let angular = PyArray1::from_slice(world.py(), angular_rps.as_slice());
            world.call_method1("release", (body, linear, angular)).map(drop)
        })
    }

    /// The pose of every body in the world, by body id.
    ///
    /// # Errors
    /// [`SimError::Ask`], only if MuJoCo itself fails.
    pub fn body_poses(&self) -> Result<Vec<Isometry3<f64>>, SimError> {
        self.ask("tell poses", |world| {
            let poses: PyReadonlyArray2<'_, f64> = world.call_method0("body_poses")?.extract()?;
            let (poses, _) = poses.as_slice()?.as_chunks();
            Ok(poses.iter().map(isometry).collect())
        })
    }

    /// The centre of every geom in the world, by geom id.
    ///
    /// # Errors
    /// As [`Self::body_poses`].
    pub fn geom_centers(&self) -> Result<Vec<Point3<f64>>, SimError> {
        self.ask("tell where geoms are", |world| {
            let centers: PyReadonlyArray2<'_, f64> = world.call_method0("geom_centers")?.extract()?;
            let (centers, _) = centers.as_slice()?.as_chunks::<3>();
            Ok(centers.iter().map(|&center| center.into()).collect())
        })
    }

    /// Angular and linear velocity of a body's origin, along the body's own axes.
    ///
    /// # Errors
    /// As [`Self::body_poses`].
    pub fn body_velocity(&self, body: usize) -> Result<(Vector3<f64>, Vector3<f64>), SimError> {
        self.ask("tell a velocity", |world| {
            let velocity: PyReadonlyArray1<'_, f64> =
                world.call_method1("body_velocity", (body,))?.extract()?;
            let (angular, linear) = velocity.as_slice()?.split_at(3);
            Ok((Vector3::from_column_slice(angular), Vector3::from_column_slice(linear)))
        })
    }

    /// The first position coordinate of each joint (the angle of a hinge), by joint id.
    ///
    /// # Errors
    /// As [`Self::body_poses`].
    pub fn joint_positions(&self) -> Result<Vec<f64>, SimError> {
        self.ask("tell joint angles", |world| {
            let positions: PyReadonlyArray1<'_, f64> = world.call_method0("joint_positions")?.extract()?;
            Ok(positions.as_slice()?.to_vec())
        })
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        let Some(camera) = self.camera.take() else { return };
        Python::attach(|py| {
            // Freed here and not by Python, which could free it while another camera is current.
            // A failure leaks driver memory of a world that is gone; there is nobody to tell.
            let _ = camera.bind(py).call_method0("close");
        });
    }
}

/// From position and quaternion (w, x, y, z).
pub(super) fn isometry(&[x, y, z, w, i, j, k]: &[f64; 7]) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
    Isometry3::from_parts(Translation3::new(x, y, z), turn)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A 2 m cube 10 m ahead (its face at 9 m), a mocap cube behind, and a body that may fall.
    pub(in crate::sim) const XML: &str = r#"<mujoco><option timestep="0.005"/><worldbody>
        <light directional="true" dir="0 0 -1" pos="0 0 10"/>
        <geom name="ground" type="plane" size="0 0 1" group="1" contype="0" conaffinity="0"/>
        <body name="obj:cube" pos="10 0 1"><geom name="cube" type="box" size="1 1 1" group="2"/></body>
        <body name="obj:mover" mocap="true" pos="-10 0 1"><geom type="box" size="1 1 1" group="2"/></body>
        <body name="ego"><freejoint/>
          <geom type="box" pos="2 0 1.5" size="2 1 1" group="4" contype="0" conaffinity="0"/></body>
        </worldbody></mujoco>"#;

    pub(in crate::sim) fn mount() -> CameraMount {
        CameraMount {
            body: "ego".into(),
            cameras: vec![(
                Transform::looking_forward(Vector3::new(0.0, 0.0, 1.0), 0.0),
                Pinhole::from_horizontal_fov(160, 80, std::f64::consts::FRAC_PI_2),
            )],
            n_samples: 0,
            shadow_size_px: 256,
            renderer: Renderer::Classic,
        }
    }

    #[test]
    fn a_free_body_falls_and_a_mocap_body_goes_where_it_is_put() {
        let mut sim = Simulator::new(XML, &[], &mount()).unwrap();
        let mover = sim.body("obj:mover").unwrap();
        let pose = Isometry3::translation(3.0, 4.0, 5.0);
        sim.step(&[], &[(sim.mocap(mover).unwrap(), pose)], 20).unwrap();
        let poses = sim.body_poses().unwrap();
        assert!((poses[mover].translation.vector - Vector3::new(3.0, 4.0, 5.0)).norm() < 1e-12);
        let ego = sim.body("ego").unwrap();
        let (_, linear) = sim.body_velocity(ego).unwrap();
        assert!((linear.z + 9.81 * 0.1).abs() < 1e-6, "0.1 s of free fall: {linear}");
    }

    #[test]
    fn a_geom_takes_another_colour_while_running() {
        let lit = XML.replace(
            "<worldbody>",
            "<asset><material name=\"lit\" rgba=\"1 0 0 1\" emission=\"1\"/></asset><worldbody>",
        );
        let mut sim = Simulator::new(&lit, &[], &mount()).unwrap();
        let middle = |sim: &mut Simulator| sim.render_rgb().unwrap().get_pixel(80, 40).0;
        let before = middle(&mut sim);
        sim.set_materials(&[("cube".into(), "lit".into())]).unwrap();
        let after = middle(&mut sim);
        assert!(
            // Grey before; then red, with some white glint.
            before[0].abs_diff(before[1]) < 30 && after[0] > 200 && after[1] < 90,
            "{before:?} {after:?}"
        );
        let error = sim.set_materials(&[("cube".into(), "unlit".into())]).unwrap_err().to_string();
        assert!(error.contains("unlit"), "{error}");
    }

    #[test]
    fn a_held_body_stays_until_it_is_let_go_and_then_flies_and_spins() {
        let xml = XML.replace(
            "</worldbody>",
            r#"<body name="held" pos="0 20 6" quat="0.7071068 0.7071068 0 0"><freejoint/>
               <geom type="box" size="0.2 0.2 0.2" pos="0 0 0.5" mass="2"/></body></worldbody>
               <equality><weld body1="held" anchor="0 20 6"/></equality>"#,
        );
        let mut sim = Simulator::new(&xml, &[], &mount()).unwrap();
        let held = sim.body("held").unwrap();
        // Its centre of mass: half a metre along the body's z, which points to -y.
        let center = |sim: &Simulator| sim.body_poses().unwrap()[held] * Point3::new(0.0, 0.0, 0.5);
        let start = center(&sim);
        sim.step(&[], &[], 100).unwrap();
        // The weld gives way by millimetres.
        assert!((center(&sim) - start).norm() < 0.01, "{}", center(&sim));
        let start = center(&sim);
        sim.release(held, &Vector3::new(3.0, 0.0, 1.0), &Vector3::new(0.0, 4.0, 0.0)).unwrap();
        sim.step(&[], &[], 100).unwrap();
        let fall_m = 1.0 * 0.5 - 9.81 * 0.5 * 0.5 / 2.0;
        let moved = center(&sim) - start;
        assert!((moved - Vector3::new(1.5, 0.0, fall_m)).norm() < 0.02, "{moved}");
        let (angular, _) = sim.body_velocity(held).unwrap();
        assert!((angular.norm() - 4.0).abs() < 0.01, "{angular}");
        let error = sim.release(held, &Vector3::zeros(), &Vector3::zeros()).unwrap_err().to_string();
        assert!(error.contains("not held"), "{error}");
    }

    #[test]
    fn a_broken_world_is_refused_with_mujocos_words() {
        let error = Simulator::new("<mujoco><worldbody><bdy/></worldbody></mujoco>", &[], &mount());
        assert!(error.unwrap_err().to_string().contains("bdy"));
    }
}
