//! Sensor noise: photon noise that grows with the root of the light, and a constant part.
//!
//! sigma^2 = a I + b on display values 0 to 1; the gain is high at night.

use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use super::picture::Picture;
use crate::random;
use crate::sensors::weather::WeatherState;

/// Draws at which a row can start.
const N_STARTS: usize = 1 << 16;

/// Noise as a share of full scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Level {
    /// a: variance per light.
    pub photon: f32,
    /// b: variance in the dark.
    pub dark: f32,
}

/// The noise at a sun's altitude: by day, none that an 8-bit picture could show.
pub(super) fn level(state: &WeatherState) -> Option<Level> {
    if state.is_night() {
        return Some(Level { photon: 4.5e-4, dark: 1.2e-4 });
    }
    (state.sun_altitude_rad < 0.3).then_some(Level { photon: 4e-5, dark: 1e-5 })
}

/// Normal draws; each row of a picture takes another part of them.
#[derive(Debug, Clone)]
pub(super) struct Tile(Vec<f32>);

impl Tile {
    /// Prepares the noise for pictures of this width.
    pub(super) fn new(width: usize) -> Self {
        let mut rng = random::stream(0, "camera-noise-tile", 0);
        Self((0..N_STARTS + 3 * width).map(|_| StandardNormal.sample(&mut rng)).collect())
    }

    pub(super) fn add(&self, picture: &mut Picture, level: Option<Level>, seed: u64, sample_idx: u64) {
        let Some(level) = level else { return };
        let mut rng = random::stream(seed, "camera-noise", sample_idx);
        for row in picture.pixels.chunks_mut(picture.width) {
            let start = rng.random_range(0..N_STARTS);
            for (channel, draw) in row.as_flattened_mut().iter_mut().zip(&self.0[start..]) {
                *channel += (level.photon * *channel + level.dark).max(0.0).sqrt() * draw;
            }
        }
    }
}
