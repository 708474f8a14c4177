//! Soft returns of the LiDAR in fog: light that the droplets themselves send back.
//!
//! Hahner et al., "Fog Simulation on Real LiDAR Point Clouds", ICCV 2021: the droplets before a
//! target at `r0` answer a sin^2 pulse of half-power width tau with
//!
//! soft(r) = beta / beta0 * Int_0^{2 tau} sin^2(pi t / (2 tau)) exp(-2 alpha s) / s^2 xi(s) [s <= r0] dt
//!
//! with s = r - c t / 2, t in seconds as in the authors' code (their beta0 = 1e-6 / pi absorbs the
//! unit), and the overlap xi of beam and receiver rising from 0 at 0.9 m to 1 at 1 m. Theirs is relative
//! to the target's own return; here beta0 stands for a target of mean reflectivity (0.25), so that rays
//! into the open answer too. A hard target gives reflectivity * cos(incidence) * exp(-2 alpha r0) / r0^2.

use super::echo::{Echo, Reflector};

/// Speed of light, metres per second.
const LIGHT_MPS: f64 = 299_792_458.0;
/// Half-power pulse width, seconds.
const PULSE_S: f64 = 20e-9;
/// Back-scatter of fog per metre and steradian: this over the MOR.
const BACKSCATTER_PER_MOR: f64 = 0.046;
/// The authors' beta0: back-scatter of a hard target.
const TARGET_BACKSCATTER: f64 = 1e-6 / std::f64::consts::PI;
/// Reflectivity of the target that `TARGET_BACKSCATTER` stands for: usual things on a street.
const TARGET_REFLECTIVITY: f64 = 0.25;
/// Where the receiver begins to see the beam, and where it sees all of it.
const OVERLAP_M: [f64; 2] = [0.9, 1.0];
const STEP_M: f64 = 0.1;
/// Farther targets no longer change the strongest soft return.
const REACH_M: f64 = 25.0;
const N_PULSE_STEPS: usize = 48;

/// The strongest soft return by the target's range, in steps of 0.1 m.
#[derive(Debug, Clone)]
pub(super) struct SoftReturns(Vec<Echo>);

impl SoftReturns {
    /// The soft returns for a fog's optical range and the extinction of the air as a whole.
    pub(super) fn new(mor_m: f64, extinction_per_m: f64) -> Self {
        let scale = TARGET_REFLECTIVITY * BACKSCATTER_PER_MOR / mor_m / TARGET_BACKSCATTER;
        let n = (REACH_M / STEP_M) as usize;
        let strongest = |i: usize| {
            let target_m = STEP_M * i as f64;
            let pulse_m = LIGHT_MPS * PULSE_S;
            let ranges = (0..).map(|k| STEP_M * f64::from(k)).take_while(|r| *r <= target_m + pulse_m);
            let echo = |power, range_m| Echo { reflector: Reflector::Fog, power, range_m };
            ranges
                .map(|range_m| echo(scale * response_s(range_m, target_m, extinction_per_m), range_m))
                .max_by(|a, b| a.power.total_cmp(&b.power))
                .unwrap_or(echo(0.0, 0.0))
        };
        Self((0..=n).map(strongest).collect())
    }

    /// The strongest soft return before a target at `range_m` (infinite: no target).
    pub(super) fn before(&self, range_m: f64) -> Echo {
        let i = (range_m / STEP_M).min((self.0.len() - 1) as f64) as usize;
        self.0[i]
    }
}

/// The integral over the pulse by the midpoint rule.
fn response_s(range_m: f64, target_m: f64, extinction_per_m: f64) -> f64 {
    let dt_s = 2.0 * PULSE_S / N_PULSE_STEPS as f64;
    let at = |k: usize| {
        let t_s = (k as f64 + 0.5) * dt_s;
        let s_m = range_m - LIGHT_MPS * t_s / 2.0;
        let overlap = ((s_m - OVERLAP_M[0]) / (OVERLAP_M[1] - OVERLAP_M[0])).clamp(0.0, 1.0);
        if overlap <= 0.0 || s_m > target_m {
            return 0.0;
        }
        let pulse = (std::f64::consts::PI * t_s / (2.0 * PULSE_S)).sin().powi(2);
        pulse * (-2.0 * extinction_per_m * s_m).exp() / (s_m * s_m) * overlap
    };
    (0..N_PULSE_STEPS).map(at).sum::<f64>() * dt_s
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn soft_returns_come_from_a_few_metres_and_grow_with_the_fog() {
        let (thick, thin) = (SoftReturns::new(50.0, 0.06), SoftReturns::new(200.0, 0.015));
        let far = thick.before(f64::INFINITY);
        assert!((2.0..6.0).contains(&far.range_m), "{far:?}");
        let ratio = far.power / thin.before(f64::INFINITY).power;
        // Four times the back-scatter, less what the thicker fog swallows on the first metres.
        assert!((3.0..4.0).contains(&ratio), "{ratio}");
    }

    #[test]
    fn there_is_no_soft_return_before_a_target_that_the_receiver_sees_first() {
        assert_eq!(SoftReturns::new(50.0, 0.06).before(0.5).power, 0.0);
    }

    #[test]
    fn the_midpoint_sum_equals_a_fine_one() {
        let fine: f64 = {
            let n = 100_000;
            let dt = 2.0 * PULSE_S / f64::from(n);
            let at = |k: i32| {
                let t = (f64::from(k) + 0.5) * dt;
                let s = 4.0 - LIGHT_MPS * t / 2.0;
                let overlap = ((s - 0.9) / 0.1).clamp(0.0, 1.0);
                let pulse = (std::f64::consts::PI * t / (2.0 * PULSE_S)).sin().powi(2);
                if overlap > 0.0 { pulse * (-0.12 * s).exp() / (s * s) * overlap } else { 0.0 }
            };
            (0..n).map(at).sum::<f64>() * dt
        };
        assert!((response_s(4.0, 50.0, 0.06) / fine - 1.0).abs() < 0.02);
    }
}
