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

/// A curve that detections join one by one, in rank order.
#[derive(Debug, Clone)]
pub(super) struct GrowingCurve {
    n_positives: f64,
    n_true: f64,
    /// True and false ones.
    n_all: f64,
    last_score: f64,
    /// As far as recall has got.
    curve: Curve,
}

impl GrowingCurve {
    pub(super) fn new(n_positives: usize) -> Self {
        let curve = Curve { precision: Vec::with_capacity(N_STEPS), confidence: Vec::with_capacity(N_STEPS) };
        Self { n_positives: count(n_positives), n_true: 0.0, n_all: 0.0, last_score: 0.0, curve }
    }

    /// Takes the next detection: its score, and whether it is a true positive.
    pub(super) fn add(&mut self, score: f64, is_match: bool) {
        if is_match {
            self.n_true += 1.0;
            let recall = self.n_true / self.n_positives;
            while self.curve.precision.len() < N_STEPS && recall > self.next_step() {
                self.pass_step(score, recall);
            }
        }
        self.n_all += 1.0;
        self.last_score = score;
    }

    /// Takes a detection several times, one after the other.
    pub(super) fn add_times(&mut self, n: u32, score: f64, is_match: bool) {
        if is_match {
            (0..n).for_each(|_| self.add(score, true));
        } else if n > 0 {
            self.n_all += f64::from(n);
            self.last_score = score;
        }
    }

    /// The recall whose values are not known yet.
    fn next_step(&self) -> f64 {
        count(self.curve.precision.len()) * STEP
    }

    /// Adds the values at the next step: recall passes it with a match of this score, which is not counted yet.
    ///
    /// `numpy.interp`: below all recalls the first value; where a recall equals the step, the last of its values;
    /// elsewhere on the line between the neighbours.
    fn pass_step(&mut self, score: f64, recall: f64) {
        let step = self.next_step();
        let precision = self.n_true / (self.n_all + 1.0);
        if self.n_all == 0.0 {
            self.push(precision, score);
            return;
        }
        let (n_before, score_before) = (self.n_true - 1.0, self.last_score);
        let (recall_before, precision_before) = (n_before / self.n_positives, n_before / self.n_all);
        if recall_before == step {
            self.push(precision_before, score_before);
            return;
        }
        let between = |before: f64, after: f64| {
            let slope = (after - before) / (recall - recall_before);
            slope * (step - recall_before) + before
        };
        self.push(between(precision_before, precision), between(score_before, score));
    }

    fn push(&mut self, precision: f64, confidence: f64) {
        self.curve.precision.push(precision);
        self.curve.confidence.push(confidence);
    }

    /// The curve of all; zero if there is no positive or no match, as the devkit's `no_predictions`.
    pub(super) fn finish(mut self) -> Curve {
        if self.n_positives == 0.0 || self.n_true == 0.0 {
            return Curve { precision: vec![0.0; N_STEPS], confidence: vec![0.0; N_STEPS] };
        }
        if self.curve.precision.len() < N_STEPS && self.n_true / self.n_positives == self.next_step() {
            self.push(self.n_true / self.n_all, self.last_score);
        }
        self.curve.precision.resize(N_STEPS, 0.0);
        self.curve.confidence.resize(N_STEPS, 0.0);
        self.curve
    }
}

impl Curve {
    /// The curve of detections in rank order: each one's score and whether it is a true positive.
    ///
    /// All zero if there is no positive or no match, as the devkit's `no_predictions`.
    pub(super) fn new(ranked: impl IntoIterator<Item = (f64, bool)>, n_positives: usize) -> Self {
        let mut curve = GrowingCurve::new(n_positives);
        ranked.into_iter().for_each(|(score, is_match)| curve.add(score, is_match));
        curve.finish()
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
    use proptest::prelude::*;

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

    /// `numpy.interp` over the recalls, precisions and scores of all detections, as the devkit does it.
    fn by_interpolation(ranked: &[(f64, bool)], n_positives: usize) -> Curve {
        let n_true = |i: usize| count(ranked[..=i].iter().filter(|(_, is_match)| *is_match).count());
        let recall: Vec<f64> = (0..ranked.len()).map(|i| n_true(i) / count(n_positives)).collect();
        let precision: Vec<f64> = (0..ranked.len()).map(|i| n_true(i) / count(i + 1)).collect();
        let scores: Vec<f64> = ranked.iter().map(|&(score, _)| score).collect();
        let at_steps = |values: &[f64]| {
            (0..N_STEPS).map(|step| interpolate(count(step) * STEP, &recall, values, 0.0)).collect()
        };
        Curve { precision: at_steps(&precision), confidence: at_steps(&scores) }
    }

    proptest! {
        #[test]
        fn a_curve_that_grows_is_that_of_interpolation(
            matches in proptest::collection::vec(proptest::bool::weighted(0.4), 1..300), n_missed in 0..40_usize,
        ) {
            let ranked: Vec<(f64, bool)> =
                matches.iter().enumerate().map(|(i, &is_match)| (1.0 / count(i / 2 + 1), is_match)).collect();
            let n_true = matches.iter().filter(|&&is_match| is_match).count();
            prop_assume!(n_true > 0);
            let n_positives = n_true + n_missed;
            let found = Curve::new(ranked.iter().copied(), n_positives);
            prop_assert_eq!(found, by_interpolation(&ranked, n_positives));
        }
    }
}
