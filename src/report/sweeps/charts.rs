//! The charts of sweeps, for files and for the page.

use crate::eval::judge::Judge;
use crate::eval::safety::{Early, EarlyShare};
use crate::eval::sweep::{Change, SweepPoint, Sweeps};
use crate::report::chart::{Axis, Chart, Look, Series, Tone};

const HEIGHT_PX: u32 = 340;

/// The change's name for readers.
#[must_use]
pub fn title(change: Change) -> &'static str {
    match change {
        Change::SpeedMps => "Speed set to",
        Change::SteeringDeg => "Steering set to",
        Change::SpeedFactor => "Speed sensor errs",
        Change::SteeringOffsetDeg => "Steering sensor errs",
    }
}

fn axis_name(change: Change) -> &'static str {
    match change {
        Change::SpeedMps => "speed of every frame, m/s",
        Change::SteeringDeg => "steering of every frame, degrees, left positive",
        Change::SpeedFactor => "measured speed over the true one",
        Change::SteeringOffsetDeg => "measured steering less the true one, degrees",
    }
}

/// The judge's name for readers.
#[must_use]
pub fn judge_name(judge: Judge) -> &'static str {
    look(judge).0
}

fn look(judge: Judge) -> (&'static str, Tone, Look) {
    match judge {
        Judge::Network => ("the network", Tone::Harmful, Look::LineAndDots),
        Judge::Zone => ("zone over its boxes", Tone::Harmless, Look::LineAndDots),
        Judge::ZoneSoft => ("zone over its boxes, soft", Tone::Harmless, Look::Dashed),
        Judge::SpeedZone => ("zone by speed alone", Tone::Green, Look::LineAndDots),
        Judge::ZoneExpected => ("zone over its boxes, expected", Tone::Harmless, Look::Dots),
        Judge::Both => ("network and zone together", Tone::Harmful, Look::Dashed),
        Judge::SpeedZoneSoft => ("zone by speed alone, soft", Tone::Green, Look::Dashed),
    }
}

/// The charts of a change, with a line for each judge: mAP, and where the truth moves also how many objects are harmful
/// and called so, and how well both sets agree. `None` if nothing was swept.
#[must_use]
pub fn over(sweeps: &Sweeps, change: Change) -> Vec<Chart> {
    let curves: Vec<_> = sweeps.curves.iter().filter(|curve| curve.change == change).collect();
    let Some(any) = curves.first().filter(|curve| !curve.points.is_empty()) else { return Vec::new() };
    let lines = |value: &dyn Fn(&SweepPoint) -> Option<f64>| -> Vec<Series> {
        let line = |curve: &&crate::eval::sweep::SweepCurve| {
            let (name, tone, look) = look(curve.judge);
            let points = curve.points.iter().filter_map(|point| Some((point.value, value(point)?)));
            Series::new(name, tone, look, points.collect())
        };
        curves.iter().map(line).collect()
    };
    let values = || curves.iter().flat_map(|curve| &curve.points).map(|point| point.value);
    let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
    let chart = |what: &str, y, series| {
        let title = format!("{}: {what}", title(change));
        Chart::new(title, Axis::over(axis_name(change), low, high), y, series, HEIGHT_PX)
    };
    let mut charts = Vec::new();
    if change.moves_truth() {
        let a_frame = |n: usize| n as f64 / sweeps.n_samples.max(1) as f64;
        let truth = any.points.iter().map(|point| (point.value, a_frame(point.n_harmful))).collect();
        let truth = Series::new("truth", Tone::Ink, Look::Dashed, truth);
        let called = lines(&|point| Some(a_frame(point.n_called_harmful)));
        let series: Vec<Series> = std::iter::once(truth).chain(called).collect();
        charts.push(chart("the harmful set", from_zero("harmful objects a frame", &series), series));
        let agreement = lines(&|point| point.set_iou);
        let y = Axis::share("IoU of the harmful sets");
        charts.push(chart("agreement of the harmful sets", y, agreement));
    }
    let scores = lines(&|point| point.scores.total.mean);
    let lowest = scores.iter().flat_map(|line| &line.points).map(|point| point.1).fold(1.0, f64::min);
    // From the tenth below the lowest point.
    let low = ((10.0 * lowest - 0.2).floor() / 10.0).clamp(0.0, 0.9);
    charts.push(chart("mAP", Axis::over("mAP", low, 1.0), scores));
    charts
}

/// False-harmful boxes whose object turns harmful within this many samples, beside all harmless objects.
#[must_use]
pub fn early(early: &Early) -> Chart {
    let line = |name: String, tone, value: fn(&EarlyShare) -> Option<f64>| {
        let points = early.within.iter().filter_map(|of| Some((of.n_later as f64, value(of)?)));
        Series::new(name, tone, Look::LineAndDots, points.collect())
    };
    let series = vec![
        line(format!("{} false-harmful boxes", early.n_false_harmful), Tone::Harmful, |of| of.share),
        line("all harmless objects".to_owned(), Tone::Harmless, |of| of.share_of_harmless),
    ];
    let last = early.within.last().map_or(1.0, |of| of.n_later as f64);
    let x = Axis::over("samples later, at most", 1.0, last);
    let y = from_zero("share that turns harmful", &series);
    Chart::new("False alarms that were only early", x, y, series, HEIGHT_PX)
}

/// An axis from zero to a little above the highest point.
fn from_zero(name: &str, series: &[Series]) -> Axis {
    let highest = series.iter().flat_map(|line| &line.points).map(|point| point.1).fold(0.0, f64::max);
    Axis::over(name, 0.0, 1.08 * highest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::sweep::SweepCurve;
    use crate::eval::{ClassScores, Columns};

    fn sweeps() -> Sweeps {
        let point = |value: f64, n_called: usize| SweepPoint {
            value,
            scores: Columns {
                total: ClassScores::new(Some(0.5), Some(0.9)),
                id_matched: None,
                ood_all: None,
                ood_matched: None,
            },
            n_truths: 40,
            n_located: 36,
            n_harmful: 8,
            n_called_harmful: n_called,
            n_both: n_called,
            set_iou: (n_called > 0).then_some(n_called as f64 / 8.0),
            agreement: Some(0.9),
        };
        let curve = |change: Change, judge, values: &[f64]| SweepCurve {
            change,
            judge,
            truth_moves: change.moves_truth(),
            points: values.iter().enumerate().map(|(i, &value)| point(value, 2 * i)).collect(),
        };
        Sweeps {
            n_samples: 4,
            curves: vec![
                curve(Change::SpeedMps, Judge::Network, &[0.0, 7.0, 14.0]),
                curve(Change::SpeedMps, Judge::Zone, &[0.0, 7.0, 14.0]),
                curve(Change::SpeedFactor, Judge::Zone, &[0.9, 1.0, 1.1]),
            ],
            early: None,
        }
    }

    #[test]
    fn every_judge_has_a_line_beside_the_truths_and_gaps_where_nothing_is_known() {
        let charts = over(&sweeps(), Change::SpeedMps);
        let [counts, agreement, ap] = &charts[..] else { panic!("three charts") };
        assert_eq!(counts.series.len(), 3);
        assert_eq!(counts.series[0].points, [(0.0, 2.0), (7.0, 2.0), (14.0, 2.0)]);
        assert_eq!(counts.series[2].points, [(0.0, 0.0), (7.0, 0.5), (14.0, 1.0)]);
        assert_eq!(agreement.series[1].points, [(7.0, 0.25), (14.0, 0.5)]);
        assert_eq!((ap.series.len(), ap.y.low, ap.y.high), (2, 0.6, 1.0));
        let [only_ap] = &over(&sweeps(), Change::SpeedFactor)[..] else { panic!("the truth stays") };
        assert_eq!(only_ap.title, "Speed sensor errs: mAP");
        assert_eq!(over(&sweeps(), Change::SteeringDeg), [], "nothing was swept");
    }

    #[test]
    fn early_shares_stand_over_their_samples() {
        let share = |n_later, share| EarlyShare {
            n_later,
            n_boxes: 5,
            n_turned: 1,
            share,
            share_of_harmless: Some(0.05),
        };
        let early_figures = Early {
            n_false_harmful: 7,
            within: vec![share(1, Some(0.2)), share(2, Some(0.4)), share(3, None)],
        };
        let chart = early(&early_figures);
        assert_eq!(chart.series[0].points, [(1.0, 0.2), (2.0, 0.4)]);
        assert_eq!(
            (chart.series[0].name.as_str(), chart.series[1].points.len()),
            ("7 false-harmful boxes", 3)
        );
    }
}
