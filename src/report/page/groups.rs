//! Scores by group: a chart and a table for each axis.

use super::model::{Block, Cell, Figure, Table, number};
use super::plot::{Axis, Chart, Look, Series, Tone, row};
use super::{ReportError, Side};
use crate::eval::{self, Breakdown, GroupScores};
use crate::object::Harm;

/// The section's blocks.
pub fn blocks(sides: &[Side]) -> Result<Vec<Block>, ReportError> {
    let mut blocks = Vec::new();
    for side in sides {
        let evaluation = &side.scores.evaluation;
        let config = &evaluation.metrics.config;
        blocks.push(Block::heading(side.name));
        blocks.push(Block::text(format!(
            "Found, called the other class and missed, in percent of the truths, at {} m with a score of {} or more.",
            config.tp_threshold_m, config.operating_score
        )));
        for breakdown in &evaluation.breakdowns {
            blocks.push(Block::fold(title(breakdown.axis), of_axis(breakdown)?));
        }
    }
    Ok(blocks)
}

/// An axis as a person names it.
fn title(axis: eval::Axis) -> &'static str {
    match axis {
        eval::Axis::Distribution => "In and out of distribution",
        eval::Axis::Kind => "Kind of object",
        eval::Axis::IdCategory => "Family, in distribution",
        eval::Axis::OodCategory => "Family, out of distribution",
        eval::Axis::RangeM => "Range, m",
        eval::Axis::VisibleFraction => "Visible share",
        eval::Axis::NLidarPoints => "LiDAR points",
        eval::Axis::Event => "Event",
        eval::Axis::ZoneDistanceM => "Distance to the zone's edge, m",
        eval::Axis::Town => "Town",
        eval::Axis::Weather => "Weather",
        eval::Axis::SpeedMps => "Speed, m/s",
        eval::Axis::SteeringDeg => "Steering, degrees",
    }
}

fn of_axis(breakdown: &Breakdown) -> Result<Vec<Block>, ReportError> {
    let names: Vec<String> = breakdown.groups.iter().map(|group| spoken(&group.name)).collect();
    // The two classes lie a little above and below their row.
    let points = |class: Harm| -> Vec<(f64, f64)> {
        let shift = if class == Harm::Harmful { 0.13 } else { -0.13 };
        let groups = breakdown.groups.iter().enumerate();
        groups
            .filter_map(|(i, group)| Some((group.classes.get(class).ap?, row(i, names.len()) + shift)))
            .collect()
    };
    let series = Harm::ALL.map(|class| Series {
        name: class.name().to_owned(),
        tone: if class == Harm::Harmful { Tone::Harmful } else { Tone::Harmless },
        look: Look::Dots,
        points: points(class),
    });
    let chart = Chart {
        x: Axis::share("AP"),
        y: Axis::rows(&names),
        series: series.into_iter().filter(|series| !series.points.is_empty()).collect(),
        height_px: 84 + 26 * names.len() as u32,
    };
    let of = if breakdown.axis.is_of_samples() {
        "Scores of the samples of each group alone, all false positives included."
    } else {
        "Scores on the objects of each group; false positives on nothing count in none."
    };
    let rows = breakdown.groups.iter().map(|group| {
        let start = [spoken(&group.name).into(), group.n_samples.to_string().into()];
        let cells = Harm::ALL.into_iter().flat_map(|class| cells(group.classes.get(class)));
        start.into_iter().chain(cells).collect()
    });
    let of_class = |class: &str| -> [String; 6] {
        ["truths", "AP", "found", "other", "missed", "false"].map(|what| format!("{class} {what}"))
    };
    let head = ["group".to_owned(), "samples".to_owned()].into_iter();
    let head = head.chain(of_class("harmful")).chain(of_class("harmless")).collect();
    let table = Table { head, rows: rows.collect(), note: of.to_owned() };
    Ok(vec![
        Block::Figures { figures: vec![Figure::new(title(breakdown.axis), &chart)?] },
        Block::Table(table),
    ])
}

fn cells(scores: &GroupScores) -> [Cell; 6] {
    let share = |n: usize| match scores.n_truths {
        0 => "–".into(),
        n_truths => format!("{:.0}", 100.0 * n as f64 / n_truths as f64).into(),
    };
    [
        scores.n_truths.to_string().into(),
        number(scores.ap, 3).into(),
        share(scores.n_found),
        share(scores.n_misclassified),
        share(scores.n_missed),
        scores.n_false.to_string().into(),
    ]
}

/// A name of the files as words.
pub fn spoken(name: &str) -> String {
    name.replace('_', " ")
}
