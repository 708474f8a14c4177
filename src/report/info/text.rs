//! The description of a data set as text.

use std::fmt;

use super::{Comparison, GroupInfo, Info, TOLERANCE};

impl fmt::Display for Info {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let what = if self.ood { "in and out of distribution" } else { "in distribution" };
        write!(f, "{}: {what}, seed {}", self.dataset.display(), self.seed)?;
        match &self.label_set {
            Some(set) => writeln!(f, ", labels `{set}`\n")?,
            None => writeln!(f, ", not labelled\n")?,
        }
        writeln!(
            f,
            "{:<20}{:>9}{:>9}{:>9}{:>10}{:>9}",
            "", "episodes", "samples", "objects", "a sample", "harmful"
        )?;
        write_group(f, "all", &self.all)?;
        for (split, group) in &self.splits {
            write_group(f, &format!("split {}", format!("{split:?}").to_lowercase()), group)?;
        }
        for (town, group) in &self.towns {
            write_group(f, town, group)?;
        }
        for (weather, group) in &self.weathers {
            write_group(f, weather, group)?;
        }
        self.write_comparison(f)?;
        self.write_spread(f)?;
        if let Some(note) = &self.note {
            writeln!(f, "\n{note}")?;
        }
        Ok(())
    }
}

fn write_group(f: &mut fmt::Formatter<'_>, name: &str, group: &GroupInfo) -> fmt::Result {
    let a_sample = group.objects_per_sample.map_or_else(|| "-".into(), |mean| format!("{mean:.1}"));
    let harmful = percent(group.harmful_share.and_then(|shares| shares.all));
    let GroupInfo { n_episodes, n_samples, n_objects, .. } = group;
    writeln!(f, "{name:<20}{n_episodes:>9}{n_samples:>9}{n_objects:>9}{a_sample:>10}{harmful:>9}")
}

fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "-".into(), |share| format!("{:.1} %", 100.0 * share))
}

/// Rounded to tenths, without a sign before zero.
fn tenths(value: f64) -> f64 {
    (value * 10.0).round() / 10.0 + 0.0
}

impl Info {
    fn write_comparison(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let row = if self.ood { "OOD set" } else { "training set" };
        writeln!(
            f,
            "\n{:<32}{:>9}{:>9}{:>8}",
            format!("beside the paper's {row}"),
            "here",
            "paper",
            "ratio"
        )?;
        for Comparison { quantity, here, paper, ratio, is_within_tolerance, is_share } in &self.comparison {
            let number = |value: Option<f64>| match value {
                Some(value) if !is_share => format!("{value:.2}"),
                value => percent(value),
            };
            let ratio = ratio.map_or_else(|| "-".into(), |ratio| format!("{ratio:.2}"));
            let verdict = match is_within_tolerance {
                Some(true) => format!("  within {:.0} %", 100.0 * TOLERANCE),
                Some(false) => "  OUTSIDE".into(),
                None => String::new(),
            };
            writeln!(f, "{quantity:<32}{:>9}{:>9}{ratio:>8}{verdict}", number(*here), number(Some(*paper)))?;
        }
        Ok(())
    }

    fn write_spread(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let span = |least: Option<f64>, most: Option<f64>, unit: &str| match (least, most) {
            (Some(least), Some(most)) => format!("{:.1} to {:.1} {unit}", tenths(least), tenths(most)),
            _ => "-".into(),
        };
        let (hardness, histograms) = (&self.hardness, &self.histograms);
        let farthest = hardness.farthest_m.map_or_else(|| "-".into(), |range_m| format!("{range_m:.1} m"));
        let size = self.bytes_per_sample.map_or_else(|| "-".into(), |bytes| format!("{:.1} kB", bytes / 1e3));
        let (speed, steering) = (&histograms.speed_mps, &histograms.steering_deg);
        let rows = [
            ("objects more than half occluded", percent(hardness.more_than_half_occluded)),
            ("objects with 10 LiDAR points or fewer", percent(hardness.ten_points_or_fewer)),
            ("farthest object", farthest),
            ("speed", span(speed.least, speed.most, "m/s")),
            ("steering, left positive", span(steering.least, steering.most, "degrees")),
            ("size of a sample", size),
        ];
        writeln!(f)?;
        rows.iter().try_for_each(|(name, value)| writeln!(f, "{name:<41}{value}"))
    }
}
