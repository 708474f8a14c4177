//! Closed-loop drives: who avoids what, at how many false stops, what open-loop figures say of it, and the worst cases.

use super::strips::worst_cases;
use super::{ReportError, Side};
use crate::eval::judge::Judge;
use crate::eval::safety::{Alarms, OperatingPoint};
use crate::outcome::{
    DriveSummary, Figures, GroupFigures, Measure, Source, drive_rows, impact_rows, share_lines,
};
use crate::report::chart::{Axis, Chart, Look, Series, Tone, row};
use crate::report::document::{Block, Figure};
use crate::report::score_tables::to_words;
use crate::report::standing::Standing;
use crate::report::table::Table;
use std::path::Path;

/// Axes of groups that are drawn.
const AXES: [(&str, &str); 6] = [
    ("family", "By scenario family"),
    (
        "distribution",
        "By what blind runs into: familiar (id), unfamiliar (ood), unannotated (background), built in (scenery)",
    ),
    ("hit by blind", "By kind of what blind runs into"),
    ("event", "By what happens to what blind runs into"),
    ("weather", "By weather"),
    ("town", "By town"),
];
/// Groups with fewer episodes in which something could be avoided are left out.
const LEAST_AVOIDABLE: usize = 2;
/// Fewer drivers have no correlation.
const LEAST_CORRELATED: usize = 3;

/// What figures of drives may be used for.
#[must_use]
pub fn standing(summary: &DriveSummary) -> Standing {
    Standing { split: Some(summary.split), data_version: 2 }
}

/// The section's blocks; at most `n_cases` worst cases of each driver.
pub fn blocks(
    (folder, summary): (&Path, &DriveSummary),
    sides: &[Side],
    n_cases: usize,
) -> Result<Vec<Block>, ReportError> {
    let mut blocks = vec![Block::text(standing(summary).to_string())];
    blocks.push(Block::Table(to_table(drive_rows(&summary.figures)).with_note(
        "A false stop is a brake above 3 m/s² with nothing truly harmful ahead. docs/drive.md says what is counted.",
    )));
    blocks.extend(share_lines(&summary.figures).into_iter().map(Block::text));
    blocks.push(Block::Table(
        to_table(impact_rows(&summary.figures))
            .with_note("Collisions by the closing speed along the contact."),
    ));
    let mut figures: Vec<Figure> = trade_off(&summary.figures)?.into_iter().collect();
    for (axis, title) in AXES {
        figures.extend(by_group(&summary.figures, axis, title)?);
    }
    for (axis, title) in [("weather", "False stops by weather"), ("town", "False stops by town")] {
        figures.extend(false_stops_by_group(&summary.figures, axis, title)?);
    }
    if !figures.is_empty() {
        blocks.push(Block::Figures { figures });
    }
    blocks.extend(open_loop(summary, sides)?);
    blocks.extend(worst_cases(folder, summary, n_cases)?);
    Ok(blocks)
}

fn to_table(mut rows: Vec<Vec<String>>) -> Table {
    let head = rows.remove(0);
    Table::new(head, rows.into_iter().map(|row| row.into_iter().map(Into::into).collect()).collect())
}

fn avoided(figures: &Figures) -> Option<f64> {
    figures.avoided_share.or(figures.avoided_of_all_share).and_then(|share| share.value)
}

/// Avoided collisions over false stops, a point a driver.
fn trade_off(figures: &[Figures]) -> Result<Option<Figure>, ReportError> {
    let point = |of: &Figures| Some((of.false_stops_per_km.value?, avoided(of)?));
    let points: Vec<(f64, f64)> = figures.iter().filter_map(point).collect();
    if points.len() < 2 {
        return Ok(None);
    }
    let most = points.iter().map(|point| point.0).fold(1.0, f64::max);
    let (x, y) = (Axis::over("false stops a km", 0.0, 1.15 * most), Axis::share("avoided"));
    let series = vec![Series::new("", Tone::Harmful, Look::Dots, points)];
    let mut chart = Chart::new("Collisions avoided and false stops", x, y, series, 320);
    let names = figures.iter().filter_map(|of| Some((point(of)?, of.who.name.clone())));
    chart.texts = names.collect();
    Ok(Some(Figure::new(&chart)?.with_caption("Better is up and to the left.")))
}

/// The drivers that are tested: all but the floor and the ceiling.
fn tested(figures: &[Figures]) -> Vec<&Figures> {
    figures.iter().filter(|of| !matches!(of.who.source, Source::Blind | Source::Truth)).collect()
}

/// The share avoided in each group.
fn by_group(figures: &[Figures], axis: &str, title: &str) -> Result<Option<Figure>, ReportError> {
    let tested = tested(figures);
    let Some(first) = tested.first().filter(|of| of.avoided_of_all_share.is_some()) else { return Ok(None) };
    let is_drawn = |group: &&GroupFigures| group.n_avoidable >= LEAST_AVOIDABLE && !group.name.is_empty();
    let rows: Vec<(&str, String)> = groups_of(first, axis)
        .iter()
        .filter(is_drawn)
        .map(|group| (group.name.as_str(), format!("{} ({})", to_words(&group.name), group.n_avoidable)))
        .collect();
    // What older rules wrote has no intervals.
    let counted = |group: &GroupFigures| Measure {
        value: Some(group.n_avoided as f64 / group.n_avoidable as f64),
        interval: group.avoided_share.and_then(|share| share.interval),
    };
    in_rows(&tested, axis, title, Axis::share("avoided"), &rows, &counted)
}

/// The false stops in each group, where they are known with their intervals.
fn false_stops_by_group(figures: &[Figures], axis: &str, title: &str) -> Result<Option<Figure>, ReportError> {
    let tested = tested(figures);
    let Some(first) = tested.first() else { return Ok(None) };
    let rate = |group: &GroupFigures| group.false_stops_per_km.unwrap_or_default();
    let is_drawn = |group: &&GroupFigures| !group.name.is_empty() && rate(group).value.is_some();
    let rows: Vec<(&str, String)> = groups_of(first, axis)
        .iter()
        .filter(is_drawn)
        .map(|group| (group.name.as_str(), format!("{} ({:.1} km)", to_words(&group.name), group.driven_km)))
        .collect();
    if rows.len() < 2 {
        return Ok(None);
    }
    let ends = tested.iter().flat_map(|of| groups_of(of, axis)).map(rate);
    let highest = 1.5 * ends.filter_map(|of| of.value).fold(1.0, f64::max);
    // A group of few kilometres has an interval longer than the picture.
    let drawn = |group: &GroupFigures| {
        let Measure { value, interval } = rate(group);
        Measure { value, interval: interval.map(|ends| ends.map(|end| end.min(highest))) }
    };
    in_rows(&tested, axis, title, Axis::over("false stops a km", 0.0, highest), &rows, &drawn)
}

fn groups_of<'a>(of: &'a Figures, axis: &str) -> &'a [GroupFigures] {
    of.groups.get(axis).map_or(&[], Vec::as_slice)
}

/// A row a group, and in it a dot a driver with its interval.
fn in_rows(
    tested: &[&Figures],
    axis: &str,
    title: &str,
    x: Axis,
    rows: &[(&str, String)],
    measure: &dyn Fn(&GroupFigures) -> Measure,
) -> Result<Option<Figure>, ReportError> {
    if rows.is_empty() {
        return Ok(None);
    }
    let n_drawn = tested.len().min(Tone::ROW.len());
    let mut series = Vec::new();
    for (i, of) in tested.iter().take(n_drawn).enumerate() {
        // Drivers lie a little above and below their row.
        let shift = 0.12 * ((n_drawn - 1) as f64 / 2.0 - i as f64);
        let (mut dots, mut ends) = (Vec::new(), Vec::new());
        for (n, (name, _)) in rows.iter().enumerate() {
            let Some(group) = groups_of(of, axis).iter().find(|group| group.name == *name) else { continue };
            let (at, Measure { value, interval }) = (row(n, rows.len()) + shift, measure(group));
            dots.extend(value.map(|value| (value, at)));
            ends.extend(interval.into_iter().flatten().map(|end| (end, at)));
        }
        series.push(Series::new(of.who.name.clone(), Tone::ROW[i], Look::Dots, dots));
        series.push(Series::new("", Tone::ROW[i], Look::Strokes, ends));
    }
    let names: Vec<String> = rows.iter().map(|(_, text)| text.clone()).collect();
    let height_px = 84 + 26 * rows.len() as u32;
    let chart = Chart::new(title, x, Axis::rows(&names), series, height_px);
    let left_out: Vec<&str> = tested.iter().skip(n_drawn).map(|of| of.who.name.as_str()).collect();
    let left_out = if left_out.is_empty() {
        String::new()
    } else {
        format!(" Not drawn, but in the table and drive.json: {}.", left_out.join(", "))
    };
    Ok(Some(Figure::new(&chart)?.with_caption(format!("Intervals of 95 % by episode.{left_out}"))))
}

/// A driver at a score, and what the scores of recorded samples say of that score.
#[derive(Debug, Clone, PartialEq)]
struct Foretold {
    name: String,
    /// Share of the harmful events that no sample finds, and of those that are warned of in time.
    missed: f64,
    in_time: Option<f64>,
    false_alarms_per_km: f64,
    /// In the closed loop.
    avoided: f64,
    false_stops_per_km: f64,
}

/// Charts of the closed loop over the open one, for drivers that are the scored network at several scores.
fn open_loop(summary: &DriveSummary, sides: &[Side]) -> Result<Vec<Block>, ReportError> {
    let mut blocks = Vec::new();
    for side in sides {
        let foretold = foretell(summary, side);
        if foretold.len() < 2 {
            let what = format!(
                "what the scores {} say of the closed loop: the network that was scored drives {} here within those scores, and two \
                 drivers of it, at two scores, are needed",
                side.name.to_lowercase(),
                if foretold.is_empty() { "nowhere" } else { "once" }
            );
            let command = "harmzone drive blind truth RUN RUN@0.2 RUN@0.4 --out DIR; harmzone eval RUN --data DATA --ood --out SCORES \
                           --set 'safety.false_alarms_per_km=[1, 3, 10, 30, 100, 300]'";
            blocks.push(Block::absent(what, command));
            continue;
        }
        let line = |x: &dyn Fn(&Foretold) -> Option<f64>, y: &dyn Fn(&Foretold) -> f64| -> Vec<(f64, f64)> {
            foretold.iter().filter_map(|of| Some((x(of)?, y(of)))).collect()
        };
        let missed = line(&|of| Some(of.missed), &|of| 1.0 - of.avoided);
        let in_time = line(&|of| of.in_time, &|of| of.avoided);
        let alarms = line(&|of| Some(of.false_alarms_per_km), &|of| of.false_stops_per_km);
        let of_alarms = |i: usize| alarms.iter().map(|&point| <[f64; 2]>::from(point)[i]).fold(1.0, f64::max);
        let charts = [
            (
                "Collisions and missed events",
                Axis::share("harmful events missed, open loop"),
                Axis::share("collided"),
                missed,
            ),
            (
                "Avoided and warned in time",
                Axis::share("warned in time, open loop"),
                Axis::share("avoided"),
                in_time,
            ),
            (
                "False stops and false alarms",
                Axis::over("false alarms a km, open loop", 0.0, 1.1 * of_alarms(0)),
                Axis::over("false stops a km", 0.0, 1.1 * of_alarms(1)),
                alarms,
            ),
        ];
        let mut figures = Vec::new();
        for (title, x, y, points) in charts {
            if points.len() < 2 {
                continue;
            }
            let told = match correlation(&points) {
                Some(r) if points.len() >= LEAST_CORRELATED => {
                    format!("Correlation {r:+.2}, of {} drivers.", points.len())
                }
                _ => format!("{} drivers: too few, or too alike, for a correlation.", points.len()),
            };
            let names = foretold.iter().zip(&points).map(|(of, &point)| (point, of.name.clone()));
            let texts = if points.len() == foretold.len() { names.collect() } else { Vec::new() };
            let series = vec![Series::new("", Tone::Harmless, Look::Dots, points.clone())];
            let chart = Chart { texts, ..Chart::new(title, x, y, series, 320) };
            figures.push(Figure::new(&chart)?.with_caption(told));
        }
        blocks.push(Block::heading(&format!("What the scores {} say of it", side.name.to_lowercase())));
        blocks.push(Block::text(
            "Each point is the same network at another score from which it brakes hard. Open loop: what the tables of missed harm \
             say of that score, between the scores that they hold. Warned in time: at the first of their decelerations.",
        ));
        blocks.push(Block::Figures { figures });
    }
    Ok(blocks)
}

fn foretell(summary: &DriveSummary, side: &Side) -> Vec<Foretold> {
    let scored = side.scores.provenance.as_ref().and_then(|source| source.checkpoint_sha256.as_deref());
    let (Some(scored), Some(alarms)) = (scored, &side.scores.evaluation.safety.alarms) else {
        return Vec::new();
    };
    let drivers = summary.figures.iter().zip(&summary.origins).filter(|(_, origin)| origin.sha256 == scored);
    drivers
        .filter_map(|(figures, origin)| {
            // Another judge's scores are others.
            let Source::Network { judge: Judge::Network, .. } = origin.who.source else { return None };
            let score = origin.min_score?;
            let of = |value: &dyn Fn(&OperatingPoint) -> Option<f64>| between(alarms, score, value);
            Some(Foretold {
                name: format!("{score:.2}"),
                missed: of(&|point| point.missed_per_event)?,
                in_time: of(&|point| point.warned.first()?.in_time),
                false_alarms_per_km: of(&|point| Some(point.false_alarms_per_km))?,
                avoided: avoided(figures)?,
                false_stops_per_km: figures.false_stops_per_km.value?,
            })
        })
        .collect()
}

/// A figure at a score, on the line between the points on both sides of it; `None` beyond them.
fn between(alarms: &Alarms, score: f64, value: &dyn Fn(&OperatingPoint) -> Option<f64>) -> Option<f64> {
    let mut known: Vec<(f64, f64)> =
        alarms.points.iter().filter_map(|point| Some((point.score?, value(point)?))).collect();
    known.sort_by(|a, b| a.0.total_cmp(&b.0));
    let after = known.iter().position(|point| point.0 >= score)?;
    let (to, from) = (known[after], known[after.saturating_sub(1)]);
    if to.0 == score {
        return Some(to.1);
    }
    (from.0 < score).then(|| from.1 + (to.1 - from.1) * (score - from.0) / (to.0 - from.0))
}

/// Pearson's correlation; `None` where either does not vary.
fn correlation(points: &[(f64, f64)]) -> Option<f64> {
    let n = points.len() as f64;
    let (mean_x, mean_y) =
        (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let sum =
        |of: &dyn Fn(f64, f64) -> f64| points.iter().map(|p| of(p.0 - mean_x, p.1 - mean_y)).sum::<f64>();
    let (xx, yy, xy) = (sum(&|x, _| x * x), sum(&|_, y| y * y), sum(&|x, y| x * y));
    (xx > 0.0 && yy > 0.0).then(|| xy / (xx * yy).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_between_two_scores_lies_on_the_line_between_them() {
        let mut alarms = crate::report::results::test_data::test_alarms();
        let point = alarms.points[0].clone();
        let at = |score, missed| OperatingPoint {
            score: Some(score),
            missed_per_event: Some(missed),
            ..point.clone()
        };
        alarms.points = vec![at(0.8, 0.5), at(0.4, 0.1), OperatingPoint { score: None, ..point.clone() }];
        let missed = |score| between(&alarms, score, &|point| point.missed_per_event);
        assert!((missed(0.5).unwrap() - 0.2).abs() < 1e-12);
        assert_eq!((missed(0.4), missed(0.8), missed(0.3), missed(0.9)), (Some(0.1), Some(0.5), None, None));
    }

    #[test]
    fn correlation_is_one_on_a_line_and_unknown_where_nothing_varies() {
        assert!((correlation(&[(0.0, 1.0), (1.0, 3.0), (3.0, 7.0)]).unwrap() - 1.0).abs() < 1e-12);
        assert!((correlation(&[(0.0, 7.0), (1.0, 3.0), (2.0, 5.0)]).unwrap() + 0.5).abs() < 1e-12);
        assert_eq!(correlation(&[(1.0, 1.0), (1.0, 3.0)]), None);
    }
}
