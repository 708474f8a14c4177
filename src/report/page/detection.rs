//! Precision over recall, AP at each distance, errors of the found boxes, and the outcomes of detections.

use super::{ReportError, Side};
use crate::eval::{Column, Curve, Metrics, Mode};
use crate::object::Harm;
use crate::report::chart::{Axis, Chart, Look, Series, Tone};
use crate::report::document::{Block, Figure};
use crate::report::score_tables;
use crate::report::table::{Table, ap};

/// Distance of the recall steps of a [`Curve`].
const STEP: f64 = 0.01;

/// Columns in the order of their tones.
const COLUMNS: [(Column, &str); 4] = [
    (Column::Total, "total"),
    (Column::IdMatched, "ID, matched FPs"),
    (Column::OodAll, "OOD, all FPs"),
    (Column::OodMatched, "OOD, matched FPs"),
];

/// The section's blocks.
pub fn blocks(sides: &[Side]) -> Result<Vec<Block>, ReportError> {
    let mut blocks = Vec::new();
    for side in sides {
        let metrics = &side.scores.evaluation.metrics;
        blocks.push(Block::heading(side.name));
        let mut figures = Vec::new();
        for class in Harm::ALL {
            figures.push(by_distance(metrics, class)?);
        }
        if metrics.mode == Mode::Ood {
            for class in Harm::ALL {
                figures.push(by_column(metrics, class)?);
            }
        }
        blocks.push(Block::Figures { figures });
        blocks.push(per_threshold(metrics));
        blocks.push(Block::Table(score_tables::errors(metrics)));
        blocks.push(Block::Table(score_tables::counts(metrics)));
        blocks.extend(score_tables::neutral(metrics).map(Block::Table));
    }
    Ok(blocks)
}

/// The curve up to the recall that is reached.
fn points(curve: &Curve) -> Vec<(f64, f64)> {
    let last = curve.confidence.iter().rposition(|&confidence| confidence != 0.0);
    let n = last.map_or(0, |last| last + 1);
    curve.precision.iter().take(n).enumerate().map(|(i, &precision)| (i as f64 * STEP, precision)).collect()
}

fn figure(title: &str, series: Vec<Series>) -> Result<Figure, ReportError> {
    let chart = Chart::new(title, Axis::share("recall"), Axis::share("precision"), series, 340);
    Ok(Figure::new(&chart)?)
}

fn by_distance(metrics: &Metrics, class: Harm) -> Result<Figure, ReportError> {
    let curves = metrics.curves.total.get(class);
    let aps = metrics.per_threshold.total.get(class);
    let of_threshold = |(i, threshold_m): (usize, &f64)| {
        let (curve, value) = (curves.get(i)?, aps.get(i)?);
        let name = format!("{threshold_m} m, AP {}", ap(*value));
        let tone = Tone::ROW[i % Tone::ROW.len()];
        Some(Series::new(name, tone, Look::Line, points(curve)))
    };
    let series = metrics.config.dist_thresholds_m.iter().enumerate().filter_map(of_threshold).collect();
    figure(&format!("{}, by centre distance", class.name()), series)
}

fn by_column(metrics: &Metrics, class: Harm) -> Result<Figure, ReportError> {
    let config = &metrics.config;
    let at = config.dist_thresholds_m.iter().position(|&threshold_m| threshold_m == config.tp_threshold_m);
    let of_column = |(i, (column, name)): (usize, (Column, &str))| {
        let curve = metrics.curves.get(column)?.get(class).get(at?)?;
        let value = metrics.per_threshold.get(column)?.get(class).get(at?)?;
        let name = format!("{name}, AP {}", ap(*value));
        Some(Series::new(name, Tone::ROW[i], Look::Line, points(curve)))
    };
    let series = COLUMNS.into_iter().enumerate().filter_map(of_column).collect();
    figure(&format!("{} at {} m, by column", class.name(), config.tp_threshold_m), series)
}

fn per_threshold(metrics: &Metrics) -> Block {
    let thresholds = &metrics.config.dist_thresholds_m;
    let head = std::iter::once("AP at".to_owned());
    let head = head.chain(thresholds.iter().map(|threshold_m| format!("{threshold_m} m")));
    let mut rows = Vec::new();
    for (column, name) in COLUMNS {
        let Some(aps) = metrics.per_threshold.get(column) else { continue };
        for class in Harm::ALL {
            let cells = aps.get(class).iter().map(|&value| ap(value).into());
            rows.push(std::iter::once(format!("{name}: {}", class.name()).into()).chain(cells).collect());
        }
    }
    Block::Table(Table::new(head, rows))
}
