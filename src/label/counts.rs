//! How many objects are harmful and harmless, by kind and distribution: the table that `label` prints.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};

use crate::object::{Distribution, Harm, Kind};

/// Harmful and harmless objects of one group.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HarmCount {
    pub harmful: u64,
    pub harmless: u64,
}

impl HarmCount {
    #[must_use]
    pub fn total(self) -> u64 {
        self.harmful + self.harmless
    }

    /// Harmful over all; none where there is no object.
    #[must_use]
    pub fn harmful_share(self) -> Option<f64> {
        (self.total() > 0).then(|| self.harmful as f64 / self.total() as f64)
    }

    fn plus(self, other: Self) -> Self {
        Self { harmful: self.harmful + other.harmful, harmless: self.harmless + other.harmless }
    }
}

/// Counts over samples: every annotated object counts once in every sample it is in.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Counts {
    pub n_samples: u64,
    /// By distribution, then kind; groups without an object are left out.
    pub objects: BTreeMap<Distribution, BTreeMap<Kind, HarmCount>>,
}

impl Counts {
    /// Counts one object.
    pub fn add(&mut self, distribution: Distribution, kind: Kind, harm: Harm) {
        let count = self.objects.entry(distribution).or_default().entry(kind).or_default();
        match harm {
            Harm::Harmful => count.harmful += 1,
            Harm::Harmless => count.harmless += 1,
        }
    }

    /// Adds the counts of another episode.
    pub fn merge(&mut self, other: &Self) {
        self.n_samples += other.n_samples;
        for (&distribution, kinds) in &other.objects {
            for (&kind, &count) in kinds {
                let here = self.objects.entry(distribution).or_default().entry(kind).or_default();
                *here = here.plus(count);
            }
        }
    }

    /// The sum over the groups that fit; none stands for all.
    #[must_use]
    pub fn of(&self, distribution: Option<Distribution>, kind: Option<Kind>) -> HarmCount {
        self.objects
            .iter()
            .filter(|(found, _)| distribution.is_none_or(|wanted| wanted == **found))
            .flat_map(|(_, kinds)| kinds)
            .filter(|(found, _)| kind.is_none_or(|wanted| wanted == **found))
            .fold(HarmCount::default(), |sum, (_, &count)| sum.plus(count))
    }
}

impl fmt::Display for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let all = self.of(None, None).total();
        let each = if self.n_samples > 0 { all as f64 / self.n_samples as f64 } else { 0.0 };
        writeln!(f, "{} samples, {all} objects ({each:.1} a sample)", self.n_samples)?;
        writeln!(f, "{:<22}{:>9}{:>10}{:>8}", "", "harmful", "harmless", "share")?;
        let distributions = [(None, "all"), (Some(Distribution::Id), "id"), (Some(Distribution::Ood), "ood")];
        let kinds = [
            (None, ""),
            (Some(Kind::Vehicle), "vehicle"),
            (Some(Kind::Pedestrian), "pedestrian"),
            (Some(Kind::Static), "static"),
        ];
        for (distribution, name) in distributions {
            for (kind, kind_name) in kinds {
                let count = self.of(distribution, kind);
                let Some(share) = count.harmful_share() else { continue };
                let row = format!("{name:<4}{kind_name}");
                let (harmful, harmless) = (count.harmful, count.harmless);
                writeln!(f, "{row:<22}{harmful:>9}{harmless:>10}{:>7.1}%", 100.0 * share)?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn three_in_four() -> Counts {
        let mut counts = Counts { n_samples: 2, ..Counts::default() };
        counts.add(Distribution::Id, Kind::Vehicle, Harm::Harmful);
        counts.add(Distribution::Id, Kind::Vehicle, Harm::Harmless);
        counts.add(Distribution::Ood, Kind::Static, Harm::Harmful);
        counts.add(Distribution::Ood, Kind::Static, Harm::Harmful);
        counts
    }

    #[test]
    fn shares_are_harmful_over_all_of_the_group() {
        let counts = three_in_four();
        assert_eq!(counts.of(None, None).harmful_share(), Some(0.75));
        assert_eq!(counts.of(Some(Distribution::Id), None).harmful_share(), Some(0.5));
        assert_eq!(counts.of(None, Some(Kind::Static)).harmful_share(), Some(1.0));
        assert_eq!(counts.of(None, Some(Kind::Pedestrian)).harmful_share(), None);
    }

    #[test]
    fn merged_counts_are_sums() {
        let mut twice = three_in_four();
        twice.merge(&three_in_four());
        assert_eq!((twice.n_samples, twice.of(None, None).total()), (4, 8));
    }

    #[test]
    fn the_table_shows_groups_that_have_objects() {
        let table = three_in_four().to_string();
        assert!(table.contains("2 samples, 4 objects (2.0 a sample)"), "{table}");
        assert!(table.contains("ood static") && !table.contains("pedestrian"), "{table}");
    }

    #[test]
    fn counts_survive_json() {
        let text = serde_json::to_string(&three_in_four()).unwrap();
        assert_eq!(serde_json::from_str::<Counts>(&text).unwrap(), three_in_four());
    }
}
