//! Scores by group: a chart and a table for each axis.

use super::{ReportError, Side};
use crate::eval::Breakdown;
use crate::object::Harm;
use crate::report::chart::{Axis, Chart, Look, Series, Tone, row};
use crate::report::document::{Block, Figure};
use crate::report::score_tables::{self, title, to_words};

/// The section's blocks.
pub fn blocks(sides: &[Side]) -> Result<Vec<Block>, ReportError> {
    let mut blocks = Vec::new();
    for side in sides {
        let evaluation = &side.scores.evaluation;
        blocks.push(Block::heading(side.name));
        blocks.push(Block::text(score_tables::terms(&evaluation.metrics)));
        for breakdown in &evaluation.breakdowns {
            let figures = vec![Figure::new(&chart(breakdown))?];
            let table = Block::Table(score_tables::groups(breakdown));
            blocks.push(Block::fold(title(breakdown.axis), vec![Block::Figures { figures }, table]));
        }
    }
    Ok(blocks)
}

fn chart(breakdown: &Breakdown) -> Chart {
    let names: Vec<String> = breakdown.groups.iter().map(|group| to_words(&group.name)).collect();
    let series = Harm::ALL.map(|class| {
        // The two classes lie a little above and below their row.
        let (tone, shift) =
            if class == Harm::Harmful { (Tone::Harmful, 0.13) } else { (Tone::Harmless, -0.13) };
        let groups = breakdown.groups.iter().enumerate();
        let point = |(i, group): (usize, &crate::eval::Group)| {
            Some((group.classes.get(class).ap?, row(i, names.len()) + shift))
        };
        Series::new(class.name(), tone, Look::Dots, groups.filter_map(point).collect())
    });
    let series = series.into_iter().filter(|series| !series.points.is_empty()).collect();
    let height_px = 84 + 26 * names.len() as u32;
    Chart::new(title(breakdown.axis), Axis::share("AP"), Axis::rows(&names), series, height_px)
}
