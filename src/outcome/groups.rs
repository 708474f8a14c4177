//! Drives by what was hit, where and in what weather.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::drive_outcome::{Collision, DriveOutcome};

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
}

/// The episodes by town, by weather, and by what `blind` (or, without it, the driver) ran into.
pub(super) fn groups(
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
