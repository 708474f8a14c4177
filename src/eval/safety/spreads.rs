//! Whether a detector's spreads are honest: how often the truth lies within them.
//!
//! Errors of what was matched at the threshold of the errors, over the detection's own standard deviations. Where errors follow
//! Laplace's distribution, 1 - exp(-sqrt(2) k) of them lie within k deviations: 75.7 % within one, 94.1 % within two.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use super::{Context, MetricTable, MetricValue};
use crate::eval::EvalConfig;
use crate::eval::matching::Outcome;
use crate::geometry::{Box3, Ego};
use crate::object::{BoxSpread, Harm};

/// Errors of one number of the boxes beside their spreads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SpreadCheck {
    /// `x_m`, `y_m`, `z_m`, `length`, `width`, `height` (as parts of the size) or `yaw_rad` (a box turned half counts as the same).
    pub number: String,
    pub n: usize,
    /// Root of the mean square of the errors, and of the standard deviations that were told.
    pub rms_error: f64,
    pub rms_told: f64,
    /// Shares of the errors within one and two of their standard deviations.
    pub within_one: f64,
    pub within_two: f64,
}

/// What [`SpreadCheck::number`] may be.
const NUMBERS: [&str; 7] = ["x_m", "y_m", "z_m", "length", "width", "height", "yaw_rad"];

/// One for each number of a box; empty where no matched detection tells spreads.
pub(super) fn measure(of: &Context<'_>) -> Vec<SpreadCheck> {
    let matching = of.matching;
    let mut pairs: Vec<[(f64, f64); 7]> = Vec::new();
    for class in Harm::ALL {
        for (ranked, outcome) in matching.operating(class) {
            if let (Outcome::Matched(number), Some(spread)) = (outcome, ranked.detection.spread) {
                let truth = &matching.object(number).object.truth.box_in_ego;
                pairs.push(errors_and_spreads(&ranked.detection.box_in_ego, truth, &spread));
            }
        }
    }
    if pairs.is_empty() {
        return Vec::new();
    }
    let n = pairs.len();
    let check = |(i, name): (usize, &str)| {
        let mean = |value: &dyn Fn((f64, f64)) -> f64| {
            pairs.iter().map(|pair| value(pair[i])).sum::<f64>() / n as f64
        };
        let within = |k: f64| mean(&|(error, told)| f64::from(u8::from(error.abs() <= k * told)));
        SpreadCheck {
            number: name.to_owned(),
            n,
            rms_error: mean(&|(error, _)| error * error).sqrt(),
            rms_told: mean(&|(_, told)| told * told).sqrt(),
            within_one: within(1.0),
            within_two: within(2.0),
        }
    };
    NUMBERS.into_iter().enumerate().map(check).collect()
}

/// The error of each number with its standard deviation.
fn errors_and_spreads(found: &Box3<Ego>, truth: &Box3<Ego>, spread: &BoxSpread) -> [(f64, f64); 7] {
    let center = found.center.coords - truth.center.coords;
    let turn = (found.yaw_rad - truth.yaw_rad).rem_euclid(PI);
    [
        (center.x, spread.x_m),
        (center.y, spread.y_m),
        (center.z, spread.z_m),
        ((found.length_m / truth.length_m).ln(), spread.length),
        ((found.width_m / truth.width_m).ln(), spread.width),
        ((found.height_m / truth.height_m).ln(), spread.height),
        (turn.min(PI - turn), spread.yaw_rad),
    ]
}

pub(super) fn show(checks: &Vec<SpreadCheck>, config: &EvalConfig) -> Option<MetricTable> {
    let row = |check: &SpreadCheck| {
        vec![
            MetricValue::name(check.number.clone()),
            MetricValue::Count(check.n),
            MetricValue::number(check.rms_error, 3),
            MetricValue::number(check.rms_told, 3),
            MetricValue::share(Some(check.within_one), None),
            MetricValue::share(Some(check.within_two), None),
        ]
    };
    let note = format!(
        "Errors of what was found at {} m, beside the standard deviations that the detector told; sizes as parts. Laplace's \
         distribution has 75.7 % within one deviation, 94.1 % within two.",
        config.tp_threshold_m
    );
    let head = ["spread of", "boxes", "error, rms", "told, rms", "within one", "within two"];
    MetricTable::new(&head, checks.iter().map(row).collect(), note)
}

#[cfg(test)]
mod tests {
    use crate::dataset::SampleFacts;
    use crate::eval::matching::tests::{found, truth};
    use crate::eval::{EvalSample, Mode, Protocol, evaluate};
    use crate::object::{BoxSpread, Distribution, Harm};

    #[test]
    fn errors_within_the_told_spread_are_counted_number_by_number() {
        let spread =
            BoxSpread { x_m: 0.3, y_m: 0.1, z_m: 0.1, length: 0.1, width: 0.1, height: 0.1, yaw_rad: 0.1 };
        // Off by 0.2 m and by 0.5 m along x: one within one deviation, both within two.
        let sample = |i: usize, error_m: f64| EvalSample {
            id: i.to_string(),
            facts: SampleFacts::default(),
            objects: vec![truth(10.0, Harm::Harmful, Distribution::Id)],
            detections: vec![found(10.0 + error_m, Harm::Harmful, 0.9)],
            n_points: vec![],
        };
        let mut samples = vec![sample(0, 0.2), sample(1, 0.5)];
        let measured = |samples: &[EvalSample]| {
            evaluate(samples, &Protocol::default(), Mode::Id).unwrap().safety.spreads
        };
        assert!(measured(&samples).is_empty(), "no detection tells its spread");
        samples.iter_mut().for_each(|sample| sample.detections[0].spread = Some(spread));
        // Turned half: the same box.
        samples[0].detections[0].box_in_ego.yaw_rad += std::f64::consts::PI;
        let checks = measured(&samples);
        let x = &checks[0];
        assert_eq!((x.number.as_str(), x.n, x.within_one, x.within_two), ("x_m", 2, 0.5, 1.0));
        assert!((x.rms_error - (0.145_f64).sqrt()).abs() < 1e-9 && (x.rms_told - 0.3).abs() < 1e-12);
        let yaw = checks.last().unwrap();
        assert!(yaw.number == "yaw_rad" && yaw.rms_error < 1e-9);
    }
}
