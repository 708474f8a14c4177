//! The worst of what a detector did wrong, each with what is needed to look at it: harm that it missed, false alarms.
//!
//! At the operating score and the threshold of the errors. A miss is a harmful truth that no harmful detection takes; a
//! false alarm is a harmful detection with no harmful truth within the threshold (a second box on a harmful object is
//! not one). Misses are worst where the least room to stop is left, false alarms where the score is highest.
//! An object counts once per episode, where it is worst, and an episode gives few of a kind, so that one
//! scene does not fill the list.

use std::collections::{HashMap, HashSet};

use serde::{Deserialize, Serialize};

use super::filter::KeptSample;
use super::matching::{Matching, Outcome, center_distance_m};
use super::protocol::Protocol;
use super::sample::{EvalSample, Mode, ScoreError};
use crate::dataset::{SampleFacts, episode_of_id};
use crate::geometry::{Box3, Ego};
use crate::object::{Detection, Harm, LabelledObject, Object};

/// Most faults of a kind that are kept: more than anyone looks through.
const MOST_OF_KIND: usize = 40;

/// Most faults of a kind from one episode.
const MOST_OF_EPISODE: usize = 3;

/// What went wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// A harmful object on which no detection lies.
    NotSeen,
    /// A harmful object on which only a harmless detection lies.
    CalledHarmless,
    /// A harmless object that is called harmful.
    CalledHarmful,
    /// A harmful detection where no object is.
    NothingThere,
}

impl FaultKind {
    pub const ALL: [Self; 4] = [Self::NotSeen, Self::CalledHarmless, Self::CalledHarmful, Self::NothingThere];

    /// Whether harm was missed; else it is a false alarm.
    #[must_use]
    pub fn is_miss(self) -> bool {
        matches!(self, Self::NotSeen | Self::CalledHarmless)
    }
}

/// One fault.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fault {
    pub kind: FaultKind,
    /// The sample at which it is worst.
    pub sample: String,
    /// Samples of the episode in which the object has this fault; 1 where objects have no ids.
    pub n_samples: usize,
    /// The score of a false alarm; for a miss, the best score of a harmful detection on it, if any.
    pub score: Option<f64>,
    /// The box of a missed object, or of the detection that is a false alarm.
    pub place: Box3<Ego>,
    /// From the ego's origin to the box's centre on the ground, metres.
    pub range_m: f64,
    /// Signed distance to the zone's edge, metres, negative inside.
    pub zone_distance_m: Option<f64>,
    /// The gap left ahead after stopping, metres; negative if it is too late.
    pub stopping_margin_m: Option<f64>,
    /// The object, if there is one.
    pub object: Option<LabelledObject>,
    pub facts: SampleFacts,
    /// The sample's detections of the operating score or more.
    pub detections: Vec<Detection>,
}

/// A fault's place, for who marks all faults of an episode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaultPlace {
    pub kind: FaultKind,
    /// Place of its sample among those given.
    pub sample_idx: usize,
    /// The box of a missed object, or of the detection that is a false alarm.
    pub place: Box3<Ego>,
}

/// Every fault of these samples, not only the worst.
///
/// # Errors
/// As [`super::score`].
pub fn list_faults(samples: &[EvalSample], protocol: &Protocol) -> Result<Vec<FaultPlace>, ScoreError> {
    let matching = Matching::new(samples, protocol, Mode::Id)?;
    // The filters leave out what nobody annotated.
    let is_kept = |(_, sample): &(usize, &EvalSample)| !sample.facts.is_unlabelled;
    let kept: Vec<usize> = samples.iter().enumerate().filter(is_kept).map(|(i, _)| i).collect();
    let place = |fault: Found<'_>| FaultPlace {
        kind: fault.kind,
        sample_idx: kept[fault.sample_idx],
        place: *fault.place,
    };
    Ok(find_all(&matching).into_iter().map(place).collect())
}

/// The worst faults, kind by kind, the worst first.
pub(super) fn find_worst(matching: &Matching<'_>) -> Vec<Fault> {
    let mut found = find_all(matching);
    // Stable: equal ones stay in the order of the samples.
    found.sort_by(|a, b| {
        a.kind.cmp(&b.kind).then_with(|| {
            b.badness.0.total_cmp(&a.badness.0).then_with(|| a.badness.1.total_cmp(&b.badness.1))
        })
    });
    let mut samples: HashMap<_, HashSet<&str>> = HashMap::new();
    for fault in &found {
        if let Some(object) = fault.identify(matching) {
            samples.entry(object).or_default().insert(fault.sample(matching).id);
        }
    }
    let (mut is_kept, mut n_kept) = (HashSet::new(), HashMap::<_, usize>::new());
    let mut worst = Vec::new();
    for fault in &found {
        let object = fault.identify(matching);
        if object.is_some_and(|object| !is_kept.insert(object)) {
            continue;
        }
        let keys = [(fault.kind, None), (fault.kind, Some(episode(fault.sample(matching))))];
        let [of_kind, of_episode] = keys.map(|key| n_kept.get(&key).copied().unwrap_or(0));
        if of_kind < MOST_OF_KIND && of_episode < MOST_OF_EPISODE {
            keys.into_iter().for_each(|key| *n_kept.entry(key).or_default() += 1);
            worst.push(fault.describe(matching, object.map_or(1, |object| samples[&object].len())));
        }
    }
    worst
}

/// A fault as it is found, before it is known to be one of the worst.
struct Found<'a> {
    kind: FaultKind,
    sample_idx: usize,
    place: &'a Box3<Ego>,
    score: Option<f64>,
    object: Option<&'a LabelledObject>,
    /// How bad it is, the larger the worse; then the range, the nearer the worse.
    badness: (f64, f64),
}

/// Every fault of every sample.
fn find_all<'a>(matching: &Matching<'a>) -> Vec<Found<'a>> {
    let mut faults = Vec::new();
    for (ranked, outcome) in matching.operating(Harm::Harmful) {
        let sample = &matching.samples[ranked.sample_idx];
        let place = &ranked.detection.box_in_ego;
        let object = match outcome {
            Outcome::Matched(_) | Outcome::Neutral(_) => continue,
            _ if is_on_harmful(matching, sample, place) => continue,
            Outcome::Misclassified(of) => Some(matching.object(of).object),
            Outcome::Unmatched => None,
        };
        let kind = if object.is_some() { FaultKind::CalledHarmful } else { FaultKind::NothingThere };
        let (score, badness) = (Some(ranked.score), (ranked.score, range_m(place)));
        faults.push(Found { kind, sample_idx: ranked.sample_idx, place, score, object, badness });
    }
    let is_found = &matching.met(Harm::Harmful).is_matched;
    let is_called_harmless = &matching.met(Harm::Harmless).is_mistaken;
    for of in matching.objects.iter().filter(|of| of.object.harm == Harm::Harmful && !is_found[of.number]) {
        let (sample, object) = (&matching.samples[of.sample_idx], of.object);
        let kind = if is_called_harmless[of.number] { FaultKind::CalledHarmless } else { FaultKind::NotSeen };
        let place = &object.truth.box_in_ego;
        let margin_m = stopping_margin_m(matching, sample.facts, &object.truth.solid_in_ego());
        faults.push(Found {
            kind,
            sample_idx: of.sample_idx,
            place,
            score: find_best_harmful_score(matching, sample, object),
            object: Some(object),
            badness: (margin_m.map_or(f64::NEG_INFINITY, |margin_m| -margin_m), range_m(place)),
        });
    }
    faults
}

/// Whether something harmful is there, whether the LiDAR hit it or not.
fn is_on_harmful(matching: &Matching<'_>, sample: &KeptSample<'_>, place: &Box3<Ego>) -> bool {
    let reach_m = matching.config().tp_threshold_m;
    let there = sample.objects.iter().chain(&sample.unhit);
    let mut harmful = there.filter(|object| object.harm == Harm::Harmful);
    harmful.any(|object| center_distance_m(&object.truth.box_in_ego, place) < reach_m)
}

fn find_best_harmful_score(
    matching: &Matching<'_>,
    sample: &KeptSample<'_>,
    object: &LabelledObject,
) -> Option<f64> {
    let place = &object.truth.box_in_ego;
    let lies_on = |found: &&&Detection| {
        let distance_m = center_distance_m(&found.box_in_ego, place);
        found.harm == Harm::Harmful && distance_m < matching.config().tp_threshold_m
    };
    sample.detections.iter().filter(lies_on).map(|found| found.score).max_by(f64::total_cmp)
}

/// The gap left ahead after stopping.
fn stopping_margin_m(matching: &Matching<'_>, facts: &SampleFacts, place: &Box3<Ego>) -> Option<f64> {
    let config = &matching.config().safety;
    let deceleration_mps2 = *config.decelerations_mps2.first()?;
    let stopping_m = config.stopping_distance_m(facts.speed_mps?, deceleration_mps2);
    Some(facts.gap_ahead_m(place)? - stopping_m)
}

fn range_m(place: &Box3<Ego>) -> f64 {
    place.center.x().hypot(place.center.y())
}

impl Found<'_> {
    fn sample<'m, 'a>(&self, matching: &'m Matching<'a>) -> &'m KeptSample<'a> {
        &matching.samples[self.sample_idx]
    }

    /// What makes two faults the same one at different samples.
    fn identify<'m>(&'m self, matching: &'m Matching<'_>) -> Option<(FaultKind, &'m str, &'m str)> {
        let id = self.object?.truth.id.as_deref()?;
        Some((self.kind, episode(self.sample(matching)), id))
    }

    fn describe(&self, matching: &Matching<'_>, n_samples: usize) -> Fault {
        let (config, sample) = (matching.config(), self.sample(matching));
        let kept = sample.detections.iter().filter(|found| found.score >= config.operating_score);
        let mut detections: Vec<Detection> = kept.map(|&&found| found).collect();
        detections.sort_by(|a, b| b.score.total_cmp(&a.score));
        let true_object = self.object.map(|object| &object.truth);
        let missed = true_object.filter(|truth| truth.box_in_ego == *self.place);
        let footprint = missed.map_or(*self.place, Object::solid_in_ego);
        Fault {
            kind: self.kind,
            sample: sample.id.to_owned(),
            n_samples,
            score: self.score,
            place: *self.place,
            range_m: range_m(self.place),
            zone_distance_m: sample.facts.zone_distance_m(&footprint),
            stopping_margin_m: stopping_margin_m(matching, sample.facts, &footprint),
            object: self.object.cloned(),
            facts: sample.facts.clone(),
            detections,
        }
    }
}

/// The name of a sample's episode.
fn episode<'a>(sample: &KeptSample<'a>) -> &'a str {
    sample.facts.episode.as_deref().unwrap_or_else(|| episode_of_id(sample.id))
}

#[cfg(test)]
mod tests {
    use super::super::matching::tests::{found, truth};
    use super::super::{EvalSample, Mode, Protocol, evaluate};
    use super::*;
    use crate::object::Distribution;

    fn sample(
        id: &str,
        speed_mps: f64,
        objects: Vec<LabelledObject>,
        detections: Vec<Detection>,
    ) -> EvalSample {
        let facts =
            SampleFacts { speed_mps: Some(speed_mps), front_bumper_x_m: Some(3.0), ..SampleFacts::default() };
        EvalSample::new(id, facts, objects, detections)
    }

    fn named(name: &str, x_m: f64, harm: Harm) -> LabelledObject {
        let mut object = truth(x_m, harm, Distribution::Id);
        object.truth.id = Some(name.into());
        object
    }

    fn worst(samples: &[EvalSample]) -> Vec<Fault> {
        evaluate(samples, &Protocol::default(), Mode::Id).unwrap().faults
    }

    #[test]
    fn each_fault_is_told_by_what_lies_there() {
        use Harm::{Harmful, Harmless};
        let samples = [sample(
            "e/0",
            10.0,
            vec![
                named("missed", 10.0, Harmful),
                named("called harmless", 20.0, Harmful),
                named("alarm", 30.0, Harmless),
                named("found", 40.0, Harmful),
            ],
            vec![
                found(20.0, Harmless, 0.9),
                found(20.5, Harmful, 0.1), // below the operating score
                found(30.0, Harmful, 0.8),
                found(40.0, Harmful, 0.7),
                found(40.5, Harmful, 0.6), // a second box on what is found
                found(47.0, Harmful, 0.5),
            ],
        )];
        let faults = worst(&samples);
        let told: Vec<_> = faults
            .iter()
            .map(|f| (f.kind, f.object.as_ref().and_then(|object| object.truth.id.as_deref()), f.score))
            .collect();
        let wanted = [
            (FaultKind::NotSeen, Some("missed"), None),
            (FaultKind::CalledHarmless, Some("called harmless"), Some(0.1)),
            (FaultKind::CalledHarmful, Some("alarm"), Some(0.8)),
            (FaultKind::NothingThere, None, Some(0.5)),
        ];
        assert_eq!(told, wanted);
        // The box of 4 m at 10 m begins 5 m before the bumper; 10 m/s need 10 m to react and 12.5 m to brake.
        assert!((faults[0].stopping_margin_m.unwrap() + 17.5).abs() < 1e-12);
        assert_eq!(faults[0].detections.len(), 5);
        let mut places: Vec<_> = list_faults(&samples, &Protocol::default()).unwrap();
        places.sort_by_key(|fault| fault.kind);
        assert!(places.iter().map(|of| (of.kind, of.place)).eq(faults.iter().map(|of| (of.kind, of.place))));
        assert_eq!(faults[0].place, samples[0].objects[0].truth.box_in_ego);
    }

    #[test]
    fn an_object_counts_once_at_its_worst_and_an_episode_does_not_fill_the_list() {
        let miss = |id: &str, name: &str, x_m| sample(id, 5.0, vec![named(name, x_m, Harm::Harmful)], vec![]);
        let mut samples = vec![miss("a/0", "one", 20.0), miss("a/1", "one", 9.0), miss("a/2", "one", 15.0)];
        samples.extend((3..9).map(|i| miss(&format!("a/{i}"), &format!("other {i}"), 30.0)));
        samples.push(miss("b/0", "one", 10.0));
        let faults = worst(&samples);
        let told: Vec<_> = faults.iter().map(|fault| (fault.sample.as_str(), fault.n_samples)).collect();
        assert_eq!(told, [("a/1", 3), ("b/0", 1), ("a/3", 1), ("a/4", 1)]);
        let all = list_faults(&samples, &Protocol::default()).unwrap();
        assert!(all.iter().map(|fault| fault.sample_idx).eq(0..10), "every miss of every sample");
        samples[0].facts.is_unlabelled = true;
        let all = list_faults(&samples, &Protocol::default()).unwrap();
        assert!(all.iter().map(|fault| fault.sample_idx).eq(1..10), "places are those of the samples given");
    }

    #[test]
    fn a_box_on_something_harmful_that_the_lidar_did_not_hit_is_no_fault() {
        let mut walker = named("walker", 10.0, Harm::Harmful);
        walker.truth.n_lidar_points = Some(0);
        let boxes = vec![found(10.5, Harm::Harmful, 0.9), found(20.0, Harm::Harmful, 0.8)];
        let faults = worst(&[sample("e/0", 10.0, vec![walker, named("car", 30.0, Harm::Harmless)], boxes)]);
        let told: Vec<_> = faults.iter().map(|fault| (fault.kind, fault.score)).collect();
        assert_eq!(told, [(FaultKind::NothingThere, Some(0.8))]);
    }

    #[test]
    fn a_perfect_detector_has_no_fault() {
        let all = [Harm::Harmful, Harm::Harmless];
        let truths = all.map(|harm| truth(10.0 + 20.0 * harm.index() as f64, harm, Distribution::Ood));
        let detections = all.map(|harm| found(10.0 + 20.0 * harm.index() as f64, harm, 0.9));
        assert_eq!(worst(&[sample("e/0", 5.0, truths.to_vec(), detections.to_vec())]), []);
    }
}
