//! The figures of drives: collisions, what of `blind`'s was avoided, false stops, progress, comfort; with intervals by episode.
//!
//! Drivers are compared on the episodes that all of them finished, world by world. Intervals are the bootstrap's, by episode, of
//! 1,000 resamples.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::drive_outcome::{Collision, DriveOutcome, End};
use super::who::{Source, Who};
use crate::eval::{interval, resample};

const N_RESAMPLES: usize = 1000;
const BOOTSTRAP_SEED: u64 = 0;
/// Bounds between the bands of impact speed, m/s.
pub(super) const IMPACT_BANDS_MPS: [f64; 3] = [2.0, 5.0, 10.0];

/// A figure and its interval.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Measure {
    /// `None` where there is nothing to divide by.
    pub value: Option<f64>,
    pub interval: Option<[f64; 2]>,
}

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
    /// Of all episodes in which `blind` collides.
    pub avoided_of_all_share: Option<Measure>,
    /// Of those in which it does not collide with something sudden ([`super::is_sudden`]).
    pub avoided_of_not_sudden_share: Option<Measure>,
    /// How many these are.
    pub n_not_sudden: Option<usize>,
    pub false_stops_per_km: Measure,
    /// Drives that ended standing before nothing.
    #[serde(default)]
    pub stuck_per_km: Measure,
    /// Distance over that of a free car in the same time; a drive that ended stuck counts with all of its time.
    pub progress: Measure,
    /// Mean of the time to collision at the first brake, seconds.
    pub first_brake_ttc_s: Measure,
    pub rms_jerk_mps3: Measure,
    /// Shares of the episodes that ended standing before something harmful, and before nothing.
    pub stopped_share: f64,
    pub stuck_share: f64,
    pub n_struck: usize,
    /// Mean energy of the collisions, joules.
    pub mean_energy_j: Option<f64>,
    /// By what, where and in what weather.
    pub groups: BTreeMap<String, Vec<GroupFigures>>,
}

/// One group of episodes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GroupFigures {
    pub name: String,
    pub n_episodes: usize,
    pub n_collisions: usize,
    /// As of [`Figures::avoided_share`], or of `blind`'s collisions where `truth` did not drive.
    pub n_avoidable: usize,
    pub n_avoided: usize,
    pub n_false_stops: usize,
    pub driven_km: f64,
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
    let rows = drives.iter().map(|(who, outcomes)| {
        let n_failed = outcomes.iter().filter(|outcome| outcome.is_failed()).count();
        figures(who, &in_common(outcomes), n_failed, blind.as_deref(), truth.as_deref())
    });
    rows.collect()
}

/// A sum over the episodes that were drawn.
fn sum(outcomes: &[DriveOutcome], n_drawn: &[u32], value: impl Fn(usize, &DriveOutcome) -> f64) -> f64 {
    let terms = outcomes.iter().enumerate().zip(n_drawn);
    terms.map(|((i, outcome), n)| f64::from(*n) * value(i, outcome)).sum()
}

fn figures(
    who: &Who,
    outcomes: &[DriveOutcome],
    n_failed: usize,
    blind: Option<&[DriveOutcome]>,
    truth: Option<&[DriveOutcome]>,
) -> Figures {
    let n = outcomes.len();
    let ratio = |above: &(dyn Fn(usize, &DriveOutcome) -> f64 + Sync),
                 below: &(dyn Fn(usize, &DriveOutcome) -> f64 + Sync)| {
        let of_drawn = |n_drawn: &[u32]| {
            let divisor = sum(outcomes, n_drawn, below);
            (divisor > 0.0).then(|| sum(outcomes, n_drawn, above) / divisor)
        };
        let value = of_drawn(&vec![1; n]);
        let interval = (n > 1)
            .then(|| interval(resample(n, N_RESAMPLES, BOOTSTRAP_SEED, of_drawn).into_iter().flatten()))
            .flatten();
        Measure { value, interval }
    };
    let yes = |is: bool| f64::from(u8::from(is));
    let collides = |outcome: &DriveOutcome| outcome.collision.is_some();
    let km = |_: usize, outcome: &DriveOutcome| outcome.distance_m / 1000.0;
    let hits = |_: usize, outcome: &DriveOutcome| yes(collides(outcome));
    let one = |_: usize, _: &DriveOutcome| 1.0;
    let is_hit_by =
        |others: Option<&[DriveOutcome]>, i: usize| others.is_some_and(|others| collides(&others[i]));
    let is_avoidable = |i: usize| is_hit_by(blind, i) && truth.is_some() && !is_hit_by(truth, i);
    let avoidable = |i: usize, _: &DriveOutcome| yes(is_avoidable(i));
    let avoided = |i: usize, outcome: &DriveOutcome| yes(is_avoidable(i) && !collides(outcome));
    let is_stuck = |outcome: &DriveOutcome| outcome.end == End::Stuck;
    let stuck = |_: usize, outcome: &DriveOutcome| yes(is_stuck(outcome));
    let avoided_going =
        |i: usize, outcome: &DriveOutcome| yes(is_avoidable(i) && !collides(outcome) && !is_stuck(outcome));
    let of_blind = |i: usize, _: &DriveOutcome| yes(is_hit_by(blind, i));
    let avoided_of_all = |i: usize, outcome: &DriveOutcome| yes(is_hit_by(blind, i) && !collides(outcome));
    let is_not_sudden = |i: usize| {
        let hit = blind.and_then(|blind| blind[i].collision.as_ref());
        hit.is_some_and(|hit| !hit.is_sudden)
    };
    let not_sudden = |i: usize, _: &DriveOutcome| yes(is_not_sudden(i));
    let avoided_of_not_sudden =
        |i: usize, outcome: &DriveOutcome| yes(is_not_sudden(i) && !collides(outcome));
    let has_both = blind.is_some() && truth.is_some();
    let collisions: Vec<&Collision> =
        outcomes.iter().filter_map(|outcome| outcome.collision.as_ref()).collect();
    let share = |end: &End| outcomes.iter().filter(|o| o.end == *end).count() as f64 / n.max(1) as f64;
    let band =
        |collision: &Collision| IMPACT_BANDS_MPS.iter().filter(|&&b| collision.impact_mps >= b).count();
    let mut n_by_impact = [0; 4];
    collisions.iter().for_each(|collision| n_by_impact[band(collision)] += 1);
    let energy_j: f64 = collisions.iter().map(|collision| collision.energy_j).sum();
    let counted = |i: usize| if truth.is_some() { is_avoidable(i) } else { is_hit_by(blind, i) };
    Figures {
        who: who.clone(),
        n_episodes: n,
        n_failed,
        driven_km: outcomes.iter().map(|outcome| outcome.distance_m / 1000.0).sum(),
        n_collisions: collisions.len(),
        n_by_impact,
        collision_share: ratio(&hits, &one),
        collisions_per_km: ratio(&hits, &km),
        avoided_share: has_both.then(|| ratio(&avoided, &avoidable)),
        avoided_going_share: has_both.then(|| ratio(&avoided_going, &avoidable)),
        n_avoidable: has_both.then(|| (0..n).filter(|&i| is_avoidable(i)).count()),
        avoided_of_all_share: blind.map(|_| ratio(&avoided_of_all, &of_blind)),
        avoided_of_not_sudden_share: blind.map(|_| ratio(&avoided_of_not_sudden, &not_sudden)),
        n_not_sudden: blind.map(|_| (0..n).filter(|&i| is_not_sudden(i)).count()),
        false_stops_per_km: ratio(&|_, outcome| outcome.n_false_stops() as f64, &km),
        stuck_per_km: ratio(&stuck, &km),
        progress: ratio(&|_, outcome| outcome.distance_m, &|_, outcome| outcome.free_m),
        first_brake_ttc_s: ratio(&|_, o| o.first_brake_ttc_s.unwrap_or(0.0), &|_, o| {
            yes(o.first_brake_ttc_s.is_some())
        }),
        rms_jerk_mps3: ratio(&|_, outcome| outcome.rms_jerk_mps3, &one),
        stopped_share: share(&End::Stopped),
        stuck_share: share(&End::Stuck),
        n_struck: outcomes.iter().map(|outcome| outcome.struck_by.len()).sum(),
        mean_energy_j: (!collisions.is_empty()).then(|| energy_j / collisions.len() as f64),
        groups: groups(outcomes, blind, counted),
    }
}

/// The episodes by town, by weather, and by what `blind` (or, without it, the driver) ran into.
fn groups(
    outcomes: &[DriveOutcome],
    blind: Option<&[DriveOutcome]>,
    is_counted: impl Fn(usize) -> bool,
) -> BTreeMap<String, Vec<GroupFigures>> {
    let hit = |i: usize| blind.unwrap_or(outcomes)[i].collision.as_ref();
    let of_hit =
        |i: usize, name: &dyn Fn(&Collision) -> String| hit(i).map_or_else(|| "nothing".to_owned(), name);
    let distribution = |hit: &Collision| {
        let is_background = if hit.is_background { "background" } else { "scenery" };
        hit.distribution.filter(|_| !hit.is_background).map_or(is_background, |of| of.name()).to_owned()
    };
    let axes: [(&str, &dyn Fn(usize) -> String); 7] = [
        ("family", &|i| outcomes[i].family.clone()),
        ("town", &|i| outcomes[i].town.clone()),
        ("weather", &|i| outcomes[i].weather.clone()),
        ("hit by blind", &|i| of_hit(i, &|hit| hit.category.clone())),
        ("distribution", &|i| of_hit(i, &distribution)),
        ("event", &|i| of_hit(i, &|hit| hit.event.name().to_owned())),
        ("spot", &|i| of_hit(i, &|hit| hit.spot.name().to_owned())),
    ];
    let of_axis = |(axis, name): (&str, &dyn Fn(usize) -> String)| {
        let mut of_name: BTreeMap<String, GroupFigures> = BTreeMap::new();
        for (i, outcome) in outcomes.iter().enumerate() {
            let name = name(i);
            let group = of_name.entry(name.clone()).or_insert(GroupFigures {
                name,
                n_episodes: 0,
                n_collisions: 0,
                n_avoidable: 0,
                n_avoided: 0,
                n_false_stops: 0,
                driven_km: 0.0,
            });
            let collides = outcome.collision.is_some();
            group.n_episodes += 1;
            group.n_collisions += usize::from(collides);
            group.n_avoidable += usize::from(is_counted(i));
            group.n_avoided += usize::from(is_counted(i) && !collides);
            group.n_false_stops += outcome.n_false_stops();
            group.driven_km += outcome.distance_m / 1000.0;
        }
        (axis.to_owned(), of_name.into_values().collect())
    };
    axes.into_iter().map(of_axis).collect()
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
        assert_eq!(rows[0].avoided_share.unwrap().value, Some(0.0));
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
    fn an_episode_that_one_driver_failed_in_counts_for_nobody() {
        let (who, mut failed) = drives("exec:cat", [None; 4]);
        failed[1].end = End::Failed("it died".into());
        let rows = compare(&[drives("blind", [Some(3.0); 4]), (who, failed)]);
        assert_eq!([rows[0].n_episodes, rows[1].n_episodes], [3, 3]);
        assert_eq!([rows[0].n_failed, rows[1].n_failed], [0, 1]);
        assert_eq!(rows[0].n_collisions, 3);
    }
}
