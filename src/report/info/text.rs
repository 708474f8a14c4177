//! The description of a data set as text.

use std::fmt;

use super::{Comparison, GroupInfo, Info, TOLERANCE};
use crate::episode::MadeWith;
use crate::object::Distribution;
use crate::report::table::{number, percent};
use crate::text_table::text_table;

impl fmt::Display for Info {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let what = if self.ood { "in and out of distribution" } else { "in distribution" };
        let (path, version) = (self.dataset.display(), self.data_version);
        write!(f, "{path}: {what}, seed {}, data version {version}", self.seed)?;
        if let Some(part) = self.part {
            write!(f, ", shard {} of {} episodes", part.shard, part.n_episodes)?;
        }
        match &self.label_set {
            Some(set) => writeln!(f, ", labels `{set}`\n")?,
            None => writeln!(f, ", not labelled\n")?,
        }
        for MadeWith { mujoco, opengl, libc, cpu } in &self.made_with {
            writeln!(f, "  made with  MuJoCo {mujoco}; {opengl}; {libc}; {cpu}")?;
        }
        if !self.made_with.is_empty() {
            writeln!(f)?;
        }
        write!(f, "{}\n{}\n{}", self.group_table(), self.comparison_table(), self.spread_table())?;
        if let Some(kinds) = self.unfamiliar_kinds() {
            writeln!(f, "\nUnfamiliar objects: {kinds}")?;
        }
        if !self.background.is_empty() {
            let categories: Vec<&str> = self.background.iter().map(String::as_str).collect();
            writeln!(f, "  never annotated  {}", categories.join(", "))?;
        }
        if let Some(unfamiliar) = &self.unfamiliar {
            write!(f, "\n{}", unfamiliar.table())?;
        }
        for group in &self.logs {
            write!(f, "\n{}", super::logs::text(group))?;
        }
        if let Some(note) = &self.note {
            writeln!(f, "\n{note}")?;
        }
        Ok(())
    }
}

impl Info {
    /// The unfamiliar kinds by name, with their boxes.
    fn unfamiliar_kinds(&self) -> Option<String> {
        let unfamiliar = self.categories.iter().filter(|of| of.category.distribution == Distribution::Ood);
        let kinds = unfamiliar.map(|of| (of.category.category.as_str(), of.n_objects));
        let mut kinds: Vec<(&str, u64)> = kinds.collect();
        kinds.sort_unstable();
        let told: Vec<String> = kinds.iter().map(|(name, n)| format!("{name} {n}")).collect();
        (!told.is_empty()).then(|| told.join(", "))
    }

    fn group_table(&self) -> String {
        let splits = self.splits.iter();
        let splits = splits.map(|(split, group)| (format!("split {split:?}").to_lowercase(), group));
        let others = self.towns.iter().chain(&self.weathers).map(|(name, group)| (name.clone(), group));
        let row = |(name, group): (String, &GroupInfo)| {
            let counts = [group.n_episodes, group.n_samples, group.n_objects].map(|n| n.to_string());
            let shares = [
                number(group.objects_per_sample, 1),
                percent(group.harmful_share.and_then(|shares| shares.all)),
            ];
            [name].into_iter().chain(counts).chain(shares).collect()
        };
        let head = ["", "episodes", "samples", "objects", "a sample", "harmful"].map(str::to_owned).to_vec();
        let all = std::iter::once(("all".to_owned(), &self.all));
        text_table(std::iter::once(head).chain(all.chain(splits).chain(others).map(row)))
    }

    fn comparison_table(&self) -> String {
        let row = |of: &Comparison| {
            let value = |value| if of.is_share { percent(value) } else { number(value, 2) };
            let verdict = match of.is_within_tolerance {
                Some(true) => format!("within {:.0} %", 100.0 * TOLERANCE),
                Some(false) => "OUTSIDE".to_owned(),
                None => String::new(),
            };
            [of.quantity.to_owned(), value(of.here), value(Some(of.paper)), number(of.ratio, 2), verdict]
        };
        let name = if self.ood { "beside the paper's OOD set" } else { "beside the paper's training set" };
        let head = [name, "here", "paper", "ratio", ""].map(str::to_owned);
        text_table(std::iter::once(head).chain(self.comparison.iter().map(row)))
    }

    fn spread_table(&self) -> String {
        let span = |least: Option<f64>, most: Option<f64>, unit: &str| match least.and(most) {
            Some(_) => format!("{} to {} {unit}", number(least, 1), number(most, 1)),
            None => number(None, 1),
        };
        let with_unit = |value: Option<f64>, unit: &str| match value {
            Some(_) => format!("{} {unit}", number(value, 1)),
            None => number(None, 1),
        };
        let (hardness, histograms) = (&self.hardness, &self.histograms);
        let (speed, steering) = (&histograms.speed_mps, &histograms.steering_deg);
        let size_kb = self.bytes_per_sample.map(|bytes| bytes / 1e3);
        text_table([
            ["objects more than half occluded".to_owned(), percent(hardness.more_than_half_occluded)],
            ["objects with 10 LiDAR points or fewer".to_owned(), percent(hardness.ten_points_or_fewer)],
            ["farthest object".to_owned(), with_unit(hardness.farthest_m, "m")],
            ["speed".to_owned(), span(speed.least, speed.most, "m/s")],
            ["steering, left positive".to_owned(), span(steering.least, steering.most, "degrees")],
            ["size of a sample".to_owned(), with_unit(size_kb, "kB")],
        ])
    }
}
