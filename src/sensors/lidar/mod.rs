//! The spinning LiDAR: which rays it fires, and what comes back from their hits through the weather.
//!
//! Powers are in units of a target with reflectivity 1 at 1 m, seen at right angles in clear air:
//!
//! power = reflectivity * factor(incidence) * exp(-2 alpha range) / range^2, alpha the air's extinction; the factor is that of the
//! surface's finish, less what a grazing beam loses as it smears over the ground ([`surface`]).
//!
//! A return is detected with probability min(1, power / threshold); the threshold is the power of a
//! target of reflectivity 0.1 at the sensor's stated range. Where fog or a rain drop sends back more than
//! the target, its return takes the target's place ([`fog`]; [`rain`], above the threshold only); water on the ground weakens the
//! target ([`wet_ground`]). Of windows a share returns, the others let the beam through; among leaves
//! a beam goes some way. The reported intensity makes up for the range by the
//! make's own curve ([`response`]) of x = reflectivity * factor(incidence) * exp(-2 (alpha + attenuation) range).

mod added_fog;
mod echo;
mod fog;
mod pattern;
mod rain;
mod response;
mod surface;
mod wet_ground;

use rand::RngExt;
use rand_distr::{Beta, Distribution, StandardNormal};

pub use self::added_fog::AddedFog;
use self::echo::Echo;
pub use self::echo::Reflector;
use self::fog::SoftReturns;
pub use self::pattern::{Pattern, is_in_view};
use self::rain::Drops;
use self::response::Response;
pub use self::surface::{Finish, TUFT_M};
use super::rig_config::RigLidarConfig;
use super::weather::WeatherState;
use crate::random::{self, Rng};
use crate::sample::LidarPoint;

/// Range noise of a return at the detection threshold is this over the square root of two (LISA).
const THRESHOLD_NOISE_M: f64 = 0.09;
/// Air with an optical range below this counts as fog.
const FOG_MOR_M: f64 = 1000.0;
/// Soft returns lie up to this much behind their strongest place, by Beta(2, 20) (Hahner et al. 2021).
const SOFT_SPREAD_M: f64 = 10.0;

/// A ray's true hit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Infinite where nothing is hit.
    pub range_m: f64,
    /// Cosine of the angle between ray and surface normal, 0 to 1.
    pub cos_incidence: f64,
    /// Reflectivity of the dry surface at right angles; 1 for a white one, more for retroreflectors.
    pub reflectivity: f64,
    /// Whether rain makes a film of water on it.
    pub is_paved: bool,
    pub finish: Finish,
    /// How far behind the hit there are leaves; only read where the finish is [`Finish::Leafy`].
    pub leaves_m: f64,
}

/// A turn of the LiDAR, by its number in the episode; each draws noise of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turn {
    Sample(u64),
    /// Between two samples.
    Sweep(u64),
}

/// A measured point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LidarReturn {
    /// Index of its ray in the pattern.
    pub ray: usize,
    pub reflector: Reflector,
    pub point: LidarPoint,
}

/// The sensor of one episode in its weather.
#[derive(Debug, Clone)]
pub struct Receiver {
    config: RigLidarConfig,
    state: WeatherState,
    min_power: f64,
    soft_returns: Option<SoftReturns>,
    drops: Option<Drops>,
    rings: Vec<RingFlaws>,
    response: Response,
    seed: u64,
}

/// What sets a beam apart from the others.
#[derive(Debug, Clone, Copy)]
struct RingFlaws {
    offset_m: f64,
    dropout: f64,
    gain: f64,
}

/// The random numbers of one turn.
struct Draws {
    noise: Rng,
    weather: Rng,
    strength: Rng,
    leaves: Rng,
}

impl Receiver {
    /// A sensor with `n_rings` beams; its own flaws and all noise come from the seed.
    pub fn new(config: &RigLidarConfig, n_rings: usize, state: &WeatherState, seed: u64) -> Self {
        let min_power = 0.1 / config.sure_range_m.powi(2);
        let mut rng = random::stream(seed, "lidar-rings", 0);
        let mut gain_rng = random::stream(seed, "lidar-gains", 0);
        let response = Response::new(config.preset, &config.intensity);
        let rings = (0..n_rings).map(|_| {
            let offset_m = config.ring_bias_m * standard_normal(&mut rng);
            let dropout = config.dropout * (1.0 + config.dropout_spread * (2.0 * rng.random::<f64>() - 1.0));
            RingFlaws { offset_m, dropout, gain: response.draw_gain(&mut gain_rng) }
        });
        let is_fog = state.mor_m < FOG_MOR_M;
        Self {
            config: config.clone(),
            state: *state,
            min_power,
            soft_returns: is_fog.then(|| SoftReturns::new(state.mor_m, state.extinction_per_m())),
            drops: Drops::new(state, min_power),
            rings: rings.collect(),
            response,
            seed,
        }
    }

    /// The measured points of a turn, ray by ray; lost points and those out of range are left out.
    ///
    /// Every ray draws equally many numbers whatever it hits, so one object more does not change the others'
    /// noise.
    ///
    /// # Panics
    /// If hits and rays differ in number, or a ring has no entry.
    pub fn returns(&self, pattern: &Pattern, hits: &[Hit], turn: Turn) -> Vec<LidarReturn> {
        assert_eq!(hits.len(), pattern.directions.len(), "one hit for each ray");
        let (names, turn_idx) = match turn {
            Turn::Sample(i) => (["lidar-noise", "lidar-weather", "lidar-strength", "lidar-leaves"], i),
            Turn::Sweep(i) => (
                ["lidar-sweep-noise", "lidar-sweep-weather", "lidar-sweep-strength", "lidar-sweep-leaves"],
                i,
            ),
        };
        let [noise, weather, strength, leaves] = names.map(|name| random::stream(self.seed, name, turn_idx));
        let mut draws = Draws { noise, weather, strength, leaves };
        let rays = hits.iter().enumerate();
        rays.filter_map(|(ray, hit)| self.measure(pattern, ray, hit, &mut draws)).collect()
    }

    fn measure(&self, pattern: &Pattern, ray: usize, hit: &Hit, draws: &mut Draws) -> Option<LidarReturn> {
        let ring = pattern.rings[ray];
        let flaws = self.rings[usize::from(ring)];
        let range_draw = standard_normal(&mut draws.noise);
        let [dropout_draw, detection_draw] = [draws.noise.random::<f64>(), draws.noise.random::<f64>()];
        let glass_draw = draws.strength.random::<f64>();
        let strength_draw = standard_normal(&mut draws.strength);
        let leaves_draw = draws.leaves.random::<f64>();

        let is_leafy = hit.finish == Finish::Leafy;
        let way_m = if is_leafy { surface::way_among_leaves_m(leaves_draw, hit.leaves_m) } else { 0.0 };
        let hit = &Hit { range_m: hit.range_m + way_m, ..*hit };
        let echo = self.strongest(hit, glass_draw < self.config.glass_return, &mut draws.weather);
        let signal_to_threshold = echo.power / self.min_power;
        if dropout_draw < flaws.dropout || detection_draw >= signal_to_threshold {
            return None;
        }
        let is_turbid = self.soft_returns.is_some() || self.drops.is_some();
        let weak_m =
            if is_turbid { THRESHOLD_NOISE_M / (2.0 * signal_to_threshold.max(1.0)).sqrt() } else { 0.0 };
        let range_m = echo.range_m + flaws.offset_m + self.config.range_noise_m.hypot(weak_m) * range_draw;
        if !range_m.is_finite() || range_m <= 0.0 || range_m > self.config.max_range_m {
            return None;
        }
        let calibrated = echo.power * echo.range_m.powi(2);
        let own_loss = (-2.0 * self.config.attenuation_per_m * echo.range_m).exp();
        let intensity = self.response.report(calibrated * own_loss, echo.range_m, flaws.gain, strength_draw);
        let at = pattern.directions[ray] * range_m;
        let point = LidarPoint {
            x_m: at.x as f32,
            y_m: at.y as f32,
            z_m: at.z as f32,
            intensity: intensity as f32,
            ring,
        };
        Some(LidarReturn { ray, reflector: echo.reflector, point })
    }

    /// The strongest of the target's, the fog's and the drops' echoes.
    fn strongest(&self, hit: &Hit, glass_returns: bool, weather_rng: &mut Rng) -> Echo {
        let mut strongest = Echo { reflector: Reflector::Target, power: 0.0, range_m: hit.range_m };
        let is_met = hit.range_m.is_finite() && hit.range_m > 0.0;
        if is_met && (hit.finish != Finish::Glass || glass_returns) {
            let wetness = if hit.is_paved { self.state.wetness } else { 0.0 };
            let factor = wet_ground::factor(hit.finish, hit.reflectivity, hit.cos_incidence, wetness);
            let air = (-2.0 * self.state.extinction_per_m() * hit.range_m).exp();
            let back = factor * surface::peak_kept(hit.range_m, hit.cos_incidence);
            strongest.power = hit.reflectivity * back * air / hit.range_m.powi(2);
        }
        if let Some(soft_returns) = &self.soft_returns {
            let mut soft = soft_returns.before(hit.range_m);
            let spread = Beta::new(2.0, 20.0).expect("both shapes are positive").sample(weather_rng);
            if soft.power > strongest.power {
                // Not behind the target.
                soft.range_m = (soft.range_m + SOFT_SPREAD_M * spread).min(hit.range_m);
                strongest = soft;
            }
        }
        if let Some(drops) = &self.drops {
            let drop = drops.strongest(hit.range_m, weather_rng);
            if drop.power > strongest.power.max(self.min_power) {
                strongest = drop;
            }
        }
        strongest
    }
}

fn standard_normal(rng: &mut Rng) -> f64 {
    StandardNormal.sample(rng)
}

#[cfg(test)]
mod tests;
