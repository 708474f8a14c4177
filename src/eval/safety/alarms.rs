//! Harm that is missed at a bearable number of false alarms, and whether the warning leaves room to stop.
//!
//! A false alarm is a harmful detection that takes no harmful truth at the threshold of the errors and is not neutral,
//! counted anew in each sample; kilometres are those that the ego drove between samples. An operating point is the
//! lowest score at which the false alarms per kilometre do not exceed the given number. An event is warned in
//! time where the distance from the bumper to the object, at the first sample at which `confirm_n` of the
//! last `confirm_of` samples of the event found it harmful, is at least `v * reaction_time_s + v^2 / (2
//! deceleration)`, v the ego's speed there.

use serde::{Deserialize, Serialize};

use super::tracks::{self, Sight, Tracks};
use super::{Context, MetricTable, MetricValue};
use crate::eval::EvalConfig;
use crate::eval::matching::{Matching, Outcome};
use crate::object::Harm;

/// Missed harm at each of the config's false alarms a kilometre.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Alarms {
    /// Distance that the ego drove between samples.
    pub driven_km: f64,
    /// Hours between the first and the last sample of each episode; 0 if times are unknown.
    pub driven_h: f64,
    pub points: Vec<OperatingPoint>,
}

/// What happens at one score.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OperatingPoint {
    /// What was asked for.
    pub max_false_alarms_per_km: f64,
    /// Detections of this score or more count; `None` if none may.
    pub score: Option<f64>,
    pub n_false_alarms: usize,
    pub false_alarms_per_km: f64,
    pub false_alarms_per_h: Option<f64>,
    pub n_harmful: usize,
    /// Harmful truths that are not found harmful, over all.
    pub missed_per_sample: Option<f64>,
    pub n_events: usize,
    /// Events that are found in no sample, over all; needs ids.
    pub missed_per_event: Option<f64>,
    /// One for each of the config's decelerations; needs ids, speeds and the bumper.
    pub warned: Vec<Warned>,
}

/// Warnings against the stopping distance at one deceleration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Warned {
    pub deceleration_mps2: f64,
    /// Events in which stopping was possible at all at the first sample.
    pub n_stoppable: usize,
    /// Of these, the ones that were warned of in time.
    pub n_in_time: usize,
    pub in_time: Option<f64>,
}

/// `None` if a sample does not say where the ego was, or if the ego did not move.
pub(super) fn measure(of: &Context<'_>) -> Option<Alarms> {
    let matching = of.matching;
    let (driven_km, driven_h) = sum_driven(matching)?;
    if driven_km <= 0.0 {
        return None;
    }
    let n_harmful = matching.objects.iter().filter(|of| of.object.harm == Harm::Harmful).count();
    let events = of.tracks.as_ref().map(Tracks::events).unwrap_or_default();
    let measure_point = |&max_false_alarms_per_km: &f64| {
        let (score, n_false_alarms) = find_score(matching, max_false_alarms_per_km * driven_km);
        let is_found = matching.meet(Harm::Harmful, score.unwrap_or(f64::INFINITY)).is_matched;
        let share = |n: usize, of: usize| (of > 0).then(|| n as f64 / of as f64);
        let n_found = is_found.iter().filter(|&&found| found).count();
        let is_missed = |event: &&&[Sight]| !event.iter().any(|sight| is_found[sight.number]);
        OperatingPoint {
            max_false_alarms_per_km,
            score,
            n_false_alarms,
            false_alarms_per_km: n_false_alarms as f64 / driven_km,
            false_alarms_per_h: (driven_h > 0.0).then(|| n_false_alarms as f64 / driven_h),
            n_harmful,
            missed_per_sample: share(n_harmful - n_found, n_harmful),
            n_events: events.len(),
            missed_per_event: share(events.iter().filter(is_missed).count(), events.len()),
            warned: count_warned(matching, &events, &is_found),
        }
    };
    let points = matching.config().safety.false_alarms_per_km.iter().map(measure_point).collect();
    Some(Alarms { driven_km, driven_h, points })
}

pub(super) fn show(alarms: &Option<Alarms>, config: &EvalConfig) -> Option<MetricTable> {
    let (alarms, config) = (alarms.as_ref()?, &config.safety);
    let row = |point: &OperatingPoint| {
        let mut row = vec![
            MetricValue::name(point.max_false_alarms_per_km.to_string()),
            MetricValue::number(point.score, 3),
            MetricValue::number(point.false_alarms_per_km, 1),
            MetricValue::share(point.missed_per_sample, point.n_harmful),
            MetricValue::share(point.missed_per_event, point.n_events),
        ];
        row.extend(point.warned.iter().map(|warned| MetricValue::share(warned.in_time, warned.n_stoppable)));
        row
    };
    let note = format!(
        "{:.2} km driven. An event is a run of samples in which one object is harmful. A warning is confirmed by {} of {} \
         samples, and in time if the car, after {} s, can still stop before the object.",
        alarms.driven_km, config.confirm_n, config.confirm_of, config.reaction_time_s
    );
    let head =
        ["false alarms/km, at most", "score", "false alarms/km", "missed, of objects", "missed, of events"];
    let mut table = MetricTable::new(&head, alarms.points.iter().map(row).collect(), note)?;
    let decelerations = config.decelerations_mps2.iter();
    table.head.extend(decelerations.map(|deceleration| format!("warned in time, {deceleration} m/s²")));
    Some(table)
}

/// Kilometres and hours of all episodes.
fn sum_driven(matching: &Matching<'_>) -> Option<(f64, f64)> {
    let (mut driven_m, mut driven_s) = (0.0, 0.0);
    for pair in tracks::episodes(&matching.samples)?.iter().flat_map(|episode| episode.windows(2)) {
        let [before, after] = [0, 1].map(|i| matching.samples[pair[i]].facts);
        let ([x0, y0], [x1, y1]) = (before.position_in_world_m?, after.position_in_world_m?);
        driven_m += (x1 - x0).hypot(y1 - y0);
        driven_s += before.time_s.zip(after.time_s).map_or(0.0, |(start, end)| end - start);
    }
    Some((driven_m / 1000.0, driven_s / 3600.0))
}

/// The lowest score with no more false alarms than allowed, and their number. Detections of equal score count
/// all or not at all.
fn find_score(matching: &Matching<'_>, allowed: f64) -> (Option<f64>, usize) {
    let alarms: Vec<(f64, bool)> = matching
        .ranked_from(Harm::Harmful, f64::NEG_INFINITY)
        .filter(|(_, outcome)| !matches!(outcome, Outcome::Neutral(_)))
        .map(|(ranked, outcome)| (ranked.score, !matches!(outcome, Outcome::Matched(_))))
        .collect();
    let (mut lowest, mut n_false) = (None, 0);
    for equal in alarms.chunk_by(|a, b| a.0 == b.0) {
        let n_more = equal.iter().filter(|&&(_, is_false)| is_false).count();
        if (n_false + n_more) as f64 > allowed {
            break;
        }
        n_false += n_more;
        lowest = Some(equal[0].0);
    }
    (lowest, n_false)
}

fn count_warned(matching: &Matching<'_>, events: &[&[Sight]], is_found: &[bool]) -> Vec<Warned> {
    let config = &matching.config().safety;
    let can_stop = |sight: &Sight, deceleration_mps2: f64| -> Option<bool> {
        let placed = &matching.objects[sight.number];
        let facts = matching.facts_of(placed);
        let stopping_m = config.stopping_distance_m(facts.speed_mps?, deceleration_mps2);
        Some(facts.gap_ahead_m(&placed.object.truth.solid_in_ego())? >= stopping_m)
    };
    let find_confirmed = |event: &[Sight]| -> Option<Sight> {
        let at = (0..event.len()).find(|&last| {
            let recent = &event[(last + 1).saturating_sub(config.confirm_of)..=last];
            recent.iter().filter(|sight| is_found[sight.number]).count() >= config.confirm_n
        });
        at.map(|at| event[at])
    };
    let of_deceleration = |&deceleration_mps2: &f64| {
        let is_stoppable = |event: &&&[Sight]| can_stop(&event[0], deceleration_mps2) == Some(true);
        let stoppable: Vec<&&[Sight]> = events.iter().filter(is_stoppable).collect();
        let is_in_time = |event: &&&&[Sight]| {
            find_confirmed(event).is_some_and(|sight| can_stop(&sight, deceleration_mps2) == Some(true))
        };
        let (n_stoppable, n_in_time) = (stoppable.len(), stoppable.iter().filter(is_in_time).count());
        let in_time = (n_stoppable > 0).then(|| n_in_time as f64 / n_stoppable as f64);
        Warned { deceleration_mps2, n_stoppable, n_in_time, in_time }
    };
    config.decelerations_mps2.iter().map(of_deceleration).collect()
}

#[cfg(test)]
mod tests {
    use super::super::tracks::tests::episode;
    use crate::eval::matching::tests::found;
    use crate::eval::{EvalConfig, EvalSample, Mode, Protocol, SafetyConfig, evaluate};
    use crate::object::Harm;

    fn alarms(samples: &[EvalSample], config: SafetyConfig) -> super::Alarms {
        let config = EvalConfig { safety: config, ..EvalConfig::default() };
        let protocol = Protocol::try_from(config).unwrap();
        evaluate(samples, &protocol, Mode::Id).unwrap().safety.alarms.unwrap()
    }

    /// Two episodes of 10 m each; the first one's object is found from its second sample on, and there are false
    /// alarms of 0.9 and 0.3, far off.
    fn samples() -> Vec<EvalSample> {
        let mut samples = episode("a", "hhh");
        samples.extend(episode("b", "hhh"));
        samples[1].detections = vec![found(15.0, Harm::Harmful, 0.5), found(40.0, Harm::Harmful, 0.9)];
        samples[2].detections = vec![found(10.0, Harm::Harmful, 0.4), found(40.0, Harm::Harmful, 0.3)];
        samples
    }

    fn per_km(false_alarms_per_km: f64) -> SafetyConfig {
        SafetyConfig { false_alarms_per_km: vec![false_alarms_per_km], ..SafetyConfig::default() }
    }

    #[test]
    fn the_operating_point_spends_no_more_false_alarms_than_given() {
        // 20 m are driven: 50 a kilometre are one, 100 are two.
        let one = &alarms(&samples(), per_km(50.0)).points[0];
        assert_eq!((one.score, one.n_false_alarms, one.n_harmful, one.n_events), (Some(0.4), 1, 6, 2));
        assert!((one.missed_per_sample.unwrap() - 4.0 / 6.0).abs() < 1e-12);
        assert_eq!(one.missed_per_event, Some(0.5));
        let two = &alarms(&samples(), per_km(100.0)).points[0];
        assert_eq!((two.score, two.n_false_alarms), (Some(0.3), 2));
        let none = &alarms(&samples(), per_km(10.0)).points[0];
        assert_eq!((none.score, none.missed_per_event), (None, Some(1.0)));
    }

    #[test]
    fn a_warning_is_in_time_while_the_gap_exceeds_the_stopping_distance() {
        // At 10 m/s without reaction time: 12.5 m at 4 m/s^2, 6.25 m at 8. The gaps are 15, 10 and 5 m (a box of
        // 4 m centred at 20, 15, 10, the bumper at 3).
        let config = |confirm_n| SafetyConfig { reaction_time_s: 0.0, confirm_n, ..per_km(100.0) };
        let found = |confirm_n| {
            let points = alarms(&samples(), config(confirm_n)).points;
            [0, 1].map(|i| (points[0].warned[i].n_stoppable, points[0].warned[i].n_in_time))
        };
        // Confirmed at once: at 10 m.
        assert_eq!(found(1), [(2, 0), (2, 1)]);
        // Confirmed by two: at 5 m, too late for both.
        assert_eq!(found(2), [(2, 0), (2, 0)]);
    }
}
