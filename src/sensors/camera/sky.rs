//! The sky: gradients by daytime, the sun's glow, clouds, and the haze that hides them.

use nalgebra::Vector3;
use rand::RngExt;

use super::picture::{Colour, View, mix, scale};
use super::shot::Material;
use super::table::{angle, floor};
use crate::random;
use crate::sensors::weather::{Daytime, SUN_AZIMUTH_RAD, WeatherState};

/// Columns round the horizon and rows from it to the zenith.
const WIDTH: usize = 1024;
const HEIGHT: usize = 192;
/// A car on the road tilts by no more than this.
const MOST_TILT_RAD: f64 = 0.3;
/// Thickness of the hazy layer of air.
const HAZE_LAYER_M: f64 = 400.0;

/// Zenith and horizon of an open and of a covered sky.
struct Tones {
    open: [Colour; 2],
    covered: [Colour; 2],
    sun: Colour,
    cloud: Colour,
}

fn tones(daytime: Daytime) -> Tones {
    match daytime {
        Daytime::Noon => Tones {
            open: [[0.24, 0.45, 0.78], [0.76, 0.85, 0.93]],
            covered: [[0.60, 0.63, 0.67], [0.80, 0.81, 0.82]],
            sun: [1.0, 0.97, 0.9],
            cloud: [0.95, 0.96, 0.97],
        },
        Daytime::Sunset => Tones {
            open: [[0.25, 0.31, 0.52], [0.86, 0.58, 0.40]],
            covered: [[0.38, 0.37, 0.41], [0.60, 0.53, 0.50]],
            sun: [1.0, 0.72, 0.38],
            cloud: [0.92, 0.60, 0.47],
        },
        Daytime::Night => Tones {
            open: [[0.012, 0.018, 0.05], [0.075, 0.075, 0.10]],
            covered: [[0.055, 0.052, 0.055], [0.115, 0.10, 0.09]],
            sun: [0.0; 3],
            cloud: [0.07, 0.07, 0.08],
        },
    }
}

/// The sky by direction.
#[derive(Debug, Clone)]
pub(super) struct Panorama {
    /// Row by row from the horizon to the highest that the camera can see.
    colours: Vec<Colour>,
    n_rows: usize,
    /// The colour of thick haze: Koschmieder's air light.
    pub air_light: Colour,
}

impl Panorama {
    /// For a camera that sees up to `highest_rad` over or under the horizon while its car stands level.
    pub(super) fn new(daytime: Daytime, state: &WeatherState, highest_rad: f64, seed: u64) -> Self {
        let highest = (highest_rad + MOST_TILT_RAD) / std::f64::consts::FRAC_PI_2;
        let n_rows = ((highest * HEIGHT as f64).ceil() as usize).clamp(1, HEIGHT);
        let azimuths: Vec<(f32, f32)> = (0..WIDTH)
            .map(|column| (column as f32 / WIDTH as f32 * std::f32::consts::TAU).sin_cos())
            .collect();
        let tones = tones(daytime);
        let cover = state.cloud_cover as f32;
        let gloom = 1.0 - 0.3 * (state.rain_rate_mmph / 45.0).min(1.0) as f32;
        let clouds = Clouds::new(seed);
        let (sin, cos) = state.sun_altitude_rad.sin_cos();
        let to_sun =
            Vector3::new(cos * SUN_AZIMUTH_RAD.cos(), cos * SUN_AZIMUTH_RAD.sin(), sin).cast::<f32>();
        let horizon = scale(mix(tones.open[1], tones.covered[1], cover), gloom);
        // Fog is lit from above as well as from the side.
        let air_light = mix(horizon, scale(mix(tones.open[0], tones.covered[0], cover), gloom), 0.25);
        let mut colours = Vec::with_capacity(WIDTH * n_rows);
        for row in 0..n_rows {
            let altitude = (row as f32 + 0.5) / HEIGHT as f32 * std::f32::consts::FRAC_PI_2;
            let (up, flat) = altitude.sin_cos();
            let high = up.powf(0.55);
            let haze = (state.extinction_per_m() * HAZE_LAYER_M) as f32 / up.max(0.03);
            let seen_through = (-haze).exp();
            for (sin, cos) in &azimuths {
                let direction = Vector3::new(flat * cos, flat * sin, up);
                let open = mix(tones.open[1], tones.open[0], high);
                let covered = mix(tones.covered[1], tones.covered[0], high);
                // Clouds lie on a plane overhead, so they crowd together towards the horizon.
                let spot = [direction.x / (up + 0.12), direction.y / (up + 0.12)];
                let thickness = clouds.fractal(spot.map(|c| c * 1.7));
                let edge = 1.05 - 1.1 * cover;
                let is_cloud = ((thickness - edge) * 4.0 + 0.5).clamp(0.0, 1.0);
                let tone = if cover > 0.6 { scale(covered, 0.86 + 0.28 * thickness) } else { tones.cloud };
                let mut colour = mix(open, tone, is_cloud);
                let along_sun = direction.dot(&to_sun).max(0.0);
                let glare = (0.35 * along_sun.powi(8) + 0.5 * along_sun.powi(180)) * (1.0 - cover);
                colour = mix(colour, tones.sun, glare.min(1.0));
                if along_sun > 0.9997 && cover < 0.6 {
                    colour = [1.0; 3];
                }
                colours.push(mix(air_light, scale(colour, gloom), seen_through));
            }
        }
        Self { colours, n_rows, air_light }
    }

    /// The sky in a direction of the world; below the horizon its mirror image.
    pub(super) fn towards(&self, direction: &Vector3<f32>) -> Colour {
        let flat = (direction.x * direction.x + direction.y * direction.y).sqrt();
        let altitude = angle(direction.z.abs(), flat);
        let turn = angle(direction.y, direction.x) * (WIDTH as f32 / std::f32::consts::TAU);
        let column = floor(turn).rem_euclid(WIDTH as i32) as usize;
        let row = (altitude * (HEIGHT as f32 / std::f32::consts::FRAC_PI_2)) as i32 as usize;
        self.colours[row.min(self.n_rows - 1) * WIDTH + column]
    }

    /// Paints the sky's pixels with `put`, two by two: the panorama's own cells are wider.
    pub(super) fn paint(&self, view: &View<'_>, material: &[Material], mut put: impl FnMut(usize, Colour)) {
        let width = view.width();
        let height = material.len() / width;
        for v in (0..height).step_by(2) {
            for u in (0..width).step_by(2) {
                let mut seen = None;
                for (u, v) in [(u, v), (u + 1, v), (u, v + 1), (u + 1, v + 1)] {
                    let at = v * width + u;
                    if u < width && v < height && material[at] == Material::Sky {
                        put(at, *seen.get_or_insert_with(|| self.towards(&view.ray_in_world(u, v))));
                    }
                }
            }
        }
    }
}

/// Value noise on a lattice that repeats every 64 cells.
struct Clouds(Vec<f32>);

impl Clouds {
    const SIDE: usize = 64;

    fn new(seed: u64) -> Self {
        let mut rng = random::stream(seed, "clouds", 0);
        Self((0..Self::SIDE * Self::SIDE).map(|_| rng.random::<f32>()).collect())
    }

    fn at(&self, [x, y]: [f32; 2]) -> f32 {
        let cell = |i: i32, j: i32| {
            let wrap = |k: i32| k.rem_euclid(Self::SIDE as i32) as usize;
            self.0[wrap(j) * Self::SIDE + wrap(i)]
        };
        let (i, j) = (floor(x), floor(y));
        let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
        let (s, t) = (smooth(x - i as f32), smooth(y - j as f32));
        let low = cell(i, j) + (cell(i + 1, j) - cell(i, j)) * s;
        let high = cell(i, j + 1) + (cell(i + 1, j + 1) - cell(i, j + 1)) * s;
        low + (high - low) * t
    }

    /// Five octaves, 0 to 1.
    fn fractal(&self, [x, y]: [f32; 2]) -> f32 {
        let octave = |k: i32| {
            let scale = (1 << k) as f32;
            self.at([x * scale + 17.3 * k as f32, y * scale + 9.1 * k as f32]) / scale
        };
        (0..5).map(octave).sum::<f32>() / (2.0 - 2f32.powi(-4))
    }
}
