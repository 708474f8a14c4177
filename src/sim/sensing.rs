//! What the sensors get of a world: first hits of rays, pictures, depths and segmentations.

use image::RgbImage;
use nalgebra::{Point3, Vector3};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use super::mount::Renderer;
use super::simulator::Simulator;
use super::{SimError, text};
use crate::rays::RayHits;

/// What a camera shows, pixel by pixel, rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct DrawnView {
    pub rgb: RgbImage,
    /// Along the optical axis, infinite for the sky; empty where it was not asked for.
    pub depth_m: Vec<f32>,
    /// The geom that each pixel shows; -1 where there is none.
    pub geoms: Vec<i32>,
}

impl Simulator {
    /// First hits of rays in the world frame on what can be seen (not on the ego), by MuJoCo; [`Self::ray_scene`]
    /// makes what is much faster.
    ///
    /// # Errors
    /// As [`Self::body_poses`].
    pub fn cast_rays(
        &self,
        origin: &Point3<f64>,
        directions: &[Vector3<f64>],
        max_range_m: f64,
    ) -> Result<RayHits, SimError> {
        self.ask("cast rays", |world| {
            let py = world.py();
            let origin = PyArray1::from_slice(py, origin.coords.as_slice());
            let flat: Vec<f64> = directions.iter().flat_map(|d| [d.x, d.y, d.z]).collect();
            let rays = PyArray1::from_vec(py, flat).reshape([directions.len(), 3])?;
            let cast = py.import("harmzone_sim")?.getattr("cast_rays")?;
            let (range_m, geom, cos_incidence): (
                PyReadonlyArray1<'_, f64>,
                PyReadonlyArray1<'_, i32>,
                PyReadonlyArray1<'_, f64>,
            ) = cast.call1((world, origin, rays, max_range_m))?.extract()?;
            Ok(RayHits {
                range_m: range_m.as_slice()?.to_vec(),
                geom: geom.as_slice()?.to_vec(),
                cos_incidence: cos_incidence.as_slice()?.to_vec(),
            })
        })
    }

    /// As [`Self::cast_rays`], one ray after the other by `mj_ray`: slow, and without the shortcuts of `mj_multiRay`,
    /// which lose hits. That leaves out the whole body where a ray misses the ball round its collision shapes
    /// (`mju_singleRay` in MuJoCo's engine_ray.c), and so all that is only seen and lies outside: the handle of a
    /// suitcase, the leaves of a tree.
    #[cfg(test)]
    pub(crate) fn cast_single_rays(
        &self,
        origin: &Point3<f64>,
        directions: &[Vector3<f64>],
        max_range_m: f64,
    ) -> RayHits {
        let none = RayHits { range_m: Vec::new(), geom: Vec::new(), cos_incidence: Vec::new() };
        self.ask("cast single rays", |world| {
            let py = world.py();
            let mj_ray = py.import("mujoco")?.getattr("mj_ray")?;
            let (model, data) = (world.getattr("model")?, world.getattr("data")?);
            let groups = py.import("harmzone_sim.rays")?.getattr("_VISIBLE_GROUPS")?;
            let origin = PyArray1::from_slice(py, origin.coords.as_slice());
            directions.iter().try_fold(none, |mut hits, direction| {
                let ray = PyArray1::from_slice(py, direction.as_slice());
                let (geom, normal) = (PyArray1::from_vec(py, vec![-1]), PyArray1::zeros(py, 3, false));
                let asked = (&model, &data, &origin, ray, &groups, true, -1, &geom, &normal);
                let range_m: f64 = mj_ray.call1(asked)?.extract()?;
                let (geom, normal): (i32, Vec<f64>) = (geom.get_item(0)?.extract()?, normal.to_vec()?);
                let cos: f64 = direction.iter().zip(normal).map(|(a, b)| a * b).sum();
                let found = geom >= 0 && range_m <= max_range_m;
                hits.range_m.push(if found { range_m } else { f64::INFINITY });
                hits.geom.push(if found { geom } else { -1 });
                hits.cos_incidence.push(if found { cos.abs() } else { 0.0 });
                Ok(hits)
            })
        })
        .unwrap()
    }

    /// The first camera's picture of the present state.
    ///
    /// # Errors
    /// [`SimError::NoGl`] where nothing can be drawn.
    pub fn render_rgb(&mut self) -> Result<RgbImage, SimError> {
        self.with_python("draw", |_, camera| {
            camera.call_method0("draw")?;
            rgb_image(&camera.call_method0("rgb")?.extract()?)
        })
    }

    /// A camera's picture of the present state with the geom, and on request the depth, of each pixel; cameras are
    /// numbered as in the mount.
    ///
    /// # Errors
    /// As [`Self::render_rgb`].
    pub fn render(&mut self, camera_idx: usize, with_depth: bool) -> Result<DrawnView, SimError> {
        self.with_python("draw", |_, camera| {
            camera.call_method1("draw", (camera_idx,))?;
            let rgb = rgb_image(&camera.call_method0("rgb")?.extract()?)?;
            let mut depth_m = Vec::new();
            if with_depth {
                let read: PyReadonlyArray2<'_, f32> = camera.call_method0("depth_m")?.extract()?;
                depth_m = read.as_slice()?.to_vec();
            }
            let geoms: PyReadonlyArray2<'_, i32> = camera.call_method0("geoms")?.extract()?;
            Ok(DrawnView { rgb, depth_m, geoms: geoms.as_slice()?.to_vec() })
        })
    }

    /// Vendor, renderer and version of the OpenGL that draws.
    ///
    /// # Errors
    /// As [`Self::render_rgb`].
    pub fn gl_info(&mut self) -> Result<[String; 3], SimError> {
        self.with_python("tell its OpenGL", |world, _| {
            let info = world.py().import("harmzone_sim")?.call_method0("gl_info")?;
            info.extract::<(String, String, String)>().map(<[String; 3]>::from)
        })
    }

    /// The version of MuJoCo, and name and version of the C library.
    ///
    /// # Errors
    /// Python fails.
    pub fn library_versions(&mut self) -> Result<[String; 2], SimError> {
        self.with_python("tell its versions", |world, _| {
            let versions = world.py().import("harmzone_sim")?.call_method0("library_versions")?;
            versions.extract::<(String, String)>().map(<[String; 2]>::from)
        })
    }

    pub(super) fn camera<'py>(&mut self, py: Python<'py>) -> Result<Bound<'py, PyAny>, SimError> {
        if let Some(camera) = &self.camera {
            return Ok(camera.bind(py).clone());
        }
        let class = match self.renderer {
            Renderer::Classic => "Camera",
            Renderer::Filament => "FilamentCamera",
        };
        let make = || py.import("harmzone_sim")?.getattr(class)?.call1((self.world.bind(py),));
        let camera = make().map_err(|error| match self.renderer {
            Renderer::Classic => SimError::NoGl { message: text(&error) },
            Renderer::Filament => SimError::NoFilament { message: text(&error) },
        })?;
        self.camera = Some(camera.clone().unbind());
        Ok(camera)
    }
}

/// From `[row, column, channel]`.
fn rgb_image(pixels: &PyReadonlyArray3<'_, u8>) -> PyResult<RgbImage> {
    let (n_rows, n_columns, _) = pixels.as_array().dim();
    let image = RgbImage::from_raw(n_columns as u32, n_rows as u32, pixels.as_slice()?.to_vec());
    Ok(image.expect("three bytes a pixel"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::simulator::tests::{XML, mount};

    #[test]
    fn a_ray_hits_the_cube_head_on_and_passes_through_the_own_car() {
        let sim = Simulator::new(XML, &[], &mount()).unwrap();
        let rays = [Vector3::x(), Vector3::y(), -Vector3::z()];
        let hits = sim.cast_rays(&Point3::new(0.0, 0.0, 1.0), &rays, 70.0).unwrap();
        assert!((hits.range_m[0] - 9.0).abs() < 1e-9 && (hits.cos_incidence[0] - 1.0).abs() < 1e-9);
        assert_eq!(sim.geom_bodies()[hits.geom[0] as usize], sim.body("obj:cube").unwrap());
        assert!(hits.range_m[1].is_infinite() && hits.geom[1] == -1);
        assert!((hits.range_m[2] - 1.0).abs() < 1e-9, "the ground is a plane at z = 0");
    }

    #[test]
    fn the_picture_shows_the_cube_where_the_pinhole_projects_it() {
        let mut sim = Simulator::new(XML, &[], &mount()).unwrap();
        let seen = sim.render(0, false).unwrap().geoms;
        let cube = sim.body("obj:cube").unwrap();
        let columns: Vec<usize> = (0..seen.len())
            .filter(|&i| seen[i] >= 0 && sim.geom_bodies()[seen[i] as usize] == cube)
            .map(|i| i % 160)
            .collect();
        // fx = 80 px, the face is 1 m to each side at 9 m: 80 +- 8.9 px.
        assert_eq!((columns.iter().min(), columns.iter().max()), (Some(&71), Some(&88)));
        assert_eq!(sim.render_rgb().unwrap().dimensions(), (160, 80));
    }

    #[test]
    fn the_depth_of_the_cubes_face_is_its_distance_and_the_skys_is_infinite() {
        let mut sim = Simulator::new(XML, &[], &mount()).unwrap();
        let picture = sim.render(0, true).unwrap();
        assert_eq!(picture.rgb, sim.render_rgb().unwrap());
        let at = |u: usize, v: usize| picture.depth_m[v * 160 + u];
        assert!((at(80, 40) - 9.0).abs() < 0.01, "{}", at(80, 40));
        // The ground 39.5 px below the horizon: 1 m * 80 px / 39.5 px.
        assert!((at(5, 79) - 80.0 / 39.5).abs() < 0.01, "{}", at(5, 79));
        assert!(at(5, 2).is_infinite());
    }

    #[test]
    fn a_second_camera_draws_as_well_as_the_first() {
        let mut first = Simulator::new(XML, &[], &mount()).unwrap();
        let mut second = Simulator::new(XML, &[], &mount()).unwrap();
        let seen = first.render(0, false).unwrap();
        assert_eq!(second.render(0, false).unwrap(), seen);
        drop(first);
        assert_eq!(second.render(0, false).unwrap(), seen);
    }
}
