//! How recall falls with the weather: a straight line by least squares through every truth.
//!
//! y is 1 where a truth is found at the operating score and the threshold of the errors, else 0; x is what the sample's
//! weather says. The line through all truths is that through the groups of equal x, each weighed by its truths.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{Context, MetricTable, MetricValue};
use crate::dataset::SampleFacts;
use crate::eval::matching::Matching;
use crate::eval::{EvalConfig, PerClass};
use crate::object::Harm;

/// A fitted line, and the groups it goes through.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Slope {
    /// Change of recall per unit of x.
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

/// Over the extinction of haze or fog, ln 20 / MOR (Koschmieder), 1/m.
pub(super) fn measure_fog(of: &Context<'_>) -> PerClass<Option<Slope>> {
    measure(of, |facts| Some(20f64.ln() / facts.mor_m.filter(|&mor_m| mor_m > 0.0)?))
}

/// Over the rain rate, mm/h.
pub(super) fn measure_rain(of: &Context<'_>) -> PerClass<Option<Slope>> {
    measure(of, |facts| facts.rain_rate_mmph)
}

pub(super) fn show_fog(by: &PerClass<Option<Slope>>, _: &EvalConfig) -> Option<MetricTable> {
    show("recall over extinction of haze and fog, ln 20 / MOR, 1/m", by)
}

pub(super) fn show_rain(by: &PerClass<Option<Slope>>, _: &EvalConfig) -> Option<MetricTable> {
    show("recall over rain rate, mm/h", by)
}

fn show(what: &str, by: &PerClass<Option<Slope>>) -> Option<MetricTable> {
    let rows = Harm::ALL.into_iter().filter_map(|class| {
        let of = by.get(class).as_ref()?;
        Some(vec![
            MetricValue::name(class.name()),
            MetricValue::number(of.slope, 4),
            MetricValue::number(of.intercept, 3),
        ])
    });
    MetricTable::new(&[what, "a unit", "at 0"], rows.collect(), "Least squares through every object.")
}

/// The slope of each class; `None` unless its objects are known at two or more values of x.
fn measure(of: &Context<'_>, x_of: impl Fn(&SampleFacts) -> Option<f64>) -> PerClass<Option<Slope>> {
    PerClass::from_fn(|class| of_recall(of.matching, class, &x_of))
}

fn of_recall(
    matching: &Matching<'_>,
    class: Harm,
    x_of: impl Fn(&SampleFacts) -> Option<f64>,
) -> Option<Slope> {
    let is_found = &matching.met(class).is_matched;
    // By bits: all x are from one table or file and not negative, so their bits sort like the numbers.
    let mut groups: BTreeMap<u64, (usize, usize)> = BTreeMap::new();
    for of in matching.objects.iter().filter(|of| of.object.harm == class) {
        let x = x_of(matching.facts_of(of)).filter(|x| x.is_finite() && *x >= 0.0);
        let Some(x) = x else { continue };
        // Negative zero has other bits than zero.
        let group = groups.entry((x + 0.0).to_bits()).or_default();
        group.0 += 1;
        group.1 += usize::from(is_found[of.number]);
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
