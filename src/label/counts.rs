//! The result of labelling: harmful and harmless boxes by distribution and kind, as a table.

use std::fmt;

use serde::Serialize;

use crate::episode::manifest::{HarmCounts, LabelCounts};
use crate::object::{Distribution, Kind};
use crate::text_table::text_table;

/// The result of labelling a data set; every annotated box counts once in each sample it is in.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LabelSummary {
    /// Name of the label set.
    pub set: String,
    /// Whether the set was there already, complete and made with the same zone: nothing was written.
    pub was_complete: bool,
    pub n_episodes: usize,
    pub n_samples: usize,
    /// Episodes whose workers died or hung, and how. The set is unfinished then, without `labels.json`, and the counts are of what is
    /// whole; the same command labels the rest.
    pub lost: Vec<String>,
    pub counts: LabelCounts,
}

/// The sum over the groups that fit; `None` stands for all.
#[must_use]
pub fn count_of(counts: &LabelCounts, distribution: Option<Distribution>, kind: Option<Kind>) -> HarmCounts {
    let mut sum = HarmCounts::default();
    for found in [Distribution::Id, Distribution::Ood] {
        for found_kind in [Kind::Vehicle, Kind::Pedestrian, Kind::Static] {
            if distribution.is_none_or(|wanted| wanted == found)
                && kind.is_none_or(|wanted| wanted == found_kind)
            {
                let count = counts.get(found).get(found_kind);
                sum.harmful += count.harmful;
                sum.harmless += count.harmless;
            }
        }
    }
    sum
}

impl fmt::Display for LabelSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.was_complete {
            writeln!(f, "label set `{}` is complete and of the same zone; nothing to do", self.set)?;
        }
        if self.n_episodes == 0 && self.lost.is_empty() {
            let none = "this part has no episode, so that nothing was labelled";
            return write!(f, "label set `{}`: {none}", self.set);
        }
        let all = count_of(&self.counts, None, None);
        let total = all.harmful + all.harmless;
        let each = if self.n_samples > 0 { total as f64 / self.n_samples as f64 } else { 0.0 };
        writeln!(
            f,
            "label set `{}`: {} episodes, {} samples, {total} objects ({each:.1} a sample)",
            self.set, self.n_episodes, self.n_samples
        )?;
        if !self.lost.is_empty() {
            writeln!(
                f,
                "lost: {} episodes, told on standard error; without them there is no labels.json, and the same command labels them",
                self.lost.len()
            )?;
        }
        let distributions = [(None, "all"), (Some(Distribution::Id), "id"), (Some(Distribution::Ood), "ood")];
        let kinds = [
            (None, ""),
            (Some(Kind::Vehicle), " vehicle"),
            (Some(Kind::Pedestrian), " pedestrian"),
            (Some(Kind::Static), " static"),
        ];
        let mut rows = vec![["", "harmful", "harmless", "share"].map(str::to_owned)];
        for (distribution, name) in distributions {
            for (kind, kind_name) in kinds {
                let HarmCounts { harmful, harmless } = count_of(&self.counts, distribution, kind);
                if harmful + harmless > 0 {
                    let share = 100.0 * harmful as f64 / (harmful + harmless) as f64;
                    rows.push([
                        format!("{name}{kind_name}"),
                        harmful.to_string(),
                        harmless.to_string(),
                        format!("{share:.1}%"),
                    ]);
                }
            }
        }
        f.write_str(text_table(rows).trim_end())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::object::Harm;

    #[test]
    fn the_table_shows_shares_of_the_groups_that_have_objects() {
        let mut counts = LabelCounts::default();
        for harm in [Harm::Harmful, Harm::Harmless, Harm::Harmless, Harm::Harmless] {
            counts.id.vehicle.add(harm);
        }
        counts.ood.static_object.add(Harm::Harmful);
        let summary = LabelSummary {
            set: "rect".into(),
            was_complete: false,
            n_episodes: 1,
            n_samples: 2,
            lost: Vec::new(),
            counts,
        };
        let table = summary.to_string();
        assert!(!table.contains("lost"), "{table}");
        let with_loss = LabelSummary { lost: vec!["one".into()], ..summary };
        assert!(with_loss.to_string().contains("lost: 1 episodes"), "{with_loss}");
        assert!(table.contains("2 samples, 5 objects (2.5 a sample)"), "{table}");
        assert!(table.contains("40.0%") && table.contains("25.0%") && table.contains("100.0%"), "{table}");
        assert!(!table.contains("pedestrian"), "{table}");
    }
}
