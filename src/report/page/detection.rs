//! Precision over recall, AP at each distance, errors of what was found, and what became of detections.

use super::model::{Block, Figure, Table, ap, number};
use super::plot::{Axis, Chart, Look, Series, Tone};
use super::{ReportError, Side};
use crate::eval::{Column, Curve, Metrics, Mode};
use crate::object::Harm;

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
        blocks.push(errors(metrics));
        blocks.push(outcomes(metrics));
    }
    Ok(blocks)
}

/// The curve up to the recall that is reached.
fn points(curve: &Curve) -> Vec<(f64, f64)> {
    let last = curve.confidence.iter().rposition(|&confidence| confidence != 0.0);
    let n = last.map_or(0, |last| last + 1);
    curve.precision.iter().take(n).enumerate().map(|(i, &precision)| (i as f64 * STEP, precision)).collect()
}

fn chart(series: Vec<Series>) -> Chart {
    Chart { x: Axis::share("recall"), y: Axis::share("precision"), series, height_px: 340 }
}

fn by_distance(metrics: &Metrics, class: Harm) -> Result<Figure, ReportError> {
    let curves = metrics.curves.total.get(class);
    let aps = metrics.per_threshold.total.get(class);
    let of_threshold = |(i, threshold_m): (usize, &f64)| {
        let (curve, value) = (curves.get(i)?, aps.get(i)?);
        let name = format!("{threshold_m} m, AP {}", ap(*value));
        let tone = Tone::ROW[i % Tone::ROW.len()];
        Some(Series { name, tone, look: Look::Line, points: points(curve) })
    };
    let series = metrics.config.dist_thresholds_m.iter().enumerate().filter_map(of_threshold).collect();
    Figure::new(format!("{}, by centre distance", class.name()), &chart(series))
}

fn by_column(metrics: &Metrics, class: Harm) -> Result<Figure, ReportError> {
    let config = &metrics.config;
    let at = config.dist_thresholds_m.iter().position(|&threshold_m| threshold_m == config.tp_threshold_m);
    let of_column = |(i, (column, name)): (usize, (Column, &str))| {
        let curve = metrics.curves.get(column)?.get(class).get(at?)?;
        let value = metrics.per_threshold.get(column)?.get(class).get(at?)?;
        let name = format!("{name}, AP {}", ap(*value));
        Some(Series { name, tone: Tone::ROW[i], look: Look::Line, points: points(curve) })
    };
    let series = COLUMNS.into_iter().enumerate().filter_map(of_column).collect();
    Figure::new(format!("{} at {} m, by column", class.name(), config.tp_threshold_m), &chart(series))
}

fn per_threshold(metrics: &Metrics) -> Block {
    let thresholds = &metrics.config.dist_thresholds_m;
    let head: Vec<String> = std::iter::once("AP at".to_owned())
        .chain(thresholds.iter().map(|threshold_m| format!("{threshold_m} m")))
        .collect();
    let mut rows = Vec::new();
    for (column, name) in COLUMNS {
        let Some(aps) = metrics.per_threshold.get(column) else { continue };
        for class in Harm::ALL {
            let cells = aps.get(class).iter().map(|&value| ap(value).into());
            rows.push(std::iter::once(format!("{name}: {}", class.name()).into()).chain(cells).collect());
        }
    }
    Block::Table(Table { head, rows, note: String::new() })
}

fn errors(metrics: &Metrics) -> Block {
    let rows = Harm::ALL.map(|class| {
        let errors = metrics.tp_errors.get(class);
        let values = [errors.ate, errors.ase, errors.aoe].map(|value| number(Some(value), 3).into());
        std::iter::once(class.name().into()).chain(values).collect()
    });
    let note = format!("Mean errors of what was found at {} m.", metrics.config.tp_threshold_m);
    Block::Table(Table::new(&["errors", "ATE m", "ASE", "AOE rad"], rows.into()).with_note(note))
}

fn outcomes(metrics: &Metrics) -> Block {
    let config = &metrics.config;
    let at = config.dist_thresholds_m.iter().position(|&threshold_m| threshold_m == config.tp_threshold_m);
    let rows = Harm::ALL.into_iter().filter_map(|class| {
        let counts = metrics.counts.outcomes.get(class).get(at?)?;
        let cells = [
            metrics.counts.truths.get(class).all,
            *metrics.counts.detections.get(class),
            counts.matched,
            counts.misclassified,
            counts.unmatched,
        ];
        let cells = cells.map(|n| n.to_string().into());
        Some(std::iter::once(class.name().into()).chain(cells).collect())
    });
    let head = ["counts", "truths", "detections", "matched", "other class", "unmatched"];
    let filters = &metrics.filters;
    let note = format!(
        "{} samples; detections of every score, matched at {} m. Dropped at {} m or more: {} truths and {} detections; \
         without a LiDAR point: {} truths.",
        metrics.counts.n_samples,
        config.tp_threshold_m,
        filters.max_range_m,
        filters.truths_out_of_range,
        filters.detections_out_of_range,
        filters.truths_without_points
    );
    Block::Table(Table::new(&head, rows.collect()).with_note(note))
}
