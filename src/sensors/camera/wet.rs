//! Water on the ground: darker where it soaks in, a mirror where it stands.
//!
//! The ray that a level ground mirrors runs up the picture, in the same column if the camera is level. It
//! is followed row by row until a thing nearer than the ray itself is met; else the sky is seen. This is
//! done for every second pixel. How much is mirrored follows Fresnel (Schlick) and a pattern of puddles
//! fixed to the ground.

use nalgebra::Vector3;

use super::picture::{Colour, Picture, View, mix, scale};
use super::shot::{Material, Rendered};
use super::sky::Panorama;
use super::table::Sine;

/// Reflectance of water at right angles.
const F0: f32 = 0.02;
/// How much darker soaked asphalt is.
const DARKENING: f32 = 0.45;
/// A thing that ends this far before the mirrored ray is passed behind.
const THICKNESS_M: f32 = 2.5;
/// Rows between two probes of the march.
const PROBE_PX: f32 = 9.0;

/// Water on the ground, in a pattern fixed to it.
#[derive(Debug, Clone)]
pub(super) struct Puddles {
    sine: Sine,
}

impl Puddles {
    pub(super) fn new() -> Self {
        Self { sine: Sine::new() }
    }

    /// Covers the paved ground with a film of water.
    pub(super) fn cover(
        &self,
        picture: &mut Picture,
        view: &View<'_>,
        rendered: &Rendered<'_>,
        panorama: &Panorama,
        wetness: f64,
    ) {
        let wetness = wetness as f32;
        let width = picture.width;
        let dry = picture.clone();
        for v in (0..picture.height).step_by(2) {
            for u in (0..width).step_by(2) {
                let block = [(0, 0), (1, 0), (0, 1), (1, 1)];
                let paved = |du: usize, dv: usize| {
                    let (u, v) = (u + du, v + dv);
                    (u < width && v < dry.height && rendered.material[v * width + u] == Material::Paved)
                        .then_some(v * width + u)
                };
                let Some(first) = block.into_iter().find_map(|(du, dv)| paved(du, dv)) else { continue };
                let ray = view.ray_in_world(u, v);
                let share = self.mirror_share(&ray, rendered.depth_m[first], view, wetness);
                let seen = if share > 0.01 {
                    mirrored(&dry, view, rendered, panorama, u, first / width, &ray)
                } else {
                    [0.0; 3]
                };
                for at in block.into_iter().filter_map(|(du, dv)| paved(du, dv)) {
                    let soaked = scale(dry.pixels[at], 1.0 - DARKENING * wetness);
                    picture.pixels[at] = mix(soaked, seen, share);
                }
            }
        }
    }

    /// The mirrored share of the light: Fresnel times the film's smoothness there.
    fn mirror_share(&self, ray: &Vector3<f32>, depth_m: f32, view: &View<'_>, wetness: f32) -> f32 {
        let cos = (-ray.z / ray.norm()).clamp(0.0, 1.0);
        let fresnel = F0 + (1.0 - F0) * (1.0 - cos).powi(5);
        let x = view.camera_in_world.x as f32 + ray.x * depth_m;
        let y = view.camera_in_world.y as f32 + ray.y * depth_m;
        // Puddles: two waves of a few metres that do not repeat together, finer ones on top.
        let sin = |angle_rad| self.sine.of(angle_rad);
        let wave = sin(0.9 * x + 1.7 * sin(0.31 * y)) + sin(1.1 * y + 1.3 * sin(0.27 * x));
        let ripple = sin(3.1 * x - 2.3 * y) + sin(2.7 * x + 3.7 * y);
        let puddle = (0.5 + 0.22 * wave + 0.06 * ripple).clamp(0.0, 1.0);
        // A full film mirrors nearly everywhere, a thin one only in its puddles.
        let film = (puddle + wetness - 0.65).clamp(0.0, 1.0);
        0.85 * fresnel * film
    }
}

/// What the mirror shows at a pixel of the ground.
fn mirrored(
    dry: &Picture,
    view: &View<'_>,
    rendered: &Rendered<'_>,
    panorama: &Panorama,
    u: usize,
    v: usize,
    ray: &Vector3<f32>,
) -> Colour {
    let intrinsics = view.intrinsics;
    let up = Vector3::new(ray.x, ray.y, -ray.z);
    let up_in_camera = view.in_camera(&up);
    let depth_m = rendered.depth_m[v * dry.width + u];
    let start = view.ray_in_camera(u, v) * depth_m;
    // Rows that the mirrored ray passes: from the pixel itself up to its vanishing point.
    let vanishing = if up_in_camera.z > 1e-3 {
        intrinsics.cy_px as f32 + intrinsics.fy_px as f32 * up_in_camera.y / up_in_camera.z
    } else {
        -1.0
    };
    // What the mirrored ray meets at a row: the pixel of a thing nearer than itself; without a ray the march
    // ends.
    let probe = |row: f32| -> Option<Option<usize>> {
        let slope = (row + 0.5 - intrinsics.cy_px as f32) / intrinsics.fy_px as f32;
        // (start.y + t up.y) / (start.z + t up.z) = slope
        let t = (start.y - slope * start.z) / (slope * up_in_camera.z - up_in_camera.y);
        let (x, z) = (start.x + t * up_in_camera.x, start.z + t * up_in_camera.z);
        if !(t > 0.0 && z > 0.0) {
            return None;
        }
        let column = (intrinsics.cx_px as f32 + intrinsics.fx_px as f32 * x / z) as usize;
        let at = row as usize * dry.width + column.min(dry.width - 1);
        let is_thing = !matches!(rendered.material[at], Material::Sky | Material::Paved);
        // Nothing but walls is thicker than this; a pole before the ray does not hide what is behind it.
        let is_met = (z - THICKNESS_M..z + 0.5).contains(&rendered.depth_m[at]);
        Some((is_thing && is_met).then_some(at))
    };
    let mut row = v as f32 - PROBE_PX;
    while row > vanishing && row >= 0.0 {
        match probe(row) {
            None => break,
            // The rows just skipped may show the thing already.
            Some(Some(at)) => {
                let nearer = (1..PROBE_PX as usize).rev().find_map(|k| probe(row + k as f32).flatten());
                return dry.pixels[nearer.unwrap_or(at)];
            }
            Some(None) => row -= PROBE_PX,
        }
    }
    panorama.towards(&up)
}
