//! Harm that is missed at a bearable number of false alarms, and whether the warning leaves room to stop.
//!
//! A false alarm is a harmful detection that takes no harmful truth at the threshold of the errors and is not neutral,
//! counted anew in each sample; kilometres are those that the ego drove between samples. An operating point is the
//! lowest score at which the false alarms per kilometre do not exceed the given number. An event is warned in
//! time where the distance from the bumper to the object, at the first sample at which `confirm_n` of the
//! last `confirm_of` samples of the event found it harmful, is at least `v * reaction_time_s + v^2 / (2
//! deceleration)`, v the ego's speed there. Intervals are of the same resamples as those of the APs, each with an
//! operating score of its own; those in which the ego does not move are left out.

use serde::{Deserialize, Serialize};

use super::alarm_facts::{AlarmFacts, Tally};
use super::missed_groups::{self, MissedGroup};
use super::{Context, MetricTable, MetricValue, Tracks};
use crate::eval::EvalConfig;
use crate::eval::bootstrap::{Resamples, interval};
use crate::eval::matching::Matching;

/// Missed harm at each of the config's false alarms a kilometre.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Alarms {
    /// Distance that the ego drove between samples.
    pub driven_km: f64,
    /// Hours between the first and the last sample of each episode; 0 if times are unknown.
    pub driven_h: f64,
    pub points: Vec<OperatingPoint>,
    /// Harm in and out of distribution, then each family out of distribution; empty where no harmful truth says which it is.
    #[serde(default)]
    pub groups: Vec<MissedGroup>,
}

/// What happens at one score.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OperatingPoint {
    /// What was asked for.
    pub max_false_alarms_per_km: f64,
    /// Detections of this score or more count; `None` if none may.
    pub score: Option<f64>,
    pub n_false_alarms: usize,
    /// Of these, how many lie on a harmless object.
    #[serde(default)]
    pub n_false_on_harmless: usize,
    pub false_alarms_per_km: f64,
    pub false_alarms_per_h: Option<f64>,
    pub n_harmful: usize,
    /// Harmful truths that are not found harmful, over all.
    pub missed_per_sample: Option<f64>,
    pub missed_per_sample_interval: Option<[f64; 2]>,
    pub n_events: usize,
    /// Events that are found in no sample, over all; needs ids.
    pub missed_per_event: Option<f64>,
    pub missed_per_event_interval: Option<[f64; 2]>,
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
    pub in_time_interval: Option<[f64; 2]>,
}

/// `None` if a sample does not say where the ego was, or if the ego did not move.
pub(super) fn measure(of: &Context<'_>) -> Option<Alarms> {
    let facts = AlarmFacts::gather(of.matching, of.tracks.as_ref())?;
    let once = vec![1; facts.n_episodes];
    let asked = &of.matching.config().safety.false_alarms_per_km;
    let points: Vec<OperatingPoint> = asked.iter().map(|&per_km| measure_point(of, &facts, per_km)).collect();
    let scores: Vec<f64> = points.iter().map(|point| point.score.unwrap_or(f64::INFINITY)).collect();
    let groups = missed_groups::measure(&facts, asked, &scores, Resamples::of(of.matching).as_ref());
    Some(Alarms { driven_km: facts.driven_km(&once), driven_h: facts.driven_h, points, groups })
}

/// Shares of the harmful events, at each of the config's false alarms a kilometre: that are missed, then that are warned of in
/// time at each of its decelerations.
pub(in crate::eval) struct EventShares {
    pub n_events: usize,
    /// Events in which stopping was possible at first, for each deceleration.
    pub n_stoppable: Vec<usize>,
    /// `[false alarms][missed, warned ..]`.
    pub whole: Vec<Vec<Option<f64>>>,
    /// In each resample, at the score that keeps to so many false alarms there.
    pub resampled: Vec<Vec<Vec<Option<f64>>>>,
}

/// `None` as of [`measure`].
pub(in crate::eval) fn event_shares(matching: &Matching<'_>, resamples: &Resamples) -> Option<EventShares> {
    let facts = AlarmFacts::gather(matching, Tracks::of_samples(&matching.samples).as_ref())?;
    let config = &matching.config().safety;
    let n_decelerations = config.decelerations_mps2.len();
    let confirm = (config.confirm_n, config.confirm_of);
    let warned = |score: f64, n_drawn: &[u32], i: usize| facts.count_warned(score, n_drawn, i, confirm);
    let at = |n_drawn: &[u32], per_km: f64| -> Vec<Option<f64>> {
        if facts.driven_km(n_drawn) <= 0.0 {
            return vec![None; 1 + n_decelerations];
        }
        let score = facts.find_score(per_km, n_drawn).0.unwrap_or(f64::INFINITY);
        let missed = facts.count_missed_events(score, n_drawn, |_| true);
        let warned = (0..n_decelerations).map(|i| warned(score, n_drawn, i));
        [missed].into_iter().chain(warned).map(Tally::share).collect()
    };
    let shares = |n_drawn: &[u32]| -> Vec<Vec<Option<f64>>> {
        config.false_alarms_per_km.iter().map(|&per_km| at(n_drawn, per_km)).collect()
    };
    let once = vec![1; facts.n_episodes];
    Some(EventShares {
        n_events: facts.events.len(),
        n_stoppable: (0..n_decelerations).map(|i| warned(f64::INFINITY, &once, i).of).collect(),
        whole: shares(&once),
        resampled: resamples.map(shares),
    })
}

fn measure_point(of: &Context<'_>, facts: &AlarmFacts<'_>, max_false_alarms_per_km: f64) -> OperatingPoint {
    let config = &of.matching.config().safety;
    let n_decelerations = config.decelerations_mps2.len();
    let once = vec![1; facts.n_episodes];
    let tally = |n_drawn: &[u32]| -> Option<Vec<Tally>> {
        if facts.driven_km(n_drawn) <= 0.0 {
            return None;
        }
        let score = facts.find_score(max_false_alarms_per_km, n_drawn).0.unwrap_or(f64::INFINITY);
        let missed = facts.count_missed(score, n_drawn, |_| true);
        let missed_events = facts.count_missed_events(score, n_drawn, |_| true);
        let confirm = (config.confirm_n, config.confirm_of);
        let warned = (0..n_decelerations).map(|i| facts.count_warned(score, n_drawn, i, confirm));
        Some([missed, missed_events].into_iter().chain(warned).collect())
    };
    let found = tally(&once).expect("the ego moved");
    let resampled = Resamples::of(of.matching).map(|resamples| resamples.map(tally)).unwrap_or_default();
    let interval_of =
        |i: usize| interval(resampled.iter().flatten().filter_map(|tallies| tallies[i].share()));
    let (score, alarms) = facts.find_score(max_false_alarms_per_km, &once);
    let warned = config.decelerations_mps2.iter().zip(2..).map(|(&deceleration_mps2, i)| Warned {
        deceleration_mps2,
        n_stoppable: found[i].of,
        n_in_time: found[i].n,
        in_time: found[i].share(),
        in_time_interval: interval_of(i),
    });
    OperatingPoint {
        max_false_alarms_per_km,
        score,
        n_false_alarms: alarms.n,
        n_false_on_harmless: alarms.n_on_harmless,
        false_alarms_per_km: alarms.n as f64 / facts.driven_km(&once),
        false_alarms_per_h: (facts.driven_h > 0.0).then(|| alarms.n as f64 / facts.driven_h),
        n_harmful: found[0].of,
        missed_per_sample: found[0].share(),
        missed_per_sample_interval: interval_of(0),
        n_events: found[1].of,
        missed_per_event: found[1].share(),
        missed_per_event_interval: interval_of(1),
        warned: warned.collect(),
    }
}

pub(super) fn show(alarms: &Option<Alarms>, config: &EvalConfig) -> Option<MetricTable> {
    let (alarms, config) = (alarms.as_ref()?, &config.safety);
    let row = |point: &OperatingPoint| {
        let mut row = vec![
            MetricValue::name(point.max_false_alarms_per_km.to_string()),
            MetricValue::number(point.score, 3),
            MetricValue::number(point.false_alarms_per_km, 1),
            MetricValue::Share {
                value: (point.n_false_alarms > 0)
                    .then(|| point.n_false_on_harmless as f64 / point.n_false_alarms as f64),
                of: Some(point.n_false_alarms),
                interval: None,
            },
            MetricValue::Share {
                value: point.missed_per_event,
                of: Some(point.n_events),
                interval: point.missed_per_event_interval,
            },
            MetricValue::Share {
                value: point.missed_per_sample,
                of: Some(point.n_harmful),
                interval: point.missed_per_sample_interval,
            },
        ];
        row.extend(point.warned.iter().map(|warned| MetricValue::Share {
            value: warned.in_time,
            of: Some(warned.n_stoppable),
            interval: warned.in_time_interval,
        }));
        row
    };
    let note = format!(
        "{:.2} km driven. An event is a run of samples in which one object is harmful. A warning is confirmed by {} of {} \
         samples, and in time if the car, after {} s, can still stop before the object.",
        alarms.driven_km, config.confirm_n, config.confirm_of, config.reaction_time_s
    );
    let head = [
        "false alarms/km, at most",
        "score",
        "false alarms/km",
        "of these on harmless objects",
        "missed, of events",
        "missed, of objects",
    ];
    let mut table = MetricTable::new(&head, alarms.points.iter().map(row).collect(), note)?;
    let decelerations = config.decelerations_mps2.iter();
    table.head.extend(decelerations.map(|deceleration| format!("warned in time, {deceleration} m/s²")));
    Some(table)
}

/// The table of the groups.
pub(super) fn show_groups(alarms: &Option<Alarms>, _: &EvalConfig) -> Option<MetricTable> {
    let alarms = alarms.as_ref()?;
    let per_km: Vec<f64> = alarms.points.iter().map(|point| point.max_false_alarms_per_km).collect();
    missed_groups::show(&alarms.groups, &per_km)
}

#[cfg(test)]
mod tests {
    use super::super::tracks::tests::episode;
    use crate::eval::matching::tests::{found, truth};
    use crate::eval::{EvalConfig, EvalSample, Mode, Protocol, SafetyConfig, evaluate};
    use crate::object::{Distribution, Harm};

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
    fn an_alarm_on_a_harmful_object_without_a_point_is_not_false_and_finds_its_event() {
        // One object, without a point at the second sample of three, and found there alone.
        let mut samples = episode("a", "hhh");
        samples[1].objects[0].truth.n_lidar_points = Some(0);
        samples[1].detections = vec![found(15.0, Harm::Harmful, 0.5), found(15.5, Harm::Harmful, 0.4)];
        let point = &alarms(&samples, per_km(1000.0)).points[0];
        assert_eq!((point.n_harmful, point.missed_per_sample), (2, Some(1.0)), "it is no part of the recall");
        assert_eq!((point.n_events, point.missed_per_event), (1, Some(0.0)));
        // The second box on it is false.
        assert_eq!((point.score, point.n_false_alarms), (Some(0.4), 1));
        // Alone it costs nothing, so it counts where none may be false, and where something harmless stands by its side.
        for stands_beside in [false, true] {
            let mut samples = samples.clone();
            samples[1].detections.truncate(1);
            if stands_beside {
                samples[1].objects.push(truth(16.0, Harm::Harmless, Distribution::Id));
            }
            let point = &alarms(&samples, per_km(0.1)).points[0];
            assert_eq!((point.score, point.n_false_alarms), (Some(0.5), 0));
            assert_eq!(point.missed_per_event, Some(0.0));
        }
        // An alarm on a harmless one is false, as anywhere.
        samples[1].objects[0].harm = Harm::Harmless;
        assert_eq!(alarms(&samples, per_km(1000.0)).points[0].n_false_alarms, 2);
        // Two of three samples confirm it, the one without a point among them.
        samples[1].objects[0].harm = Harm::Harmful;
        samples[0].detections = vec![found(20.0, Harm::Harmful, 0.5)];
        let config = SafetyConfig { reaction_time_s: 0.0, ..per_km(1000.0) };
        let warned = &alarms(&samples, config).points[0].warned[1];
        assert_eq!((warned.n_stoppable, warned.n_in_time), (1, 1));
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
