//! What the scores mean for a car: missed harm, warnings, steady labels, separation, the zone's edge, weather.

use super::{ReportError, Side};
use crate::eval::PerClass;
use crate::eval::safety::{EdgeBand, Slope};
use crate::object::Harm;
use crate::report::chart::{Axis, Chart, Look, Series, Tone};
use crate::report::document::{Block, Figure};
use crate::report::score_tables;

/// The section's blocks.
pub fn blocks(sides: &[Side]) -> Result<Vec<Block>, ReportError> {
    let mut blocks = Vec::new();
    for side in sides {
        let evaluation = &side.scores.evaluation;
        let safety = &evaluation.safety;
        blocks.push(Block::heading(side.name));
        blocks.extend(score_tables::safety(evaluation).into_iter().map(Block::Table));
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

/// Recall of the groups and the line through all truths; nothing if the weather is not known.
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
