//! The figures of drives as text.

use std::fmt;

use super::DriveSummary;
use super::figures::Figures;
use super::groups::GroupFigures;
use super::measure::Measure;
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
        for (i, line) in share_lines(&self.figures).into_iter().enumerate() {
            writeln!(f, "{}{line}", if i == 0 { "\n" } else { "" })?;
        }
        for figures in &self.figures {
            for axis in ["family", "distribution", "hit by blind", "event", "weather", "town"] {
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

/// What of `blind`'s collisions was avoided, counted in other ways than the table's, and how drivers differ: a line each.
#[must_use]
pub fn share_lines(figures: &[Figures]) -> Vec<String> {
    let of_all = |what: &dyn Fn(&Figures) -> Option<String>| {
        let told = |of: &Figures| Some(format!("{} {}", of.who.name, what(of)?));
        figures.iter().filter_map(told).collect::<Vec<_>>().join(", ")
    };
    let count = |what: &dyn Fn(&Figures) -> Option<usize>| figures.iter().find_map(what);
    let text = |share: Option<Measure>| share.map(|share| share.to_string());
    let mut lines = Vec::new();
    if let Some(n) = count(&|of| of.n_avoidable) {
        lines.push(format!(
            "Avoided in the table: of the {n} episodes in which blind collides and truth does not. Intervals of 95 %: bootstrap by \
             episode, scenarios of a family together; exact where nothing or everything happened."
        ));
        let going = of_all(&|of| text(of.avoided_going_share));
        lines.push(format!("Avoided, and not stuck at the end: {going}."));
        let there = of_all(&|of| Some(format!("{} of {}", of.avoided_there_share?, of.n_came_there?)));
        lines.push(format!("Avoided, of those in which it came to where blind collides: {there}."));
    }
    if let Some(n) = count(&|of| of.n_blind_hits) {
        lines.push(format!(
            "Avoided, of all {n} that blind hits: {}.",
            of_all(&|of| text(of.avoided_of_all_share))
        ));
    }
    if let Some(n) = count(&|of| of.n_not_sudden) {
        let shares = of_all(&|of| text(of.avoided_of_not_sudden_share));
        lines.push(format!(
            "Avoided, of the {n} in which blind hits nothing that comes too suddenly for any brake: {shares}."
        ));
    }
    for of in figures {
        let Some(over) = &of.over_first else { continue };
        let avoided =
            over.avoided_share.map_or_else(String::new, |share| format!(", avoided {}", signed(share)));
        let energy = over.energy_j.filter(|energy_j| energy_j.value.is_some());
        let energy = energy.map(|energy_j| format!(", kJ a collision {}", signed(energy_j.scaled(1e-3))));
        lines.push(format!(
            "{} against {}, in the same worlds: collisions an episode {}{avoided}, false stops a km {}, stuck a km {}{}.",
            of.who.name,
            over.than,
            signed(over.collision_share),
            signed(over.false_stops_per_km),
            signed(over.stuck_per_km),
            energy.unwrap_or_default()
        ));
    }
    lines
}

/// A difference: `+0.08 (-0.02 to +0.15)`.
fn signed(of: Measure) -> String {
    let Some(value) = of.value else { return "-".to_owned() };
    match of.interval {
        Some([low, high]) => format!("{value:+.2} ({low:+.2} to {high:+.2})"),
        None => format!("{value:+.2}"),
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
        "brakes in vain a km",
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
        of.vain_brakes_per_km.map_or_else(|| "-".to_owned(), |brakes| brakes.to_string()),
        of.stuck_per_km.to_string(),
        of.progress.to_string(),
        of.first_brake_ttc_s.to_string(),
        of.rms_jerk_mps3.to_string(),
    ]
}

fn impact_row(of: &Figures) -> Vec<String> {
    let mut cells = vec![of.who.name.clone()];
    cells.extend(of.n_by_impact.iter().map(ToString::to_string));
    let energy_kj = of.energy_j.unwrap_or(Measure { value: of.mean_energy_j, interval: None }).scaled(1e-3);
    cells.push(if energy_kj.value.is_some() { energy_kj.to_string() } else { "-".to_owned() });
    cells.extend([of.stopped_share, of.stuck_share].map(|share| format!("{:.0} %", 100.0 * share)));
    cells.push(of.n_struck.to_string());
    cells
}
