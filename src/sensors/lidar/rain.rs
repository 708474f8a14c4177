//! Rain drops in a LiDAR beam, after LISA (Kilic et al. 2021, "Lidar Light Scattering Augmentation").
//!
//! Drops follow Marshall and Palmer, N(D) = 8000 exp(-Lambda D) per m^3 and mm. One of diameter D at
//! range r in a beam of 3 mrad answers with power
//! F exp(-2 alpha r) min((D / (3e-3 r))^2, 1) / r^2, F = |(n - 1) / (n + 1)|^2 for water, in units of a
//! target with reflectivity 1 at 1 m. The strongest one counts. Drops whose answer could never be
//! detected are not drawn: the spectrum is cut where the nearest drop stays below the threshold, and
//! the beam where the largest does, which changes no result.

use rand::RngExt;
use rand_distr::{Distribution, Poisson};

use super::echo::{Echo, Reflector};
use crate::random::Rng;
use crate::sensors::weather::{DROPS_PER_M3_MM, WeatherState};

/// Refractive index of water at 905 nm.
const WATER_INDEX: f64 = 1.328;
const BEAM_DIVERGENCE_RAD: f64 = 3e-3;
/// Nothing nearer is in the beam.
const NEAREST_M: f64 = 1.5;
/// Larger drops break up as they fall.
const LARGEST_MM: f64 = 6.0;

/// The drops of one rain, as far as a LiDAR of some sensitivity can detect them.
#[derive(Debug, Clone)]
pub(super) struct Drops {
    slope_per_mm: f64,
    extinction_per_m: f64,
    least_mm: f64,
    reach_m: f64,
    count: Poisson<f64>,
}

impl Drops {
    /// `None` without rain, or if no drop could be detected.
    pub(super) fn new(state: &WeatherState, min_power: f64) -> Option<Self> {
        let slope_per_mm = state.drop_slope_per_mm();
        if !slope_per_mm.is_finite() {
            return None;
        }
        let spread_m = 1e-3 / BEAM_DIVERGENCE_RAD;
        // F (D / (b r))^2 / r^2 = min_power, solved for D at the nearest range and for r at the largest D.
        let least_mm = (min_power / fresnel()).sqrt() * NEAREST_M.powi(2) / spread_m;
        let reach_m = (fresnel() / min_power).sqrt() * LARGEST_MM * spread_m;
        let reach_m = reach_m.sqrt();
        if least_mm >= LARGEST_MM || reach_m <= NEAREST_M {
            return None;
        }
        let drops_per_m3 = DROPS_PER_M3_MM / slope_per_mm * (-slope_per_mm * least_mm).exp();
        let cone_m3 = std::f64::consts::PI / 3.0 * reach_m * (reach_m * BEAM_DIVERGENCE_RAD / 2.0).powi(2);
        let count = Poisson::new(drops_per_m3 * cone_m3).ok()?;
        Some(Self { slope_per_mm, extinction_per_m: state.extinction_per_m(), least_mm, reach_m, count })
    }

    /// The strongest answer of the drops before a target at `range_m`.
    ///
    /// Draws equally many numbers whatever the range.
    pub(super) fn strongest(&self, range_m: f64, rng: &mut Rng) -> Echo {
        let mut strongest = Echo { reflector: Reflector::Rain, power: 0.0, range_m: f64::INFINITY };
        let n = self.count.sample(rng) as u64;
        for _ in 0..n {
            // Drops fill the cone evenly: r = R u^(1/3).
            let at_m = self.reach_m * rng.random::<f64>().cbrt();
            let diameter_mm = self.least_mm - (1.0 - rng.random::<f64>()).ln() / self.slope_per_mm;
            let covered = (1e-3 * diameter_mm / (BEAM_DIVERGENCE_RAD * at_m)).powi(2).min(1.0);
            let power = fresnel() * (-2.0 * self.extinction_per_m * at_m).exp() * covered / (at_m * at_m);
            if (NEAREST_M..range_m).contains(&at_m) && power > strongest.power {
                strongest = Echo { reflector: Reflector::Rain, power, range_m: at_m };
            }
        }
        strongest
    }
}

fn fresnel() -> f64 {
    ((WATER_INDEX - 1.0) / (WATER_INDEX + 1.0)).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random;
    use crate::sensors::Weather;

    fn rain(rain_rate_mmph: f64) -> WeatherState {
        WeatherState { rain_rate_mmph, ..Weather::HardRainNoon.state() }
    }

    fn detected_share(rate: f64) -> f64 {
        let drops = Drops::new(&rain(rate), 1e-5).unwrap();
        let mut rng = random::stream(3, "t", 0);
        let n = 40_000;
        let hits = (0..n).filter(|_| drops.strongest(f64::INFINITY, &mut rng).power > 1e-5).count();
        hits as f64 / f64::from(n)
    }

    #[test]
    fn harder_rain_scatters_more_back() {
        let (soft, hard) = (detected_share(5.0), detected_share(50.0));
        assert!(soft > 0.0 && hard > 3.0 * soft && hard < 0.5, "{soft} {hard}");
    }

    #[test]
    fn the_share_of_detected_drops_is_that_of_the_integral() {
        // Expected drops above the threshold: Int n(D) V(r(D)) dD, V the cone up to where the drop's
        // answer equals the threshold (extinction left out; it takes off 2 % at these ranges).
        let slope = rain(50.0).drop_slope_per_mm();
        let step_mm = 1e-3;
        let expected: f64 = (0..20_000)
            .map(|i| (f64::from(i) + 0.5) * step_mm)
            .map(|d_mm| {
                let r4 = fresnel() / 1e-5 * (d_mm * 1e-3 / BEAM_DIVERGENCE_RAD).powi(2);
                let r = r4.powf(0.25);
                let cone = |r: f64| std::f64::consts::PI / 12.0 * BEAM_DIVERGENCE_RAD.powi(2) * r.powi(3);
                let volume = (cone(r) - cone(NEAREST_M)).max(0.0);
                DROPS_PER_M3_MM * (-slope * d_mm).exp() * volume * step_mm
            })
            .sum();
        let share = 1.0 - (-expected).exp();
        let found = detected_share(50.0);
        assert!((found / share - 1.0).abs() < 0.1, "{found} against {share}");
    }

    #[test]
    fn no_rain_has_no_drops_and_a_near_wall_hides_them() {
        assert!(Drops::new(&Weather::FogNoon.state(), 1e-5).is_none());
        let drops = Drops::new(&rain(50.0), 1e-5).unwrap();
        let mut rng = random::stream(4, "t", 0);
        assert!((0..1000).all(|_| drops.strongest(1.4, &mut rng).power == 0.0));
    }
}
