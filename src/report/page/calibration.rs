//! Whether scores are honest probabilities: reliability diagrams, ECE and Brier score.

use super::{ReportError, Side};
use crate::eval::safety::Calibration;
use crate::report::chart::{Axis, Chart, Look, Series, Tone};
use crate::report::document::{Block, Figure};
use crate::report::table::number;

/// The section's blocks.
pub fn blocks(sides: &[Side]) -> Result<Vec<Block>, ReportError> {
    let mut blocks = vec![Block::text(
        "A point on the diagonal is honest: of detections with a score of 0.7, seven in ten are right. ECE is the mean \
         distance from the diagonal, weighed by how many fall into each bin; Brier is the mean squared error.",
    )];
    for side in sides {
        let safety = &side.scores.evaluation.safety;
        let mut figures = Vec::new();
        if let Some(detections) = &safety.detection_calibration {
            let lines = [
                ("harmful", Tone::Harmful, &detections.harmful),
                ("harmless", Tone::Harmless, &detections.harmless),
            ];
            figures.extend(diagram(&format!("Score of detections, {}", side.short), "score", &lines)?);
        }
        let harm = &safety.harm_calibration;
        let lines = [
            ("all objects", Tone::Ink, &harm.all),
            ("ID objects", Tone::Harmless, &harm.id),
            ("OOD objects", Tone::Amber, &harm.ood),
        ];
        figures.extend(diagram(&format!("Probability of harm, {}", side.short), "probability", &lines)?);
        blocks.push(Block::heading(side.name));
        if !figures.is_empty() {
            blocks.push(Block::Figures { figures });
        }
    }
    Ok(blocks)
}

/// `None` if there is nothing to show.
fn diagram(
    title: &str,
    x_name: &str,
    lines: &[(&str, Tone, &Calibration)],
) -> Result<Option<Figure>, ReportError> {
    let of_line = |&(name, tone, calibration): &(&str, Tone, &Calibration)| {
        let bins = calibration.bins.iter();
        let points: Vec<_> = bins.filter_map(|bin| bin.mean_probability.zip(bin.frequency)).collect();
        let name = format!("{name}, ECE {}", number(calibration.ece, 3));
        (!points.is_empty()).then_some(Series::new(name, tone, Look::LineAndDots, points))
    };
    let mut series: Vec<Series> = lines.iter().filter_map(of_line).collect();
    if series.is_empty() {
        return Ok(None);
    }
    let diagonal = vec![(0.0, 0.0), (1.0, 1.0)];
    series.insert(0, Series::new("honest", Tone::Soft, Look::Dashed, diagonal));
    let (x, y) = (Axis::share(x_name), Axis::share("share that is so"));
    Ok(Some(Figure::new(&Chart::new(title, x, y, series, 380))?))
}
