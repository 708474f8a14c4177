//! Precision and errors over recall, AP and mean errors: nuscenes-devkit's arithmetic, step by step.
//!
//! Recall is sampled at 101 steps. AP = mean over the steps above `min_recall` of
//! max(0, precision - `min_precision`), over 1 - `min_precision`. Source: `accumulate`, `calc_ap` and
//! `calc_tp` of nuscenes-devkit 1.2.0 (`nuscenes/eval/detection/algo.py`), and `numpy.interp`.

use serde::{Deserialize, Serialize};

/// Recall steps from 0 to 1.
const N_STEPS: usize = 101;

/// Distance of recall steps; `numpy.linspace(0, 1, 101)[i]` is `i * 0.01` to the last bit, unlike `i / 100`.
const STEP: f64 = 0.01;

/// Errors kept for each match: translation (metres), scale (1 - IoU of aligned boxes), orientation (radians).
pub(super) const N_ERRORS: usize = 3;

/// Precision and confidence at each of the 101 recall steps, 0, 0.01 .. 1; zero beyond the recall that is reached.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Curve {
    pub precision: Vec<f64>,
    /// The lowest score of the detections needed to reach the recall.
    pub confidence: Vec<f64>,
}

impl Curve {
    /// The curve of detections in rank order: each one's score and whether it is a true positive.
    ///
    /// All zero if there is no positive or no match, as the devkit's `no_predictions`.
    pub(super) fn new(ranked: impl IntoIterator<Item = (f64, bool)>, n_positives: usize) -> Self {
        let (mut recall, mut precision, mut confidence) = (Vec::new(), Vec::new(), Vec::new());
        let (mut n_true, mut n_false) = (0.0, 0.0);
        for (score, is_match) in ranked {
            *(if is_match { &mut n_true } else { &mut n_false }) += 1.0;
            precision.push(n_true / (n_false + n_true));
            recall.push(n_true / count(n_positives));
            confidence.push(score);
        }
        if n_positives == 0 || n_true == 0.0 {
            return Self { precision: vec![0.0; N_STEPS], confidence: vec![0.0; N_STEPS] };
        }
        let at_steps = |values: &[f64]| {
            (0..N_STEPS).map(|step| interpolate(count(step) * STEP, &recall, values, 0.0)).collect()
        };
        Self { precision: at_steps(&precision), confidence: at_steps(&confidence) }
    }

    /// Average precision, 0 to 1.
    pub(super) fn average_precision(&self, first_step: usize, min_precision: f64) -> f64 {
        let clipped =
            self.precision[first_step..].iter().map(|precision| (precision - min_precision).max(0.0));
        // The devkit's own perfect AP is 1.0000000000000004.
        (mean(clipped) / (1.0 - min_precision)).min(1.0)
    }

    /// Mean errors of the matches, given in rank order, over the recall that was reached; 1 each if it
    /// is not above the minimum.
    pub(super) fn mean_errors(
        &self,
        matches: &[(f64, [f64; N_ERRORS])],
        first_step: usize,
    ) -> [f64; N_ERRORS] {
        let last_step = self.confidence.iter().rposition(|&confidence| confidence != 0.0).unwrap_or(0);
        if last_step < first_step || matches.is_empty() {
            return [1.0; N_ERRORS];
        }
        // Ascending scores, as interpolation needs them.
        let scores: Vec<f64> = matches.iter().rev().map(|&(score, _)| score).collect();
        std::array::from_fn(|which| {
            let mut sum = 0.0;
            let mut running: Vec<f64> = matches
                .iter()
                .enumerate()
                .map(|(i, (_, errors))| {
                    sum += errors[which];
                    sum / count(i + 1)
                })
                .collect();
            running.reverse();
            let beyond = *running.last().expect("there is at least one match");
            let at_steps = self.confidence[first_step..=last_step].iter();
            mean(at_steps.map(|&confidence| interpolate(confidence, &scores, &running, beyond)))
        })
    }
}

/// `numpy.interp(x, xs, ys, right=beyond)` for one `x`; `xs` ascending, neither slice empty.
///
/// Below all `xs` it is the first value. Where `x` equals repeated `xs`, it is the last of their values.
fn interpolate(x: f64, xs: &[f64], ys: &[f64], beyond: f64) -> f64 {
    let n_not_above = xs.partition_point(|&other| other <= x);
    let Some(below) = n_not_above.checked_sub(1) else { return ys[0] };
    if xs[below] == x {
        return ys[below];
    }
    if n_not_above == xs.len() {
        return beyond;
    }
    let slope = (ys[below + 1] - ys[below]) / (xs[below + 1] - xs[below]);
    slope * (x - xs[below]) + ys[below]
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = count(values.len());
    values.sum::<f64>() / n
}

#[allow(clippy::cast_precision_loss)] // counts of boxes and steps, far below 2^53
fn count(n: usize) -> f64 {
    n as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolation_takes_the_last_of_equal_points_as_numpy_does() {
        let (xs, ys) = ([0.1, 0.1, 0.3], [1.0, 0.5, 0.7]);
        let at = |x| interpolate(x, &xs, &ys, 0.0);
        assert_eq!([at(0.0), at(0.1), at(0.3), at(0.31)], [1.0, 0.5, 0.7, 0.0]);
        assert!((at(0.2) - 0.6).abs() < 1e-12);
    }

    #[test]
    fn one_true_positive_of_two_truths_reaches_half_the_area() {
        // Precision 1 up to recall 0.5, nothing beyond: steps 11..=50 of 11..=100 count.
        let curve = Curve::new([(0.9, true)], 2);
        assert!((curve.average_precision(11, 0.1) - 40.0 / 90.0).abs() < 1e-12);
    }

    #[test]
    fn no_positive_or_no_match_is_zero() {
        for (ranked, n_positives) in [(vec![], 3), (vec![(0.9, false)], 3), (vec![(0.9, false)], 0)] {
            let curve = Curve::new(ranked, n_positives);
            assert_eq!(curve.average_precision(11, 0.1), 0.0);
            assert_eq!(curve.mean_errors(&[], 11), [1.0; 3]);
        }
    }

    #[test]
    fn errors_below_the_minimum_recall_are_one() {
        // One match of ten truths: recall 0.1 is reached, not passed.
        let curve = Curve::new([(0.9, true)], 10);
        assert_eq!(curve.mean_errors(&[(0.9, [0.0; 3])], 11), [1.0; 3]);
    }
}
