//! How far two histograms with the same edges lie apart: Jensen-Shannon divergence and Wasserstein-1 distance.
//!
//! Jensen-Shannon (Lin 1991, "Divergence measures based on the Shannon entropy", IEEE Trans. Inf. Theory 37(1)), in bits,
//! 0 to 1, over the bins' shares p and q, with what lies below the first and above the last edge as two more bins:
//! `JSD = KL(p || m) / 2 + KL(q || m) / 2`, `m = (p + q) / 2`, `KL(p || m) = sum p log2(p / m)`.
//!
//! Wasserstein-1, in the quantity's unit (Vallender 1974; Ramdas, Garcia and Cuturi 2017, eq. 7): the area between the two
//! cumulative distributions, `W1 = integral |F_a(x) - F_b(x)| dx`. Values spread evenly over their bin, and values outside
//! count at the nearest edge.

use serde::Serialize;

use crate::dataset::statistics::Histogram;

/// How far two distributions lie apart.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Distance {
    /// In bits: 0 for the same shares, 1 for no bin in common.
    pub jensen_shannon: f64,
    /// In the quantity's unit: how far values must be moved, on average, to turn one into the other.
    pub wasserstein: f64,
}

impl Distance {
    /// `None` if one of them is empty.
    #[must_use]
    pub fn between(a: &Histogram, b: &Histogram) -> Option<Self> {
        debug_assert_eq!(a.edges, b.edges);
        let (shares_a, shares_b) = (shares(a)?, shares(b)?);
        let pairs = || shares_a.iter().copied().zip(shares_b.iter().copied());
        let jensen_shannon = pairs().map(|(p, q)| divergence(p, q)).sum::<f64>().clamp(0.0, 1.0);
        // Difference of the cumulative distributions at each edge.
        let at_edges: Vec<f64> = pairs()
            .scan(0.0, |sum, (p, q)| {
                *sum += p - q;
                Some(*sum)
            })
            .collect();
        let widths = a.edges.windows(2).map(|edge| edge[1] - edge[0]);
        let areas = at_edges.windows(2).zip(widths).map(|(at, width)| width * mean_height(at[0], at[1]));
        Some(Self { jensen_shannon, wasserstein: areas.sum() })
    }
}

impl Distance {
    /// Whether one of the two is greater.
    #[must_use]
    pub fn exceeds(&self, other: &Self) -> bool {
        self.jensen_shannon > other.jensen_shannon || self.wasserstein > other.wasserstein
    }
}

/// Shares of all values: below, the bins, above.
fn shares(of: &Histogram) -> Option<Vec<f64>> {
    let counts = [of.n_below].into_iter().chain(of.counts.iter().copied()).chain([of.n_above]);
    let total: u64 = counts.clone().sum();
    (total > 0).then(|| counts.map(|count| count as f64 / total as f64).collect())
}

/// A bin's part of the divergence.
fn divergence(p: f64, q: f64) -> f64 {
    let middle = f64::midpoint(p, q);
    let part = |share: f64| if share > 0.0 { share / 2.0 * (share / middle).log2() } else { 0.0 };
    part(p) + part(q)
}

/// Mean of |line| between two ends.
fn mean_height(left: f64, right: f64) -> f64 {
    if left * right >= 0.0 {
        f64::midpoint(left.abs(), right.abs())
    } else {
        (left * left + right * right) / (2.0 * (left.abs() + right.abs()))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn histogram(values: &[f64]) -> Histogram {
        let mut histogram = Histogram::even(0.0, 10.0, 10);
        values.iter().for_each(|&value| histogram.add(value));
        histogram
    }

    fn between(a: &[f64], b: &[f64]) -> Distance {
        Distance::between(&histogram(a), &histogram(b)).unwrap()
    }

    #[test]
    fn nothing_in_common_is_one_bit_and_a_shift_is_as_far_as_it_shifts() {
        let apart = between(&[1.5, 1.5], &[4.5]);
        assert!((apart.jensen_shannon - 1.0).abs() < 1e-12 && (apart.wasserstein - 3.0).abs() < 1e-12);
        // Half of the values moved by two metres; the halves that differ share no bin.
        let half = between(&[1.5, 5.5], &[3.5, 5.5]);
        assert!((half.jensen_shannon - 0.5).abs() < 1e-12 && (half.wasserstein - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_textbook_divergence_of_two_coins() {
        // p = (3/4, 1/4), q = (1/4, 3/4), m = (1/2, 1/2): 1 - H(1/4) = 1 - 0.8112781 bits.
        let found = between(&[0.5, 0.5, 0.5, 1.5], &[0.5, 1.5, 1.5, 1.5]).jensen_shannon;
        assert!((found - 0.188_721_875_5).abs() < 1e-9, "{found}");
    }

    #[test]
    fn lines_that_cross_are_measured_on_both_sides() {
        // One bin of 1 m against its two neighbours, half in each: the cumulative lines cross in the middle bin.
        let found = between(&[5.5], &[4.5, 6.5]).wasserstein;
        // Triangles: 0.5 * 1 * 0.5 left and right, two of 0.5 * 0.5 * 0.5 between.
        assert!((found - 0.75).abs() < 1e-12, "{found}");
    }

    #[test]
    fn values_outside_differ_from_values_inside_and_nothing_has_no_distance() {
        let outside = between(&[-3.0, 5.5], &[12.0, 5.5]);
        assert!((outside.jensen_shannon - 0.5).abs() < 1e-12 && (outside.wasserstein - 5.0).abs() < 1e-12);
        assert_eq!(Distance::between(&histogram(&[1.0]), &histogram(&[])), None);
    }

    proptest! {
        #[test]
        fn a_distance_is_symmetric_zero_to_itself_and_bounded(
            a in proptest::collection::vec(-1.0..11.0, 1..30), b in proptest::collection::vec(-1.0..11.0, 1..30),
        ) {
            let (there, back) = (between(&a, &b), between(&b, &a));
            prop_assert!((there.jensen_shannon - back.jensen_shannon).abs() < 1e-12);
            prop_assert!((there.wasserstein - back.wasserstein).abs() < 1e-12);
            prop_assert!((0.0..=1.0).contains(&there.jensen_shannon) && there.wasserstein <= 10.0 + 1e-12);
            let same = between(&a, &a);
            prop_assert!(same.jensen_shannon < 1e-12 && same.wasserstein < 1e-12);
        }
    }
}
