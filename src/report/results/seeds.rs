//! Trainings of a row from several seeds: their figures side by side, with mean and standard deviation.

use serde::{Deserialize, Serialize};

use super::{MissedHarm, Record, Results};
use crate::eval::safety::{Alarms, OperatingPoint};
use crate::eval::versus::{Versus, VersusLine, column_name};
use crate::eval::{ClassScores, Column, Columns, Confidence};
use crate::report::missed;
use crate::report::paper::Line;
use crate::report::table::{Cell, Table, ap, number, percent};

/// A network's trainings from several seeds as one detector, whose figures are their means; or one training alone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SeedMeans {
    /// Their SHA-256, the headline's first.
    pub networks: Vec<String>,
    /// On the splits val and dev.
    pub seen: SeedMean,
    /// On the groups of towns of split test.
    pub groups: Vec<SeedMean>,
}

/// Means with intervals by a bootstrap over the episodes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SeedMean {
    pub id: Versus,
    pub ood: Versus,
}

impl SeedMean {
    pub(super) fn sets(&self) -> [&Versus; 2] {
        [&self.id, &self.ood]
    }
}

/// One figure of each training, with its interval where there is one.
struct Figure {
    name: String,
    is_share: bool,
    values: Vec<Values>,
    /// Of their mean.
    mean_interval: Option<[f64; 2]>,
}

impl Figure {
    fn row(&self) -> Vec<Cell> {
        let show = |of: Option<f64>| if self.is_share { percent(of) } else { ap(of) };
        let cell = |(value, interval): Values| {
            let end = |end: f64| if self.is_share { number(Some(100.0 * end), 1) } else { ap(Some(end)) };
            let below = interval.map(|ends| ends.map(end).join("–"));
            Cell { text: show(value), below: below.into_iter().collect() }
        };
        let cells = self.values.iter().map(|&of| cell(of));
        let values: Option<Vec<f64>> = self.values.iter().map(|(value, _)| *value).collect();
        let spread = values.as_deref().map(deviation);
        let spread = if self.is_share { number(spread.map(|of| 100.0 * of), 1) } else { number(spread, 3) };
        let mean = cell((values.as_deref().map(mean), self.mean_interval));
        std::iter::once(self.name.as_str().into()).chain(cells).chain([mean, spread.into()]).collect()
    }
}

/// The mean of what all have; none where one has nothing.
pub(super) fn mean_of(values: impl IntoIterator<Item = Option<f64>>) -> Option<f64> {
    let values: Option<Vec<f64>> = values.into_iter().collect();
    values.filter(|of| !of.is_empty()).map(|of| mean(&of))
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Of a sample.
fn deviation(values: &[f64]) -> f64 {
    let mean = mean(values);
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (squares / (values.len() as f64 - 1.0)).sqrt()
}

/// The headline and its repeats on the splits that choices are made by; `None` where it has none.
pub(super) fn table(results: &Results, headline: &Record) -> Option<Table> {
    let records = results.runs_of(&headline.name);
    let sets =
        |of: &Record| [(of.id_columns(), of.missed.id.clone()), (of.ood.clone(), of.missed.ood.clone())];
    let runs: Vec<_> = records.iter().map(|record| (format!("seed {}", record.seed), sets(record))).collect();
    let runs: Vec<Run<'_>> = runs
        .iter()
        .map(|(name, sets)| Run {
            name: name.clone(),
            sets: sets.each_ref().map(|(columns, alarms)| Set {
                columns,
                alarms: alarms.as_ref(),
                confidence: None,
            }),
        })
        .collect();
    of_runs(&runs, None)
}

/// A training's figures in and out of distribution.
pub(super) struct Run<'a> {
    pub name: String,
    pub sets: [Set<'a>; 2],
}

/// Figures on a data set.
pub(super) struct Set<'a> {
    pub columns: &'a Columns<ClassScores>,
    pub alarms: Option<&'a Alarms>,
    pub confidence: Option<&'a Confidence>,
}

/// The interval of a line's first detector, by the line's name.
fn interval_of(lines: &[VersusLine], name: &str) -> Option<[f64; 2]> {
    lines.iter().find(|line| line.name == name)?.figures.first()?.interval
}

/// Figures of several trainings side by side; `None` of one. The intervals of their means are those of `means`, in and out of
/// distribution.
pub(super) fn of_runs(runs: &[Run<'_>], means: Option<[&Versus; 2]>) -> Option<Table> {
    if runs.len() < 2 {
        return None;
    }
    let mut figures = Vec::new();
    let points: Vec<f64> = runs[0].sets[1]
        .alarms
        .map(|alarms| alarms.points.iter().map(|of| of.max_false_alarms_per_km).collect())
        .unwrap_or_default();
    for (i, set) in ["ID", "OOD"].into_iter().enumerate() {
        let mut of_point =
            |k: usize, what: String, mean_interval, get: &dyn Fn(&OperatingPoint) -> Values| {
                let values = runs
                    .iter()
                    .map(|run| run.sets[i].alarms.and_then(|of| of.points.get(k)).map_or((None, None), get));
                let name = format!("{set}: {what}");
                let figure = Figure { name, is_share: true, values: values.collect(), mean_interval };
                figures.extend(Some(figure).filter(|of| of.values.iter().any(|(value, _)| value.is_some())));
            };
        for (k, per_km) in points.iter().enumerate() {
            let at = format!("at {per_km} false alarms/km");
            let mean_interval = means.and_then(|of| interval_of(&of[i].missed, &at));
            of_point(k, format!("harmful events missed {at}"), mean_interval, &|of| {
                (of.missed_per_event, of.missed_per_event_interval)
            });
        }
        for (k, per_km) in points.iter().enumerate() {
            let hardest = |of: &OperatingPoint| of.warned.last().map(|of| of.deceleration_mps2);
            let deceleration = runs[0].sets[i].alarms.and_then(|of| hardest(of.points.get(k)?));
            let Some(deceleration_mps2) = deceleration else { continue };
            let what = format!("warned in time, {deceleration_mps2} m/s², at {per_km} false alarms/km");
            let line = format!("at {per_km} false alarms/km, {deceleration_mps2} m/s²");
            let mean_interval = means.and_then(|of| interval_of(&of[i].warned, &line));
            of_point(k, what, mean_interval, &|of| {
                of.warned.last().map_or((None, None), |of| (of.in_time, of.in_time_interval))
            });
        }
    }
    let columns = std::iter::once((0, None)).chain(Column::ALL.map(|column| (1, Some(column))));
    for (i, column) in columns {
        let line = |run: &Run<'_>| {
            let set = &run.sets[i];
            let scores = set.columns.get(column.unwrap_or(Column::Total))?;
            Some(Line::new(column, scores, set.confidence))
        };
        let Some(lines) = runs.iter().map(line).collect::<Option<Vec<Line>>>() else { continue };
        let parts: &[(usize, &str)] =
            if column.is_none() { &[(0, ", harmful"), (2, "")] } else { &[(2, "")] };
        figures.extend(parts.iter().map(|&(part, what)| Figure {
            name: format!("{}{what}", lines[0].name),
            is_share: false,
            values: lines.iter().map(|line| (line.ours[part], line.intervals[part])).collect(),
            mean_interval: means.and_then(|of| {
                let lines = if part == 0 { &of[i].harmful } else { &of[i].mean };
                interval_of(lines, &column_name(column.unwrap_or(Column::Total)))
            }),
        }));
    }
    let head =
        std::iter::once("the same training from other seeds").chain(runs.iter().map(|run| run.name.as_str()));
    let head = head.chain(["mean", "standard deviation"]);
    Some(Table::new(head, figures.iter().map(Figure::row).collect()))
}

/// A figure and its interval.
type Values = (Option<f64>, Option<[f64; 2]>);

/// Harmful events missed at the middle number of false alarms, ID / OOD; the mean of the runs.
pub(super) fn missed_events<'a>(runs: impl IntoIterator<Item = &'a MissedHarm>) -> Cell {
    let runs: Vec<&MissedHarm> = runs.into_iter().collect();
    let share = |of: fn(&MissedHarm) -> Option<&Alarms>| {
        let shares = runs.iter().map(|run| Some(missed::middle(of(run)?)?.missed_per_event));
        let shares: Option<Vec<Option<f64>>> = shares.collect();
        shares.map_or_else(|| "–".to_owned(), |shares| percent(mean_of(shares)))
    };
    let text = [share(|of| of.id.as_ref()), share(|of| of.ood.as_ref())].join(" / ");
    let interval = |of: &Option<Alarms>| missed::middle(of.as_ref()?)?.missed_per_event_interval;
    let below = match runs[..] {
        [run] => both_intervals([interval(&run.id), interval(&run.ood)], |end| number(Some(100.0 * end), 1)),
        _ => None,
    };
    Cell { text, below: below.into_iter().collect() }
}

/// `0.70–0.75 / 0.60–0.66`; nothing where neither is known.
pub(super) fn both_intervals(of: [Option<[f64; 2]>; 2], show: impl Fn(f64) -> String) -> Option<String> {
    let text = |of: Option<[f64; 2]>| of.map_or_else(|| "–".to_owned(), |ends| ends.map(&show).join("–"));
    of.iter().any(Option::is_some).then(|| of.map(text).join(" / "))
}

#[cfg(test)]
mod tests {
    use super::super::blocks;
    use super::super::test_data::test_with_repeats;
    use crate::report::document::markdown;

    #[test]
    fn seeds_stand_side_by_side_and_a_row_of_several_is_their_mean() {
        let text = markdown(&blocks(&test_with_repeats()));
        // Means of harmful and harmless: .65, .55 and .6.
        let line = "| OOD: mAP (total) | 0.650 | 0.550 | 0.600 | 0.600 | 0.050 |";
        assert!(text.contains(line), "{text}");
        assert!(text.contains("| seed 3 | seed 4 | seed 5 | mean | standard deviation |"), "{text}");
        // The fused row: .65 and .7.
        assert!(text.contains("**0.675** (0.850 / 0.500, seeds 0.650, 0.700)"), "{text}");
        assert!(text.contains("| 3, 4 |") && text.contains("--out runs/fused-seed-4"), "{text}");
    }
}
