//! Koschmieder's law: a thing's light fades into the air's own with distance.
//!
//! I = J t + A (1 - t), t = exp(-alpha d), with the same alpha as the LiDAR's, d the distance along the
//! ray and A the air light. Display-referred, as in Foggy Cityscapes (Sakaridis et al. 2018).

use super::picture::{Picture, View, mix};
use super::shot::{Material, Rendered};
use super::sky::Panorama;
use crate::sensors::weather::WeatherState;

/// Things farther away than this all look alike.
const FAR_M: f32 = 1024.0;
/// Steps per metre in the table of transmissions.
const STEPS_PER_M: f32 = 4.0;
/// Fog that takes less than this share at 100 m is left out.
const LEAST_LOSS: f64 = 0.03;

/// Whether the air can be seen at all over the length of a street.
pub(super) fn is_visible(state: &WeatherState) -> bool {
    1.0 - (-100.0 * state.extinction_per_m()).exp() > LEAST_LOSS
}

/// Fades everything but the sky, which has its own haze.
pub(super) fn veil(
    picture: &mut Picture,
    view: &View<'_>,
    rendered: &Rendered<'_>,
    panorama: &Panorama,
    state: &WeatherState,
) {
    let alpha = state.extinction_per_m() as f32;
    let n = (FAR_M * STEPS_PER_M) as usize;
    let transmission: Vec<f32> = (0..=n).map(|i| (-alpha * i as f32 / STEPS_PER_M).exp()).collect();
    let pixels =
        picture.pixels.iter_mut().zip(rendered.depth_m).zip(&view.rays.stretch).zip(rendered.material);
    for (((pixel, depth_m), stretch), material) in pixels {
        if *material == Material::Sky {
            continue;
        }
        let step = (depth_m * stretch * STEPS_PER_M).min(n as f32) as i32 as usize;
        *pixel = mix(panorama.air_light, *pixel, transmission[step]);
    }
}
