//! How far the clouds of two data sets lie apart as a whole: energy distances of points drawn from both.
//!
//! A point counts by its range, its height over the ego's ground plane and its intensity, each divided by its standard
//! deviation in A. With `x`, `x'` drawn from A and `y`, `y'` from B (Szekely and Rizzo 2013, "Energy statistics", J. Stat.
//! Plan. Inference 143(8)): `D2 = 2 E|x - y| - E|x - x'| - E|y - y'|`, 0 for the same distribution. Of all three together,
//! which sees what each alone does not, and of each alone.
//!
//! Intervals and the yardstick draw whole parts, as in [`super::spread`]: the sums of distances between parts are all
//! that a draw needs.

use rand::RngExt;
use rayon::prelude::*;
use serde::Serialize;

use super::cloud::CloudPoint;
use super::measure::MeasuredSet;
use super::spread::{N_RESAMPLES, SEED, middle, most_of, share_like};
use crate::random;

/// Energy distances of two sets' clouds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CloudGap {
    /// Of range, height and intensity together.
    pub joint: EnergyDistance,
    /// Of each alone, in the order of [`super::PROPERTIES`].
    pub single: [EnergyDistance; 3],
}

/// One energy distance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct EnergyDistance {
    pub distance: f64,
    /// The middle of the distances when episodes are drawn anew; `None` where a set has one part.
    pub interval: Option<[f64; 2]>,
    /// What parts of A stay below from each other, in all draws but one of twenty; `None` where A has one part.
    pub within_a: Option<f64>,
}

/// Compares the clouds; `None` where a set has no point.
pub(super) fn compare_clouds(a: &MeasuredSet, b: &MeasuredSet) -> Option<CloudGap> {
    let clouds: Vec<Vec<CloudPoint>> =
        a.parts.iter().chain(&b.parts).map(|part| part.cloud.clone()).collect();
    let (of_a, of_b) = clouds.split_at(a.parts.len());
    if of_a.iter().all(Vec::is_empty) || of_b.iter().all(Vec::is_empty) {
        return None;
    }
    let scales = deviations(of_a);
    let n_samples: Vec<usize> = a.parts.iter().map(|part| part.n_samples).collect();
    let energy = |used: [bool; 3]| {
        let factors = [0, 1, 2].map(|i| if used[i] { 1.0 / scales[i] } else { 0.0 });
        Sums::of(&clouds, factors, of_a.len()).energy(&n_samples, b.facts.n_samples)
    };
    let single = [0, 1, 2].map(|only| energy([0, 1, 2].map(|i| i == only)));
    let [Some(range), Some(height), Some(intensity)] = single else { return None };
    Some(CloudGap { joint: energy([true; 3])?, single: [range, height, intensity] })
}

/// Standard deviations of all points; 1 where a property does not vary.
fn deviations(parts: &[Vec<CloudPoint>]) -> CloudPoint {
    let points = || parts.iter().flatten();
    let n = points().count() as f64;
    [0, 1, 2].map(|i| {
        let mean = points().map(|point| point[i]).sum::<f64>() / n;
        let variance = points().map(|point| (point[i] - mean).powi(2)).sum::<f64>() / n;
        if variance > 0.0 { variance.sqrt() } else { 1.0 }
    })
}

/// Sums of the distances between the points of any two parts, of which the first `n_a` are A's.
struct Sums {
    n_a: usize,
    n_points: Vec<f64>,
    /// `[part, part]`.
    distances: Vec<Vec<f64>>,
}

impl Sums {
    fn of(parts: &[Vec<CloudPoint>], factors: CloudPoint, n_a: usize) -> Self {
        let scaled: Vec<Vec<CloudPoint>> = parts
            .iter()
            .map(|part| part.iter().map(|point| [0, 1, 2].map(|i| point[i] * factors[i])).collect())
            .collect();
        let between = |one: &[CloudPoint], other: &[CloudPoint]| {
            let apart = |x: &CloudPoint, y: &CloudPoint| {
                let [dx, dy, dz] = [0, 1, 2].map(|i| x[i] - y[i]);
                (dx * dx + dy * dy + dz * dz).sqrt()
            };
            one.iter().map(|x| other.iter().map(|y| apart(x, y)).sum::<f64>()).sum::<f64>()
        };
        let row = |i: usize| (0..=i).map(|j| between(&scaled[i], &scaled[j])).collect::<Vec<f64>>();
        let halves: Vec<Vec<f64>> = (0..parts.len()).into_par_iter().map(row).collect();
        let full = |i: usize| (0..parts.len()).map(|j| halves[i.max(j)][i.min(j)]).collect();
        let n_points = parts.iter().map(|part| part.len() as f64).collect();
        Self { n_a, n_points, distances: (0..parts.len()).map(full).collect() }
    }

    /// The distance between some parts and others, each as often as it is named; `None` where one side has no point.
    fn between(&self, one: &[usize], other: &[usize]) -> Option<f64> {
        let n_of = |parts: &[usize]| parts.iter().map(|&i| self.n_points[i]).sum::<f64>();
        let mean = |one: &[usize], other: &[usize]| {
            let sum: f64 =
                one.iter().map(|&i| other.iter().map(|&j| self.distances[i][j]).sum::<f64>()).sum();
            sum / (n_of(one) * n_of(other))
        };
        let is_known = n_of(one) > 0.0 && n_of(other) > 0.0;
        is_known.then(|| (2.0 * mean(one, other) - mean(one, one) - mean(other, other)).max(0.0))
    }

    /// The distance of B from A. `n_samples`: of each part of A.
    fn energy(&self, n_samples: &[usize], n_samples_of_b: usize) -> Option<EnergyDistance> {
        let (a, b): (Vec<usize>, Vec<usize>) = (0..self.n_points.len()).partition(|&i| i < self.n_a);
        let draw_anew = |draw: u64| {
            let mut rng = random::stream(SEED, "compare-resample", draw);
            let mut from = |parts: &[usize]| -> Vec<usize> {
                parts.iter().map(|_| parts[rng.random_range(0..parts.len())]).collect()
            };
            let (a, b) = (from(&a), from(&b));
            self.between(&a, &b)
        };
        let halves = |draw: u64| {
            let (first, rest) = share_like(n_samples, n_samples_of_b, draw);
            self.between(&first, &rest)
        };
        let interval = (a.len() > 1 && b.len() > 1)
            .then(|| middle(&(0..N_RESAMPLES).filter_map(draw_anew).collect::<Vec<_>>()));
        let within_a =
            (a.len() > 1).then(|| most_of(&(0..N_RESAMPLES).filter_map(halves).collect::<Vec<_>>()));
        Some(EnergyDistance {
            distance: self.between(&a, &b)?,
            interval: interval.flatten(),
            within_a: within_a.flatten(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Parts of one point each, which differ in range alone.
    fn parts(ranges_m: &[f64]) -> Vec<Vec<CloudPoint>> {
        ranges_m.iter().map(|&range_m| vec![[range_m, 0.0, 0.0]]).collect()
    }

    #[test]
    fn the_distance_of_few_points_is_the_one_counted_by_hand() {
        // E|x - y| = (1 + 3 + 1 + 1) / 4 for x in {0, 2}, y in {1, 3}; E|x - x'| = E|y - y'| = (0 + 2 + 2 + 0) / 4.
        let sums = Sums::of(&parts(&[0.0, 2.0, 1.0, 3.0]), [1.0; 3], 2);
        let found = sums.between(&[0, 1], &[2, 3]).unwrap();
        assert!((found - (2.0 * 1.5 - 1.0 - 1.0)).abs() < 1e-12, "{found}");
        assert_eq!(sums.between(&[0, 1], &[0, 1]), Some(0.0));
        assert_eq!(Sums::of(&[Vec::new(), vec![[1.0; 3]]], [1.0; 3], 1).between(&[0], &[1]), None);
    }

    #[test]
    fn what_two_properties_show_together_neither_shows_alone() {
        // The same ranges and heights in both, but paired the other way round.
        let clouds = [vec![[0.0, 0.0, 0.0], [1.0, 1.0, 0.0]], vec![[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]];
        let distance = |factors| Sums::of(&clouds, factors, 1).between(&[0], &[1]).unwrap();
        assert_eq!((distance([1.0, 0.0, 0.0]), distance([0.0, 1.0, 0.0])), (0.0, 0.0));
        assert!(distance([1.0, 1.0, 0.0]) > 0.5);
    }

    #[test]
    fn an_interval_holds_the_distance_and_parts_of_a_set_are_nearer() {
        let sums = Sums::of(&parts(&[0.0, 1.0, 0.5, 0.2, 9.0, 8.0, 8.5, 8.2]), [1.0; 3], 4);
        let found = sums.energy(&[1; 4], 4).unwrap();
        let [low, high] = found.interval.unwrap();
        assert!(low <= found.distance && found.distance <= high, "{found:?}");
        assert!(found.within_a.unwrap() < 0.2 * found.distance, "{found:?}");
        let alone = Sums::of(&parts(&[0.0, 9.0]), [1.0; 3], 1).energy(&[1], 1).unwrap();
        assert_eq!((alone.interval, alone.within_a), (None, None));
    }
}
