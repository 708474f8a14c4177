//! Water on the ground: darker where it soaks in, a mirror where it stands.
//!
//! The ray that a level ground mirrors runs up the picture, in the same column if the camera is level. It
//! is followed row by row until a thing nearer than the ray itself is met; else the sky is seen. This is
//! done for every second pixel. How much is mirrored follows Fresnel (Schlick) and a pattern of puddles
//! fixed to the ground.

use nalgebra::Vector3;

use super::picture::{Picture, View, mix, scale};
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
const PROBE_PX: usize = 9;

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
        let things = Things::new(rendered, view);
        for v in (0..picture.height).step_by(2) {
            for u in (0..width).step_by(2) {
                let block = [(0, 0), (1, 0), (0, 1), (1, 1)];
                let height = picture.height;
                let paved = |du: usize, dv: usize| {
                    let (u, v) = (u + du, v + dv);
                    (u < width && v < height && rendered.material[v * width + u] == Material::Paved)
                        .then_some(v * width + u)
                };
                let Some(first) = block.into_iter().find_map(|(du, dv)| paved(du, dv)) else { continue };
                let ray = view.ray_in_world(u, v);
                let share = self.mirror_share(&ray, rendered.depth_m[first], view, wetness);
                let seen = if share > 0.01 {
                    let up = Vector3::new(ray.x, ray.y, -ray.z);
                    let start = view.ray_in_camera(u, first / width) * rendered.depth_m[first];
                    // What is mirrored is not paved, so that it is still dry.
                    match things.meet(&start, &view.in_camera(&up), first / width) {
                        Some(at) => picture.pixels[at],
                        None => panorama.towards(&up),
                    }
                } else {
                    [0.0; 3]
                };
                for at in block.into_iter().filter_map(|(du, dv)| paved(du, dv)) {
                    let soaked = scale(picture.pixels[at], 1.0 - DARKENING * wetness);
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

/// What can be met by mirrored rays.
struct Things<'a> {
    /// Of each pixel; far behind the camera where it shows no thing.
    depth_m: Vec<f32>,
    view: &'a View<'a>,
}

impl<'a> Things<'a> {
    fn new(rendered: &Rendered<'_>, view: &'a View<'a>) -> Self {
        let depth_of = |(material, depth_m): (&Material, &f32)| match material {
            Material::Sky | Material::Paved => -1e6,
            _ => *depth_m,
        };
        Self { depth_m: rendered.material.iter().zip(rendered.depth_m).map(depth_of).collect(), view }
    }

    /// The pixel of the thing that a mirrored ray meets; it leaves the ground in row `v`.
    ///
    /// The points start + t up of the ray that row y = slope z of the picture shows have
    /// t = (start.y - slope start.z) / (slope up.z - up.y), so that their depth is a constant over a linear
    /// function of the slope, and their column is a linear function of it.
    fn meet(&self, start: &Vector3<f32>, up: &Vector3<f32>, v: usize) -> Option<usize> {
        let intrinsics = self.view.intrinsics;
        let width = self.view.width();
        let (fx_px, cx_px) = (intrinsics.fx_px as f32, intrinsics.cx_px as f32);
        // Rows that the mirrored ray passes: from the pixel itself up to its vanishing point.
        let vanishing =
            if up.z > 1e-3 { intrinsics.cy_px as f32 + intrinsics.fy_px as f32 * up.y / up.z } else { -1.0 };
        let scaled_depth = up.z * start.y - up.y * start.z;
        let column_at_0 = cx_px + fx_px * (up.x * start.y - start.x * up.y) / scaled_depth;
        let column_by_slope = fx_px * (start.x * up.z - up.x * start.z) / scaled_depth;
        // The pixel of a thing nearer than the ray itself; without a ray the march ends.
        let probe = |row: usize| -> Option<Option<usize>> {
            let slope = self.view.rays.down[row];
            let scale = (slope * up.z - up.y).recip();
            let z = scaled_depth * scale;
            if !((start.y - slope * start.z) * scale > 0.0 && z > 0.0) {
                return None;
            }
            let column = (column_at_0 + column_by_slope * slope).clamp(0.0, (width - 1) as f32);
            let at = row * width + column as i32 as usize;
            // Nothing but walls is thicker than this; a pole before the ray does not hide what is behind it.
            Some((z - THICKNESS_M..z + 0.5).contains(&self.depth_m[at]).then_some(at))
        };
        let mut row = v.checked_sub(PROBE_PX)?;
        while row as f32 > vanishing {
            match probe(row)? {
                // The rows just skipped may show the thing already.
                Some(at) => {
                    let nearer = (1..PROBE_PX).rev().find_map(|k| probe(row + k).flatten());
                    return Some(nearer.unwrap_or(at));
                }
                None => row = row.checked_sub(PROBE_PX)?,
            }
        }
        None
    }
}
