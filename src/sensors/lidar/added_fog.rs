//! Fog in a cloud that was recorded in clearer air, as Hahner et al. put it into clouds of real streets ([`super::fog`]).
//!
//! What the recording says of a point is enough for it: the intensity stands for the power that came back, freed from range, 100
//! of 255 for a white target (of makes with another curve it is a rough guess). Rays that met nothing in clear air have no point
//! and get none; a cloud that has fog gets more of it.

use rand::RngExt;
use rand_distr::{Beta, Distribution};

use super::SOFT_SPREAD_M;
use super::fog::SoftReturns;
use crate::random::Rng;
use crate::sample::LidarPoint;

/// The intensity of a white target, of 255, as calibrated sensors tell it.
const WHITE: f64 = 100.0;
/// A point that was measured sent back this much at least; some makes tell 0 of dark things.
const LEAST: f64 = 2.0;
/// Power that is detected for sure: a target of reflectivity 0.1 at 100 m.
const MIN_POWER: f64 = 1e-5;

/// Fog of one density.
#[derive(Debug, Clone)]
pub struct AddedFog {
    extinction_per_m: f64,
    soft_returns: SoftReturns,
}

impl AddedFog {
    /// Fog of this meteorological optical range, metres; it makes a table, which takes milliseconds.
    #[must_use]
    pub fn new(mor_m: f64) -> Self {
        let extinction_per_m = 20f64.ln() / mor_m;
        Self { extinction_per_m, soft_returns: SoftReturns::new(mor_m, extinction_per_m) }
    }

    /// What becomes of a point: weaker, or in its place what the droplets before it send back; `None` where too little comes back.
    pub fn on(&self, point: &LidarPoint, rng: &mut Rng) -> Option<LidarPoint> {
        let (spread, detection) =
            (Beta::new(2.0, 20.0).expect("both shapes are positive").sample(rng), rng.random::<f64>());
        let at = [point.x_m, point.y_m, point.z_m].map(f64::from);
        let range_m = at.iter().map(|x| x * x).sum::<f64>().sqrt();
        if range_m <= 0.0 {
            return Some(*point);
        }
        let air = (-2.0 * self.extinction_per_m * range_m).exp();
        let strength = f64::from(point.intensity).max(LEAST) / WHITE * air;
        let (power, soft) = (strength / range_m.powi(2), self.soft_returns.before(range_m));
        if detection >= power.max(soft.power) / MIN_POWER {
            return None;
        }
        if soft.power <= power {
            return Some(LidarPoint { intensity: (f64::from(point.intensity) * air) as f32, ..*point });
        }
        let soft_m = (soft.range_m + SOFT_SPREAD_M * spread).min(range_m);
        let [x_m, y_m, z_m] = at.map(|x| (x * soft_m / range_m) as f32);
        let intensity = (WHITE * soft.power * soft.range_m.powi(2)).min(255.0) as f32;
        Some(LidarPoint { x_m, y_m, z_m, intensity, ..*point })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::stream;

    /// Points that stay, are the fog's, and are lost, of a hundred at a range.
    fn fates(mor_m: f64, range_m: f32, intensity: f32) -> [usize; 3] {
        let (fog, mut rng) = (AddedFog::new(mor_m), stream(1, "added-fog-test", 0));
        let point = LidarPoint { x_m: range_m, y_m: 0.0, z_m: 0.0, intensity, ring: 3 };
        let mut fates = [0; 3];
        for _ in 0..100 {
            match fog.on(&point, &mut rng) {
                Some(seen) if seen.x_m == range_m => {
                    let air = (-2.0 * 20f64.ln() / mor_m * f64::from(range_m)).exp() as f32;
                    assert!((seen.intensity - intensity * air).abs() < 0.01);
                    fates[0] += 1;
                }
                Some(seen) => {
                    assert!((1.0..range_m).contains(&seen.x_m) && seen.x_m < 12.0, "{seen:?}");
                    assert!((0.0..60.0).contains(&seen.intensity) && seen.ring == 3, "{seen:?}");
                    fates[1] += 1;
                }
                None => fates[2] += 1,
            }
        }
        fates
    }

    #[test]
    fn near_things_stay_and_droplets_take_the_place_of_far_and_dark_ones() {
        assert_eq!(fates(1e6, 60.0, 30.0), [100, 0, 0], "clear air");
        assert_eq!(fates(100.0, 5.0, 30.0), [100, 0, 0]);
        assert_eq!(fates(400.0, 5.0, 0.0), [100, 0, 0], "a dark road, of which some makes tell 0");
        let [kept, fog, lost] = fates(50.0, 60.0, 10.0);
        assert!(kept == 0 && (10..60).contains(&fog) && lost > 30, "{fog} {lost}");
        let kept = |mor_m| fates(mor_m, 25.0, 10.0)[0];
        assert!(kept(100.0) <= kept(400.0), "{} {}", kept(100.0), kept(400.0));
    }
}
