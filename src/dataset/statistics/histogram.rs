//! Counts of a number in bins; what lies outside is counted too.

use serde::Serialize;

/// Bins `[edges[i], edges[i + 1])`, the last one closed, as numpy's `histogram` counts them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Histogram {
    pub edges: Vec<f64>,
    pub counts: Vec<u64>,
    /// Values before the first edge and after the last.
    pub n_below: u64,
    pub n_above: u64,
    /// The least and the greatest value; `None` if nothing was counted.
    pub least: Option<f64>,
    pub most: Option<f64>,
}

impl Histogram {
    /// Bins between rising edges, of which there are two or more.
    #[must_use]
    pub fn new(edges: Vec<f64>) -> Self {
        let counts = vec![0; edges.len() - 1];
        Self { edges, counts, n_below: 0, n_above: 0, least: None, most: None }
    }

    /// `n_bins` bins of equal width between two edges.
    #[must_use]
    pub fn even(first: f64, last: f64, n_bins: u32) -> Self {
        let edge = |i: u32| (first * f64::from(n_bins - i) + last * f64::from(i)) / f64::from(n_bins);
        Self::new((0..=n_bins).map(edge).collect())
    }

    pub fn add(&mut self, value: f64) {
        self.add_times(value, 1);
    }

    /// Counts a value as often as it occurs.
    pub fn add_times(&mut self, value: f64, n_times: u64) {
        self.least = Some(self.least.map_or(value, |least| least.min(value)));
        self.most = Some(self.most.map_or(value, |most| most.max(value)));
        let (first, last) = (self.edges[0], self.edges[self.edges.len() - 1]);
        if value < first {
            self.n_below += n_times;
        } else if value > last {
            self.n_above += n_times;
        } else {
            let bin = self.edges.partition_point(|&edge| edge <= value) - 1;
            let last_bin = self.counts.len() - 1;
            self.counts[bin.min(last_bin)] += n_times;
        }
    }

    /// How many values were counted, those outside among them.
    #[must_use]
    pub fn n_values(&self) -> u64 {
        self.n_below + self.counts.iter().sum::<u64>() + self.n_above
    }

    /// Adds the counts of another histogram with the same edges.
    pub fn merge(&mut self, other: &Self) {
        debug_assert_eq!(self.edges, other.edges);
        for (to, from) in self.counts.iter_mut().zip(&other.counts) {
            *to += from;
        }
        self.n_below += other.n_below;
        self.n_above += other.n_above;
        let pick = |a: Option<f64>, b: Option<f64>, of_both: fn(f64, f64) -> f64| match (a, b) {
            (Some(a), Some(b)) => Some(of_both(a, b)),
            (one, none) => one.or(none),
        };
        self.least = pick(self.least, other.least, f64::min);
        self.most = pick(self.most, other.most, f64::max);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_on_an_edge_falls_into_the_bin_above_and_on_the_last_edge_into_the_last_bin() {
        let mut histogram = Histogram::even(0.0, 3.0, 3);
        for value in [-0.1, 0.0, 0.9, 1.0, 2.5, 3.0, 3.1, 9.0] {
            histogram.add(value);
        }
        assert_eq!(histogram.edges, [0.0, 1.0, 2.0, 3.0]);
        assert_eq!(
            (histogram.counts.as_slice(), histogram.n_below, histogram.n_above),
            (&[2, 1, 2][..], 1, 2)
        );
        assert_eq!((histogram.least, histogram.most), (Some(-0.1), Some(9.0)));
    }

    #[test]
    fn halves_merge_to_the_whole_and_nothing_changes_nothing() {
        let values = [0.2, 4.0, 7.5, -1.0, 3.3];
        let of = |values: &[f64]| {
            let mut histogram = Histogram::even(0.0, 5.0, 5);
            values.iter().for_each(|&value| histogram.add(value));
            histogram
        };
        let mut merged = of(&values[..2]);
        merged.merge(&of(&values[2..]));
        merged.merge(&of(&[]));
        assert_eq!(merged, of(&values));
    }
}
