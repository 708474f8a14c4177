//! One-cycle learning rate (Smith 2018): a cosine rise from a tenth of the peak, a cosine fall to a
//! ten-thousandth of it.

use std::f64::consts::PI;

/// Learning rate of step `step` of `n_steps`.
#[must_use]
pub fn one_cycle(step: usize, n_steps: usize, peak: f64, rise_share: f64) -> f64 {
    let (start, end) = (peak / 10.0, peak * 1e-4);
    let turn = rise_share * n_steps as f64;
    let here = step as f64;
    let cosine = |from: f64, to: f64, share: f64| to + (from - to) * (1.0 + (PI * share).cos()) / 2.0;
    if here < turn {
        cosine(start, peak, here / turn)
    } else {
        cosine(peak, end, ((here - turn) / (n_steps as f64 - turn).max(1.0)).min(1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_starts_low_peaks_at_the_turn_and_ends_near_zero() {
        assert!((one_cycle(0, 100, 1.0, 0.4) - 0.1).abs() < 1e-12);
        assert!((one_cycle(40, 100, 1.0, 0.4) - 1.0).abs() < 1e-12);
        assert!(one_cycle(99, 100, 1.0, 0.4) < 0.01);
        assert!((1..41).all(|step| one_cycle(step, 100, 1.0, 0.4) > one_cycle(step - 1, 100, 1.0, 0.4)));
    }
}
