//! The most important figures, with the paper's beside them and their confidence intervals.

use super::{ReportError, Side};
use crate::report::chart::{Axis, Chart, Look, Series, Tone, row};
use crate::report::document::{Block, Figure, Tile};
use crate::report::missed;
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
    let alarms =
        sides.iter().filter_map(|side| Some((side.name, side.scores.evaluation.safety.alarms.as_ref()?)));
    let alarms: Vec<missed::NamedAlarms<'_>> = alarms.collect();
    let families = alarms.iter().filter_map(|&set| missed::by_family(set));
    let mut blocks: Vec<Block> = standings.collect();
    blocks.push(Block::Tiles { tiles: sides.iter().flat_map(tiles).collect() });
    blocks.extend(missed::table(&alarms).into_iter().chain(families).map(Block::Table));
    blocks.push(Block::Table(score_tables::headline(&evaluations)));
    blocks.push(Block::Figures { figures: sides.iter().map(figure).collect::<Result<_, _>>()? });
    Ok(blocks)
}

fn tiles(side: &Side) -> Vec<Tile> {
    let evaluation = &side.scores.evaluation;
    let mean_ap = |line: &Line| Tile {
        name: format!("mAP, {}", side.short),
        value: ap(line.ours[2]),
        note: format!("the paper's, elsewhere: {}", ap(line.paper[2])),
    };
    let missed = evaluation.safety.alarms.as_ref().and_then(missed::middle).map(|point| {
        let (value, of) = match point.missed_per_event {
            Some(share) => (Some(share), format!("{} events", point.n_events)),
            None => (point.missed_per_sample, format!("{} objects", point.n_harmful)),
        };
        Tile {
            name: format!("harm missed, {}", side.short),
            value: percent(value),
            note: format!("of {of}, at {} false alarms/km", point.max_false_alarms_per_km),
        }
    });
    missed.into_iter().chain(Line::of_evaluation(evaluation).first().map(mean_ap)).collect()
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
