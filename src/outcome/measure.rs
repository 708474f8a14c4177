//! Figures over drives, and how far other worlds would move them.
//!
//! Intervals are the bootstrap's: whole episodes are drawn, and scenarios of one family, which are one idea in several places,
//! together. Where nothing at all happened, or everything did, each resample says the same; there the ends are exact ones
//! (Clopper and Pearson 1934 of shares, Garwood 1936 of rates), the families, or else the episodes, being counted.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::drive_outcome::DriveOutcome;
use crate::eval::{interval, resample};

const N_RESAMPLES: usize = 1000;
const BOOTSTRAP_SEED: u64 = 0;
/// Beyond each end of an interval of 95 %.
const TAIL: f64 = 0.025;

/// A figure and its interval.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Measure {
    /// `None` where there is nothing to divide by.
    pub value: Option<f64>,
    pub interval: Option<[f64; 2]>,
}

impl Measure {
    /// In another unit.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        let scale = |value: f64| factor * value;
        Self { value: self.value.map(scale), interval: self.interval.map(|ends| ends.map(scale)) }
    }
}

/// What a ratio is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ratio {
    /// Of some episodes, those of which something holds.
    Share,
    /// Events over a length.
    Rate,
    /// Anything else.
    Mean,
}

/// A value of each episode.
pub(super) type Of<'a> = &'a (dyn Fn(usize) -> f64 + Sync);

/// The drives of one driver as they are drawn.
pub(super) struct Draws {
    /// Number of each episode's group.
    group_of: Vec<usize>,
    n_groups: usize,
}

impl Draws {
    /// Episodes of a family are a group, each other episode one of its own.
    pub fn of(outcomes: &[DriveOutcome]) -> Self {
        let mut groups: BTreeMap<&str, usize> = BTreeMap::new();
        let mut group_of = Vec::with_capacity(outcomes.len());
        let mut n_groups = 0;
        for outcome in outcomes {
            let group = match (outcome.family.as_str(), groups.get(outcome.family.as_str())) {
                ("", _) | (_, None) => {
                    n_groups += 1;
                    n_groups - 1
                }
                (_, Some(&group)) => group,
            };
            if !outcome.family.is_empty() {
                groups.insert(&outcome.family, group);
            }
            group_of.push(group);
        }
        Self { group_of, n_groups }
    }

    /// A sum over another, with its interval.
    pub fn ratio(&self, kind: Ratio, above: Of<'_>, below: Of<'_>) -> Measure {
        let value = self.quotient(&vec![1; self.n_groups], above, below);
        let of_drawn = |n_drawn: &[u32]| self.quotient(n_drawn, above, below);
        let drawn = || self.interval(&of_drawn).filter(|_| self.counted_groups(below).len() > 1);
        let interval = self.exact(kind, value, below).or_else(drawn);
        Measure { value, interval }
    }

    /// How much more one sum over another is than a second one, within the same resamples. Where all
    /// resamples show the same, the ends are those of a share or rate of nothing, to both sides: what differs in none of n episodes.
    pub fn difference(&self, kind: Ratio, one: [Of<'_>; 2], other: [Of<'_>; 2]) -> Measure {
        let of_drawn = |n_drawn: &[u32]| {
            let [one, other] = [one, other].map(|[above, below]| self.quotient(n_drawn, above, below));
            Some(one? - other?)
        };
        let exact = || {
            let [one, other] = [one, other].map(|[_, below]| self.exact(kind, Some(0.0), below));
            one.zip(other).map(|([_, one], [_, other])| [-one.max(other), one.max(other)])
        };
        let can_differ = [one, other].iter().all(|[_, below]| self.counted_groups(below).len() > 1);
        let interval = match self.interval(&of_drawn).filter(|_| can_differ) {
            Some([low, high]) if low == high => exact().map_or(Some([low, high]), |[down, up]| {
                let ends = [low + down, high + up];
                Some(if kind == Ratio::Share { ends.map(|end| end.clamp(-1.0, 1.0)) } else { ends })
            }),
            drawn => drawn,
        };
        Measure { value: of_drawn(&vec![1; self.n_groups]), interval }
    }

    fn quotient(&self, n_drawn: &[u32], above: Of<'_>, below: Of<'_>) -> Option<f64> {
        let sum = |value: Of<'_>| -> f64 {
            let terms = self.group_of.iter().enumerate();
            terms.map(|(i, &group)| f64::from(n_drawn[group]) * value(i)).sum()
        };
        let divisor = sum(below);
        (divisor > 0.0).then(|| sum(above) / divisor)
    }

    fn interval(&self, of_drawn: &(dyn Fn(&[u32]) -> Option<f64> + Sync)) -> Option<[f64; 2]> {
        let resamples = || resample(self.n_groups, N_RESAMPLES, BOOTSTRAP_SEED, of_drawn);
        (self.n_groups > 1).then(|| interval(resamples().into_iter().flatten())).flatten()
    }

    /// The groups that a figure is of. Resamples of one alone all show the same, however uncertain it is.
    fn counted_groups(&self, below: Of<'_>) -> BTreeSet<usize> {
        let counted = (0..self.group_of.len()).filter(|&i| below(i) > 0.0);
        counted.map(|i| self.group_of[i]).collect()
    }

    /// The interval of a share or rate of nothing, or of all.
    fn exact(&self, kind: Ratio, value: Option<f64>, below: Of<'_>) -> Option<[f64; 2]> {
        let value = value?;
        let counted = || (0..self.group_of.len()).filter(|&i| below(i) > 0.0);
        let groups = self.counted_groups(below);
        let least_of_all = TAIL.powf(1.0 / groups.len() as f64);
        match kind {
            Ratio::Share if value == 0.0 => Some([0.0, 1.0 - least_of_all]),
            Ratio::Share if value == 1.0 => Some([least_of_all, 1.0]),
            // What happens in one scenario of a family happens in all.
            Ratio::Rate if value == 0.0 => {
                let of_each = counted().count() as f64 / groups.len() as f64;
                Some([0.0, -TAIL.ln() * of_each / counted().map(below).sum::<f64>()])
            }
            Ratio::Share | Ratio::Rate | Ratio::Mean => None,
        }
    }
}

pub(super) fn yes(is: bool) -> f64 {
    f64::from(u8::from(is))
}

#[cfg(test)]
mod tests {
    use super::super::test_data::drives;
    use super::*;

    /// Four drives of these families.
    fn draws(families: [&str; 4]) -> Draws {
        let (_, mut outcomes) = drives("small", [None; 4]);
        for (outcome, family) in outcomes.iter_mut().zip(families) {
            outcome.family = family.to_owned();
        }
        Draws::of(&outcomes)
    }

    #[test]
    fn where_nothing_or_everything_happened_the_ends_are_exact() {
        let draws = draws([""; 4]);
        let one = |_: usize| 1.0;
        let none = draws.ratio(Ratio::Share, &|_| 0.0, &one);
        let [low, high] = none.interval.unwrap();
        // Of none in four: 1 - 0.025^(1/4).
        assert!(low == 0.0 && (high - 0.6024).abs() < 1e-4, "{none:?}");
        let all = draws.ratio(Ratio::Share, &one, &one);
        assert!((all.interval.unwrap()[0] - 0.3976).abs() < 1e-4 && all.value == Some(1.0), "{all:?}");
        // None in 2 km: at most 3.69 events.
        let rate = draws.ratio(Ratio::Rate, &|_| 0.0, &|_| 0.5);
        assert!((rate.interval.unwrap()[1] - 3.6889 / 2.0).abs() < 1e-4, "{rate:?}");
        assert_eq!(draws.ratio(Ratio::Mean, &|_| 0.0, &one).interval, Some([0.0, 0.0]));
        assert_eq!(draws.ratio(Ratio::Share, &one, &|_| 0.0), Measure::default());
    }

    #[test]
    fn scenarios_of_a_family_are_drawn_together() {
        let first = |i: usize| f64::from(u8::from(i == 0));
        let share = |families| draws(families).ratio(Ratio::Share, &first, &|_| 1.0);
        let (alone, together) = (share([""; 4]), share(["bale", "bale", "child", "child"]));
        assert_eq!((alone.value, together.value), (Some(0.25), Some(0.25)));
        // Of four draws of four, three may be the first; of two families its own may be drawn twice.
        assert_eq!((alone.interval, together.interval), (Some([0.0, 0.75]), Some([0.0, 0.5])));
        let none = |families| draws(families).ratio(Ratio::Rate, &|_| 0.0, &|_| 0.5).interval.unwrap()[1];
        assert!((none(["bale", "bale", "child", "child"]) / none([""; 4]) - 2.0).abs() < 1e-9);
        // With one family alone there is nothing to draw from, be it that all others count for nothing.
        assert_eq!(share(["bale"; 4]).interval, None);
        let half = |i: usize| first(i) / 2.0;
        for kind in [Ratio::Share, Ratio::Rate, Ratio::Mean] {
            let of_first = draws([""; 4]).ratio(kind, &half, &first);
            assert_eq!(of_first, Measure { value: Some(0.5), interval: None });
        }
        let one: [Of<'_>; 2] = [&half, &first];
        assert_eq!(draws([""; 4]).difference(Ratio::Mean, one, one).interval, None);
    }

    #[test]
    fn a_difference_is_taken_within_each_resample() {
        let draws = draws([""; 4]);
        let (one, two) = (|i: usize| i as f64, |i: usize| i as f64 + 2.0);
        let all = |_: usize| 1.0;
        let Measure { value, interval } = draws.difference(Ratio::Mean, [&two, &all], [&one, &all]);
        assert_eq!((value, interval), (Some(2.0), Some([2.0, 2.0])));
        // Two who never differ in four drives may differ in others.
        let same = |kind| draws.difference(kind, [&one, &all], [&one, &all]);
        let high = same(Ratio::Share).interval.unwrap();
        assert!((high[1] - 0.6024).abs() < 1e-4 && high[0] == -high[1], "{high:?}");
        assert!((same(Ratio::Rate).interval.unwrap()[1] - 3.6889 / 4.0).abs() < 1e-4);
        // And one who always does what the other never does may not.
        let none = |_: usize| 0.0;
        let always = draws.difference(Ratio::Share, [&all, &all], [&none, &all]);
        assert!(always.value == Some(1.0) && always.interval == Some([1.0 - high[1], 1.0]), "{always:?}");
        assert_eq!(same(Ratio::Mean), Measure { value: Some(0.0), interval: Some([0.0; 2]) });
    }
}
