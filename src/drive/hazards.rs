//! The hazards that a driver remembers: which of a sample's are those from before.

use std::collections::VecDeque;
use std::mem;

use super::config::ReflexConfig;
use super::tracks::{Sample, Seen, apart_m, moved_m};
use crate::geometry::{Box3, World};

/// A confirmed harmful box, or where one that moves will be met.
#[derive(Debug, Clone)]
pub(super) struct Hazard {
    pub at: Box3<World>,
    pub confirmed_s: f64,
    /// How many samples have confirmed it.
    pub n_confirmed: u32,
    /// Whether it stood when it was last confirmed; `None` of what was not there before, and so has no speed.
    pub stands: Option<bool>,
    /// Whether boxes sure enough for a full brake have confirmed it.
    pub is_sure: bool,
    /// Whether the last sample shows its box, harmful or not.
    pub is_seen: bool,
    /// Where it was confirmed before, the latest last; as many places as make it one that has stood.
    pub places: VecDeque<Box3<World>>,
}

impl Hazard {
    /// Whether so many samples have confirmed it at one place that it stays where nobody sees it: who walks by at less than
    /// `moving_mps` does not.
    pub fn has_stood(&self, config: &ReflexConfig) -> bool {
        self.stands == Some(true)
            && self.n_confirmed >= config.near_confirming
            && self.places.iter().all(|place| moved_m(place, &self.at).norm() <= config.near_moved_m)
    }
}

/// The hazards of a drive.
#[derive(Debug, Clone, Default)]
pub(super) struct Hazards(Vec<Hazard>);

impl Hazards {
    pub fn iter(&self) -> impl Iterator<Item = &Hazard> {
        self.0.iter()
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub fn retain(&mut self, is_kept: impl FnMut(&Hazard) -> bool) {
        self.0.retain(is_kept);
    }

    /// Moves each hazard along with its box, from the sample before to this one, whatever the box is called now: what drives off is
    /// not remembered where it stood.
    pub fn follow(&mut self, before: Option<&Sample>, now: &Sample, config: &ReflexConfig) {
        for known in &mut self.0 {
            let is_own = |seen: &Seen| apart_m(&seen.at, &known.at) == 0.0;
            let own = before.and_then(|of| Some((of, of.seen.iter().position(is_own)?)));
            let is_now = own.and_then(|(before, i)| config.partner(&before.seen, i, &now.seen));
            known.is_seen = is_now.is_some();
            if let Some(j) = is_now {
                known.at = now.seen[j].at;
            }
        }
    }

    /// Matches a sample's hazards with the known ones, the nearest pairs first; unmatched ones are new. What moves is not taken for what
    /// has stood for `near_confirming` samples, unless that was seen to come there: somebody who passes a low thing that nobody sees any
    /// more must not take its place.
    pub fn confirm(&mut self, found: Vec<Hazard>, config: &ReflexConfig) {
        let mut pairs = Vec::new();
        for (i, hazard) in found.iter().enumerate() {
            for (j, known) in self.0.iter().enumerate() {
                let is_apart_m = apart_m(&known.at, &hazard.at);
                let may_be = hazard.stands != Some(false) || !known.has_stood(config) || is_apart_m == 0.0;
                if config.is_same(&known.at, &hazard.at) && may_be {
                    pairs.push((is_apart_m, i, j));
                }
            }
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut is_taken, mut known_as) = (vec![false; self.0.len()], vec![None; found.len()]);
        for (_, i, j) in pairs {
            if known_as[i].is_none() && !is_taken[j] {
                (known_as[i], is_taken[j]) = (Some(j), true);
            }
        }
        for (mut hazard, known_as) in found.into_iter().zip(known_as) {
            if let Some(j) = known_as {
                hazard.n_confirmed += self.0[j].n_confirmed;
                hazard.stands = hazard.stands.or(self.0[j].stands);
                hazard.is_sure |= self.0[j].is_sure;
                hazard.places = mem::take(&mut self.0[j].places);
                hazard.places.push_back(hazard.at);
                let n_surplus = hazard.places.len().saturating_sub(config.near_confirming as usize);
                hazard.places.drain(..n_surplus);
                self.0[j] = hazard;
            } else {
                let places = VecDeque::from([hazard.at]);
                self.0.push(Hazard { stands: hazard.stands.or(Some(true)), places, ..hazard });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point;

    fn crate_at(x_m: f64) -> Hazard {
        let at = Box3 {
            center: Point::new(x_m, 0.0, 0.5),
            length_m: 1.0,
            width_m: 1.0,
            height_m: 1.0,
            yaw_rad: 0.0,
        };
        Hazard {
            at,
            confirmed_s: 0.0,
            n_confirmed: 1,
            stands: Some(true),
            is_sure: true,
            is_seen: true,
            places: VecDeque::new(),
        }
    }

    /// Places and confirmations after samples that show crates at these places.
    fn after(samples: &[&[f64]]) -> Vec<(f64, u32)> {
        let mut hazards = Hazards::default();
        for places_m in samples {
            hazards.confirm(places_m.iter().copied().map(crate_at).collect(), &ReflexConfig::default());
        }
        hazards.iter().map(|hazard| (hazard.at.center.x(), hazard.n_confirmed)).collect()
    }

    #[test]
    fn a_sample_confirms_each_of_two_side_by_side_once_in_whatever_order() {
        assert_eq!(after(&[&[20.0, 22.0], &[22.1, 20.1], &[20.2, 22.2]]), [(20.2, 3), (22.2, 3)]);
    }

    #[test]
    fn a_second_box_of_one_thing_is_new_and_does_not_take_its_place() {
        assert_eq!(after(&[&[20.0], &[22.0, 20.1], &[20.2]]), [(20.2, 3), (22.0, 1)]);
    }

    #[test]
    fn who_passes_what_has_stood_does_not_take_its_place() {
        let mut hazards = Hazards::default();
        for x_m in [6.0, 6.0, 6.0, 6.0] {
            hazards.confirm(vec![crate_at(x_m)], &ReflexConfig::default());
        }
        hazards.confirm(vec![Hazard { stands: Some(false), ..crate_at(7.0) }], &ReflexConfig::default());
        let found: Vec<(Option<bool>, u32)> = hazards.iter().map(|of| (of.stands, of.n_confirmed)).collect();
        assert_eq!(found, [(Some(true), 4), (Some(false), 1)]);
    }

    #[test]
    fn who_walks_by_slowly_has_not_stood_and_who_comes_to_rest_has() {
        let config = ReflexConfig::default();
        let mut hazards = Hazards::default();
        let mut has_stood = |x_m: f64| {
            hazards.confirm(vec![crate_at(x_m)], &config);
            hazards.iter().next().unwrap().has_stood(&config)
        };
        let walking: Vec<bool> = [4.0, 4.2, 4.4, 4.6, 4.8].map(&mut has_stood).into();
        assert_eq!(walking, [false; 5]);
        let resting: Vec<bool> = [4.8, 4.8, 4.8].map(&mut has_stood).into();
        assert_eq!(resting, [true, true, true]);
    }

    #[test]
    fn what_is_seen_again_after_a_gap_stands_or_moves_as_it_did() {
        for stood in [true, false] {
            let mut hazards = Hazards::default();
            let found = |stands| Hazard { stands, ..crate_at(6.0) };
            for stands in [Some(stood), None] {
                hazards.confirm(vec![found(stands)], &ReflexConfig::default());
            }
            let known: Vec<(Option<bool>, u32)> =
                hazards.iter().map(|of| (of.stands, of.n_confirmed)).collect();
            assert_eq!(known, [(Some(stood), 2)]);
        }
    }

    #[test]
    fn what_is_farther_than_one_thing_may_move_is_another() {
        assert_eq!(after(&[&[20.0], &[23.5]]), [(20.0, 1), (23.5, 1)]);
    }
}
