//! What is counted on the way, and what a drive came to.

use super::config::HARD_BRAKING_MPS2;
use super::rest::TimeAtRest;
use crate::generate::{CONTROL_PERIOD_S, EpisodePlan};
use crate::outcome::{Collision, DriveOutcome, End, HardStop};

/// Control steps over which acceleration and its change are taken: 0.25 s.
const N_SMOOTH: usize = 5;

/// A hard brake goes on above this, m/s².
const STILL_HARD_MPS2: f64 = 2.0;
/// A brake that is felt, and above which it goes on, m/s².
const FELT_BRAKING_MPS2: f64 = 1.0;
const STILL_FELT_MPS2: f64 = 0.5;
/// A brake goes on through pauses of this length, seconds.
const PAUSE_S: f64 = 0.5;
/// A stop begins at this speed or above, m/s: the last of a crawl is none.
const LEAST_STOP_MPS: f64 = 1.0;

/// What perception orders at a control step, and what is true then.
pub(super) struct Order {
    pub time_s: f64,
    pub speed_mps: f64,
    pub braking_mps2: f64,
    /// Whether the ego rolls.
    pub moves: bool,
    /// Whether something is truly harmful, or was in the time in which a hazard is remembered.
    pub is_right: bool,
}

/// Brakes above a threshold, each with all that goes on of it.
pub(super) struct Brakes {
    above_mps2: f64,
    /// It goes on above this.
    still_mps2: f64,
    until_s: f64,
    pub stops: Vec<HardStop>,
}

impl Brakes {
    fn above(above_mps2: f64, still_mps2: f64) -> Self {
        Self { above_mps2, still_mps2, until_s: f64::NEG_INFINITY, stops: Vec::new() }
    }

    pub fn note(&mut self, now: &Order) {
        let &Order { time_s, speed_mps, braking_mps2, moves, is_right } = now;
        let goes_on = time_s <= self.until_s && moves;
        if goes_on && braking_mps2 > self.still_mps2 {
            self.until_s = time_s + PAUSE_S;
        }
        if braking_mps2 <= self.above_mps2 || !moves || (!goes_on && speed_mps < LEAST_STOP_MPS) {
            return;
        }
        if !goes_on {
            self.stops.push(HardStop { time_s, braking_mps2, is_false: true });
        }
        self.until_s = time_s + PAUSE_S;
        let stop = self.stops.last_mut().expect("one has just been noted, if none was");
        stop.braking_mps2 = stop.braking_mps2.max(braking_mps2);
        if is_right {
            stop.is_false = false;
        }
    }
}

/// What is counted on the way.
pub(super) struct Notes {
    pub n_samples: usize,
    pub n_steps: u64,
    pub distance_m: f64,
    pub speeds_mps: Vec<f64>,
    pub collision: Option<Collision>,
    pub struck_by: Vec<String>,
    pub hard_stops: Brakes,
    /// Brakes of any strength that one feels.
    pub brakes: Brakes,
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
            hard_stops: Brakes::above(HARD_BRAKING_MPS2, STILL_HARD_MPS2),
            brakes: Brakes::above(FELT_BRAKING_MPS2, STILL_FELT_MPS2),
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
            hard_stops: self.hard_stops.stops,
            brakes: self.brakes.stops,
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
    fn a_partial_brake_in_vain_is_a_brake_and_no_hard_stop() {
        let mut notes = Notes::new();
        let mut order = |time_s, braking_mps2, is_right| {
            let now = Order { time_s, speed_mps: 8.0, braking_mps2, moves: true, is_right };
            notes.hard_stops.note(&now);
            notes.brakes.note(&now);
        };
        order(1.0, 3.0, false);
        order(1.4, 3.0, false);
        order(3.0, 3.0, true);
        order(5.0, 6.0, false);
        order(7.0, 0.9, false);
        let of = |brakes: &Brakes| -> Vec<(f64, bool)> {
            brakes.stops.iter().map(|stop| (stop.time_s, stop.is_false)).collect()
        };
        assert_eq!(of(&notes.hard_stops), [(5.0, true)]);
        assert_eq!(of(&notes.brakes), [(1.0, true), (3.0, false), (5.0, true)]);
    }

    #[test]
    fn comfort_of_a_steady_brake_is_its_deceleration_without_jerk() {
        let speeds: Vec<f64> = (0..60).map(|i| 10.0 - 3.0 * CONTROL_PERIOD_S * f64::from(i)).collect();
        let (hardest_mps2, jerk_mps3) = comfort(&speeds);
        assert!((hardest_mps2 - 3.0).abs() < 1e-9 && jerk_mps3 < 1e-9, "{hardest_mps2} {jerk_mps3}");
        assert_eq!(comfort(&[]), (0.0, 0.0));
    }
}
