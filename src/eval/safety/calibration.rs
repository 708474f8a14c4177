//! Whether probabilities are honest: Brier score, expected calibration error, reliability diagram.
//!
//! Brier = mean (p - y)^2 (Brier 1950). ECE = sum over bins of n_bin / n * |mean y - mean p| with bins of equal width
//! (Naeini et al. 2015, Guo et al. 2017); for detections y is whether it is a true positive (Kueppers et al.
//! 2020).

use serde::{Deserialize, Serialize};

use super::{ByDistribution, Context, MetricTable, MetricValue};
use crate::eval::matching::Outcome;
use crate::eval::{EvalConfig, PerClass};
use crate::object::Harm;

/// How probabilities and outcomes agree.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    pub n: usize,
    /// `None` without any probability.
    pub brier: Option<f64>,
    pub ece: Option<f64>,
    /// The reliability diagram: bins of equal width from 0 to 1, the last one closed.
    pub bins: Vec<Bin>,
}

/// One bin of a reliability diagram.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Bin {
    pub n: usize,
    pub mean_probability: Option<f64>,
    /// Share that came true.
    pub frequency: Option<f64>,
}

impl Calibration {
    /// Takes probabilities from 0 to 1 and whether each came true.
    pub fn new(told: &[(f64, bool)], n_bins: usize) -> Self {
        let truth = |came_true: bool| f64::from(u8::from(came_true));
        let mut sums = vec![(0_usize, 0.0, 0.0); n_bins];
        for &(probability, came_true) in told {
            let bin = ((probability * n_bins as f64) as usize).min(n_bins - 1);
            sums[bin].0 += 1;
            sums[bin].1 += probability;
            sums[bin].2 += truth(came_true);
        }
        let n = told.len();
        let per = |sum: f64, n: usize| (n > 0).then(|| sum / n as f64);
        Self {
            n,
            brier: per(told.iter().map(|&(p, came_true)| (p - truth(came_true)).powi(2)).sum(), n),
            ece: per(sums.iter().map(|(_, p, y)| (p - y).abs()).sum(), n),
            bins: sums
                .into_iter()
                .map(|(n, p, y)| Bin { n, mean_probability: per(p, n), frequency: per(y, n) })
                .collect(),
        }
    }
}

/// Calibration of the detections' scores, at the threshold of the errors; `None` if a score is not from 0 to
/// 1.
pub(super) fn measure_detections(of: &Context<'_>) -> Option<PerClass<Calibration>> {
    let scores = PerClass::from_fn(|class| -> Vec<(f64, bool)> {
        let ranked = of.matching.ranked_from(class, f64::NEG_INFINITY);
        ranked
            .filter(|(_, outcome)| !matches!(outcome, Outcome::Neutral(_)))
            .map(|(ranked, outcome)| (ranked.score, matches!(outcome, Outcome::Matched(_))))
            .collect()
    });
    let is_probability = |&(score, _): &(f64, bool)| (0.0..=1.0).contains(&score);
    let are_probabilities = scores.harmful.iter().chain(&scores.harmless).all(is_probability);
    let n_bins = of.matching.config().safety.n_bins;
    are_probabilities.then(|| PerClass::from_fn(|class| Calibration::new(scores.get(class), n_bins)))
}

/// Calibration of the probability of harm.
pub(super) fn measure_harm(of: &Context<'_>) -> ByDistribution<Calibration> {
    let n_bins = of.matching.config().safety.n_bins;
    ByDistribution::from_fn(|distribution| Calibration::new(&of.probabilities(distribution), n_bins))
}

pub(super) fn show_detections(by: &Option<PerClass<Calibration>>, _: &EvalConfig) -> Option<MetricTable> {
    let by = by.as_ref()?;
    show("calibration of scores", Harm::ALL.map(|class| (class.name(), by.get(class))))
}

pub(super) fn show_harm(by: &ByDistribution<Calibration>, _: &EvalConfig) -> Option<MetricTable> {
    show("calibration of harm", by.named())
}

fn show<const N: usize>(what: &str, lines: [(&str, &Calibration); N]) -> Option<MetricTable> {
    let row = |(name, of): (&str, &Calibration)| {
        let errors = [of.ece, of.brier].map(|value| MetricValue::number(value, 4));
        [MetricValue::name(name), MetricValue::Count(of.n)].into_iter().chain(errors).collect()
    };
    let rows = lines.into_iter().filter(|(_, of)| of.n > 0).map(row).collect();
    MetricTable::new(&[what, "n", "ECE", "Brier"], rows, "")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_those_worked_out_by_hand() {
        let told = [(0.1, false), (0.2, true), (0.9, true), (1.0, true)];
        let found = Calibration::new(&told, 2);
        assert!((found.brier.unwrap() - (0.01 + 0.64 + 0.01) / 4.0).abs() < 1e-12);
        // First bin: mean 0.15 against 0.5; second: 0.95 against 1; two of four each.
        assert!((found.ece.unwrap() - f64::midpoint(0.35, 0.05)).abs() < 1e-12);
        assert_eq!((found.bins[1].n, found.bins[1].frequency), (2, Some(1.0)));
        assert_eq!(Calibration::new(&[], 2).ece, None);
    }
}
