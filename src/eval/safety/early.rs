//! False-harmful boxes that were only early: their object turns harmful one, two or three samples later.
//!
//! A false-harmful box is a harmful detection of the operating score or more that is misclassified on a harmless truth
//! (threshold of the errors). It turns within k samples if its object is harmful in any of the k next samples of its
//! episode; boxes whose episode ends before that are left out. For comparison, the same share of all harmless
//! truths.

use serde::{Deserialize, Serialize};

use super::tracks::Sight;
use super::{Context, MetricTable, MetricValue};
use crate::eval::EvalConfig;
use crate::eval::matching::Outcome;
use crate::object::Harm;

/// How many samples to look ahead at most.
const MOST_LATER: usize = 3;

/// Shares for one, two and three samples.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Early {
    /// False-harmful boxes on a harmless truth with an id.
    pub n_false_harmful: usize,
    pub within: Vec<EarlyShare>,
}

/// What happens within some samples.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EarlyShare {
    pub n_later: usize,
    /// False-harmful boxes whose episode has that many samples more.
    pub n_boxes: usize,
    /// Of these, the ones whose object turns harmful.
    pub n_turned: usize,
    pub share: Option<f64>,
    /// The same share of all harmless truths.
    pub share_of_harmless: Option<f64>,
}

pub(super) fn measure(of: &Context<'_>) -> Option<Early> {
    let tracks = of.tracks.as_ref()?;
    let false_harmful: Vec<&[Sight]> = of
        .matching
        .operating(Harm::Harmful)
        .filter_map(|(_, outcome)| match outcome {
            Outcome::Misclassified(of) => tracks.sights_from(of as usize),
            _ => None,
        })
        .collect();
    let all_harmless: Vec<&[Sight]> = tracks
        .objects
        .iter()
        .flat_map(|track| (0..track.sights.len()).map(|at| &track.sights[at..]))
        .filter(|sights| sights[0].harm == Harm::Harmless)
        .collect();
    let mut lengths = vec![0; tracks.times_s.len()];
    for episode in &tracks.episodes {
        episode.iter().for_each(|&sample_idx| lengths[sample_idx] = episode.len());
    }
    let count_turns = |from: &[&[Sight]], n_later: usize| {
        let lasting = from.iter().filter(|sights| sights[0].place + n_later < lengths[sights[0].sample_idx]);
        let turns = |sights: &&&[Sight]| {
            let mut next = sights.iter().take_while(|sight| sight.place <= sights[0].place + n_later);
            next.any(|sight| sight.harm == Harm::Harmful)
        };
        (lasting.clone().count(), lasting.filter(turns).count())
    };
    let share = |(n, n_turned): (usize, usize)| (n > 0).then(|| n_turned as f64 / n as f64);
    let within = (1..=MOST_LATER).map(|n_later| {
        let (n_boxes, n_turned) = count_turns(&false_harmful, n_later);
        EarlyShare {
            n_later,
            n_boxes,
            n_turned,
            share: share((n_boxes, n_turned)),
            share_of_harmless: share(count_turns(&all_harmless, n_later)),
        }
    });
    Some(Early { n_false_harmful: false_harmful.len(), within: within.collect() })
}

pub(super) fn show(early: &Option<Early>, _: &EvalConfig) -> Option<MetricTable> {
    let row = |share: &EarlyShare| {
        let samples = if share.n_later == 1 { "sample" } else { "samples" };
        let boxes = MetricValue::share(share.share, share.n_boxes);
        let name = MetricValue::name(format!("within {} {samples}", share.n_later));
        vec![name, boxes, MetricValue::share(share.share_of_harmless, None)]
    };
    let head = ["object turns harmful", "false-harmful boxes", "all harmless objects"];
    let note = "A false alarm on an object that is harmful a moment later was only early.";
    MetricTable::new(&head, early.as_ref()?.within.iter().map(row).collect(), note)
}

#[cfg(test)]
mod tests {
    use super::super::tracks::tests::episode;
    use crate::eval::matching::tests::found;
    use crate::eval::{Mode, Protocol, evaluate};
    use crate::object::Harm;

    #[test]
    fn a_false_harmful_box_is_early_if_its_object_turns_harmful_soon() {
        // False harmful at the first two samples; the object is harmful at the fourth alone.
        let mut samples = episode("a", "nn.hn");
        for i in [0, 1] {
            samples[i].detections = vec![found(20.0 - 5.0 * i as f64, Harm::Harmful, 0.5)];
        }
        samples[4].detections = vec![found(0.0, Harm::Harmful, 0.1)]; // below the operating score
        let early = evaluate(&samples, &Protocol::default(), Mode::Id).unwrap().safety.early.unwrap();
        assert_eq!(early.n_false_harmful, 2);
        let counts: Vec<_> = early.within.iter().map(|share| (share.n_boxes, share.n_turned)).collect();
        // Within one: none. Two: the second's. Three: both.
        assert_eq!(counts, [(2, 0), (2, 1), (2, 2)]);
        // Harmless truths: samples 0, 1 and 4, of which the last has no sample after it.
        assert_eq!(early.within[1].share_of_harmless, Some(0.5));
    }
}
