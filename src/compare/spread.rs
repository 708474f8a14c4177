//! How much a distance would vary with other episodes, and how far parts of one set lie apart.
//!
//! Samples of an episode resemble each other, so whole episodes are drawn (cluster bootstrap; Efron and Tibshirani 1993,
//! ch. 8). The yardstick: A's episodes in random order, the first of them until they have as many samples as B, at most half of
//! A's, against the rest. Few samples lie far apart by chance; the yardstick says how far.

use rand::RngExt;
use rand::seq::SliceRandom;

use super::measure::{MeasuredSet, Part};
use super::{Distance, Interval, Quantity};
use crate::dataset::statistics::Histogram;
use crate::random;

/// Share of resamples that an interval holds, and share of draws that the yardstick exceeds.
pub const LEVEL: f64 = 0.95;
/// Draws of an interval and of a yardstick.
pub const N_RESAMPLES: u64 = 200;
/// The draws are the same in every run.
pub(super) const SEED: u64 = 0;

/// The interval of a distance; `None` where a set has one part, or no draw has values on both sides.
pub(super) fn resample(quantity: Quantity, a: &MeasuredSet, b: &MeasuredSet) -> Option<Interval> {
    if a.parts.len() < 2 || b.parts.len() < 2 {
        return None;
    }
    let drawn = (0..N_RESAMPLES).filter_map(|draw| {
        let mut rng = random::stream(SEED, "compare-resample", draw);
        let mut draw_from = |parts: &[Part]| {
            sum(quantity, (0..parts.len()).map(|_| &parts[rng.random_range(0..parts.len())]))
        };
        Distance::between(&draw_from(&a.parts)?, &draw_from(&b.parts)?)
    });
    let drawn: Vec<Distance> = drawn.collect();
    let ends = |of: fn(&Distance) -> f64| middle(&drawn.iter().map(of).collect::<Vec<_>>());
    Some(Interval {
        jensen_shannon: ends(|distance| distance.jensen_shannon)?,
        wasserstein: ends(|distance| distance.wasserstein)?,
    })
}

/// The distance that two parts of a set exceed in one draw of twenty, one of them as large as the other set.
pub(super) fn within(quantity: Quantity, set: &MeasuredSet, n_samples_of_other: usize) -> Option<Distance> {
    if set.parts.len() < 2 {
        return None;
    }
    let n_samples: Vec<usize> = set.parts.iter().map(|part| part.n_samples).collect();
    let drawn = (0..N_RESAMPLES).filter_map(|draw| {
        let (first, rest) = share_like(&n_samples, n_samples_of_other, draw);
        let [first, rest] = [first, rest].map(|chosen| sum(quantity, chosen.iter().map(|&i| &set.parts[i])));
        Distance::between(&first?, &rest?)
    });
    let drawn: Vec<Distance> = drawn.collect();
    let most = |of: fn(&Distance) -> f64| most_of(&drawn.iter().map(of).collect::<Vec<_>>());
    Some(Distance {
        jensen_shannon: most(|distance| distance.jensen_shannon)?,
        wasserstein: most(|distance| distance.wasserstein)?,
    })
}

/// Cuts parts in two at random: as many as hold the other set's number of samples, at most half of all, and the rest.
/// `n_samples`: of each part, of which there are at least two.
pub(super) fn share_like(
    n_samples: &[usize],
    n_samples_of_other: usize,
    draw: u64,
) -> (Vec<usize>, Vec<usize>) {
    let n_wanted = n_samples_of_other.min(n_samples.iter().sum::<usize>() / 2).max(1);
    let mut parts: Vec<usize> = (0..n_samples.len()).collect();
    parts.shuffle(&mut random::stream(SEED, "compare-within", draw));
    let mut n_held = 0;
    let n_first = parts.iter().take_while(|&&part| {
        let is_wanted = n_held < n_wanted;
        n_held += n_samples[part];
        is_wanted
    });
    let n_first = n_first.count().clamp(1, parts.len() - 1);
    let rest = parts.split_off(n_first);
    (parts, rest)
}

/// The middle [`LEVEL`] of some values; `None` of nothing.
pub(super) fn middle(values: &[f64]) -> Option<[f64; 2]> {
    let tails = (1.0 - LEVEL) / 2.0;
    Some([quantile(values, tails)?, quantile(values, 1.0 - tails)?])
}

/// What all but one of twenty values stay below; `None` of nothing.
pub(super) fn most_of(values: &[f64]) -> Option<f64> {
    quantile(values, LEVEL)
}

/// The histogram of some parts; `None` if none of them has a value.
fn sum<'a>(quantity: Quantity, parts: impl Iterator<Item = &'a Part>) -> Option<Histogram> {
    let mut histograms = parts.filter_map(|part| Some(&part.tallies.get(quantity)?.histogram));
    let mut sum = histograms.next()?.clone();
    histograms.for_each(|histogram| sum.merge(histogram));
    Some(sum)
}

/// A quantile between two values is interpolated, as numpy's default; `None` of nothing.
fn quantile(values: &[f64], share: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = share * sorted.len().checked_sub(1)? as f64;
    let (below, above) = (at.floor() as usize, at.ceil() as usize);
    Some(sorted[below] + (sorted[above] - sorted[below]) * (at - at.floor()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::SetFacts;

    /// A set of episodes of four samples each, with these speeds.
    fn set(speeds: &[f64]) -> MeasuredSet {
        let part = |&speed: &f64| {
            let mut part = Part::default();
            part.n_samples = 4;
            part.tallies.add_times(Quantity::Speed, speed, 4);
            part
        };
        let parts: Vec<Part> = speeds.iter().map(part).collect();
        let n_samples = 4 * parts.len();
        let facts = SetFacts {
            dataset: "made".into(),
            split: None,
            n_episodes: parts.len(),
            n_samples,
            n_samples_with_truth: n_samples,
            n_objects: 0,
            n_parts: parts.len(),
        };
        MeasuredSet { facts, parts, labelled: None, odd: std::collections::BTreeMap::default() }
    }

    #[test]
    fn alike_episodes_have_no_spread_and_different_ones_have() {
        let alike = set(&[5.5; 10]);
        assert_eq!(
            within(Quantity::Speed, &alike, 40),
            Some(Distance { jensen_shannon: 0.0, wasserstein: 0.0 })
        );
        let mixed = set(&[2.5, 8.5, 2.5, 8.5, 2.5, 8.5, 2.5, 8.5]);
        let halves = within(Quantity::Speed, &mixed, 32).unwrap();
        assert!(halves.jensen_shannon > 0.05 && halves.wasserstein > 1.0, "{halves:?}");
        // One episode against the others lies farther apart than half against half.
        let single = within(Quantity::Speed, &mixed, 4).unwrap();
        assert!(single.wasserstein > halves.wasserstein, "{single:?} {halves:?}");
    }

    #[test]
    fn the_interval_holds_a_distance_between_sets_without_spread_and_one_part_has_none() {
        let (a, b) = (set(&[2.5; 4]), set(&[7.5; 4]));
        let interval = resample(Quantity::Speed, &a, &b).unwrap();
        assert_eq!((interval.jensen_shannon, interval.wasserstein), ([1.0, 1.0], [5.0, 5.0]));
        assert_eq!(resample(Quantity::Speed, &a, &set(&[7.5])), None);
        assert_eq!(within(Quantity::Speed, &set(&[7.5]), 4), None);
        assert_eq!(resample(Quantity::Steering, &a, &b), None, "not measured");
    }

    #[test]
    fn the_same_sets_give_the_same_spread() {
        let (a, b) = (set(&[1.5, 2.5, 9.5, 4.5]), set(&[7.5, 1.5, 3.5]));
        assert_eq!(resample(Quantity::Speed, &a, &b), resample(Quantity::Speed, &a, &b));
        assert_eq!(quantile(&[3.0, 1.0], 0.95), Some(2.9));
        assert_eq!(quantile(&[], 0.5), None);
    }
}
