//! The worst of what a detector did wrong, each with what is needed to look at it: harm that it missed, false alarms.
//!
//! At the operating score and the threshold of the errors. A miss is a harmful truth that no harmful detection takes; a
//! false alarm is a harmful detection with no harmful truth within the threshold (a second box on a harmful object is
//! none). Misses are worst where the least room to stop is left, false alarms where the score is highest. An object
//! counts once an episode, where it is worst, and an episode gives few of a kind, so that one scene does not fill the
//! list.

use std::collections::{HashMap, HashSet};

use serde::{Deserialize, Serialize};

use super::matching::{Outcome, center_distance_m};
use super::metrics::{self, Matching};
use super::protocol::Protocol;
use super::{EvalDetection, EvalSample, EvalTruth, Mode, SampleFacts, ScoreError, TruthFacts, check};
use crate::geometry::{Box3, Ego, Point};
use crate::object::{Distribution, Harm};

/// Faults of a kind that are kept; more than anyone looks through.
const MOST_OF_KIND: usize = 40;

/// Faults of a kind that one episode gives at most.
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
    /// Samples of the episode at which the object is so; 1 where objects have no ids.
    pub n_samples: usize,
    /// Of a false alarm its score; of a miss the best score of a harmful detection on it, if there is one.
    pub score: Option<f64>,
    /// Of a miss the object's box, of a false alarm the detection's.
    pub place: Place,
    /// From the ego's origin to the box's centre on the ground, metres.
    pub range_m: f64,
    /// Signed distance to the zone's edge, metres, negative inside.
    pub zone_distance_m: Option<f64>,
    /// What is left of the gap ahead after stopping, metres; negative where it is too late.
    pub stopping_margin_m: Option<f64>,
    /// The object, if there is one.
    pub object: Option<FaultObject>,
    pub facts: SampleFacts,
    /// The sample's detections of the operating score or more.
    pub detections: Vec<FaultDetection>,
}

/// The object of a fault.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FaultObject {
    pub harm: Harm,
    pub distribution: Option<Distribution>,
    pub n_lidar_points: Option<u32>,
    #[serde(flatten)]
    pub facts: TruthFacts,
}

/// A detection in a fault's sample.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FaultDetection {
    pub harm: Harm,
    pub score: f64,
    #[serde(flatten)]
    pub place: Place,
}

/// A box in the ego frame; size is length, width, height.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Place {
    pub center_m: [f64; 3],
    pub size_m: [f64; 3],
    pub yaw_rad: f64,
}

impl From<&Box3<Ego>> for Place {
    fn from(from: &Box3<Ego>) -> Self {
        Self {
            center_m: [from.center.x(), from.center.y(), from.center.z()],
            size_m: [from.length_m, from.width_m, from.height_m],
            yaw_rad: from.yaw_rad,
        }
    }
}

impl From<&Place> for Box3<Ego> {
    fn from(from: &Place) -> Self {
        let ([x_m, y_m, z_m], [length_m, width_m, height_m]) = (from.center_m, from.size_m);
        Self { center: Point::new(x_m, y_m, z_m), length_m, width_m, height_m, yaw_rad: from.yaw_rad }
    }
}

/// The worst faults, kind by kind, the worst first.
///
/// # Errors
/// As [`super::score`].
pub fn worst_faults(samples: &[EvalSample], protocol: &Protocol) -> Result<Vec<Fault>, ScoreError> {
    check(samples, protocol, Mode::Id)?;
    let (kept, _) = metrics::filtered(samples, protocol.config());
    let matching = metrics::matched(&kept, protocol.config());
    Ok(Finder { kept: &kept, protocol }.worst(&matching))
}

struct Finder<'a> {
    kept: &'a [EvalSample],
    protocol: &'a Protocol,
}

impl<'a> Finder<'a> {
    fn worst(&self, matching: &Matching<'a>) -> Vec<Fault> {
        let mut found = self.all(matching);
        // Stable: equal ones stay in the order of the samples.
        found.sort_by(|a, b| {
            a.kind.cmp(&b.kind).then_with(|| {
                let (a, b) = (badness(a), badness(b));
                b.0.total_cmp(&a.0).then_with(|| a.1.total_cmp(&b.1))
            })
        });
        let mut n_samples: HashMap<_, HashSet<String>> = HashMap::new();
        for fault in &found {
            if let Some(object) = whose(fault) {
                n_samples.entry(object).or_default().insert(fault.sample.clone());
            }
        }
        let (mut is_kept, mut n_kept) = (HashSet::new(), HashMap::new());
        found.retain_mut(|fault| {
            if let Some(object) = whose(fault) {
                fault.n_samples = n_samples[&object].len();
                if !is_kept.insert(object) {
                    return false;
                }
            }
            let of_kind = n_kept.get(&(fault.kind, None)).copied().unwrap_or(0);
            let of_episode: &mut usize = n_kept.entry((fault.kind, Some(episode(fault)))).or_default();
            if of_kind >= MOST_OF_KIND || *of_episode >= MOST_OF_EPISODE {
                return false;
            }
            *of_episode += 1;
            n_kept.insert((fault.kind, None), of_kind + 1);
            true
        });
        found
    }

    /// Every fault of every sample.
    fn all(&self, matching: &Matching<'a>) -> Vec<Fault> {
        let (at, config) = (self.protocol.tp_threshold_idx(), self.protocol.config());
        let n_truths = self.kept.iter().map(|sample| sample.truths.len()).sum();
        let (mut is_found, mut is_called_harmless) = (vec![false; n_truths], vec![false; n_truths]);
        let mut faults = Vec::new();
        let counts = |score: f64| score >= config.operating_score;
        for (ranked, outcome) in
            matching.harmful.at(at).take_while(|(ranked, _)| counts(ranked.detection.score))
        {
            let sample = &self.kept[ranked.sample_idx];
            let object = match outcome {
                Outcome::Matched(truth, _) => {
                    is_found[truth.number] = true;
                    continue;
                }
                _ if self.is_on_harmful(sample, &ranked.detection.box_in_ego) => continue,
                Outcome::Misclassified(truth) => Some(truth.truth),
                Outcome::Unmatched => None,
            };
            let kind = if object.is_some() { FaultKind::CalledHarmful } else { FaultKind::NothingThere };
            let found = ranked.detection;
            faults.push(self.fault(kind, sample, &found.box_in_ego, Some(found.score), object));
        }
        for (_, outcome) in matching.harmless.at(at).take_while(|(ranked, _)| counts(ranked.detection.score))
        {
            if let Outcome::Misclassified(truth) = outcome {
                is_called_harmless[truth.number] = true;
            }
        }
        let truths =
            self.kept.iter().flat_map(|sample| sample.truths.iter().map(move |truth| (sample, truth)));
        for (number, (sample, truth)) in truths.enumerate() {
            if truth.harm == Harm::Harmful && !is_found[number] {
                let kind =
                    if is_called_harmless[number] { FaultKind::CalledHarmless } else { FaultKind::NotSeen };
                let score = self.best_harmful_score(sample, truth);
                faults.push(self.fault(kind, sample, &truth.box_in_ego, score, Some(truth)));
            }
        }
        faults
    }

    fn is_on_harmful(&self, sample: &EvalSample, place: &Box3<Ego>) -> bool {
        let reach_m = self.protocol.config().tp_threshold_m;
        let mut harmful = sample.truths.iter().filter(|truth| truth.harm == Harm::Harmful);
        harmful.any(|truth| center_distance_m(&truth.box_in_ego, place) < reach_m)
    }

    fn best_harmful_score(&self, sample: &EvalSample, truth: &EvalTruth) -> Option<f64> {
        let reach_m = self.protocol.config().tp_threshold_m;
        let lies_on = |found: &&EvalDetection| {
            found.harm == Harm::Harmful && center_distance_m(&found.box_in_ego, &truth.box_in_ego) < reach_m
        };
        sample.detections.iter().filter(lies_on).map(|found| found.score).max_by(f64::total_cmp)
    }

    fn fault(
        &self,
        kind: FaultKind,
        sample: &EvalSample,
        place: &Box3<Ego>,
        score: Option<f64>,
        object: Option<&EvalTruth>,
    ) -> Fault {
        let config = self.protocol.config();
        let mut detections: Vec<&EvalDetection> =
            sample.detections.iter().filter(|found| found.score >= config.operating_score).collect();
        detections.sort_by(|a, b| b.score.total_cmp(&a.score));
        Fault {
            kind,
            sample: sample.id.clone(),
            n_samples: 1,
            score,
            place: place.into(),
            range_m: place.center.x().hypot(place.center.y()),
            zone_distance_m: sample.facts.zone_distance_m(place),
            stopping_margin_m: self.stopping_margin_m(&sample.facts, place),
            object: object.map(|truth| FaultObject {
                harm: truth.harm,
                distribution: truth.distribution,
                n_lidar_points: truth.n_lidar_points,
                facts: truth.facts.clone(),
            }),
            facts: sample.facts.clone(),
            detections: detections
                .into_iter()
                .map(|found| FaultDetection {
                    harm: found.harm,
                    score: found.score,
                    place: (&found.box_in_ego).into(),
                })
                .collect(),
        }
    }

    /// The gap ahead less the stopping distance at the first of the config's decelerations.
    fn stopping_margin_m(&self, facts: &SampleFacts, place: &Box3<Ego>) -> Option<f64> {
        let config = &self.protocol.config().safety;
        let speed_mps = facts.speed_mps?.max(0.0);
        let braking_m = speed_mps * speed_mps / (2.0 * config.decelerations_mps2.first()?);
        Some(facts.gap_ahead_m(place)? - speed_mps * config.reaction_time_s - braking_m)
    }
}

/// How bad, the larger the worse; then the range, the nearer the worse.
fn badness(fault: &Fault) -> (f64, f64) {
    let first = if fault.kind.is_miss() {
        fault.stopping_margin_m.map_or(f64::NEG_INFINITY, |margin_m| -margin_m)
    } else {
        fault.score.unwrap_or(f64::NEG_INFINITY)
    };
    (first, fault.range_m)
}

fn episode(fault: &Fault) -> String {
    let of_id = || super::facts::episode_of_id(&fault.sample).to_owned();
    fault.facts.episode.clone().unwrap_or_else(of_id)
}

/// What makes two faults the same one at different samples.
fn whose(fault: &Fault) -> Option<(FaultKind, String, String)> {
    let id = fault.object.as_ref()?.facts.id.clone()?;
    Some((fault.kind, episode(fault), id))
}

#[cfg(test)]
mod tests {
    use super::super::matching::tests::{found, truth};
    use super::*;

    fn sample(
        id: &str,
        speed_mps: f64,
        truths: Vec<EvalTruth>,
        detections: Vec<EvalDetection>,
    ) -> EvalSample {
        let facts =
            SampleFacts { speed_mps: Some(speed_mps), front_bumper_x_m: Some(3.0), ..SampleFacts::default() };
        EvalSample { id: id.into(), facts, truths, detections }
    }

    fn named(name: &str, x_m: f64, harm: Harm) -> EvalTruth {
        let facts = TruthFacts { id: Some(name.into()), ..TruthFacts::default() };
        EvalTruth { facts, ..truth(x_m, harm, Distribution::Id) }
    }

    fn worst(samples: &[EvalSample]) -> Vec<Fault> {
        worst_faults(samples, &Protocol::default()).unwrap()
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
            .map(|f| (f.kind, f.object.as_ref().and_then(|object| object.facts.id.as_deref()), f.score))
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
        assert_eq!(Box3::from(&faults[0].place), samples[0].truths[0].box_in_ego);
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
    }

    #[test]
    fn a_perfect_detector_has_no_fault_and_no_sample_is_an_error() {
        let all = [Harm::Harmful, Harm::Harmless];
        let truths = all.map(|harm| truth(10.0 + 20.0 * harm.index() as f64, harm, Distribution::Ood));
        let detections = all.map(|harm| found(10.0 + 20.0 * harm.index() as f64, harm, 0.9));
        assert_eq!(worst(&[sample("e/0", 5.0, truths.to_vec(), detections.to_vec())]), []);
        assert!(worst_faults(&[], &Protocol::default()).is_err());
    }
}
