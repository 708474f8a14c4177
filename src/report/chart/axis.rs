//! One direction of a chart: its range, its scale, and the text along it.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};

/// One direction of a chart.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    pub name: String,
    pub low: f64,
    pub high: f64,
    /// Places of the grid lines, with their text.
    pub ticks: Vec<(f64, String)>,
    pub is_log: bool,
}

/// Farther out an axis does not reach, and less far its ends do not lie apart: numbers of files are not believed.
const FARTHEST: f64 = 1e12;

/// A point off the plane is drawn no farther away than this many of its sides: lines are dashed by the pixel.
const MOST_SIDES: f64 = 10.0;

/// The end of an axis: a number.
fn end(at: f64) -> f64 {
    if at.is_nan() { 0.0 } else { at.clamp(-FARTHEST, FARTHEST) }
}

impl Axis {
    /// A straight axis with these ticks.
    #[must_use]
    pub fn new(name: &str, low: f64, high: f64, ticks: Vec<(f64, String)>) -> Self {
        Self { name: name.to_owned(), low, high, ticks, is_log: false }
    }

    /// An axis from 0 to 1.
    #[must_use]
    pub fn share(name: &str) -> Self {
        Self::over(name, 0.0, 1.0)
    }

    /// An axis over all values, with ticks at round numbers.
    #[must_use]
    pub fn over(name: &str, low: f64, high: f64) -> Self {
        let (low, high) = (end(low), end(high));
        let least = f64::max(1.0, low.abs()) / FARTHEST;
        let high = if high - low > least { high } else { low + 1.0 };
        let rough = (high - low) / 7.0;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|n| n * power).into_iter().find(|&step| step >= rough);
        let step = step.unwrap_or(rough);
        let n_decimals = (-step.log10().floor()).max(0.0) as usize;
        let (first, last) = ((low / step - 1e-9).ceil() as i64, (high / step + 1e-9).floor() as i64);
        // Adding zero: no tick is called -0.
        let ticks = (first..=last).map(|i| i as f64 * step + 0.0);
        Self::new(name, low, high, ticks.map(|at| (at, format!("{at:.n_decimals$}"))).collect())
    }

    /// A logarithmic axis, with ticks at one, two and five times the powers of ten; `low` must be above zero.
    #[must_use]
    pub fn log(name: &str, low: f64, high: f64) -> Self {
        let low = end(low).max(1.0 / FARTHEST);
        let high = end(high).max(low);
        let powers = (low.log10().floor() as i32)..=(high.log10().ceil() as i32);
        let ticks = powers.flat_map(|power| {
            let n_decimals = (-power).max(0) as usize;
            [1.0, 2.0, 5.0].map(|n| n * 10f64.powi(power)).map(|at| (at, format!("{at:.n_decimals$}")))
        });
        let ticks = ticks.filter(|(at, _)| (low..=high).contains(at)).collect();
        Self { is_log: true, ..Self::new(name, low, high, ticks) }
    }

    /// Names one below the other; [`row`] gives the place of each.
    #[must_use]
    pub fn rows(names: &[String]) -> Self {
        let ticks = names.iter().enumerate().map(|(i, name)| (row(i, names.len()), name.clone())).collect();
        Self::new("", -0.6, names.len() as f64 - 0.4, ticks)
    }

    fn scale(&self, value: f64) -> f64 {
        if self.is_log { value.ln() } else { value }
    }

    /// Where a value lies between the ends, 0 to 1.
    pub(super) fn share_at(&self, value: f64) -> f64 {
        let [low, high] = [self.low, self.high].map(|end| self.scale(end));
        (self.scale(value) - low) / (high - low)
    }
}

/// Place of a row on [`Axis::rows`].
#[must_use]
pub fn row(i: usize, n: usize) -> f64 {
    n as f64 - 1.0 - i as f64
}

/// An axis as the plotting library needs it, with only its own ticks.
pub(super) struct Ticked(pub(super) Axis);

impl Ranged for Ticked {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (start, end): (i32, i32)) -> i32 {
        let share = self.0.share_at(*value).clamp(-MOST_SIDES, MOST_SIDES);
        start + (share * f64::from(end - start)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        let wants_light_ones = hint.weight().allow_light_points();
        self.0.ticks.iter().filter(|_| !wants_light_ones).map(|tick| tick.0).collect()
    }

    fn range(&self) -> Range<f64> {
        self.0.low..self.0.high
    }
}

impl ValueFormatter<f64> for Ticked {
    fn format_ext(&self, value: &f64) -> String {
        let nearest = self.0.ticks.iter().min_by(|a, b| (a.0 - value).abs().total_cmp(&(b.0 - value).abs()));
        nearest.map_or_else(String::new, |tick| tick.1.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(axis: Axis) -> Vec<String> {
        axis.ticks.into_iter().map(|tick| tick.1).collect()
    }

    #[test]
    fn ticks_are_round_numbers_within_the_axis() {
        let ticks = |low, high| words(Axis::over("", low, high));
        assert_eq!(ticks(0.0, 14.0), ["0", "2", "4", "6", "8", "10", "12", "14"]);
        assert_eq!(ticks(-35.0, 35.0), ["-30", "-20", "-10", "0", "10", "20", "30"]);
        assert_eq!(ticks(0.0, 1.0), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(ticks(0.0, 0.3), ["0.00", "0.05", "0.10", "0.15", "0.20", "0.25", "0.30"]);
        assert_eq!(ticks(2.0, 2.0).first().map(String::as_str), Some("2.0"));
    }

    #[test]
    fn numbers_that_no_file_should_hold_give_few_ticks_of_few_digits() {
        let ends = [
            f64::NEG_INFINITY,
            -1e300,
            -1e16,
            -1.0,
            0.0,
            5e-324,
            1e-13,
            1.0,
            1e16,
            1e300,
            f64::INFINITY,
            f64::NAN,
        ];
        for (low, high) in ends.iter().flat_map(|&low| ends.map(|high| (low, high))) {
            for axis in [Axis::over("", low, high), Axis::log("", low, high)] {
                let far = Ticked(axis.clone()).map(&1e300, (0, 1000));
                assert!((-10_000..=10_000).contains(&far), "{low} {high}: {far}");
                let ticks = words(axis);
                assert!(
                    ticks.len() < 200 && ticks.iter().all(|tick| tick.len() < 40),
                    "{low} {high}: {ticks:?}"
                );
            }
        }
    }

    #[test]
    fn a_logarithmic_axis_gives_equal_room_to_equal_ratios() {
        let axis = Axis::log("", 0.04, 4.0);
        assert!((axis.share_at(0.4) - 0.5).abs() < 1e-12);
        assert_eq!(words(axis), ["0.05", "0.1", "0.2", "0.5", "1", "2"]);
    }
}
