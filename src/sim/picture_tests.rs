//! The pictures of all towns beside those of MuJoCo's own renderer, which draws every geom for every light.

use std::ffi::CString;
use std::sync::Arc;

use nalgebra::Vector3;
use pyo3::prelude::*;

use super::{CameraMount, Renderer, Simulator};
use crate::geometry::{Pinhole, Transform};
use crate::scene::{Lighting, PopulateConfig, Sun, Town, populate};

/// Shares of pixels with the same geom and with nearly the same colour, and the colours' mean difference. As edges of
/// shadows are soft here and in steps there, a colour may be any between those of MuJoCo's pixels two around.
const COMPARE: &str = r"
import mujoco
import numpy as np

def compare(world, camera):
    width_px, height_px = world.image_sizes_px[0]
    option = mujoco.MjvOption()
    option.geomgroup[:] = (1, 1, 1, 0, 0, 0)
    option.sitegroup[:] = 0
    with mujoco.Renderer(world.model, height_px, width_px, max_geom=20_000) as renderer:
        renderer.update_scene(world.data, world.camera_ids[0], option)
        rgb = renderer.render().astype(int)
        renderer.enable_segmentation_rendering()
        geoms = renderer.render()[..., 0]
    camera.draw()
    ours = camera.rgb().astype(int)
    sides = np.pad(rgb, ((2, 2), (2, 2), (0, 0)), mode='edge')
    around = np.lib.stride_tricks.sliding_window_view(sides, (5, 5), axis=(0, 1))
    off = np.maximum(around.min(axis=(-2, -1)) - ours, ours - around.max(axis=(-2, -1)))
    is_same = camera.geoms() == geoms
    return float(is_same.mean()), float((off.max(axis=-1) <= 3).mean()), float(np.abs(ours - rgb).mean())
";

#[test]
fn in_all_towns_pictures_are_those_of_mujocos_own_renderer_but_for_the_steps_of_shadows() {
    let mount = CameraMount {
        body: "ego".into(),
        cameras: vec![(
            Transform::looking_forward(Vector3::new(1.7, 0.0, 1.5), 0.0),
            Pinhole::from_horizontal_fov(800, 450, 70f64.to_radians()),
        )],
        n_samples: 0,
        // Fine, so that the two maps' texels, which lie in different directions, show less.
        shadow_size_px: 4096,
        renderer: Renderer::Classic,
    };
    let sun = |direction: Vector3<f64>| Sun {
        direction: direction.normalize().into(),
        colour: [0.7, 0.67, 0.6],
        casts_shadow: true,
    };
    let noon = sun(Vector3::new(0.55, -0.17, -0.82));
    let evening = sun(Vector3::new(0.93, -0.28, -0.25));
    for town in crate::scene::town_names() {
        let town = Arc::new(Town::load(&town).unwrap());
        let world = populate(&town, &PopulateConfig::default(), 7).unwrap();
        for (daytime, sun) in [("noon", Some(noon)), ("evening", Some(evening)), ("night", None)] {
            let lighting = Lighting { ambient: [0.5; 3], sun };
            let mjcf = world.mjcf(&lighting);
            let mut simulator = Simulator::new(&mjcf.xml, &mjcf.assets, &mount).unwrap();
            let (same, close, off) = simulator
                .with_python("compare pictures", |world, camera| {
                    let code = CString::new(COMPARE)?;
                    let module = PyModule::from_code(world.py(), &code, c"<compare>", c"compare")?;
                    module.getattr("compare")?.call1((world, camera))?.extract::<(f64, f64, f64)>()
                })
                .unwrap();
            let found = format!("{} at {daytime}: {same:.5} same, {close:.4} close, {off:.3} off", town.name);
            // Along a shadow's edge the map's texels show, which lie in another direction.
            assert!(same > 0.9995 && close > 0.98 && off < 1.2, "{found}");
        }
    }
}
