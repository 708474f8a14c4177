//! How often the label of a tracked object jumps.
//!
//! An object's label at a sample is harmful where the harmful share of its scores is at least one half. Over all pairs
//! of samples in a row in which an object is located in both, label changes are divided by the time between:
//! the true label's, the detector's, and the detector's while the true label stays.

use serde::{Deserialize, Serialize};

use super::{Context, MetricTable, MetricValue};
use crate::eval::EvalConfig;

/// Changes of labels, and the time in which they happened.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Steadiness {
    /// Pairs of samples in a row in which an object is located.
    pub n_pairs: usize,
    /// Time between them, all objects.
    pub tracked_s: f64,
    pub n_true_flips: usize,
    pub n_flips: usize,
    /// While the true label stays.
    pub n_spurious_flips: usize,
    pub true_flips_per_s: Option<f64>,
    pub flips_per_s: Option<f64>,
    pub spurious_flips_per_s: Option<f64>,
}

pub(super) fn measure(of: &Context<'_>) -> Option<Steadiness> {
    let tracks = of.tracks.as_ref()?;
    let (mut n_pairs, mut tracked_s) = (0, 0.0);
    let (mut n_true_flips, mut n_flips, mut n_spurious_flips) = (0, 0, 0);
    for pair in tracks.objects.iter().flat_map(|track| track.sights.windows(2)) {
        let is_harmful = |i: usize| Some(of.harm_probability[pair[i].number]? >= 0.5);
        let (Some(before), Some(after)) = (is_harmful(0), is_harmful(1)) else { continue };
        if pair[1].place != pair[0].place + 1 {
            continue;
        }
        n_pairs += 1;
        tracked_s += tracks.times_s[pair[1].sample_idx] - tracks.times_s[pair[0].sample_idx];
        let is_true_flip = pair[0].harm != pair[1].harm;
        n_true_flips += usize::from(is_true_flip);
        n_flips += usize::from(before != after);
        n_spurious_flips += usize::from(before != after && !is_true_flip);
    }
    let per_s = |n: usize| (tracked_s > 0.0).then(|| n as f64 / tracked_s);
    Some(Steadiness {
        n_pairs,
        tracked_s,
        n_true_flips,
        n_flips,
        n_spurious_flips,
        true_flips_per_s: per_s(n_true_flips),
        flips_per_s: per_s(n_flips),
        spurious_flips_per_s: per_s(n_spurious_flips),
    })
}

pub(super) fn show(steadiness: &Option<Steadiness>, _: &EvalConfig) -> Option<MetricTable> {
    let of = steadiness.as_ref()?;
    let row =
        |name, per_s, n| vec![MetricValue::name(name), MetricValue::number(per_s, 3), MetricValue::Count(n)];
    let rows = vec![
        row("true label", of.true_flips_per_s, of.n_true_flips),
        row("detector's label", of.flips_per_s, of.n_flips),
        row("detector's, the true one unchanged", of.spurious_flips_per_s, of.n_spurious_flips),
    ];
    let (n_pairs, tracked_s) = (of.n_pairs, of.tracked_s);
    let note = format!("Objects located in two samples in a row: {n_pairs} pairs, {tracked_s:.0} s.");
    MetricTable::new(&["label changes", "a second", "count"], rows, note)
}

#[cfg(test)]
mod tests {
    use super::super::tracks::tests::episode;
    use crate::eval::matching::tests::found;
    use crate::eval::{Mode, Protocol, evaluate};
    use crate::object::Harm;

    #[test]
    fn flips_are_counted_between_samples_in_a_row_and_told_from_true_ones() {
        let mut samples = episode("a", "nnnhh.h");
        // Labels: harmless, harmful, harmless, harmful, harmful, -, harmless.
        for (i, harm) in [(0, 1), (1, 0), (2, 1), (3, 0), (4, 0), (6, 1)] {
            samples[i].detections = vec![found(20.0 - 5.0 * i as f64, Harm::ALL[harm], 0.5)];
        }
        let steadiness =
            evaluate(&samples, &Protocol::default(), Mode::Id).unwrap().safety.steadiness.unwrap();
        let counts = (steadiness.n_pairs, steadiness.n_true_flips, steadiness.n_flips);
        assert_eq!((counts, steadiness.n_spurious_flips), ((4, 1, 3), 2));
        assert_eq!((steadiness.tracked_s, steadiness.flips_per_s), (2.0, Some(1.5)));
    }
}
