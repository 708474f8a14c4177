//! The part of a description that tells where the objects out of distribution were put and what they do.

use std::collections::BTreeMap;

use serde::Serialize;

use super::comparison::share;
use crate::dataset::statistics::{SpotCount, Unfamiliar};
use crate::object::{Event, Spot};
use crate::report::table::percent;
use crate::text_table::text_table;

/// Shares of the annotated objects out of distribution.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct UnfamiliarInfo {
    #[serde(flatten)]
    pub all: SpotInfo,
    pub spots: BTreeMap<Spot, SpotInfo>,
    /// Share of each event.
    pub events: BTreeMap<Event, Option<f64>>,
}

/// The objects of one place.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SpotInfo {
    pub n_objects: u64,
    /// Of all objects out of distribution.
    pub share: Option<f64>,
    /// `None` without labels.
    pub harmful_share: Option<f64>,
    pub more_than_half_occluded: Option<f64>,
    pub tipped_share: Option<f64>,
}

impl UnfamiliarInfo {
    /// `None` where there are no such objects.
    pub(super) fn new(counts: &Unfamiliar, is_labelled: bool) -> Option<Self> {
        let total = counts.total();
        let info = |count: &SpotCount| SpotInfo {
            n_objects: count.n_objects,
            share: share(count.n_objects, total.n_objects),
            harmful_share: share(count.n_harmful, count.n_objects).filter(|_| is_labelled),
            more_than_half_occluded: share(count.n_occluded, count.n_objects),
            tipped_share: share(count.n_tipped, count.n_objects),
        };
        (total.n_objects > 0).then(|| Self {
            all: info(&total),
            spots: counts.by_spot.iter().map(|(&spot, count)| (spot, info(count))).collect(),
            events: counts.by_event.iter().map(|(&event, &n)| (event, share(n, total.n_objects))).collect(),
        })
    }

    pub(super) fn table(&self) -> String {
        let head = ["unfamiliar objects", "share", "harmful", "less than half seen", "on a side"];
        let row = |name: &str, of: &SpotInfo| {
            let shares = [of.share, of.harmful_share, of.more_than_half_occluded, of.tipped_share];
            std::iter::once(name.to_owned()).chain(shares.map(percent)).collect::<Vec<_>>()
        };
        let spots = self.spots.iter().map(|(spot, of)| row(spot.name(), of));
        let all = std::iter::once(row("all", &self.all));
        let events = self.events.iter().filter(|(event, _)| !matches!(event, Event::None | Event::Lies));
        let event_row =
            |(event, &share): (&Event, &Option<f64>)| vec![event.name().to_owned(), percent(share)];
        let head = std::iter::once(head.map(str::to_owned).to_vec());
        let events = events.map(event_row).map(|mut row| {
            row.resize(5, String::new());
            row
        });
        text_table(head.chain(all).chain(spots).chain(events))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_of_the_unfamiliar_objects_and_harm_needs_labels() {
        let near = SpotCount { n_objects: 3, n_harmful: 2, n_occluded: 1, n_tipped: 0 };
        let hidden = SpotCount { n_objects: 1, n_harmful: 0, n_occluded: 1, n_tipped: 1 };
        let counts = Unfamiliar {
            by_spot: [(Spot::Lane, near), (Spot::Behind, hidden)].into(),
            by_event: [(Event::Lies, 3), (Event::Rolls, 1)].into(),
        };
        let info = UnfamiliarInfo::new(&counts, true).unwrap();
        let (lane, all) = (info.spots[&Spot::Lane], info.all);
        assert_eq!((lane.share, lane.harmful_share), (Some(0.75), Some(2.0 / 3.0)));
        assert_eq!((all.more_than_half_occluded, all.tipped_share), (Some(0.5), Some(0.25)));
        assert_eq!(info.events[&Event::Rolls], Some(0.25));
        let table = info.table();
        assert!(table.contains("behind") && table.contains("rolls") && !table.contains("lies"), "{table}");
        assert_eq!(UnfamiliarInfo::new(&counts, false).unwrap().all.harmful_share, None);
        assert_eq!(UnfamiliarInfo::new(&Unfamiliar::default(), true), None);
    }
}
