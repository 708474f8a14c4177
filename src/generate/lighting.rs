//! The light under which the renderer draws: the sun and the sky by altitude and cloud.
//!
//! Display-referred colours that were chosen by eye against photographs; the sun's share falls with
//! cloud, its colour reddens near the horizon, and shadows end where the sun's disk is covered.

use crate::scene::{Lighting, Sun};
use crate::sensors::{SUN_AZIMUTH_RAD, WeatherState};

/// The light that the sun and the sky give in a weather.
pub(super) fn lighting(state: &WeatherState) -> Lighting {
    if state.is_night() {
        return Lighting { ambient: [1.0; 3], sun: None };
    }
    // 0 at the horizon, 1 from 25 degrees up.
    let height = (state.sun_altitude_rad / 25f64.to_radians()).clamp(0.0, 1.0);
    let between = |low: [f64; 3], high: [f64; 3]| [0, 1, 2].map(|i| low[i] + (high[i] - low[i]) * height);
    let open = between([0.46, 0.43, 0.50], [0.48, 0.49, 0.52]);
    let covered = between([0.44, 0.41, 0.43], [0.70, 0.71, 0.73]);
    let cover = state.cloud_cover;
    // Rain clouds are thicker.
    let gloom = 1.0 - 0.25 * (state.rain_rate_mmph / 45.0).min(1.0);
    let ambient = [0, 1, 2].map(|i| (open[i] + (covered[i] - open[i]) * cover) * gloom);
    let colour = between([0.98, 0.62, 0.34], [0.78, 0.75, 0.68]).map(|c| c * (1.0 - cover).powf(0.7));
    let (sin, cos) = state.sun_altitude_rad.sin_cos();
    let direction = [-cos * SUN_AZIMUTH_RAD.cos(), -cos * SUN_AZIMUTH_RAD.sin(), -sin];
    Lighting { ambient, sun: Some(Sun { direction, colour, casts_shadow: cover < 0.6 }) }
}
