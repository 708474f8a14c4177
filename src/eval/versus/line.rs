//! A figure of detectors side by side, of each the mean of its runs, and what each gains over the first.

use std::ops::Range;

use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::eval::bootstrap::{Confidence, interval};
use crate::eval::metrics::mean;

/// A figure of each detector.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct VersusLine {
    pub name: String,
    /// Objects, harmful objects or harmful events that it is of.
    pub n_truths: usize,
    /// One for each detector.
    pub figures: Vec<VersusFigure>,
}

/// A detector's figure and what it is more than the first one's. `None` where it cannot be told.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct VersusFigure {
    pub value: Option<f64>,
    pub interval: Option<[f64; 2]>,
    pub over_first: Option<f64>,
    pub over_first_interval: Option<[f64; 2]>,
    /// The same with what other seeds would change; `None` where both are of one run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub over_first_seeds_interval: Option<[f64; 2]>,
    /// Each run's own figure, where the detector is of several; else empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub runs: Vec<Option<f64>>,
}

impl VersusLine {
    /// From each run's value, over all and in each resample.
    pub(super) fn new(
        name: String,
        n_truths: usize,
        values: &[Option<f64>],
        resampled: &[Vec<Option<f64>>],
        runs: &Runs,
    ) -> Self {
        let over = |of: &[Option<f64>], i: usize| Some(runs.mean(of, i)? - runs.mean(of, 0)?);
        let figure = |i: usize| {
            let over_first = over(values, i);
            let over_first_interval = interval(resampled.iter().filter_map(|of| over(of, i)));
            let by_seed = over_first.zip(over_first_interval).and_then(|(over, ends)| {
                let error = runs.gain_error(values, i)?;
                Some([over - (over - ends[0]).hypot(error), over + (ends[1] - over).hypot(error)])
            });
            VersusFigure {
                value: runs.mean(values, i),
                interval: interval(resampled.iter().filter_map(|of| runs.mean(of, i))),
                over_first,
                over_first_interval,
                over_first_seeds_interval: by_seed.filter(|_| i > 0),
                runs: Some(&values[runs.0[i].clone()]).filter(|of| of.len() > 1).unwrap_or_default().to_vec(),
            }
        };
        Self { name, n_truths, figures: (0..runs.0.len()).map(figure).collect() }
    }
}

/// Each detector's place among all runs.
pub(super) struct Runs(pub Vec<Range<usize>>);

impl Runs {
    /// A detector's value, the mean of its runs; none where one has none.
    fn mean(&self, of_runs: &[Option<f64>], detector: usize) -> Option<f64> {
        let values: Option<Vec<f64>> = of_runs[self.0[detector].clone()].iter().copied().collect();
        values.map(|values| mean(&values))
    }

    /// How far the difference of a detector's mean from the first one's may be off for the few seeds alone: half an interval of
    /// [`Confidence::LEVEL`]. `None` where both are of one run.
    fn gain_error(&self, of_runs: &[Option<f64>], detector: usize) -> Option<f64> {
        let runs = [0, detector].map(|i| of_runs[self.0[i].clone()].iter().copied().collect());
        let [first, other]: [Option<Vec<f64>>; 2] = runs;
        let (first, other) = (first?, other?);
        // Run by run where each has its partner; else all are taken to scatter alike about the mean of their detector.
        let (variance, freedom) = if first.len() == other.len() {
            let gains: Vec<f64> = first.iter().zip(&other).map(|(a, b)| b - a).collect();
            let freedom = gains.len() as f64 - 1.0;
            (squares_about_mean(&gains) / freedom / gains.len() as f64, freedom)
        } else {
            let [n_first, n_other] = [&first, &other].map(|of| of.len() as f64);
            let freedom = n_first + n_other - 2.0;
            let of_a_run = (squares_about_mean(&first) + squares_about_mean(&other)) / freedom;
            (of_a_run * (1.0 / n_first + 1.0 / n_other), freedom)
        };
        if freedom < 1.0 {
            return None;
        }
        let student = StudentsT::new(0.0, 1.0, freedom).expect("at least one degree of freedom");
        Some(student.inverse_cdf(f64::midpoint(1.0, Confidence::LEVEL)) * variance.sqrt())
    }
}

fn squares_about_mean(values: &[f64]) -> f64 {
    let middle = mean(values);
    values.iter().map(|value| (value - middle).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_other_seeds_would_change_widens_the_interval_of_a_gain() {
        let line = |values: &[f64], runs: Vec<Range<usize>>| {
            let values: Vec<Option<f64>> = values.iter().map(|&value| Some(value)).collect();
            // Other episodes move all runs alike, by .01 to both sides for the gain's part of it.
            let moved = |by: f64| -> Vec<Option<f64>> {
                values
                    .iter()
                    .enumerate()
                    .map(|(i, of)| of.map(|of| if i < 3 { of } else { of + by }))
                    .collect()
            };
            let resampled: Vec<_> = (0..=400).map(|i| moved(f64::from(i - 200) * 5e-5)).collect();
            VersusLine::new("a".into(), 1, &values, &resampled, &Runs(runs)).figures.pop().unwrap()
        };
        // Gains of .04, .06 and .05: .05, a standard error of .01 / sqrt 3, and Student's 4.303 for two degrees of freedom.
        let of_three = line(&[0.5, 0.5, 0.5, 0.54, 0.56, 0.55], vec![0..3, 3..6]);
        let of_episodes = of_three.over_first_interval.unwrap();
        let [low, high] = of_episodes;
        let error = 4.302_653 * 0.01 / 3_f64.sqrt();
        let wanted = [0.05 - (0.05 - low).hypot(error), 0.05 + (high - 0.05).hypot(error)];
        let found = of_three.over_first_seeds_interval.unwrap();
        assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?} against {wanted:?}");
        // Three runs against one: the three's deviation of .01, as if the other's were the same, for both means.
        let [low, high] = line(&[0.49, 0.51, 0.5, 0.55], vec![0..3, 3..4]).over_first_seeds_interval.unwrap();
        let error = 4.302_653 * 0.01 * (1.0_f64 / 3.0 + 1.0).sqrt();
        let wanted = [0.05 - error.hypot(0.05 - of_episodes[0]), 0.05 + error.hypot(of_episodes[1] - 0.05)];
        assert!((low - wanted[0]).abs() < 1e-6 && (high - wanted[1]).abs() < 1e-6, "{low} to {high}");
        // Of one run each, nobody knows.
        assert_eq!(line(&[0.5, 0.54], vec![0..1, 1..2]).over_first_seeds_interval, None);
    }
}
