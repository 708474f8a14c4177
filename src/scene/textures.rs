//! Procedural textures of the static scene, drawn in code so that no picture has to be shipped.

use std::f64::consts::TAU;

use image::{ImageFormat, Rgb, RgbImage};
use rand::RngExt;

use super::looks::{FacadeLook, GroundLook};
use super::rubble::Rubble;
use super::windows::{Floor, window};
use crate::random;

/// Edge length of every texture in pixels.
const SIZE_PX: u32 = 256;

/// How a building's walls look.
#[derive(Debug, Clone, Copy)]
pub struct Facade {
    pub look: FacadeLook,
    pub wall: [u8; 3],
    pub trim: [u8; 3],
}

fn png(image: &RgbImage) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png).expect("encoding to memory cannot fail");
    bytes.into_inner()
}

fn shade([r, g, b]: [u8; 3], factor: f64) -> Rgb<u8> {
    Rgb([r, g, b].map(|channel| (f64::from(channel) * factor).clamp(0.0, 255.0) as u8))
}

/// Grain on a base colour; `blotch` adds a softer, tileable variation.
pub fn grain(name: &str, base: [u8; 3], amount: f64, blotch: f64) -> Vec<u8> {
    let mut rng = random::stream(0, name, 0);
    tile(|u, v| {
        let (x, y) = (u * TAU, v * TAU);
        let wave = (x + (2.0 * y).sin()).sin() * (3.0 * y + x.cos()).cos();
        shade(base, 1.0 + amount * (rng.random::<f64>() - 0.5) + blotch * wave)
    })
}

/// A tile of `SIZE_PX` pixels per side; `u` to the right and `v` upwards, 0 to 1.
fn tile(mut color: impl FnMut(f64, f64) -> Rgb<u8>) -> Vec<u8> {
    let size = f64::from(SIZE_PX);
    png(&RgbImage::from_fn(SIZE_PX, SIZE_PX, |x, y| color(f64::from(x) / size, 1.0 - f64::from(y) / size)))
}

/// Stones in rows, shifted from row to row, each with a tone of its own.
fn stones(name: &str, base: [u8; 3], [n_x, n_y]: [u32; 2], joint: f64, contrast: f64) -> Vec<u8> {
    let mut rng = random::stream(0, name, 0);
    let tones: Vec<f64> = (0..n_x * n_y).map(|_| 1.0 + contrast * (rng.random::<f64>() - 0.5)).collect();
    let warmth: Vec<f64> = (0..n_x * n_y).map(|_| contrast * 0.4 * (rng.random::<f64>() - 0.5)).collect();
    tile(|u, v| {
        let row = ((v * f64::from(n_y)) as u32).min(n_y - 1);
        let shift = if n_x > 4 { 0.5 * f64::from(row % 2) } else { 0.37 * f64::from(row) };
        let x = (u * f64::from(n_x) + shift).rem_euclid(f64::from(n_x));
        let (column, in_x) = ((x as u32).min(n_x - 1), x.fract());
        let in_y = (v * f64::from(n_y)).fract();
        let edge = in_x.min(1.0 - in_x).min(in_y).min(1.0 - in_y);
        let stone = (row * n_x + column) as usize;
        // Worn stones are darkest in the joints and rise softly to their middle.
        let rise = (edge / joint).min(1.0);
        let factor = tones[stone] * (0.72 + 0.28 * rise) + 0.05 * (rng.random::<f64>() - 0.5);
        let Rgb([r, g, b]) = shade(base, factor);
        let warm = |channel: u8, share: f64| (f64::from(channel) * (1.0 + share)).clamp(0.0, 255.0) as u8;
        Rgb([warm(r, warmth[stone]), g, warm(b, -warmth[stone])])
    })
}

/// The ground's tiles: 6 m a side on roads, 2.4 m on pavements, 4 m elsewhere.
pub fn ground(look: GroundLook) -> Vec<u8> {
    match look {
        GroundLook::Asphalt => grain("asphalt", [78, 79, 82], 0.22, 0.03),
        GroundLook::WornAsphalt => grain("worn asphalt", [106, 104, 100], 0.22, 0.035),
        GroundLook::Concrete => stones("concrete slabs", [150, 148, 142], [2, 2], 0.012, 0.07),
        GroundLook::Cobbles => stones("cobbles", [118, 110, 100], [22, 24], 0.3, 0.26),
        GroundLook::Pavement => stones("slabs", [158, 154, 148], [4, 4], 0.06, 0.12),
        GroundLook::Flagstones => stones("flagstones", [172, 154, 126], [6, 8], 0.1, 0.18),
        GroundLook::Grass => grain("grass", [92, 116, 66], 0.3, 0.06),
        GroundLook::Dirt => grain("dirt", [124, 108, 84], 0.3, 0.08),
        GroundLook::Gravel => grain("gravel", [146, 138, 124], 0.42, 0.05),
    }
}

/// Stones of all sizes without mortar.
pub fn rubble(name: &str, base: [u8; 3], n: u32) -> Vec<u8> {
    let mut rng = random::stream(0, name, 1);
    let rubble = Rubble::new(name, n);
    tile(|u, v| shade(base, rubble.at(u, v) + 0.07 * (rng.random::<f64>() - 0.5)))
}

/// Corrugated steel: upright waves, 3 to a quarter of a tile.
pub fn corrugated(name: &str, base: [u8; 3]) -> Vec<u8> {
    let mut rng = random::stream(0, name, 0);
    tile(|u, v| {
        let stain = 0.05 * (v * TAU).sin() * (2.0 * u * TAU).cos();
        let grain = 0.05 * (rng.random::<f64>() - 0.5);
        shade(base, 0.84 + 0.16 * (u * 4.0 * TAU).sin().signum().max(-0.6) + stain + grain)
    })
}

/// Ripples on dark water.
pub fn water() -> Vec<u8> {
    tile(|u, v| {
        let (x, y) = (u * TAU, v * TAU);
        let wave = (7.0 * x + 2.0 * (3.0 * y).sin()).sin() + (5.0 * y + 2.5 * (2.0 * x).cos()).sin();
        shade([46, 64, 70], 1.0 + 0.07 * wave + 0.04 * (17.0 * x + 13.0 * y).sin())
    })
}

/// Roof tiles in rows.
pub fn tiles(base: [u8; 3]) -> Vec<u8> {
    stones("roof tiles", base, [12, 10], 0.25, 0.16)
}

/// Leaves: dark hollows and lit tufts.
pub fn leaves(base: [u8; 3]) -> Vec<u8> {
    stones("leaves", base, [13, 12], 0.5, 0.6)
}

/// Upright bars before something darker, with a rail at the foot and at the top.
pub fn bars(bar: [u8; 3], behind: [u8; 3]) -> Vec<u8> {
    let mut rng = random::stream(0, "bars", 0);
    tile(|u, v| {
        let grain = 1.0 + 0.08 * (rng.random::<f64>() - 0.5);
        let is_bar = (u * 8.0).fract() < 0.42 || !(0.05..0.93).contains(&v);
        if is_bar { shade(bar, grain) } else { shade(behind, 0.62 * grain) }
    })
}

impl Facade {
    /// The wall's brightness where it has a pattern.
    fn pattern(self, u: f64, v: f64) -> f64 {
        let joints = |n_x: f64, n_y: f64, joint: f64, dark: f64| {
            let row = (v * n_y).floor();
            let x = (u * n_x + 0.5 * (row % 2.0)).fract();
            if x < joint || (v * n_y).fract() < joint * n_y / n_x { dark } else { 1.0 - 0.02 * (row % 3.0) }
        };
        match self.look {
            FacadeLook::Brick => joints(8.0, 21.0, 0.07, 0.85),
            // Piers stand out at the sides of a bay, and a band of headers over it.
            FacadeLook::Warehouse => {
                let is_pier = !(0.09..0.91).contains(&u) || v > 0.93;
                joints(10.0, 32.0, 0.08, 0.82) * if is_pier { 1.12 } else { 0.92 }
            }
            FacadeLook::Stone => joints(3.0, 6.0, 0.03, 0.8),
            FacadeLook::Metal => 0.86 + 0.14 * (u * 16.0 * TAU).sin(),
            _ => 1.0 - 0.05 * (1.0 - v),
        }
    }
}

/// One bay of one floor.
pub fn facade(name: &str, facade: Facade, floor: Floor) -> Vec<u8> {
    let mut rng = random::stream(0, name, 0);
    let window @ [left, bottom, right, top] = window(facade.look, floor);
    let has_gates = matches!(facade.look, FacadeLook::Metal | FacadeLook::Warehouse);
    let is_gate = has_gates && floor == Floor::Ground;
    let rubble = (facade.look == FacadeLook::Rubble).then(|| Rubble::new(name, 19));
    let has_shutters = facade.look == FacadeLook::Shutters && floor == Floor::Upper;
    tile(|u, v| {
        let grain = 1.0 + 0.06 * (rng.random::<f64>() - 0.5);
        let is_mullion = (u - f64::midpoint(left, right)).abs() < 0.015;
        if is_within(window, 0.0, u, v) && is_gate {
            // A roller gate: narrow slats.
            return shade(facade.trim, grain * if (v * 24.0).fract() < 0.25 { 0.8 } else { 1.0 });
        }
        if is_within(window, 0.0, u, v) && !is_mullion {
            // Glass: darker below, a hint of sky above.
            return shade([96, 118, 138], 0.5 + 0.6 * (v - bottom) / (top - bottom));
        }
        let has_plinth = floor != Floor::Blank && !has_gates && rubble.is_none();
        if is_within(window, 0.04, u, v) || (v < 0.035 && has_plinth) {
            return shade(facade.trim, grain);
        }
        let wing = 0.5 * (right - left);
        let is_beside = |from: f64, to: f64| u > from && u < to && v > bottom && v < top;
        if has_shutters
            && (is_beside(left - 0.04 - wing, left - 0.04) || is_beside(right + 0.04, right + 0.04 + wing))
        {
            let slat = if (v * 30.0).fract() < 0.3 { 0.42 } else { 0.56 };
            return shade(facade.trim, slat * grain);
        }
        let pattern = rubble.as_ref().map_or_else(|| facade.pattern(u, v), |rubble| rubble.at(u, v));
        shade(facade.wall, grain * pattern)
    })
}

fn is_within([left, bottom, right, top]: [f64; 4], margin: f64, u: f64, v: f64) -> bool {
    u > left - margin && u < right + margin && v > bottom - margin && v < top + margin
}
