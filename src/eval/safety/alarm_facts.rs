//! What counts at an operating point, gathered once: alarms by rank, harmful objects, events, kilometres by episode.
//!
//! Every count takes how often each episode is drawn, so that the figures and their intervals come from the same code.

use std::ops::Range;

use super::Tracks;
use super::tracks::{self, HarmRun};
use crate::eval::bootstrap::number_episodes;
use crate::eval::filter::KeptSample;
use crate::eval::matching::{Matching, Outcome, Ranked, center_distance_m};
use crate::object::{Distribution, Harm, LabelledObject};

/// Alarms and harm of all samples.
pub(super) struct AlarmFacts<'a> {
    /// By descending score.
    alarms: Vec<Alarm>,
    pub objects: Vec<HarmfulObject<'a>>,
    pub events: Vec<HarmEvent<'a>>,
    /// Kilometres that the ego drove in each episode.
    driven_km: Vec<f64>,
    pub driven_h: f64,
    pub n_episodes: usize,
}

/// A harmful detection that is not neutral.
struct Alarm {
    score: f64,
    episode: usize,
    lies_on: LiesOn,
}

/// What a harmful detection was made on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum LiesOn {
    /// On a harmful object that no better detection took: no false alarm.
    Harm,
    /// On an object that is harmless.
    Harmless,
    /// On a harmful object that a better detection took, or where no object is.
    Nothing,
}

/// A harmful truth.
pub(super) struct HarmfulObject<'a> {
    episode: usize,
    pub origin: Origin<'a>,
    /// It is found by operating scores up to this one; minus infinity if by none.
    found_to: f64,
}

/// A run of samples in which an object is harmful.
pub(super) struct HarmEvent<'a> {
    episode: usize,
    pub origin: Origin<'a>,
    /// For each sample from the first to the last the score up to which the object is found.
    found_to: Vec<f64>,
    /// `[deceleration][sample]`: whether the ego can stop before the object; `None` where it is not known or not scored.
    can_stop: Vec<Vec<Option<bool>>>,
}

/// Where a truth belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Origin<'a> {
    pub distribution: Option<Distribution>,
    pub category: Option<&'a str>,
}

/// False alarms at a score, and those of them that lie on harmless objects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct FalseAlarms {
    pub n: usize,
    pub n_on_harmless: usize,
}

/// Of how many something is true.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Tally {
    pub n: usize,
    pub of: usize,
}

impl Tally {
    /// `None` of nothing.
    pub fn share(self) -> Option<f64> {
        (self.of > 0).then(|| self.n as f64 / self.of as f64)
    }

    fn add(&mut self, is_true: bool, times: u32) {
        self.of += times as usize;
        self.n += if is_true { times as usize } else { 0 };
    }
}

impl<'a> AlarmFacts<'a> {
    /// `None` if a sample does not say where the ego was, or if the ego did not move.
    pub fn gather(matching: &'a Matching<'a>, tracks: Option<&Tracks>) -> Option<Self> {
        let (episode_of, n_episodes) = number_episodes(&matching.samples);
        let (mut driven_km, mut driven_h) = (vec![0.0; n_episodes], 0.0);
        for pair in tracks::episodes(&matching.samples)?.iter().flat_map(|episode| episode.windows(2)) {
            let [before, after] = [0, 1].map(|i| matching.samples[pair[i]].facts);
            let ([x0, y0], [x1, y1]) = (before.position_in_world_m?, after.position_in_world_m?);
            driven_km[episode_of[pair[0]]] += (x1 - x0).hypot(y1 - y0) / 1000.0;
            driven_h += before.time_s.zip(after.time_s).map_or(0.0, |(start, end)| end - start) / 3600.0;
        }
        if driven_km.iter().sum::<f64>() <= 0.0 {
            return None;
        }
        let mut found_to = vec![f64::NEG_INFINITY; matching.objects.len()];
        let mut alarms = Vec::new();
        let mut unhit_found_to = Unhit::new(&matching.samples);
        for (ranked, outcome) in matching.ranked_from(Harm::Harmful, f64::NEG_INFINITY) {
            let lies_on = match outcome {
                Outcome::Matched(object) => {
                    found_to[object as usize] = ranked.score;
                    LiesOn::Harm
                }
                // Whatever else it lies on.
                _ if unhit_found_to.take(matching, ranked) => LiesOn::Harm,
                Outcome::Misclassified(_) => LiesOn::Harmless,
                Outcome::Unmatched => LiesOn::Nothing,
                Outcome::Neutral(_) => continue,
            };
            alarms.push(Alarm { score: ranked.score, episode: episode_of[ranked.sample_idx], lies_on });
        }
        let origin_of = |number: usize| {
            let truth = &matching.objects[number].object.truth;
            Origin { distribution: truth.distribution, category: truth.category.as_deref() }
        };
        let harmful = matching.objects.iter().filter(|of| of.object.harm == Harm::Harmful);
        let objects = harmful.map(|of| HarmfulObject {
            episode: episode_of[of.sample_idx],
            origin: origin_of(of.number),
            found_to: found_to[of.number],
        });
        let event = |event: HarmRun<'_>| {
            let first = event.sights[0];
            let n_samples = event.sights[event.sights.len() - 1].place - first.place + 1;
            let mut of_sample = vec![f64::NEG_INFINITY; n_samples];
            for sight in event.sights {
                of_sample[sight.place - first.place] = found_to[sight.number];
            }
            for unseen in &event.unseen {
                if let Some(i) = unseen.unhit_idx {
                    of_sample[unseen.place - first.place] = unhit_found_to.of_sample[unseen.sample_idx][i];
                }
            }
            HarmEvent {
                episode: episode_of[first.sample_idx],
                origin: origin_of(first.number),
                found_to: of_sample,
                can_stop: can_stop(matching, &event, n_samples),
            }
        };
        let events = tracks.map(Tracks::events).unwrap_or_default();
        Some(Self {
            alarms,
            objects: objects.collect(),
            events: events.into_iter().map(event).collect(),
            driven_km,
            driven_h,
            n_episodes,
        })
    }

    /// Kilometres, each episode as often as drawn.
    pub fn driven_km(&self, n_drawn: &[u32]) -> f64 {
        self.driven_km.iter().zip(n_drawn).map(|(km, &times)| km * f64::from(times)).sum()
    }

    /// The lowest score with no more false alarms a kilometre than allowed, `None` if none may count, and these false
    /// alarms. Detections of equal score count all or not at all.
    pub fn find_score(&self, per_km: f64, n_drawn: &[u32]) -> (Option<f64>, FalseAlarms) {
        let allowed = per_km * self.driven_km(n_drawn);
        let (mut lowest, mut all) = (None, FalseAlarms::default());
        for equal in self.alarms.chunk_by(|a, b| a.score == b.score) {
            let mut with = all;
            for alarm in equal {
                let times = n_drawn[alarm.episode] as usize;
                with.n += if alarm.lies_on == LiesOn::Harm { 0 } else { times };
                with.n_on_harmless += if alarm.lies_on == LiesOn::Harmless { times } else { 0 };
            }
            if with.n as f64 > allowed {
                break;
            }
            (lowest, all) = (Some(equal[0].score), with);
        }
        (lowest, all)
    }

    /// Harmful truths that are not found at a score.
    pub fn count_missed(&self, score: f64, n_drawn: &[u32], counts: impl Fn(&Origin<'a>) -> bool) -> Tally {
        let mut tally = Tally::default();
        for object in self.objects.iter().filter(|object| counts(&object.origin)) {
            tally.add(object.found_to < score, n_drawn[object.episode]);
        }
        tally
    }

    /// Events that are found in none of their samples at a score.
    pub fn count_missed_events(
        &self,
        score: f64,
        n_drawn: &[u32],
        counts: impl Fn(&Origin<'a>) -> bool,
    ) -> Tally {
        let mut tally = Tally::default();
        for event in self.events.iter().filter(|event| counts(&event.origin)) {
            tally.add(event.found_to.iter().all(|&found_to| found_to < score), n_drawn[event.episode]);
        }
        tally
    }

    /// Events that are warned of in time at a score, of those in which stopping was possible at their first sample. A
    /// warning is confirmed by `confirm.0` of the last `confirm.1` samples.
    pub fn count_warned(
        &self,
        score: f64,
        n_drawn: &[u32],
        deceleration_idx: usize,
        confirm: (usize, usize),
    ) -> Tally {
        let mut tally = Tally::default();
        for event in &self.events {
            let can_stop = &event.can_stop[deceleration_idx];
            if can_stop[0] == Some(true) {
                let is_in_time =
                    event.confirmed_at(score, confirm).is_some_and(|at| can_stop[at] == Some(true));
                tally.add(is_in_time, n_drawn[event.episode]);
            }
        }
        tally
    }
}

impl HarmEvent<'_> {
    /// The first of its samples at which a warning is confirmed.
    fn confirmed_at(&self, score: f64, (confirm_n, confirm_of): (usize, usize)) -> Option<usize> {
        let recent = |last: usize| -> Range<usize> { (last + 1).saturating_sub(confirm_of)..last + 1 };
        let n_found =
            |samples: Range<usize>| self.found_to[samples].iter().filter(|&&to| to >= score).count();
        (0..self.found_to.len()).find(|&last| n_found(recent(last)) >= confirm_n)
    }
}

/// Scores up to which harmful objects are found that the LiDAR did not hit: they count in no recall, but an alarm on one is not
/// false, and where their event goes on it has been warned of.
struct Unhit {
    /// `[sample][object]`, minus infinity where it is found by none.
    of_sample: Vec<Vec<f64>>,
}

impl Unhit {
    fn new(samples: &[KeptSample<'_>]) -> Self {
        Self { of_sample: samples.iter().map(|sample| vec![f64::NEG_INFINITY; sample.unhit.len()]).collect() }
    }

    /// Gives a harmful detection the nearest harmful one within the threshold of the errors that none has taken; false if there is none.
    fn take(&mut self, matching: &Matching<'_>, ranked: &Ranked<'_>) -> bool {
        let found_to = &mut self.of_sample[ranked.sample_idx];
        let objects = matching.samples[ranked.sample_idx].unhit.iter().enumerate();
        let free = objects.filter(|(i, of)| of.harm == Harm::Harmful && found_to[*i] == f64::NEG_INFINITY);
        let nearest = free
            .map(|(i, of)| (i, center_distance_m(&ranked.detection.box_in_ego, &of.truth.box_in_ego)))
            .filter(|&(_, distance_m)| distance_m < matching.config().tp_threshold_m)
            .min_by(|a, b| a.1.total_cmp(&b.1));
        nearest.inspect(|&(i, _)| found_to[i] = ranked.score).is_some()
    }
}

/// `[deceleration][sample]`: whether the ego can stop before the object after the time of a reaction.
fn can_stop(matching: &Matching<'_>, event: &HarmRun<'_>, n_samples: usize) -> Vec<Vec<Option<bool>>> {
    let config = &matching.config().safety;
    let at = |sample_idx: usize, object: &LabelledObject, deceleration_mps2: f64| -> Option<bool> {
        let facts = matching.samples[sample_idx].facts;
        let stopping_m = config.stopping_distance_m(facts.speed_mps?, deceleration_mps2);
        Some(facts.gap_ahead_m(&object.truth.solid_in_ego())? >= stopping_m)
    };
    let first = event.sights[0].place;
    let of_deceleration = |&deceleration: &f64| {
        let mut of_sample = vec![None; n_samples];
        for sight in event.sights {
            let object = matching.objects[sight.number].object;
            of_sample[sight.place - first] = at(sight.sample_idx, object, deceleration);
        }
        for (unseen, i) in event.unseen.iter().filter_map(|of| Some((of, of.unhit_idx?))) {
            let object = matching.samples[unseen.sample_idx].unhit[i];
            of_sample[unseen.place - first] = at(unseen.sample_idx, object, deceleration);
        }
        of_sample
    };
    config.decelerations_mps2.iter().map(of_deceleration).collect()
}
