//! Where objects out of distribution were put, what they do, and how much of them is seen.

use std::collections::BTreeMap;

use super::HALF_VISIBLE;
use crate::object::{Event, Harm, Object, Spot};

/// Counts of the annotated objects out of distribution.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Unfamiliar {
    pub by_spot: BTreeMap<Spot, SpotCount>,
    pub by_event: BTreeMap<Event, u64>,
}

/// Counts of the objects of one place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SpotCount {
    pub n_objects: u64,
    /// Zero where there are no labels.
    pub n_harmful: u64,
    /// Those of which less than half is visible.
    pub n_occluded: u64,
    pub n_tipped: u64,
}

impl Unfamiliar {
    pub(super) fn add(&mut self, object: &Object, harm: Option<Harm>) {
        if !object.is_ood() {
            return;
        }
        *self.by_event.entry(object.event.unwrap_or_default()).or_default() += 1;
        let count = self.by_spot.entry(object.spot.unwrap_or_default()).or_default();
        count.n_objects += 1;
        count.n_harmful += u64::from(harm == Some(Harm::Harmful));
        count.n_occluded += u64::from(object.visible_fraction.is_some_and(|share| share < HALF_VISIBLE));
        count.n_tipped += u64::from(object.is_tipped == Some(true));
    }

    pub(super) fn merge(&mut self, other: Self) {
        for (event, n) in other.by_event {
            *self.by_event.entry(event).or_default() += n;
        }
        for (spot, count) in other.by_spot {
            let sum = self.by_spot.entry(spot).or_default();
            sum.n_objects += count.n_objects;
            sum.n_harmful += count.n_harmful;
            sum.n_occluded += count.n_occluded;
            sum.n_tipped += count.n_tipped;
        }
    }

    /// All places together.
    #[must_use]
    pub fn total(&self) -> SpotCount {
        self.by_spot.values().fold(SpotCount::default(), |sum, count| SpotCount {
            n_objects: sum.n_objects + count.n_objects,
            n_harmful: sum.n_harmful + count.n_harmful,
            n_occluded: sum.n_occluded + count.n_occluded,
            n_tipped: sum.n_tipped + count.n_tipped,
        })
    }
}
