//! The figures of drives as text.

use std::fmt;

use super::DriveSummary;
use super::figures::{Figures, GroupFigures, Measure};
use crate::text_table::text_table;

/// Groups with fewer episodes in which something could be avoided are left out of the text.
const LEAST_AVOIDABLE: usize = 3;

impl fmt::Display for Measure {
    /// `0.81 (0.70 to 0.90)`, or `-` where nothing can be said.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(value) = self.value else { return f.write_str("-") };
        write!(f, "{value:.2}")?;
        match self.interval {
            Some([low, high]) => write!(f, " ({low:.2} to {high:.2})"),
            None => Ok(()),
        }
    }
}

impl fmt::Display for DriveSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&text_table(drive_rows(&self.figures)))?;
        writeln!(f)?;
        f.write_str(&text_table(impact_rows(&self.figures)))?;
        if let Some(n) = self.figures.iter().find_map(|figures| figures.n_not_sudden) {
            let of = |figures: &Figures| {
                figures.avoided_of_not_sudden_share.map(|share| format!("{} {share}", figures.who.name))
            };
            let shares: Vec<String> = self.figures.iter().filter_map(of).collect();
            writeln!(
                f,
                "\navoided, of the {n} episodes in which blind hits nothing that comes too suddenly for any brake: {}",
                shares.join(", ")
            )?;
        }
        if let Some(n) = self.figures.iter().find_map(|figures| figures.n_avoidable) {
            writeln!(
                f,
                "avoided in the table: of the {n} episodes in which blind collides and truth does not. Intervals: bootstrap by episode, 95 %."
            )?;
            let of = |figures: &Figures| {
                figures.avoided_going_share.map(|share| format!("{} {share}", figures.who.name))
            };
            let shares: Vec<String> = self.figures.iter().filter_map(of).collect();
            writeln!(f, "avoided, and not stuck at the end: {}", shares.join(", "))?;
        }
        for figures in &self.figures {
            for axis in ["family", "hit by blind", "event", "weather", "town"] {
                let groups = figures.groups.get(axis).map_or(&[][..], Vec::as_slice);
                let told: Vec<&GroupFigures> = groups
                    .iter()
                    .filter(|group| group.n_avoidable >= LEAST_AVOIDABLE && !group.name.is_empty())
                    .collect();
                if told.is_empty() || figures.avoided_of_all_share.is_none() {
                    continue;
                }
                let of = |group: &&GroupFigures| {
                    format!("{} {}/{}", group.name, group.n_avoided, group.n_avoidable)
                };
                let text: Vec<String> = told.iter().map(of).collect();
                writeln!(f, "{}, avoided by {axis}: {}", figures.who.name, text.join(", "))?;
            }
        }
        Ok(())
    }
}

/// Collisions, what was avoided, false stops and comfort: a head, then a row a driver.
#[must_use]
pub fn drive_rows(figures: &[Figures]) -> Vec<Vec<String>> {
    let head = [
        "who",
        "episodes",
        "km",
        "collisions",
        "a km",
        "avoided",
        "false stops a km",
        "stuck a km",
        "progress",
        "s to collision at first brake",
        "jerk m/s3",
    ];
    std::iter::once(head.map(str::to_owned).to_vec()).chain(figures.iter().map(row)).collect()
}

/// Collisions by impact, and how else drives ended: a head, then a row a driver.
#[must_use]
pub fn impact_rows(figures: &[Figures]) -> Vec<Vec<String>> {
    let head = [
        "who",
        "below 2 m/s",
        "2 to 5",
        "5 to 10",
        "above",
        "mean kJ",
        "stopped",
        "stuck",
        "struck by others",
    ];
    std::iter::once(head.map(str::to_owned).to_vec()).chain(figures.iter().map(impact_row)).collect()
}

fn row(of: &Figures) -> Vec<String> {
    let episodes = if of.n_failed > 0 {
        format!("{} ({} failed)", of.n_episodes, of.n_failed)
    } else {
        of.n_episodes.to_string()
    };
    vec![
        of.who.name.clone(),
        episodes,
        format!("{:.1}", of.driven_km),
        of.n_collisions.to_string(),
        of.collisions_per_km.to_string(),
        of.avoided_share
            .or(of.avoided_of_all_share)
            .map_or_else(|| "-".to_owned(), |share| share.to_string()),
        of.false_stops_per_km.to_string(),
        of.stuck_per_km.to_string(),
        of.progress.to_string(),
        of.first_brake_ttc_s.to_string(),
        of.rms_jerk_mps3.to_string(),
    ]
}

fn impact_row(of: &Figures) -> Vec<String> {
    let mut cells = vec![of.who.name.clone()];
    cells.extend(of.n_by_impact.iter().map(ToString::to_string));
    cells.push(
        of.mean_energy_j.map_or_else(|| "-".to_owned(), |energy_j| format!("{:.1}", energy_j / 1000.0)),
    );
    cells.extend([of.stopped_share, of.stuck_share].map(|share| format!("{:.0} %", 100.0 * share)));
    cells.push(of.n_struck.to_string());
    cells
}
