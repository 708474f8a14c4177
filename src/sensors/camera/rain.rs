//! Falling drops as streaks, and drops on the pane before the lens.
//!
//! Drops wider than 1 mm follow Marshall and Palmer's spectrum in the frustum's first metres; farther ones
//! are the rain's share of the fog. A drop falls at 9.65 - 10.3 exp(-0.6 D) m/s (Atlas et al. 1973, D in mm)
//! past a moving car, and its path during the exposure shows as a line. How bright streaks look, and the
//! drops on the pane, were chosen by eye.

use nalgebra::Vector3;
use rand::RngExt;
use rand_distr::{Distribution, Exp1};

use super::picture::{Colour, Picture, View, mix, scale};
use super::shot::Shot;
use super::table::{Table, floor};
use crate::random;
use crate::sensors::weather::{DROPS_PER_M3_MM, WeatherState};

const LEAST_MM: f64 = 1.0;
const NEAR_M: f32 = 0.7;
const FAR_M: f32 = 4.0;
const EXPOSURE_S: f32 = 1.0 / 60.0;
/// A drop on the pane keeps its place for this many samples.
const PANE_SAMPLES: u64 = 4;

/// Draws streaks and drops.
pub(super) fn fall(picture: &mut Picture, view: &View<'_>, state: &WeatherState, shot: &Shot<'_>, seed: u64) {
    let bright: Colour = if state.is_night() { [0.46, 0.45, 0.42] } else { [0.86, 0.88, 0.90] };
    streaks(picture, view, state, shot, seed, bright);
    pane(picture, state, shot, seed);
}

fn streaks(
    picture: &mut Picture,
    view: &View<'_>,
    state: &WeatherState,
    shot: &Shot<'_>,
    seed: u64,
    bright: Colour,
) {
    let mut rng = random::stream(seed, "rain-streaks", shot.sample_idx);
    let intrinsics = view.intrinsics;
    let [fx_px, fy_px, cx_px, cy_px] =
        [intrinsics.fx_px, intrinsics.fy_px, intrinsics.cx_px, intrinsics.cy_px].map(|px| px as f32);
    let half = [picture.width as f32 / 2.0 / fx_px, picture.height as f32 / 2.0 / fy_px];
    let volume_m3 = 4.0 * f64::from(half[0] * half[1] * (FAR_M.powi(3) - NEAR_M.powi(3))) / 3.0;
    let slope = state.drop_slope_per_mm();
    let n = (DROPS_PER_M3_MM / slope * (-slope * LEAST_MM).exp() * volume_m3) as usize;
    let fall_mps = Table::new(LEAST_MM as f32, 12.0, 512, |mm| 9.65 - 10.3 * (-0.6 * mm).exp());
    let down = view.in_camera(&-Vector3::z());
    let ahead = view.camera_from_ego.rotation.cast::<f32>() * Vector3::x() * shot.speed_mps as f32;
    for _ in 0..n {
        let [a, b, c, d, e] = [0; 5].map(|_: i32| rng.random::<f32>());
        // Evenly over the frustum: the greatest of three draws is as likely as its square.
        let depth_m = FAR_M * a.max(b).max(c);
        let excess: f32 = Exp1.sample(&mut rng);
        if depth_m < NEAR_M {
            continue;
        }
        let start = Vector3::new((2.0 * d - 1.0) * half[0], (2.0 * e - 1.0) * half[1], 1.0) * depth_m;
        let diameter_mm = LEAST_MM as f32 + excess / slope as f32;
        let end = start + (down * fall_mps.at(diameter_mm) - ahead) * EXPOSURE_S;
        if end.z < 0.2 {
            continue;
        }
        let pixel = |p: &Vector3<f32>| [cx_px + fx_px * p.x / p.z, cy_px + fy_px * p.y / p.z];
        let width_px = 1e-3 * diameter_mm * fx_px / depth_m;
        line(picture, pixel(&start), pixel(&end), (0.16 * width_px).clamp(0.015, 0.16), bright);
    }
}

/// A line one pixel wide, shared between the two columns that it passes between.
fn line(picture: &mut Picture, from: [f32; 2], to: [f32; 2], share: f32, colour: Colour) {
    let way = [to[0] - from[0], to[1] - from[1]];
    let length = (way[0] * way[0] + way[1] * way[1]).sqrt();
    let n = (length as i32 + 1).clamp(1, 200);
    let step = way.map(|part| part / n as f32);
    let (width, height) = (picture.width, picture.height as f32);
    for i in 0..n {
        let t = i as f32 + 0.5;
        let (u, v) = (from[0] + step[0] * t - 0.5, from[1] + step[1] * t);
        if v < 0.0 || v >= height {
            continue;
        }
        let row = &mut picture.pixels[v as i32 as usize * width..][..width];
        let left = floor(u);
        let right = u - left as f32;
        for (column, part) in [(left, 1.0 - right), (left + 1, right)] {
            if let Some(pixel) = row.get_mut(column as usize) {
                *pixel = mix(*pixel, colour, share * part);
            }
        }
    }
}

/// Drops that bend the view: each shows a wide part of the scene upside down.
fn pane(picture: &mut Picture, state: &WeatherState, shot: &Shot<'_>, seed: u64) {
    let mut rng = random::stream(seed, "rain-pane", shot.sample_idx / PANE_SAMPLES);
    let n = (4.0 + 0.5 * state.rain_rate_mmph).min(40.0) as usize;
    let (width, height) = (picture.width as f32, picture.height as f32);
    // Drops show what is behind all of them.
    let mut bent = Vec::new();
    for _ in 0..n {
        let [a, b, c] = [0; 3].map(|_: i32| rng.random::<f32>());
        let (center_u, center_v) = (a * width, b * height);
        let radius = (0.004 + 0.011 * c * c) * width;
        let tall = 1.25 * radius;
        let rows =
            (center_v - tall).max(0.0) as usize..((center_v + tall).min(height - 1.0).max(0.0) as usize);
        for v in rows {
            let columns = (center_u - radius).max(0.0) as usize
                ..((center_u + radius).min(width - 1.0).max(0.0) as usize);
            for u in columns {
                let (dx, dy) = ((u as f32 - center_u) / radius, (v as f32 - center_v) / tall);
                let r2 = dx * dx + dy * dy;
                if r2 >= 1.0 {
                    continue;
                }
                let from_u = (center_u - dx * radius * 5.0).clamp(0.0, width - 1.0) as usize;
                let from_v = (center_v - dy * tall * 5.0).clamp(0.0, height - 1.0) as usize;
                let seen = scale(picture.pixels[from_v * picture.width + from_u], 1.0 - 0.4 * r2 * r2);
                bent.push((v * picture.width + u, seen, 0.8 * (1.0 - r2 * r2 * r2)));
            }
        }
    }
    for (at, seen, share) in bent {
        picture.pixels[at] = mix(picture.pixels[at], seen, share);
    }
}
