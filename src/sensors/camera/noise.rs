//! Sensor noise: photon noise that grows with the root of the light, and a constant part.
//!
//! sigma^2 = a I + b on display values 0 to 1; the gain is high at night.

use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use super::picture::Picture;
use crate::random;
use crate::sensors::weather::WeatherState;

const SIDE: usize = 256;

/// Noise as a share of full scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Level {
    /// a: variance per light.
    pub photon: f32,
    /// b: variance in the dark.
    pub dark: f32,
}

/// By the sun's altitude: none that an 8-bit picture could show by day.
pub(super) fn level(state: &WeatherState) -> Option<Level> {
    if state.is_night() {
        return Some(Level { photon: 4.5e-4, dark: 1.2e-4 });
    }
    (state.sun_altitude_rad < 0.3).then_some(Level { photon: 4e-5, dark: 1e-5 })
}

/// A tile of normal draws, laid over each picture at another place.
#[derive(Debug, Clone)]
pub(super) struct Tile(Vec<f32>);

impl Tile {
    pub(super) fn new() -> Self {
        let mut rng = random::stream(0, "camera-noise-tile", 0);
        Self((0..SIDE * SIDE).map(|_| StandardNormal.sample(&mut rng)).collect())
    }

    pub(super) fn add(&self, picture: &mut Picture, level: Option<Level>, seed: u64, sample_idx: u64) {
        let Some(level) = level else { return };
        let mut rng = random::stream(seed, "camera-noise", sample_idx);
        // Rows and channels take different parts of the tile, so that no pattern repeats.
        for row in picture.pixels.chunks_mut(picture.width) {
            let starts = [0; 3].map(|_: i32| rng.random_range(0..SIDE * SIDE));
            for (u, pixel) in row.iter_mut().enumerate() {
                for (channel, start) in pixel.iter_mut().zip(starts) {
                    let sigma = (level.photon * *channel + level.dark).max(0.0).sqrt();
                    *channel += sigma * self.0[(start + u) % (SIDE * SIDE)];
                }
            }
        }
    }
}
