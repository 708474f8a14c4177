//! How much the scores would vary with other episodes: percentile intervals by bootstrap.
//!
//! Samples of an episode resemble each other, so whole episodes are drawn, with replacement, as many as there are
//! (cluster bootstrap; Efron and Tibshirani 1993, ch. 8). Matching never leaves a sample, so a resample is the same
//! ranking with each detection taken as often as its episode was drawn. A resample without a truth of a class in a
//! column says nothing about that cell and is left out of it; nor does one that lacks a class of the mean about the mean.

use std::collections::HashMap;
use std::ops::Range;

use rand::RngExt;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::curve::GrowingCurve;
use super::filter::KeptSample;
use super::matching::{Matching, Outcome};
use super::metrics::{Columns, mean};
use super::protocol::{MissingClass, Protocol};
use crate::dataset::episode_of_id;
use crate::object::Harm;
use crate::random;

/// Share of resamples that an interval holds.
const LEVEL: f64 = 0.95;

/// Intervals of every headline cell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Confidence {
    /// Share of resamples within an interval.
    pub level: f64,
    pub n_resamples: usize,
    pub n_episodes: usize,
    #[serde(flatten)]
    pub columns: Columns<Intervals>,
}

impl Confidence {
    /// Share of resamples that an interval holds.
    pub(super) const LEVEL: f64 = LEVEL;
}

/// Lower and upper end of the APs' intervals and of their mean's; `None` if no resample has a value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Intervals {
    pub harmful: Option<[f64; 2]>,
    pub harmless: Option<[f64; 2]>,
    pub mean: Option<[f64; 2]>,
}

/// What counts in one cell: for each threshold the detections by rank, and the positives of each episode.
pub(super) struct Cell {
    counting: Vec<Counting>,
    n_positives: Vec<usize>,
}

/// The detections that count at a threshold.
#[derive(Default)]
struct Counting {
    /// Of each by rank.
    episodes: Vec<u32>,
    /// Ranks of the true ones.
    matches: Vec<usize>,
}

/// Draws of the episodes: the same for every figure, so that intervals of several figures are of the same resamples.
pub(super) struct Resamples {
    /// Number of each sample's episode.
    pub episode_of: Vec<usize>,
    pub n_episodes: usize,
    n: usize,
    seed: u64,
}

impl Resamples {
    /// `None` if the config asks for none or there is only one episode.
    pub fn of(matching: &Matching<'_>) -> Option<Self> {
        let resamples = Self::always(matching);
        (resamples.n > 0).then_some(resamples)
    }

    /// As [`Self::of`], with no draw where there is nothing to draw.
    pub fn always(matching: &Matching<'_>) -> Self {
        let config = matching.config();
        let (episode_of, n_episodes) = number_episodes(&matching.samples);
        let n = if n_episodes > 1 { config.n_resamples } else { 0 };
        Self { episode_of, n_episodes, n, seed: config.bootstrap_seed }
    }

    /// How many draws there are.
    pub fn n(&self) -> usize {
        self.n
    }

    /// A value of each resample, from how often each episode was drawn.
    pub fn map<T: Send>(&self, value: impl Fn(&[u32]) -> T + Sync) -> Vec<T> {
        resample(self.n_episodes, self.n, self.seed, value)
    }
}

/// A value of each of `n` resamples of some episodes, from how often each episode was drawn.
pub fn resample<T: Send>(
    n_episodes: usize,
    n: usize,
    seed: u64,
    value: impl Fn(&[u32]) -> T + Sync,
) -> Vec<T> {
    let of_resample = |resample| {
        let mut rng = random::stream(seed, "bootstrap", resample);
        let mut n_drawn = vec![0_u32; n_episodes];
        (0..n_episodes).for_each(|_| n_drawn[rng.random_range(0..n_episodes)] += 1);
        value(&n_drawn)
    };
    (0..n as u64).into_par_iter().map(of_resample).collect()
}

/// Draws the resamples; `None` if the config asks for none or there is only one episode.
pub(super) fn measure(matching: &Matching<'_>) -> Option<Confidence> {
    let (config, protocol, mode) = (matching.config(), matching.protocol, matching.mode);
    let resamples = Resamples::of(matching)?;
    let n_episodes = resamples.n_episodes;
    let cells = Columns::from_fn(mode, |column| {
        let has = |number: usize| column.has_positive(matching.objects[number].object.truth.distribution);
        let judge = |_: usize, outcome: Outcome| column.judge(outcome, matching);
        Harm::ALL.map(|class| Cell::new(matching, class, &resamples.episode_of, n_episodes, has, judge))
    });
    let resampled: Vec<Columns<[Option<f64>; 2]>> = resamples.map(|n_drawn| {
        Columns::from_fn(mode, |column| {
            let of_column = cells.get(column).expect("same mode");
            [0, 1].map(|class| of_column[class].ap(n_drawn, protocol))
        })
    });
    let columns = Columns::from_fn(mode, |column| {
        let of_column = || resampled.iter().map(|one| one.get(column).expect("same mode"));
        let of_classes = cells.get(column).expect("same mode");
        let is_scored: Vec<usize> = (0..Harm::ALL.len())
            .filter(|&class| of_classes[class].has_positives() || config.missing_class == MissingClass::Zero)
            .collect();
        // A resample that lacks one of the classes in the mean has no mean.
        let mean_of = |aps: &[Option<f64>; 2]| {
            let aps = is_scored.iter().map(|&class| aps[class]).collect::<Option<Vec<f64>>>()?;
            (!aps.is_empty()).then(|| mean(&aps))
        };
        Intervals {
            harmful: interval(of_column().filter_map(|aps| aps[0])),
            harmless: interval(of_column().filter_map(|aps| aps[1])),
            mean: interval(of_column().filter_map(mean_of)),
        }
    });
    Some(Confidence { level: LEVEL, n_resamples: config.n_resamples, n_episodes, columns })
}

/// The episode of each sample as a number, and how many there are. A sample without a known episode counts as
/// an episode of its own.
pub(super) fn number_episodes(samples: &[KeptSample<'_>]) -> (Vec<usize>, usize) {
    let mut numbers: HashMap<&str, usize> = HashMap::new();
    let of_samples = samples
        .iter()
        .map(|sample| {
            let name = sample.facts.episode.as_deref().unwrap_or_else(|| episode_of_id(sample.id));
            let next = numbers.len();
            *numbers.entry(name).or_insert(next)
        })
        .collect();
    (of_samples, numbers.len())
}

impl Cell {
    /// What counts of a class: the objects, by number, that `has` takes, and the detections that `judge` calls true or false by
    /// their sample and their outcome.
    pub fn new(
        matching: &Matching<'_>,
        class: Harm,
        episode_of: &[usize],
        n_episodes: usize,
        has: impl Fn(usize) -> bool,
        judge: impl Fn(usize, Outcome) -> Option<bool>,
    ) -> Self {
        let mut n_positives = vec![0; n_episodes];
        for of in &matching.objects {
            let is_positive = of.object.harm == class && has(of.number);
            n_positives[episode_of[of.sample_idx]] += usize::from(is_positive);
        }
        let of_threshold = |threshold_idx| {
            let mut counting = Counting::default();
            for (ranked, outcome) in matching.at(class, threshold_idx) {
                let Some(is_match) = judge(ranked.sample_idx, outcome) else { continue };
                if is_match {
                    counting.matches.push(counting.episodes.len());
                }
                counting.episodes.push(episode_of[ranked.sample_idx] as u32);
            }
            counting
        };
        let counting = (0..matching.config().dist_thresholds_m.len()).map(of_threshold).collect();
        Self { counting, n_positives }
    }

    fn has_positives(&self) -> bool {
        self.n_positives() > 0
    }

    /// How many objects count.
    pub fn n_positives(&self) -> usize {
        self.n_positives.iter().sum()
    }

    /// AP, mean over the thresholds, of a resample; `None` if it has no positive.
    pub fn ap(&self, n_drawn: &[u32], protocol: &Protocol) -> Option<f64> {
        let n_positives: usize =
            self.n_positives.iter().zip(n_drawn).map(|(n, &drawn)| n * drawn as usize).sum();
        if n_positives == 0 {
            return None;
        }
        let aps: Vec<f64> = self
            .counting
            .iter()
            .map(|counting| {
                let mut curve = GrowingCurve::new(n_positives);
                let draws_of = |ranks: Range<usize>| -> u32 {
                    counting.episodes[ranks].iter().map(|&episode| n_drawn[episode as usize]).sum()
                };
                // No score counts in an AP, but their order.
                let mut begin = 0;
                for &rank in &counting.matches {
                    curve.add_times(draws_of(begin..rank), 0.0, false);
                    curve.add_times(draws_of(rank..rank + 1), 0.0, true);
                    begin = rank + 1;
                }
                curve.add_times(draws_of(begin..counting.episodes.len()), 0.0, false);
                curve.finish().average_precision(protocol.first_step(), protocol.config().min_precision)
            })
            .collect();
        Some(mean(&aps))
    }
}

/// The middle [`LEVEL`] of some values; quantiles between two values are interpolated, as numpy's default. `None`
/// without values.
pub fn interval(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().checked_sub(1)?;
    let quantile = |share: f64| {
        let at = share * last as f64;
        let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
        low + (high - low) * at.fract()
    };
    Some([quantile((1.0 - LEVEL) / 2.0), quantile(f64::midpoint(1.0, LEVEL))])
}

#[cfg(test)]
mod tests {
    use super::super::matching::tests::{found, truth};
    use super::super::{EvalSample, Mode, evaluate};
    use super::*;
    use crate::dataset::SampleFacts;
    use crate::object::Distribution;

    /// `n` episodes of two alike samples: in the first `n_good` both truths are found, in the others none.
    fn samples(n: usize, n_good: usize) -> Vec<EvalSample> {
        (0..2 * n)
            .map(|i| EvalSample {
                id: format!("{}/{}", i / 2, i % 2),
                facts: SampleFacts::default(),
                objects: Harm::ALL
                    .map(|harm| truth(8.0 + 9.0 * harm.index() as f64, harm, Distribution::Id))
                    .into(),
                detections: if i / 2 < n_good {
                    Harm::ALL.map(|harm| found(8.0 + 9.0 * harm.index() as f64, harm, 0.5)).into()
                } else {
                    vec![]
                },
                n_points: vec![],
            })
            .collect()
    }

    fn confidence(samples: &[EvalSample]) -> Confidence {
        evaluate(samples, &Protocol::default(), Mode::Id).unwrap().confidence.unwrap()
    }

    #[test]
    fn the_interval_is_that_of_drawing_episodes_not_samples() {
        // Recall of a resample is the share of good episodes drawn, of 20 by 0.5 each; AP follows it.
        let found = confidence(&samples(20, 10));
        assert_eq!((found.n_episodes, found.n_resamples), (20, 1000));
        let [low, high] = found.columns.total.mean.unwrap();
        // Binomial(20, 0.5): 2.5 % and 97.5 % lie at 6 and 14 episodes, recall 0.3 and 0.7.
        let ap = |recall: f64| (recall * 100.0 - 10.0) / 90.0;
        assert!((low - ap(0.3)).abs() < 0.06 && (high - ap(0.7)).abs() < 0.06, "{low} {high}");
        assert_eq!(confidence(&samples(20, 10)), found, "seeded");
    }

    #[test]
    fn a_class_that_is_not_there_at_all_has_no_part_in_the_means_interval() {
        let mut samples = samples(5, 5);
        samples.iter_mut().for_each(|sample| sample.objects.truncate(1));
        let total = confidence(&samples).columns.total;
        assert_eq!((total.harmful, total.harmless, total.mean), (Some([1.0; 2]), None, Some([1.0; 2])));
    }

    #[test]
    fn where_all_is_found_nothing_varies_and_one_episode_tells_nothing() {
        assert_eq!(confidence(&samples(5, 5)).columns.total.harmful, Some([1.0, 1.0]));
        assert!(evaluate(&samples(1, 1), &Protocol::default(), Mode::Id).unwrap().confidence.is_none());
        assert_eq!(interval([3.0, 1.0].into_iter()), Some([1.05, 2.95]));
        assert_eq!(interval(std::iter::empty()), None);
    }
}
