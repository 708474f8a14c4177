//! A data set beside the paper's: the shares that show whether both are about equally varied.

use serde::Serialize;

use crate::dataset::statistics::Group;
use crate::episode::manifest::HarmCounts;
use crate::label::count_of;
use crate::object::{Distribution, Kind};

/// A number is like the paper's if it differs by no more than this share of it.
pub const TOLERANCE: f64 = 0.3;
/// Keeps a ratio of exactly 1.3 within the tolerance.
const ROUNDING: f64 = 1e-9;

/// One number of a data set beside the paper's.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    pub quantity: &'static str,
    /// `None` if labels are needed and missing, or if there is nothing to take a share of.
    pub here: Option<f64>,
    pub paper: f64,
    /// This set's number over the paper's.
    pub ratio: Option<f64>,
    /// Whether the ratio is within [`TOLERANCE`] of one.
    pub is_within_tolerance: Option<bool>,
    /// Whether it is a share, shown in percent.
    #[serde(skip)]
    pub is_share: bool,
}

impl Comparison {
    fn new(quantity: &'static str, here: Option<f64>, paper: f64, is_share: bool) -> Self {
        let ratio = here.map(|here| here / paper);
        let is_within_tolerance = ratio.map(|ratio| (ratio - 1.0).abs() <= TOLERANCE + ROUNDING);
        Self { quantity, here, paper, ratio, is_within_tolerance, is_share }
    }
}

/// Harmful over all; `None` if there is nothing.
pub(super) fn harmful_share(counts: HarmCounts) -> Option<f64> {
    share(counts.harmful, counts.harmful + counts.harmless)
}

pub(super) fn share(part: u64, whole: u64) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

/// The rows of the paper's table: of its training set (Table I), or of its OOD set (Table II).
pub(super) fn rows(all: &Group, is_ood: bool, is_labelled: bool) -> Vec<Comparison> {
    let harmful = |distribution, kind| {
        if is_labelled { harmful_share(count_of(&all.labels, distribution, kind)) } else { None }
    };
    let of_kind = |kind| {
        let objects = &all.objects;
        share(objects.id.get(kind) + objects.ood.get(kind), objects.total())
    };
    let n_in = |distribution| -> u64 { all.objects.get(distribution).values().into_iter().sum() };
    let a_sample = share(all.objects.total(), all.n_samples);
    if is_ood {
        return vec![
            Comparison::new("harmful, ID objects", harmful(Some(Distribution::Id), None), 0.047, true),
            Comparison::new("harmful, OOD objects", harmful(Some(Distribution::Ood), None), 0.060, true),
            Comparison::new("harmful, vehicles", harmful(None, Some(Kind::Vehicle)), 0.092, true),
            Comparison::new("harmful, pedestrians", harmful(None, Some(Kind::Pedestrian)), 0.079, true),
            Comparison::new("objects a sample", a_sample, 9.5, false),
            Comparison::new(
                "OOD objects to one ID object",
                share(n_in(Distribution::Ood), n_in(Distribution::Id)),
                0.40,
                false,
            ),
        ];
    }
    vec![
        Comparison::new("harmful, all", harmful(None, None), 0.056, true),
        Comparison::new("harmful, vehicles", harmful(None, Some(Kind::Vehicle)), 0.107, true),
        Comparison::new("harmful, pedestrians", harmful(None, Some(Kind::Pedestrian)), 0.055, true),
        Comparison::new("harmful, static", harmful(None, Some(Kind::Static)), 0.020, true),
        Comparison::new("objects a sample", a_sample, 6.7, false),
        Comparison::new("of all: vehicles", of_kind(Kind::Vehicle), 0.38, true),
        Comparison::new("of all: pedestrians", of_kind(Kind::Pedestrian), 0.08, true),
        Comparison::new("of all: static", of_kind(Kind::Static), 0.55, true),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn group() -> Group {
        let mut group = Group { n_episodes: 1, n_samples: 4, ..Group::default() };
        group.objects.id.vehicle = 10;
        group.objects.id.static_object = 6;
        group.objects.ood.static_object = 4;
        group.labels.id.vehicle = HarmCounts { harmful: 1, harmless: 9 };
        group.labels.id.static_object = HarmCounts { harmful: 0, harmless: 6 };
        group.labels.ood.static_object = HarmCounts { harmful: 1, harmless: 3 };
        group
    }

    fn here(rows: &[Comparison], quantity: &str) -> Option<f64> {
        rows.iter().find(|row| row.quantity == quantity).expect("the row is there").here
    }

    #[test]
    fn shares_are_of_their_own_kind() {
        let rows = rows(&group(), false, true);
        assert_eq!(here(&rows, "harmful, all"), Some(0.1));
        assert_eq!(here(&rows, "harmful, vehicles"), Some(0.1));
        assert_eq!(here(&rows, "harmful, static"), Some(0.1));
        assert_eq!(here(&rows, "harmful, pedestrians"), None);
        assert_eq!(here(&rows, "of all: vehicles"), Some(0.5));
        assert_eq!(here(&rows, "of all: static"), Some(0.5));
        assert_eq!(here(&rows, "objects a sample"), Some(5.0));
    }

    #[test]
    fn an_ood_set_is_compared_with_the_papers_ood_set() {
        let rows = rows(&group(), true, true);
        assert_eq!(here(&rows, "harmful, ID objects"), Some(1.0 / 16.0));
        assert_eq!(here(&rows, "harmful, OOD objects"), Some(0.25));
        assert_eq!(here(&rows, "OOD objects to one ID object"), Some(0.25));
    }

    #[test]
    fn without_labels_the_harmful_shares_are_missing_and_the_rest_stands() {
        let rows = rows(&group(), false, false);
        assert_eq!(here(&rows, "harmful, all"), None);
        assert_eq!(here(&rows, "objects a sample"), Some(5.0));
    }

    #[test]
    fn thirty_percent_more_is_within_and_a_little_above_is_not() {
        let is_within = |here| Comparison::new("x", Some(here), 10.0, false).is_within_tolerance;
        assert_eq!([7.0, 13.0, 6.9, 13.1].map(is_within), [true, true, false, false].map(Some));
    }
}
