//! What is counted on the way, and what a drive came to.

use super::rest::TimeAtRest;
use crate::generate::{CONTROL_PERIOD_S, EpisodePlan};
use crate::outcome::{Collision, DriveOutcome, End, HardStop};

/// Control steps over which acceleration and its change are taken: 0.25 s.
const N_SMOOTH: usize = 5;

/// What is counted on the way.
pub(super) struct Notes {
    pub n_samples: usize,
    pub n_steps: u64,
    pub distance_m: f64,
    pub speeds_mps: Vec<f64>,
    pub collision: Option<Collision>,
    pub struck_by: Vec<String>,
    pub hard_stops: Vec<HardStop>,
    /// A hard brake goes on until then.
    pub hard_until_s: f64,
    pub first_brake_ttc_s: Option<f64>,
    pub has_braked: bool,
    pub rest: TimeAtRest,
}

impl Notes {
    pub fn new() -> Self {
        Self {
            n_samples: 0,
            n_steps: 0,
            distance_m: 0.0,
            speeds_mps: Vec::new(),
            collision: None,
            struck_by: Vec::new(),
            hard_stops: Vec::new(),
            hard_until_s: f64::NEG_INFINITY,
            first_brake_ttc_s: None,
            has_braked: false,
            rest: TimeAtRest::default(),
        }
    }

    /// `free_way_m`: how far a free car has come after each step.
    pub fn finish(self, plan: &EpisodePlan, free_way_m: &[f64], end: End) -> DriveOutcome {
        let (hardest_mps2, rms_jerk_mps3) = comfort(&self.speeds_mps);
        let driven_m = self.n_steps.checked_sub(1).map(|last| free_way_m[last as usize]);
        // Who is stuck would have stood until the end.
        let free_m = if end == End::Stuck { free_way_m.last().copied() } else { driven_m }.unwrap_or(0.0);
        DriveOutcome {
            episode: plan.name.clone(),
            family: String::new(),
            seed: plan.seed,
            town: plan.town.clone(),
            weather: plan.weather.name().to_owned(),
            end,
            duration_s: self.n_steps as f64 * CONTROL_PERIOD_S,
            distance_m: self.distance_m,
            free_m,
            collision: self.collision,
            struck_by: self.struck_by,
            hard_stops: self.hard_stops,
            first_brake_ttc_s: self.first_brake_ttc_s,
            hardest_mps2,
            rms_jerk_mps3,
            n_samples: self.n_samples,
            entry: None,
        }
    }
}

/// Greatest deceleration, and root mean square of the jerk, of speeds at the control rate.
fn comfort(speeds_mps: &[f64]) -> (f64, f64) {
    let window_s = N_SMOOTH as f64 * CONTROL_PERIOD_S;
    let change = |values: &[f64]| -> Vec<f64> {
        values
            .iter()
            .zip(values.iter().skip(N_SMOOTH))
            .map(|(before, now)| (now - before) / window_s)
            .collect()
    };
    let accelerations = change(speeds_mps);
    let jerks = change(&accelerations);
    let hardest = accelerations.iter().fold(0.0, |most: f64, acceleration| most.max(-acceleration));
    let mean = jerks.iter().map(|jerk| jerk * jerk).sum::<f64>() / jerks.len().max(1) as f64;
    (hardest, mean.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comfort_of_a_steady_brake_is_its_deceleration_without_jerk() {
        let speeds: Vec<f64> = (0..60).map(|i| 10.0 - 3.0 * CONTROL_PERIOD_S * f64::from(i)).collect();
        let (hardest_mps2, jerk_mps3) = comfort(&speeds);
        assert!((hardest_mps2 - 3.0).abs() < 1e-9 && jerk_mps3 < 1e-9, "{hardest_mps2} {jerk_mps3}");
        assert_eq!(comfort(&[]), (0.0, 0.0));
    }
}
