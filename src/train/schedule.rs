//! Learning rate and AdamW's first beta over a stage, step by step.
//!
//! | schedule | learning rate, as shares of the peak | beta1 |
//! |---|---|---|
//! | `one_cycle` | cosine from 1/10 to 1 until the turn, cosine to 1e-4 at the end | 0.9 |
//! | `cyclic` | cosine from 1/10 to 1 until the turn, cosine to 1e-5 at the end | 0.9, 0.805 at the turn, 0.9 |
//! | `warmup_cosine` | cosine from 1 to 1e-3, times a line from 1/3 to 1 over 500 steps | as `cyclic` |
//!
//! The turn comes after `rise_share` of the steps, 0.4 as published. `one_cycle` is Smith's (2018). The other two are
//! those of BEVFusion's LiDAR and fused stage: mmcv's `cyclic` with its defaults (target ratios 10 and 1e-4 of a base
//! that is a tenth of the peak, `step_ratio_up` 0.4; momentum ratios 0.85/0.95 and 1 of 0.9), and `CosineAnnealing`
//! with a linear warm-up from 1/3 and `min_lr_ratio` 1e-3. The cosine moves at each step, as in mmdet3d's port; mmcv
//! moves it once per epoch.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

/// AdamW's first beta if nothing changes it.
pub const BETA_1: f64 = 0.9;
/// Beta1 at the turn over beta1 at both ends.
const BETA_1_RATIO: f64 = 0.85 / 0.95;
/// Steps of the warm-up; a shorter stage is all warm-up.
const WARMUP_STEPS: f64 = 500.0;
const WARMUP_RATIO: f64 = 1.0 / 3.0;

/// How learning rate and beta1 change over a stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Schedule {
    #[default]
    OneCycle,
    Cyclic,
    WarmupCosine,
}

/// Learning rate and beta1 of one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pace {
    pub learning_rate: f64,
    pub beta_1: f64,
}

impl Schedule {
    /// Computes the pace of step `step` of `n_steps`; the learning rate peaks at `peak`, and the turn comes after
    /// `rise_share` of the steps.
    #[must_use]
    pub fn pace(self, step: usize, n_steps: usize, peak: f64, rise_share: f64) -> Pace {
        let (here, end) = (step as f64, n_steps as f64);
        let turn = rise_share * end;
        // mmcv's phases begin at whole steps.
        let whole_turn = turn.floor();
        let beta_1 = || rise_and_fall(here, whole_turn, end, [BETA_1, BETA_1 * BETA_1_RATIO, BETA_1]);
        match self {
            Self::OneCycle => Pace {
                learning_rate: rise_and_fall(here, turn, end, [peak / 10.0, peak, peak * 1e-4]),
                beta_1: BETA_1,
            },
            Self::Cyclic => Pace {
                learning_rate: rise_and_fall(here, whole_turn, end, [peak / 10.0, peak, peak * 1e-5]),
                beta_1: beta_1(),
            },
            Self::WarmupCosine => {
                let missing = (1.0 - here / WARMUP_STEPS).max(0.0) * (1.0 - WARMUP_RATIO);
                let learning_rate = cosine(peak, peak * 1e-3, here / end.max(1.0)) * (1.0 - missing);
                Pace { learning_rate, beta_1: beta_1() }
            }
        }
    }
}

/// Half a cosine from the first value to the second until the turn, another to the third until the end.
fn rise_and_fall(here: f64, turn: f64, end: f64, [first, second, third]: [f64; 3]) -> f64 {
    if here < turn {
        cosine(first, second, here / turn)
    } else {
        cosine(second, third, ((here - turn) / (end - turn).max(1.0)).min(1.0))
    }
}

fn cosine(from: f64, to: f64, share: f64) -> f64 {
    to + (from - to) * (1.0 + (PI * share).cos()) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(found: f64, wanted: f64) -> bool {
        (found - wanted).abs() < 1e-9 * wanted.abs().max(1e-6)
    }

    #[test]
    fn one_cycle_starts_low_peaks_at_the_turn_and_ends_near_zero() {
        let rate = |step| Schedule::OneCycle.pace(step, 100, 1.0, 0.4).learning_rate;
        assert!(near(rate(0), 0.1) && near(rate(40), 1.0) && rate(99) < 0.01);
        assert!((1..41).all(|step| rate(step) > rate(step - 1)));
        assert_eq!(Schedule::OneCycle.pace(40, 100, 1.0, 0.4).beta_1, 0.9);
    }

    /// The published LiDAR stage: base 1e-4, ten times it after 8 of 20 epochs, 1e-8 at the end.
    #[test]
    fn cyclic_passes_the_published_points() {
        let pace = |step| Schedule::Cyclic.pace(step, 20_000, 1e-3, 0.4);
        assert!(near(pace(0).learning_rate, 1e-4) && near(pace(0).beta_1, 0.9));
        assert!(near(pace(4000).learning_rate, 5.5e-4), "half way up");
        assert!(near(pace(8000).learning_rate, 1e-3));
        assert!(
            near(pace(8000).beta_1, 0.805_263_157_894_736_8),
            "OpenPCDet's 0.95 to 0.85, times 0.9 / 0.95"
        );
        assert!(
            near(pace(14_000).learning_rate, 0.5 * (1e-3 + 1e-8))
                && near(pace(14_000).beta_1, 0.5 * (0.9 + 0.9 * 0.85 / 0.95))
        );
        assert!(near(pace(20_000).learning_rate, 1e-8) && near(pace(20_000).beta_1, 0.9));
    }

    /// The published fused stage: 2e-4, a third of it at first and all of it after 500 steps; 2e-7 at the
    /// end; beta1 turns after 2.4 of 6 epochs.
    #[test]
    fn warmup_cosine_passes_the_published_points() {
        let pace = |step| Schedule::WarmupCosine.pace(step, 6000, 2e-4, 0.4);
        let regular = |step: f64| 2e-7 + (2e-4 - 2e-7) * (1.0 + (PI * step / 6000.0).cos()) / 2.0;
        assert!(near(pace(0).learning_rate, 2e-4 / 3.0) && near(pace(0).beta_1, 0.9));
        assert!(near(pace(250).learning_rate, regular(250.0) * 2.0 / 3.0), "half way up");
        assert!(near(pace(500).learning_rate, regular(500.0)));
        assert!(near(pace(2400).beta_1, 0.9 * 0.85 / 0.95) && near(pace(6000).beta_1, 0.9));
        assert!(near(pace(3000).learning_rate, 0.5 * (2e-4 + 2e-7)) && near(pace(6000).learning_rate, 2e-7));
    }

    #[test]
    fn one_step_and_turns_at_either_end_give_finite_paces() {
        for schedule in [Schedule::OneCycle, Schedule::Cyclic, Schedule::WarmupCosine] {
            for (n_steps, rise_share) in [(1, 0.4), (2, 0.0), (2, 1.0)] {
                for step in 0..n_steps {
                    let Pace { learning_rate, beta_1 } = schedule.pace(step, n_steps, 1.0, rise_share);
                    assert!((0.0..=1.0).contains(&learning_rate) && (0.8..=0.9).contains(&beta_1));
                }
            }
        }
    }
}
