//! The figures of drives: collisions, what of `blind`'s was avoided, false stops, progress, comfort; with intervals by episode.
//!
//! Drivers are compared on the episodes that all of them finished, world by world.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::drive_outcome::{Collision, DriveOutcome, End};
use super::groups::{GroupFigures, groups};
use super::measure::{Draws, Measure, Of, Ratio, yes};
use super::who::{Source, Who};

/// Bounds between the bands of impact speed, m/s.
pub(super) const IMPACT_BANDS_MPS: [f64; 3] = [2.0, 5.0, 10.0];

/// Who has come within this of where `blind` hits something has come there, metres along the route.
const REACH_M: f64 = 10.0;

/// The figures of one driver.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    pub who: Who,
    /// Episodes that all drivers finished.
    pub n_episodes: usize,
    /// Episodes of this driver that failed; they count for nobody.
    pub n_failed: usize,
    pub driven_km: f64,
    pub n_collisions: usize,
    /// By impact speed: below 2, 5 and 10 m/s, and above.
    pub n_by_impact: [usize; 4],
    /// Share of the episodes that ended in a collision.
    pub collision_share: Measure,
    pub collisions_per_km: Measure,
    /// Of the episodes in which `blind` collides and `truth` does not, those in which this driver does not either; `None` unless
    /// both drove.
    pub avoided_share: Option<Measure>,
    /// How many episodes that are.
    pub n_avoidable: Option<usize>,
    /// Of them those in which this driver does not end stuck either: who stands for ever meets nothing.
    #[serde(default)]
    pub avoided_going_share: Option<Measure>,
    /// Of the avoidable ones in which this driver came to the place where `blind` collides, or collided itself: who stops before
    /// has not shown what it would do there.
    #[serde(default)]
    pub avoided_there_share: Option<Measure>,
    /// How many these are.
    #[serde(default)]
    pub n_came_there: Option<usize>,
    /// Of all episodes in which `blind` collides.
    pub avoided_of_all_share: Option<Measure>,
    /// How many these are.
    #[serde(default)]
    pub n_blind_hits: Option<usize>,
    /// Of those in which it does not collide with something sudden ([`super::is_sudden`]).
    pub avoided_of_not_sudden_share: Option<Measure>,
    /// How many these are.
    pub n_not_sudden: Option<usize>,
    pub false_stops_per_km: Measure,
    /// Brakes above 1 m/s² with nothing truly harmful, the false stops too; `None` in what older rules wrote.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vain_brakes_per_km: Option<Measure>,
    /// Drives that ended standing before nothing.
    #[serde(default)]
    pub stuck_per_km: Measure,
    /// Against the first driver with a detector; `None` for that one, `blind` and `truth`.
    #[serde(default)]
    pub over_first: Option<OverFirst>,
    /// Distance over that of a free car in the same time; a drive that ended stuck counts with all of its time.
    pub progress: Measure,
    /// Mean of the time to collision at the first brake, seconds.
    pub first_brake_ttc_s: Measure,
    /// Mean of the drives' root mean squares.
    pub rms_jerk_mps3: Measure,
    /// Shares of the episodes that ended standing before something harmful, and before nothing.
    pub stopped_share: f64,
    pub stuck_share: f64,
    pub n_struck: usize,
    /// Mean energy of the collisions, joules.
    pub mean_energy_j: Option<f64>,
    /// The same with its interval; `None` in what older rules wrote.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub energy_j: Option<Measure>,
    /// By what, where and in what weather.
    pub groups: BTreeMap<String, Vec<GroupFigures>>,
}

/// How much more a driver does than another one in the same worlds; the intervals are of the differences within the same resamples.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OverFirst {
    /// The other one's name.
    pub than: String,
    pub collision_share: Measure,
    pub avoided_share: Option<Measure>,
    pub false_stops_per_km: Measure,
    #[serde(default)]
    pub stuck_per_km: Measure,
    /// Mean energy of the collisions, joules; each driver's own collisions, which are not of the same worlds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub energy_j: Option<Measure>,
}

/// Compares drivers on the episodes that none of them failed in.
#[must_use]
pub fn compare(drives: &[(Who, Vec<DriveOutcome>)]) -> Vec<Figures> {
    let finished = |outcomes: &[DriveOutcome]| -> BTreeSet<String> {
        outcomes
            .iter()
            .filter(|outcome| !outcome.is_failed())
            .map(|outcome| outcome.episode.clone())
            .collect()
    };
    let common =
        drives.iter().map(|(_, outcomes)| finished(outcomes)).reduce(|a, b| &a & &b).unwrap_or_default();
    let in_common = |outcomes: &[DriveOutcome]| -> Vec<DriveOutcome> {
        outcomes.iter().filter(|outcome| common.contains(&outcome.episode)).cloned().collect()
    };
    let of_source = |source: &Source| {
        let found = drives.iter().find(|(who, _)| who.source == *source);
        found.map(|(_, outcomes)| in_common(outcomes))
    };
    let (blind, truth) = (of_source(&Source::Blind), of_source(&Source::Truth));
    let beside = |outcomes| Beside { outcomes, blind: blind.as_deref(), truth: truth.as_deref() };
    let all: Vec<Vec<DriveOutcome>> = drives.iter().map(|(_, outcomes)| in_common(outcomes)).collect();
    let is_tested = |who: &Who| !matches!(who.source, Source::Blind | Source::Truth);
    let first = drives.iter().position(|(who, _)| is_tested(who));
    let rows = drives.iter().enumerate().map(|(i, (who, outcomes))| {
        let n_failed = outcomes.iter().filter(|outcome| outcome.is_failed()).count();
        let first = first.filter(|&first| i != first && is_tested(who));
        let first = first.map(|first| (&drives[first].0, beside(&all[first])));
        figures(who, beside(&all[i]), n_failed, first)
    });
    rows.collect()
}

/// A driver's drives beside those of others, world by world.
#[derive(Clone, Copy)]
struct Beside<'a> {
    outcomes: &'a [DriveOutcome],
    blind: Option<&'a [DriveOutcome]>,
    truth: Option<&'a [DriveOutcome]>,
}

impl Beside<'_> {
    fn hits(self, i: usize) -> bool {
        collides(self.outcomes, i)
    }

    fn blind_hits(self, i: usize) -> bool {
        self.blind.is_some_and(|blind| collides(blind, i))
    }

    /// Whether `blind` hits something that `truth` does not.
    fn is_avoidable(self, i: usize) -> bool {
        self.blind_hits(i) && self.truth.is_some_and(|truth| !collides(truth, i))
    }

    fn is_not_sudden(self, i: usize) -> bool {
        let hit = self.blind.and_then(|blind| blind[i].collision.as_ref());
        hit.is_some_and(|hit| !hit.is_sudden)
    }

    /// Whether it has come to where `blind` hits something: all drive one route.
    fn has_come_there(self, i: usize) -> bool {
        self.hits(i)
            || self.blind.is_some_and(|blind| self.outcomes[i].distance_m + REACH_M >= blind[i].distance_m)
    }

    fn km(self, i: usize) -> f64 {
        self.outcomes[i].distance_m / 1000.0
    }
}

/// Whether something holds of an episode.
type Is<'a> = &'a (dyn Fn(usize) -> bool + Sync);

fn collides(outcomes: &[DriveOutcome], i: usize) -> bool {
    outcomes[i].collision.is_some()
}

fn figures(who: &Who, of: Beside<'_>, n_failed: usize, first: Option<(&Who, Beside<'_>)>) -> Figures {
    let Beside { outcomes, blind, truth } = of;
    let n = outcomes.len();
    let draws = Draws::of(outcomes);
    let rate = |above: Of<'_>| draws.ratio(Ratio::Rate, above, &|i| of.km(i));
    // A share that is 0 or 1 by its definition has no ends beside itself.
    let unless = |is_set: bool| if is_set { Ratio::Mean } else { Ratio::Share };
    let of_blind = unless(who.source == Source::Blind);
    let of_both = unless(matches!(who.source, Source::Blind | Source::Truth));
    let share = |kind: Ratio, above: Is<'_>, below: Is<'_>| {
        draws.ratio(kind, &|i| yes(below(i) && above(i)), &|i| yes(below(i)))
    };
    let avoids = |i: usize| !of.hits(i);
    let is_avoidable = |i: usize| of.is_avoidable(i);
    let is_stuck = |i: usize| outcomes[i].end == End::Stuck;
    let has_both = blind.is_some() && truth.is_some();
    let count = |is: &dyn Fn(usize) -> bool| (0..n).filter(|&i| is(i)).count();
    let came = |i: usize| of.is_avoidable(i) && of.has_come_there(i);
    let collisions: Vec<&Collision> =
        outcomes.iter().filter_map(|outcome| outcome.collision.as_ref()).collect();
    let share_of = |end: &End| outcomes.iter().filter(|o| o.end == *end).count() as f64 / n.max(1) as f64;
    let band =
        |collision: &Collision| IMPACT_BANDS_MPS.iter().filter(|&&b| collision.impact_mps >= b).count();
    let mut n_by_impact = [0; 4];
    collisions.iter().for_each(|collision| n_by_impact[band(collision)] += 1);
    let energy_j: f64 = collisions.iter().map(|collision| collision.energy_j).sum();
    let counted = |i: usize| if truth.is_some() { of.is_avoidable(i) } else { of.blind_hits(i) };
    Figures {
        who: who.clone(),
        n_episodes: n,
        n_failed,
        driven_km: outcomes.iter().map(|outcome| outcome.distance_m / 1000.0).sum(),
        n_collisions: collisions.len(),
        n_by_impact,
        collision_share: share(Ratio::Share, &|i| of.hits(i), &|_| true),
        collisions_per_km: rate(&|i| yes(of.hits(i))),
        avoided_share: has_both.then(|| share(of_both, &avoids, &is_avoidable)),
        avoided_going_share: has_both.then(|| share(of_blind, &|i| avoids(i) && !is_stuck(i), &is_avoidable)),
        n_avoidable: has_both.then(|| count(&is_avoidable)),
        avoided_there_share: has_both.then(|| share(of_both, &avoids, &came)),
        n_came_there: has_both.then(|| count(&came)),
        avoided_of_all_share: blind.map(|_| share(of_blind, &avoids, &|i| of.blind_hits(i))),
        n_blind_hits: blind.map(|_| count(&|i| of.blind_hits(i))),
        avoided_of_not_sudden_share: blind.map(|_| share(of_blind, &avoids, &|i| of.is_not_sudden(i))),
        n_not_sudden: blind.map(|_| count(&|i| of.is_not_sudden(i))),
        false_stops_per_km: rate(&|i| outcomes[i].n_false_stops() as f64),
        vain_brakes_per_km: Some(rate(&|i| outcomes[i].n_vain_brakes() as f64)),
        stuck_per_km: rate(&|i| yes(is_stuck(i))),
        over_first: first.map(|(first, other)| over(first, of, other, &draws)),
        progress: draws.ratio(Ratio::Mean, &|i| outcomes[i].distance_m, &|i| outcomes[i].free_m),
        first_brake_ttc_s: draws.ratio(
            Ratio::Mean,
            &|i| outcomes[i].first_brake_ttc_s.unwrap_or(0.0),
            &|i| yes(outcomes[i].first_brake_ttc_s.is_some()),
        ),
        rms_jerk_mps3: draws.ratio(Ratio::Mean, &|i| outcomes[i].rms_jerk_mps3, &|_| 1.0),
        stopped_share: share_of(&End::Stopped),
        stuck_share: share_of(&End::Stuck),
        n_struck: outcomes.iter().map(|outcome| outcome.struck_by.len()).sum(),
        mean_energy_j: (!collisions.is_empty()).then(|| energy_j / collisions.len() as f64),
        energy_j: Some(draws.ratio(Ratio::Mean, &|i| hit_j(&outcomes[i]), &|i| yes(of.hits(i)))),
        groups: groups(outcomes, blind, &draws, of_both, counted),
    }
}

/// What a driver does more than the first.
fn over(first: &Who, of: Beside<'_>, other: Beside<'_>, draws: &Draws) -> OverFirst {
    let share = |of: Beside<'_>, i: usize| yes(of.is_avoidable(i) && !of.hits(i));
    let has_both = of.blind.is_some() && of.truth.is_some();
    let avoidable = |i: usize| yes(of.is_avoidable(i));
    let per_km = |count: &(dyn Fn(&DriveOutcome) -> f64 + Sync)| {
        let above = |of: Beside<'_>, i: usize| count(&of.outcomes[i]);
        draws.difference(
            Ratio::Rate,
            [&|i| above(of, i), &|i| of.km(i)],
            [&|i| above(other, i), &|i| other.km(i)],
        )
    };
    OverFirst {
        than: first.name.clone(),
        collision_share: draws.difference(
            Ratio::Share,
            [&|i| yes(of.hits(i)), &|_| 1.0],
            [&|i| yes(other.hits(i)), &|_| 1.0],
        ),
        avoided_share: has_both.then(|| {
            draws.difference(
                Ratio::Share,
                [&|i| share(of, i), &avoidable],
                [&|i| share(other, i), &avoidable],
            )
        }),
        false_stops_per_km: per_km(&|outcome| outcome.n_false_stops() as f64),
        stuck_per_km: per_km(&|outcome| yes(outcome.end == End::Stuck)),
        energy_j: Some(draws.difference(
            Ratio::Mean,
            [&|i| hit_j(&of.outcomes[i]), &|i| yes(of.hits(i))],
            [&|i| hit_j(&other.outcomes[i]), &|i| yes(other.hits(i))],
        )),
    }
}

/// Energy of a drive's collision, joules; 0 without one.
fn hit_j(outcome: &DriveOutcome) -> f64 {
    outcome.collision.as_ref().map_or(0.0, |collision| collision.energy_j)
}

#[cfg(test)]
mod tests {
    use super::super::test_data::drives;
    use super::*;

    #[test]
    fn avoided_is_what_blind_hits_and_truth_does_not() {
        let (a, b) = (Some(8.0), Some(1.0));
        let rows = compare(&[
            drives("blind", [a, a, a, None]),
            drives("truth", [None, None, a, None]),
            drives("small", [None, b, None, b]),
        ]);
        let small = &rows[2];
        assert_eq!((small.n_avoidable, small.avoided_share.unwrap().value), (Some(2), Some(0.5)));
        assert_eq!(small.avoided_of_all_share.unwrap().value, Some(2.0 / 3.0));
        assert_eq!(small.n_by_impact, [2, 0, 0, 0]);
        assert_eq!(small.collisions_per_km.value, Some(5.0));
        assert_eq!(small.progress.value, Some(0.5));
        let [blind, truth] = [0, 1].map(|i: usize| rows[i].avoided_share.unwrap());
        assert_eq!((blind.value, blind.interval), (Some(0.0), Some([0.0, 0.0])));
        assert_eq!((truth.value, truth.interval), (Some(1.0), Some([1.0, 1.0])));
        // Of all three that blind hits, truth avoids two.
        assert_eq!(
            (rows[1].n_blind_hits, rows[1].avoided_of_all_share.unwrap().value),
            (Some(3), Some(2.0 / 3.0))
        );
        assert_eq!(small.avoided_going_share, small.avoided_share);
        assert_eq!(small.stuck_per_km.value, Some(0.0));
        let by_hit = &small.groups["hit by blind"];
        assert_eq!(
            by_hit.iter().map(|group| group.name.as_str()).collect::<Vec<_>>(),
            ["hay_bale", "nothing"]
        );
    }

    #[test]
    fn who_stands_for_ever_avoids_all_but_not_going() {
        let hit = Some(8.0);
        let (who, mut outcomes) = drives("small", [None; 4]);
        outcomes[0].end = End::Stuck;
        let rows =
            compare(&[drives("blind", [hit, hit, None, None]), drives("truth", [None; 4]), (who, outcomes)]);
        let small = &rows[2];
        assert_eq!(small.avoided_share.unwrap().value, Some(1.0));
        assert_eq!(small.avoided_going_share.unwrap().value, Some(0.5));
        assert!((small.stuck_per_km.value.unwrap() * small.driven_km - 1.0).abs() < 1e-9);
    }

    #[test]
    fn who_stops_on_the_way_has_not_come_there() {
        let hit = Some(8.0);
        let (who, mut outcomes) = drives("small", [None; 4]);
        // Blind comes 100 m far.
        outcomes[0].distance_m = 60.0;
        outcomes[1].distance_m = 91.0;
        let rows =
            compare(&[drives("blind", [hit, hit, None, None]), drives("truth", [None; 4]), (who, outcomes)]);
        let small = &rows[2];
        assert_eq!((small.n_avoidable, small.n_came_there), (Some(2), Some(1)));
        assert_eq!(small.avoided_there_share.unwrap().value, Some(1.0));
    }

    #[test]
    fn detectors_are_set_beside_the_first_in_the_same_worlds() {
        let (a, b) = (Some(8.0), Some(1.0));
        let rows = compare(&[
            drives("blind", [a; 4]),
            drives("truth", [None; 4]),
            drives("small", [b, b, None, None]),
            drives("zone:small", [b, None, None, None]),
        ]);
        assert!(rows[..3].iter().all(|row| row.over_first.is_none()));
        let over = rows[3].over_first.as_ref().unwrap();
        assert_eq!((over.than.as_str(), over.collision_share.value), ("small", Some(-0.25)));
        assert_eq!((over.false_stops_per_km.value, over.stuck_per_km.value), (Some(0.0), Some(0.0)));
        let avoided = over.avoided_share.unwrap();
        // One world of four differs, so that no resample says the opposite.
        assert_eq!(avoided.value, Some(0.25));
        assert_eq!(avoided.interval.unwrap()[0], 0.0);
    }

    #[test]
    fn an_episode_that_one_driver_failed_in_counts_for_nobody() {
        let (who, mut failed) = drives("exec:cat", [None; 4]);
        failed[1].end = End::Failed("it died".into());
        let rows = compare(&[drives("blind", [Some(3.0); 4]), (who, failed)]);
        assert_eq!([rows[0].n_episodes, rows[1].n_episodes], [3, 3]);
        assert_eq!([rows[0].n_failed, rows[1].n_failed], [0, 1]);
        assert_eq!(rows[0].n_collisions, 3);
    }
}
