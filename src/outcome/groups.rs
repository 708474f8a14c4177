//! Drives by what was hit, where and in what weather.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::drive_outcome::{Collision, DriveOutcome};
use super::measure::{Draws, Measure, Ratio, yes};

/// One group of episodes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GroupFigures {
    pub name: String,
    pub n_episodes: usize,
    pub n_collisions: usize,
    /// As of [`super::Figures::avoided_share`], or of `blind`'s collisions where `truth` did not drive.
    pub n_avoidable: usize,
    pub n_avoided: usize,
    pub n_false_stops: usize,
    pub driven_km: f64,
    /// Of the avoidable ones, those that were avoided; `None` in what older rules wrote, as is the next.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub avoided_share: Option<Measure>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub false_stops_per_km: Option<Measure>,
}

/// The episodes by town, by weather, and by what `blind` (or, without it, the driver) ran into; `avoided` is the kind of the share.
pub(super) fn groups(
    outcomes: &[DriveOutcome],
    blind: Option<&[DriveOutcome]>,
    draws: &Draws,
    avoided: Ratio,
    is_counted: impl Fn(usize) -> bool + Sync,
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
        let mut members: BTreeMap<String, BTreeSet<usize>> = BTreeMap::new();
        for i in 0..outcomes.len() {
            members.entry(name(i)).or_default().insert(i);
        }
        let of_group = |(name, members): (String, BTreeSet<usize>)| {
            let collides = |i: usize| outcomes[i].collision.is_some();
            let counted = |i: usize| members.contains(&i) && is_counted(i);
            let count = |is: &dyn Fn(usize) -> bool| members.iter().filter(|&&i| is(i)).count();
            let km = |i: usize| if members.contains(&i) { outcomes[i].distance_m / 1000.0 } else { 0.0 };
            let n_false_stops =
                |i: usize| if members.contains(&i) { outcomes[i].n_false_stops() as f64 } else { 0.0 };
            GroupFigures {
                n_episodes: members.len(),
                n_collisions: count(&collides),
                n_avoidable: count(&counted),
                n_avoided: count(&|i| counted(i) && !collides(i)),
                n_false_stops: members.iter().map(|&i| outcomes[i].n_false_stops()).sum(),
                driven_km: members.iter().map(|&i| km(i)).sum(),
                avoided_share: Some(
                    draws.ratio(avoided, &|i| yes(counted(i) && !collides(i)), &|i| yes(counted(i))),
                ),
                false_stops_per_km: Some(draws.ratio(Ratio::Rate, &n_false_stops, &km)),
                name,
            }
        };
        (axis.to_owned(), members.into_iter().map(of_group).collect())
    };
    axes.into_iter().map(of_axis).collect()
}

#[cfg(test)]
mod tests {
    use crate::outcome::compare;
    use crate::outcome::test_data::drives;

    #[test]
    fn each_group_has_its_share_avoided_and_its_false_stops_with_intervals() {
        let mut small = drives("small", [Some(3.0), None, None, None]);
        for (outcome, town) in small.1.iter_mut().zip(["market", "market", "market", "suburb"]) {
            outcome.town = town.to_owned();
        }
        let stop = crate::outcome::HardStop { time_s: 1.0, braking_mps2: 5.0, is_false: true };
        small.1[3].hard_stops = vec![stop; 2];
        let figures = compare(&[drives("blind", [Some(3.0); 4]), drives("truth", [None; 4]), small]);
        let [market, suburb] = &figures[2].groups["town"][..] else { panic!("{:?}", figures[2].groups) };
        let avoided = market.avoided_share.unwrap();
        assert_eq!((market.n_avoided, market.n_avoidable), (2, 3));
        assert!((avoided.value.unwrap() - 2.0 / 3.0).abs() < 1e-12);
        let [low, high] = avoided.interval.unwrap();
        assert!(low < 0.5 && high == 1.0, "{avoided:?}");
        // Two in 0.1 km, all of them in one drive.
        assert_eq!(suburb.false_stops_per_km.unwrap().value, Some(20.0));
        assert_eq!(market.false_stops_per_km.unwrap().value, Some(0.0));
        assert!(market.false_stops_per_km.unwrap().interval.unwrap()[1] > 10.0);
    }
}
