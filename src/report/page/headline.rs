//! The most important figures, with the paper's beside them and their confidence intervals.

use super::{ReportError, Side};
use crate::report::chart::{Axis, Chart, Look, Series, Tone, row};
use crate::report::document::{Block, Figure, Tile};
use crate::report::paper::{Line, PARTS};
use crate::report::score_tables;
use crate::report::table::{ap, percent};

/// The section's blocks.
pub fn blocks(sides: &[Side]) -> Result<Vec<Block>, ReportError> {
    let evaluations: Vec<_> = sides.iter().map(|side| &side.scores.evaluation).collect();
    let standings = sides.iter().filter_map(|side| {
        let standing = side.scores.provenance.as_ref()?.standing()?;
        Some(Block::text(format!("{}: {standing}", side.name)))
    });
    let blocks = vec![
        Block::Tiles { tiles: sides.iter().flat_map(tiles).collect() },
        Block::Table(score_tables::headline(&evaluations)),
        Block::Figures { figures: sides.iter().map(figure).collect::<Result<_, _>>()? },
    ];
    Ok(standings.chain(blocks).collect())
}

fn tiles(side: &Side) -> Vec<Tile> {
    let evaluation = &side.scores.evaluation;
    let mean_ap = |line: &Line| Tile {
        name: format!("mAP, {}", side.short),
        value: ap(line.ours[2]),
        note: format!("the paper's, elsewhere: {}", ap(line.paper[2])),
    };
    // The middle one of the false alarms asked for.
    let points = evaluation.safety.alarms.as_ref().map_or(&[][..], |alarms| &alarms.points);
    let missed = points.get(points.len() / 2).map(|point| Tile {
        name: format!("harm missed, {}", side.short),
        value: percent(point.missed_per_sample),
        note: format!("of {} objects, at {} false alarms/km", point.n_harmful, point.max_false_alarms_per_km),
    });
    Line::of_evaluation(evaluation).first().map(mean_ap).into_iter().chain(missed).collect()
}

/// Our figure with its interval, and the paper's.
fn figure(side: &Side) -> Result<Figure, ReportError> {
    let lines = Line::of_evaluation(&side.scores.evaluation);
    let names: Vec<String> =
        lines.iter().flat_map(|line| PARTS.map(|part| format!("{}, {part}", line.short))).collect();
    let (mut ours, mut paper, mut strokes) = (Vec::new(), Vec::new(), Vec::new());
    for (i, line) in lines.iter().enumerate() {
        for part in 0..PARTS.len() {
            let y = row(i * PARTS.len() + part, names.len());
            ours.extend(line.ours[part].map(|ap| (ap, y)));
            paper.push((line.paper[part], y));
            strokes.extend(line.intervals[part].into_iter().flatten().map(|x| (x, y)));
        }
    }
    let series = [
        Series::new("95 % interval", Tone::Harmless, Look::Strokes, strokes),
        Series::new("the paper's, elsewhere", Tone::Soft, Look::Diamonds, paper),
        Series::new("this detector", Tone::Harmless, Look::Dots, ours),
    ];
    let series = series.into_iter().filter(|series| !series.points.is_empty()).collect();
    let title = format!("{}: beside the paper", side.name);
    let height_px = 84 + 24 * names.len() as u32;
    Ok(Figure::new(&Chart::new(title, Axis::share("AP"), Axis::rows(&names), series, height_px))?)
}
