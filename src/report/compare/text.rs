//! The comparison as text: one table, the farthest apart first, and what its columns mean.

use std::fmt;

use crate::compare::{
    BOX_MARGIN_M, CLUTTER_RANGE_M, COMPARED_WIDTH_PX, CloudGap, DomainGap, EnergyDistance, FLAT_M, GROUND_M,
    GapRow, LEVEL, N_POINTS, N_RESAMPLES, OBSTACLE_TOP_M, PROPERTIES, SetFacts,
};
use crate::text_table::text_table;

impl fmt::Display for DomainGap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "A: {}\nB: {}\n", tell(&self.a), tell(&self.b))?;
        let head =
            ["", "mean A", "mean B", "unit", "W1", "in A", "JSD", "95 %", "in A", ""].map(str::to_owned);
        f.write_str(&text_table(std::iter::once(head).chain(self.rows.iter().map(cells))))?;
        let n_apart = self.rows.iter().filter(|row| row.is_apart == Some(true)).count();
        let n_judged = self.rows.iter().filter(|row| row.is_apart.is_some()).count();
        writeln!(
            f,
            "\n{n_apart} of {n_judged} quantities are farther apart than parts of A are from each other."
        )?;
        if let Some(cloud) = &self.cloud {
            write_cloud(f, cloud)?;
        }
        for note in &self.notes {
            writeln!(f, "{note}.")?;
        }
        writeln!(
            f,
            "\nW1: Wasserstein-1 distance in the unit, how far values must move on average. JSD: Jensen-Shannon divergence in bits,\n\
             0 alike to 1 nothing in common. 95 %: the middle of {N_RESAMPLES} JSDs with episodes drawn anew. in A: what A's own episodes, cut\n\
             in two at random with one part as large as B, stay below in {:.0} % of {N_RESAMPLES} draws; `as A`: neither distance is above it,\n\
             which is no difference.\n\
             Ground is what lies below {GROUND_M} m over the ego's ground plane; clutter is the share of the points from there to {OBSTACLE_TOP_M} m, nearer than\n\
             {CLUTTER_RANGE_M} m, that lie in no annotated box with {BOX_MARGIN_M} m around it. No flat wall: cells of 1 m whose\n\
             points spread by more than {FLAT_M} m about any plane. Pictures are compared at {COMPARED_WIDTH_PX} px in width.",
            100.0 * LEVEL
        )
    }
}

fn write_cloud(f: &mut fmt::Formatter<'_>, cloud: &CloudGap) -> fmt::Result {
    writeln!(f, "\nClouds as a whole, {N_POINTS} points of each; energy distance, over A's deviations:\n")?;
    let dash = || "–".to_owned();
    let cells = |name: &str, of: &EnergyDistance| {
        [
            name.to_owned(),
            format!("{:.3}", of.distance),
            of.interval.map_or_else(dash, |[low, high]| format!("{low:.3} to {high:.3}")),
            of.within_a.map_or_else(dash, |within| format!("{within:.3}")),
        ]
    };
    let head = ["", "energy", "95 %", "in A"].map(str::to_owned);
    let joint = cells(&PROPERTIES.join(", "), &cloud.joint);
    let single = PROPERTIES.iter().zip(&cloud.single).map(|(name, of)| cells(&format!("{name} alone"), of));
    f.write_str(&text_table([head, joint].into_iter().chain(single)))?;
    writeln!(f)
}

fn tell(facts: &SetFacts) -> String {
    let split = facts.split.map_or_else(String::new, |split| format!(" (split {})", split.name()));
    let objects = match facts.n_samples_with_truth {
        0 => "no truth".to_owned(),
        _ => format!("{} objects", facts.n_objects),
    };
    let (n_episodes, n_samples) = (facts.n_episodes, facts.n_samples);
    format!("{}{split}: episodes {n_episodes}, samples {n_samples}, {objects}", facts.dataset.display())
}

fn cells(row: &GapRow) -> [String; 10] {
    let dash = || "–".to_owned();
    let bits = |value: f64| format!("{value:.3}");
    [
        row.name.clone(),
        digits(row.a.mean),
        digits(row.b.mean),
        row.unit.name().to_owned(),
        digits(row.distance.wasserstein),
        row.within_a.map_or_else(dash, |within| digits(within.wasserstein)),
        bits(row.distance.jensen_shannon),
        row.interval.map_or_else(dash, |interval| interval.jensen_shannon.map(bits).join(" to ")),
        row.within_a.map_or_else(dash, |within| bits(within.jensen_shannon)),
        match row.is_apart {
            Some(true) => "apart".to_owned(),
            Some(false) => "as A".to_owned(),
            None => String::new(),
        },
    ]
}

/// A number with three digits or so, whatever its size.
fn digits(value: f64) -> String {
    let n_decimals = match value.abs() {
        of if of >= 99.95 => 0,
        of if of >= 9.995 => 1,
        of if of >= 0.9995 => 2,
        _ => 3,
    };
    let text = format!("{value:.n_decimals$}");
    if text.bytes().all(|byte| b"-0.".contains(&byte)) { "0".to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_all_sizes_have_about_three_digits() {
        let told = [0.0, -0.0001, 0.01234, 1.2345, -12.345, 123.45, 12345.6].map(digits);
        assert_eq!(told, ["0", "0", "0.012", "1.23", "-12.3", "123", "12346"]);
    }
}
