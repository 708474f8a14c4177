//! What the scores mean for a car: missed harm, warnings, steady labels, separation, the zone's edge, weather.

use super::{ReportError, Side};
use crate::eval::safety::{EdgeBand, Safety, Slope};
use crate::eval::{EvalConfig, PerClass};
use crate::object::Harm;
use crate::report::chart::{Axis, Chart, Look, Series, Tone};
use crate::report::document::{Block, Figure};
use crate::report::table::{Cell, Table, number, percent};

/// The section's blocks.
pub fn blocks(sides: &[Side]) -> Result<Vec<Block>, ReportError> {
    let mut blocks = Vec::new();
    for side in sides {
        let evaluation = &side.scores.evaluation;
        let (safety, config) = (&evaluation.safety, &evaluation.metrics.config);
        blocks.push(Block::heading(side.name));
        blocks.extend(alarms(safety, config));
        blocks.extend(steadiness(safety));
        blocks.extend(early(safety));
        blocks.extend(separation(safety));
        let mut figures = Vec::new();
        if !safety.zone_edge.is_empty() {
            figures.push(zone_edge(&safety.zone_edge)?);
        }
        let weathers = [
            ("Recall in haze and fog", "extinction, ln 20 / MOR, 1/m", &safety.fog_slope),
            ("Recall in rain", "rain rate, mm/h", &safety.rain_slope),
        ];
        for (title, x_name, slopes) in weathers {
            figures.extend(slope(title, x_name, slopes)?);
        }
        if !figures.is_empty() {
            blocks.push(Block::Figures { figures });
        }
    }
    Ok(blocks)
}

fn alarms(safety: &Safety, config: &EvalConfig) -> Option<Block> {
    let alarms = safety.alarms.as_ref()?;
    let head =
        ["false alarms/km, at most", "score", "false alarms/km", "missed, of objects", "missed, of events"];
    let decelerations = config.safety.decelerations_mps2.iter();
    let warned = decelerations.map(|deceleration| format!("warned in time, {deceleration} m/s²"));
    let head = head.map(str::to_owned).into_iter().chain(warned);
    let rows = alarms.points.iter().map(|point| {
        let of = |share: Option<f64>, n: usize| Cell { text: percent(share), below: vec![format!("of {n}")] };
        let mut cells = vec![
            point.max_false_alarms_per_km.to_string().into(),
            number(point.score, 3).into(),
            format!("{:.1}", point.false_alarms_per_km).into(),
            of(point.missed_per_sample, point.n_harmful),
            of(point.missed_per_event, point.n_events),
        ];
        cells.extend(point.warned.iter().map(|warned| of(warned.in_time, warned.n_stoppable)));
        cells
    });
    let note = format!(
        "{:.2} km driven. An event is a run of samples in which one object is harmful. A warning is confirmed by {} of {} \
         samples, and in time if the car, after {} s, can still stop before the object.",
        alarms.driven_km, config.safety.confirm_n, config.safety.confirm_of, config.safety.reaction_time_s
    );
    Some(Block::Table(Table::new(head, rows.collect()).with_note(note)))
}

fn steadiness(safety: &Safety) -> Option<Block> {
    let steady = safety.steadiness.as_ref()?;
    let row = |name: &str, per_s, n: usize| vec![name.into(), number(per_s, 3).into(), n.to_string().into()];
    let rows = vec![
        row("true label", steady.true_flips_per_s, steady.n_true_flips),
        row("detector's label", steady.flips_per_s, steady.n_flips),
        row("detector's, the true one unchanged", steady.spurious_flips_per_s, steady.n_spurious_flips),
    ];
    let note = format!(
        "Objects located in two samples in a row: {} pairs, {:.0} s.",
        steady.n_pairs, steady.tracked_s
    );
    Some(Block::Table(Table::new(["label changes", "a second", "count"], rows).with_note(note)))
}

fn early(safety: &Safety) -> Option<Block> {
    let early = safety.early.as_ref()?;
    let rows = early.within.iter().map(|share| {
        let boxes = Cell { text: percent(share.share), below: vec![format!("of {}", share.n_boxes)] };
        let samples = if share.n_later == 1 { "sample" } else { "samples" };
        let name = format!("within {} {samples}", share.n_later);
        vec![name.into(), boxes, percent(share.share_of_harmless).into()]
    });
    let head = ["object turns harmful", "false-harmful boxes", "all harmless objects"];
    let note = "A false alarm on an object that is harmful a moment later was only early.";
    Some(Block::Table(Table::new(head, rows.collect()).with_note(note)))
}

fn separation(safety: &Safety) -> Option<Block> {
    let by = &safety.separation;
    let rows: Vec<Vec<Cell>> = [("all objects", &by.all), ("ID objects", &by.id), ("OOD objects", &by.ood)]
        .into_iter()
        .filter_map(|(name, separation)| {
            let separation = separation.as_ref()?;
            let figures = [separation.auroc, separation.aupr, separation.fpr95];
            let counts = format!("{} / {}", separation.n_harmful, separation.n_harmless);
            let figures = figures.map(|value| number(Some(value), 3).into());
            Some([name.into(), counts.into()].into_iter().chain(figures).collect())
        })
        .collect();
    let head = ["harmful against harmless", "objects", "AUROC", "AUPR", "FPR95"];
    let note = "Of objects that a detection lies on, by the harmful share of its scores.";
    (!rows.is_empty()).then(|| Block::Table(Table::new(head, rows).with_note(note)))
}

/// Shares over bands of the signed distance to the zone's edge.
fn zone_edge(bands: &[EdgeBand]) -> Result<Figure, ReportError> {
    let points = |value: fn(&EdgeBand) -> Option<f64>| -> Vec<(f64, f64)> {
        bands.iter().enumerate().filter_map(|(i, band)| Some((i as f64 + 0.5, value(band)?))).collect()
    };
    let series = |name: &str, tone, look, value| Series::new(name, tone, look, points(value));
    let edges =
        bands.iter().enumerate().filter_map(|(i, band)| Some(((i + 1) as f64, band.to_m?.to_string())));
    let x = Axis::new("signed distance to the zone's edge, m", 0.0, bands.len() as f64, edges.collect());
    let series = vec![
        series("harmful in truth", Tone::Ink, Look::Dashed, |band| band.harmful_share),
        series("called harmful", Tone::Harmful, Look::LineAndDots, |band| band.called_harmful_share),
        series("mean harm probability", Tone::Amber, Look::LineAndDots, |band| band.mean_harm_probability),
    ];
    let chart = Chart::new("Across the zone's edge", x, Axis::share("share of located objects"), series, 340);
    let caption = "Left of 0 the object reaches into the zone. Points stand in the middle of their band.";
    Ok(Figure::new(&chart)?.with_caption(caption))
}

/// Recall of the groups and the line through all truths; nothing where the weather is not known.
fn slope(title: &str, x_name: &str, slopes: &PerClass<Option<Slope>>) -> Result<Option<Figure>, ReportError> {
    let mut series = Vec::new();
    let mut told = Vec::new();
    let mut high = 0.0;
    for class in Harm::ALL {
        let Some(slope) = slopes.get(class) else { continue };
        let tone = if class == Harm::Harmful { Tone::Harmful } else { Tone::Harmless };
        let points: Vec<(f64, f64)> = slope.points.iter().map(|point| (point.x, point.recall)).collect();
        let ends = [points.first(), points.last()].map(|end| end.map_or(0.0, |end| end.0));
        high = f64::max(high, ends[1]);
        let line = ends.map(|x| (x, (slope.intercept + slope.slope * x).clamp(0.0, 1.0)));
        series.push(Series::new(class.name(), tone, Look::Dots, points));
        series.push(Series::new("", tone, Look::Dashed, line.into()));
        told.push(format!("{} {:+.4} a unit", class.name(), slope.slope));
    }
    if series.is_empty() {
        return Ok(None);
    }
    let (x, y) = (Axis::over(x_name, 0.0, 1.04 * high), Axis::share("recall"));
    let caption = format!("Least squares through every truth: {}.", told.join(", "));
    Ok(Some(Figure::new(&Chart::new(title, x, y, series, 320))?.with_caption(caption)))
}
