//! The figures that matter most, with the paper's beside, and how sure they are.

use super::model::{Block, Cell, Figure, Table, Tile, ap, percent};
use super::plot::{Axis, Chart, Look, Series, Tone, row};
use super::{ReportError, Side};
use crate::eval::{ClassScores, Column, Evaluation, Intervals, Mode};
use crate::report::table::{self, paper_scores};

/// The classes and their mean, as [`paper_scores`] orders them.
const PARTS: [&str; 3] = ["harmful", "harmless", "mean"];

/// A row of the table: its name, our AP, its intervals, and the paper's.
struct Line {
    name: &'static str,
    ours: [f64; 3],
    intervals: [Option<[f64; 2]>; 3],
    paper: [f64; 3],
}

/// The rows of a side: one in distribution, four out of it.
fn lines(evaluation: &Evaluation) -> Vec<Line> {
    let metrics = &evaluation.metrics;
    let line = |name, column: Column, paper: Option<Column>| {
        let ClassScores { harmful, harmless, mean } = *metrics.columns.get(column)?;
        let confidence = evaluation.confidence.as_ref();
        let intervals = confidence.and_then(|confidence| confidence.columns.get(column).copied());
        let intervals =
            intervals.map_or([None; 3], |Intervals { harmful, harmless, mean }| [harmful, harmless, mean]);
        Some(Line { name, ours: [harmful, harmless, mean], intervals, paper: paper_scores(paper) })
    };
    let all = match metrics.mode {
        Mode::Id => vec![line("ID: mAP", Column::Total, None)],
        Mode::Ood => vec![
            line("OOD set: mAP, total", Column::Total, Some(Column::Total)),
            line("ID objects, matched FPs", Column::IdMatched, Some(Column::IdMatched)),
            line("OOD objects, all FPs", Column::OodAll, Some(Column::OodAll)),
            line("OOD objects, matched FPs", Column::OodMatched, Some(Column::OodMatched)),
        ],
    };
    all.into_iter().flatten().collect()
}

/// The section's blocks.
pub fn blocks(sides: &[Side]) -> Result<Vec<Block>, ReportError> {
    let mut blocks = vec![Block::Tiles { tiles: sides.iter().flat_map(tiles).collect() }, table(sides)];
    let figures = sides.iter().map(|side| figure(side.name, &side.scores.evaluation));
    blocks.push(Block::Figures { figures: figures.collect::<Result<_, _>>()? });
    for side in sides {
        let text = table::table(&side.scores.evaluation.metrics);
        blocks.push(Block::fold(&format!("{}: as text", side.name), vec![Block::Code { text }]));
    }
    Ok(blocks)
}

fn tiles(side: &Side) -> Vec<Tile> {
    let evaluation = &side.scores.evaluation;
    let mut tiles: Vec<Tile> = lines(evaluation)
        .first()
        .map(|line| Tile {
            name: format!("mAP, {}", side.short),
            value: ap(line.ours[2]),
            note: format!("the paper's, elsewhere: {}", ap(line.paper[2])),
        })
        .into_iter()
        .collect();
    // The middle one of the false alarms asked for.
    let points = evaluation.safety.alarms.as_ref().map_or(&[][..], |alarms| &alarms.points);
    if let Some(point) = points.get(points.len() / 2) {
        tiles.push(Tile {
            name: format!("harm missed, {}", side.short),
            value: percent(point.missed_per_sample),
            note: format!(
                "of {} objects, at {} false alarms/km",
                point.n_harmful, point.max_false_alarms_per_km
            ),
        });
    }
    tiles
}

fn table(sides: &[Side]) -> Block {
    let cell = |line: &Line, i: usize| {
        let interval = line.intervals[i].map(|[low, high]| format!("{low:.3}–{high:.3}"));
        let below = interval.into_iter().chain([format!("paper {}", ap(line.paper[i]))]).collect();
        Cell { text: ap(line.ours[i]), below }
    };
    let rows = sides.iter().flat_map(|side| lines(&side.scores.evaluation)).map(|line| {
        let cells = (0..PARTS.len()).map(|i| cell(&line, i));
        std::iter::once(line.name.into()).chain(cells).collect()
    });
    let told = sides.iter().filter_map(|side| {
        let confidence = side.scores.evaluation.confidence.as_ref()?;
        Some(format!("{} episodes {}", confidence.n_episodes, side.short))
    });
    let told = told.collect::<Vec<_>>().join(", ");
    let thresholds = sides.first().map_or_else(String::new, |side| {
        let thresholds = &side.scores.evaluation.metrics.config.dist_thresholds_m;
        thresholds.iter().map(f64::to_string).collect::<Vec<_>>().join(", ")
    });
    let mut note = format!("AP, mean over centre distances of {thresholds} m. ");
    if !told.is_empty() {
        note += &format!("Below: 95 % bootstrap interval over episodes ({told}), then the paper's figure. ");
    }
    note += "The paper's come from another simulator: a yardstick, not the same work.";
    Block::Table(Table::new(&["AP", "harmful", "harmless", "mean"], rows.collect()).with_note(note))
}

/// Ours with its interval, and the paper's.
fn figure(side: &str, evaluation: &Evaluation) -> Result<Figure, ReportError> {
    let lines = lines(evaluation);
    let names: Vec<String> =
        lines.iter().flat_map(|line| PARTS.map(|part| format!("{}, {part}", short(line.name)))).collect();
    let at = |i: usize, part: usize| row(i * PARTS.len() + part, names.len());
    let (mut ours, mut paper, mut strokes) = (Vec::new(), Vec::new(), Vec::new());
    for (i, line) in lines.iter().enumerate() {
        for part in 0..PARTS.len() {
            let y = at(i, part);
            ours.push((line.ours[part], y));
            paper.push((line.paper[part], y));
            strokes.extend(line.intervals[part].into_iter().flatten().map(|x| (x, y)));
        }
    }
    let series = |name: &str, tone, look, points| Series { name: name.to_owned(), tone, look, points };
    let chart = Chart {
        x: Axis::share("AP"),
        y: Axis::rows(&names),
        height_px: 84 + 24 * names.len() as u32,
        series: vec![
            series("95 % interval", Tone::Harmless, Look::Strokes, strokes),
            series("the paper's, elsewhere", Tone::Soft, Look::Diamonds, paper),
            series("this detector", Tone::Harmless, Look::Dots, ours),
        ]
        .into_iter()
        .filter(|series| !series.points.is_empty())
        .collect(),
    };
    Figure::new(format!("{side}: beside the paper"), &chart)
}

fn short(name: &str) -> &str {
    match name {
        "OOD set: mAP, total" => "total",
        "ID objects, matched FPs" => "ID matched",
        "OOD objects, all FPs" => "OOD all",
        "OOD objects, matched FPs" => "OOD matched",
        _ => "ID",
    }
}
