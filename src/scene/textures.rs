//! Procedural textures of the static scene, drawn in code so that no picture has to be shipped.

use image::{ImageFormat, Rgb, RgbImage};
use rand::RngExt;

use crate::random;

/// Edge length of every texture in pixels.
const SIZE_PX: u32 = 128;

/// How a facade tile (one bay of one floor) looks.
#[derive(Debug, Clone, Copy)]
pub struct Facade {
    pub wall: [u8; 3],
    pub trim: [u8; 3],
    /// Window as fractions of the tile: left, bottom, right, top.
    pub window: [f64; 4],
    pub has_bricks: bool,
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
#[must_use]
pub fn grain(name: &str, base: [u8; 3], amount: f64, blotch: f64) -> Vec<u8> {
    let mut rng = random::stream(0, name, 0);
    let turn = std::f64::consts::TAU / f64::from(SIZE_PX);
    png(&RgbImage::from_fn(SIZE_PX, SIZE_PX, |x, y| {
        let (x, y) = (f64::from(x) * turn, f64::from(y) * turn);
        let wave = (x + (2.0 * y).sin()).sin() * (3.0 * y + x.cos()).cos();
        shade(base, 1.0 + amount * (rng.random::<f64>() - 0.5) + blotch * wave)
    }))
}

/// Paving slabs, four by four in a tile.
#[must_use]
pub fn slabs(base: [u8; 3]) -> Vec<u8> {
    let mut rng = random::stream(0, "slabs", 0);
    let tones: Vec<f64> = (0..16).map(|_| 0.93 + 0.12 * rng.random::<f64>()).collect();
    let slab_px = SIZE_PX / 4;
    png(&RgbImage::from_fn(SIZE_PX, SIZE_PX, |x, y| {
        let is_joint = x % slab_px < 2 || y % slab_px < 2;
        let tone = tones[(x / slab_px + 4 * (y / slab_px)) as usize];
        shade(base, (if is_joint { 0.75 } else { tone }) + 0.05 * (rng.random::<f64>() - 0.5))
    }))
}

/// One bay of one floor.
#[must_use]
pub fn facade(name: &str, look: &Facade) -> Vec<u8> {
    let mut rng = random::stream(0, name, 0);
    let [left, bottom, right, top] = look.window;
    png(&RgbImage::from_fn(SIZE_PX, SIZE_PX, |x, y| {
        let (u, v) = (f64::from(x) / f64::from(SIZE_PX), 1.0 - f64::from(y) / f64::from(SIZE_PX));
        let grain = 1.0 + 0.06 * (rng.random::<f64>() - 0.5);
        let within =
            |margin: f64| u > left - margin && u < right + margin && v > bottom - margin && v < top + margin;
        let is_mullion = (u - f64::midpoint(left, right)).abs() < 0.015;
        if within(0.0) && !is_mullion {
            // Glass: darker below, a hint of sky above.
            return shade([96, 118, 138], 0.5 + 0.6 * (v - bottom) / (top - bottom));
        }
        if within(0.04) || v < 0.035 {
            return shade(look.trim, grain);
        }
        let (row, brick_x) = (y / 6, x + 8 * ((y / 6) % 2));
        let is_joint = look.has_bricks && (y % 6 == 0 || brick_x % 16 == 0);
        shade(look.wall, grain * if is_joint { 0.85 } else { 1.0 - 0.02 * f64::from(row % 3) })
    }))
}
