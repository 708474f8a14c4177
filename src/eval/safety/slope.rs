//! How recall falls with the weather: a straight line by least squares through every truth.
//!
//! y is 1 where a truth is found at the operating score and the threshold of the errors, else 0; x is what the sample's
//! weather says. The line through all truths is that through the groups of equal x, each weighed by its truths.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::eval::matching::{ClassMatching, Outcome};
use crate::eval::protocol::Protocol;
use crate::eval::{EvalSample, SampleFacts};
use crate::object::Harm;

/// A fitted line, and the groups it goes through.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Slope {
    /// Recall a unit of x.
    pub slope: f64,
    /// Recall at x = 0.
    pub intercept: f64,
    pub points: Vec<SlopePoint>,
}

/// The truths of one x.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SlopePoint {
    pub x: f64,
    pub n_truths: usize,
    pub recall: f64,
}

/// `None` unless truths of the class are known at two values of x or more.
pub fn of_recall(
    samples: &[EvalSample],
    matching: &ClassMatching<'_>,
    class: Harm,
    protocol: &Protocol,
    x_of: impl Fn(&SampleFacts) -> Option<f64>,
) -> Option<Slope> {
    let mut is_found = vec![false; samples.iter().map(|sample| sample.truths.len()).sum()];
    for (ranked, outcome) in matching.at(protocol.tp_threshold_idx()) {
        if let Outcome::Matched(truth, _) = outcome {
            is_found[truth.number] = ranked.detection.score >= protocol.config().operating_score;
        }
    }
    let numbered = samples.iter().flat_map(|sample| sample.truths.iter().map(move |truth| (sample, truth)));
    // By bits: all x are from one table or file and not negative, so that bits are in the order of the numbers.
    let mut groups: BTreeMap<u64, (usize, usize)> = BTreeMap::new();
    for (number, (sample, truth)) in numbered.enumerate() {
        let Some(x) = x_of(&sample.facts).filter(|x| x.is_finite() && *x >= 0.0) else { continue };
        if truth.harm == class {
            // Negative zero has other bits than zero.
            let group = groups.entry((x + 0.0).to_bits()).or_default();
            group.0 += 1;
            group.1 += usize::from(is_found[number]);
        }
    }
    fit(groups
        .into_iter()
        .map(|(bits, (n_truths, n_found))| SlopePoint {
            x: f64::from_bits(bits),
            n_truths,
            recall: n_found as f64 / n_truths as f64,
        })
        .collect())
}

fn fit(points: Vec<SlopePoint>) -> Option<Slope> {
    let n: f64 = points.iter().map(|point| point.n_truths as f64).sum();
    let mean = |value: fn(&SlopePoint) -> f64| {
        points.iter().map(|point| point.n_truths as f64 * value(point)).sum::<f64>() / n
    };
    let (mean_x, mean_y) = (mean(|point| point.x), mean(|point| point.recall));
    let (mut shared, mut spread) = (0.0, 0.0);
    for point in &points {
        let (weight, dx) = (point.n_truths as f64, point.x - mean_x);
        shared += weight * dx * (point.recall - mean_y);
        spread += weight * dx * dx;
    }
    (points.len() > 1 && spread > 0.0).then(|| {
        let slope = shared / spread;
        Slope { slope, intercept: mean_y - slope * mean_x, points }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_is_that_of_least_squares_over_all_truths() {
        let point = |x, n_truths, recall| SlopePoint { x, n_truths, recall };
        // Truths: 0 -> 1, 1, 1, 1 and 2 -> 1, 0: by hand the slope is -0.25.
        let found = fit(vec![point(0.0, 4, 1.0), point(2.0, 2, 0.5)]).unwrap();
        assert!((found.slope + 0.25).abs() < 1e-12 && (found.intercept - 1.0).abs() < 1e-12);
        assert!(fit(vec![point(1.0, 4, 0.5)]).is_none());
        assert!(fit(vec![]).is_none());
    }
}
