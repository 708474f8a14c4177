//! The number that a LiDAR reports for the strength of a return: another curve in each make.
//!
//! x is the power that came back, freed from range: 1 for a white target at right angles.
//!
//! - Calibrated (Velodyne HDL-32E manual, "calibrated reflectivity"; VLP-16 and Ouster's `reflectivity` are alike): diffuse targets
//!   report 0 to 100, 100 x; what sends more back, up to an ideal retroreflector, 101 to 255.
//! - Raw (HDL-64E): the laser's power is controlled, so that strong and weak targets lie close together, in steps of 1 %, and differ from laser to
//!   laser. 115 x^(1/4), less 1.8 a metre beyond 15 m and 2.5 a metre nearer than 10 m; weak targets report 0. The
//!   figures are fits to the medians of road, plants and walls over range in KITTI, whose lasers' gains spread by 30 %.

use rand_distr::{Distribution, StandardNormal};

use crate::random::Rng;
use crate::sensors::rig_config::{IntensityConfig, LidarPreset};

/// Of 255: where calibrated sensors end the diffuse targets.
const DIFFUSE_TOP: f64 = 100.0 / 255.0;
/// Calibrated sensors report 200 of 255 for this many times the light of a white target.
const RETRO_SCALE: f64 = 5.0;
/// Raw sensors: of 255, for x = 1.
const RAW_SCALE: f64 = 115.0 / 255.0;
const RAW_GAMMA: f64 = 0.25;
/// Below this x raw sensors report 0.
const RAW_LEAST: f64 = 0.015;
const RAW_FAR_M: f64 = 15.0;
const RAW_FAR_LOSS_PER_M: f64 = 1.8 / 255.0;
const RAW_NEAR_M: f64 = 10.0;
const RAW_NEAR_LOSS_PER_M: f64 = 2.5 / 255.0;

/// One sensor's curve.
#[derive(Debug, Clone)]
pub(super) struct Response {
    is_raw: bool,
    config: IntensityConfig,
    /// Values that are told apart, less one.
    n_steps: f64,
    /// Standard deviations, as shares: between rings, and from shot to shot.
    ring_spread: f64,
    noise: f64,
}

impl Response {
    pub(super) fn new(preset: LidarPreset, config: &IntensityConfig) -> Self {
        let is_raw = preset == LidarPreset::Hdl64e;
        let (own_steps, ring_spread, noise) = if is_raw { (101, 0.3, 0.1) } else { (256, 0.08, 0.08) };
        let n_steps = if config.steps == 0 { own_steps } else { config.steps };
        Self {
            is_raw,
            n_steps: f64::from(n_steps - 1),
            ring_spread: ring_spread * config.spread,
            noise: noise * config.spread,
            config: config.clone(),
        }
    }

    /// A ring's gain, 1 in the mean.
    pub(super) fn draw_gain(&self, rng: &mut Rng) -> f64 {
        let draw: f64 = StandardNormal.sample(rng);
        // A laser much stronger than the others is turned down by who calibrates it.
        (1.0 + self.ring_spread * draw).clamp(0.2, 1.4)
    }

    /// The reported intensity, 0 to 255: of x, range, the ring's gain and a standard normal draw.
    pub(super) fn report(&self, x: f64, range_m: f64, gain: f64, draw: f64) -> f64 {
        let own = if self.is_raw { raw(x, range_m, gain) } else { gain * calibrated(x) };
        let own = (own * (1.0 + self.noise * draw)).max(0.0);
        let near = if range_m < self.config.near_m { range_m / self.config.near_m } else { 1.0 };
        let curved = if self.config.gamma == 1.0 { own } else { own.powf(self.config.gamma) };
        let share = (self.config.scale * near * curved).min(1.0);
        255.0 * (share * self.n_steps).round() / self.n_steps
    }
}

fn calibrated(x: f64) -> f64 {
    if x <= 1.0 {
        return DIFFUSE_TOP * x;
    }
    DIFFUSE_TOP + (1.0 - DIFFUSE_TOP) * (1.0 - (-(x - 1.0) / RETRO_SCALE).exp())
}

fn raw(x: f64, range_m: f64, gain: f64) -> f64 {
    if x < RAW_LEAST {
        return 0.0;
    }
    let far = RAW_FAR_LOSS_PER_M * (range_m - RAW_FAR_M).max(0.0);
    let near = RAW_NEAR_LOSS_PER_M * (RAW_NEAR_M - range_m).max(0.0);
    gain * RAW_SCALE * x.powf(RAW_GAMMA) - far - near
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(preset: LidarPreset, config: &IntensityConfig, x: f64, range_m: f64) -> f64 {
        let quiet = IntensityConfig { spread: 0.0, ..config.clone() };
        Response::new(preset, &quiet).report(x, range_m, 1.0, 0.0)
    }

    #[test]
    fn calibrated_sensors_report_percent_and_keep_the_rest_for_retroreflectors() {
        let of = |x| report(LidarPreset::Hdl32e, &IntensityConfig::default(), x, 20.0);
        assert_eq!([0.0, 0.17, 1.0].map(of), [0.0, 17.0, 100.0]);
        assert!((101.0..160.0).contains(&of(2.0)) && of(40.0) > 254.0);
    }

    #[test]
    fn the_raw_sensor_brings_road_and_plants_together_and_fades_with_range() {
        let of = |x, range_m| report(LidarPreset::Hdl64e, &IntensityConfig::default(), x, range_m);
        let (road, plants) = (of(0.067, 15.0), of(0.36, 15.0));
        assert!((50.0..70.0).contains(&road) && (80.0..100.0).contains(&plants), "{road} {plants}");
        assert!(of(0.36, 60.0) < 20.0 && of(0.01, 15.0) == 0.0 && of(60.0, 10.0) == 255.0);
        // Steps of 1 %.
        assert!((road / 2.55 - (road / 2.55).round()).abs() < 1e-9);
    }

    #[test]
    fn the_config_scales_bends_dims_near_things_and_rounds() {
        let default = IntensityConfig::default;
        let of = |config, range_m| report(LidarPreset::Vlp16, &config, 0.5, range_m);
        assert_eq!(of(IntensityConfig { scale: 2.0, ..default() }, 20.0), 100.0);
        let bent = of(IntensityConfig { gamma: 0.5, ..default() }, 20.0);
        assert_eq!(bent, (255.0 * (50.0_f64 / 255.0).sqrt()).round());
        assert_eq!(of(IntensityConfig { near_m: 8.0, ..default() }, 4.0), 25.0);
        assert_eq!(of(IntensityConfig { steps: 6, ..default() }, 20.0), 51.0);
    }
}
