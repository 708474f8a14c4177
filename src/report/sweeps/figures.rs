//! From sweeps to plots.

use crate::eval::judge::Judge;
use crate::eval::safety::Early;
use crate::eval::sweep::{Change, SweepPoint, Sweeps};
use crate::report::plot::{BLUE, DARK, Entry, GREEN, Lines, Panel, VERMILION};

fn entry(judge: Judge) -> Entry {
    let (name, color, is_dashed) = match judge {
        Judge::Network => ("the network", VERMILION, false),
        Judge::Zone => ("zone over its boxes", BLUE, false),
        Judge::ZoneSoft => ("the same, soft", BLUE, true),
        Judge::SpeedZone => ("zone by speed alone over its boxes", GREEN, false),
        Judge::SpeedZoneSoft => ("the same, soft", GREEN, true),
    };
    Entry { name: name.to_owned(), color, is_dashed }
}

/// The judges that a figure shows, in the legend's order.
fn judges(sweeps: &Sweeps) -> Vec<Judge> {
    let is_there = |judge: &Judge| sweeps.curves.iter().any(|curve| curve.judge == *judge);
    Judge::ALL.into_iter().filter(is_there).collect()
}

fn axis(change: Change) -> &'static str {
    match change {
        Change::SpeedMps => "speed given to every frame, m/s",
        Change::SteeringDeg => "steering angle given to every frame, degrees, left positive",
        Change::SpeedFactor => "measured speed over the true one",
        Change::SteeringOffsetDeg => "measured steering angle less the true one, degrees",
    }
}

/// A panel of one line a judge; the legend's first `first` entries are other lines.
fn panel(
    sweeps: &Sweeps,
    change: Change,
    first: usize,
    y_name: &str,
    value: impl Fn(&SweepPoint) -> Option<f64>,
) -> Panel {
    let line = |(i, judge): (usize, Judge)| {
        let points = sweeps.points(change, judge).iter();
        (first + i, points.filter_map(|point| Some((point.value, value(point)?))).collect::<Vec<_>>())
    };
    let lines: Vec<_> = judges(sweeps).into_iter().enumerate().map(line).collect();
    Panel { x_name: axis(change).to_owned(), y_name: y_name.to_owned(), y_range: [0.0, 1.0], lines }
}

/// The panel's scale from zero to a little above its highest point.
fn fitted(mut panel: Panel) -> Panel {
    let values = panel.lines.iter().flat_map(|(_, points)| points.iter().map(|&(_, y)| y));
    let highest = values.fold(0.0, f64::max);
    panel.y_range = [0.0, if highest > 0.0 { 1.08 * highest } else { 1.0 }];
    panel
}

/// The panel's scale from the tenth below its lowest point to one.
fn zoomed(mut panel: Panel) -> Panel {
    let values = panel.lines.iter().flat_map(|(_, points)| points.iter().map(|&(_, y)| y));
    let lowest = values.fold(1.0, f64::min);
    panel.y_range = [((10.0 * lowest - 0.2).floor() / 10.0).clamp(0.0, 0.9), 1.0];
    panel
}

/// Over speed or steering: how many objects are harmful and called so, how well both sets agree, and mAP.
pub fn over_states(sweeps: &Sweeps, change: Change) -> Lines {
    let n_samples = sweeps.n_samples.max(1) as f64;
    let truth = Entry { name: "truth: the zone over true boxes".to_owned(), color: DARK, is_dashed: false };
    let mut counts = panel(sweeps, change, 1, "harmful objects a frame", |point| {
        Some(point.n_called_harmful as f64 / n_samples)
    });
    let any_judge = judges(sweeps).first().copied().unwrap_or(Judge::Network);
    let of_truth = sweeps.points(change, any_judge).iter();
    counts.lines.insert(0, (0, of_truth.map(|p| (p.value, p.n_harmful as f64 / n_samples)).collect()));
    Lines {
        legend: std::iter::once(truth).chain(judges(sweeps).into_iter().map(entry)).collect(),
        panels: vec![
            fitted(counts),
            panel(sweeps, change, 1, "agreement: IoU of the harmful sets", |point| point.set_iou),
            zoomed(panel(sweeps, change, 1, "mAP", |point| Some(point.scores.total.mean))),
        ],
    }
}

/// mAP where speed or steering is measured wrongly.
pub fn sensor_errors(sweeps: &Sweeps) -> Lines {
    let over = |change| zoomed(panel(sweeps, change, 0, "mAP", |point| Some(point.scores.total.mean)));
    Lines {
        legend: judges(sweeps).into_iter().map(entry).collect(),
        panels: vec![over(Change::SpeedFactor), over(Change::SteeringOffsetDeg)],
    }
}

/// False-harmful boxes whose object turns harmful within so many samples, beside all harmless objects.
pub fn early(early: &Early) -> Lines {
    let entry = |name: String, color| Entry { name, color, is_dashed: false };
    let line = |value: fn(&crate::eval::safety::EarlyShare) -> Option<f64>| {
        early.within.iter().filter_map(|of| Some((of.n_later as f64, value(of)?))).collect::<Vec<_>>()
    };
    let panel = Panel {
        x_name: "samples later, at most".to_owned(),
        y_name: "share that turns harmful".to_owned(),
        y_range: [0.0, 1.0],
        lines: vec![(0, line(|of| of.share)), (1, line(|of| of.share_of_harmless))],
    };
    Lines {
        legend: vec![
            entry(format!("{} false-harmful boxes", early.n_false_harmful), VERMILION),
            entry("all harmless objects".to_owned(), BLUE),
        ],
        panels: vec![fitted(panel)],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::safety::EarlyShare;
    use crate::eval::sweep::SweepCurve;
    use crate::eval::{ClassScores, Columns};
    use crate::report::plot;

    fn sweeps() -> Sweeps {
        let point = |value: f64, n_called: usize| SweepPoint {
            value,
            scores: Columns {
                total: ClassScores { harmful: 0.5, harmless: 0.9, mean: 0.7 },
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
        let figure = over_states(&sweeps(), Change::SpeedMps);
        assert_eq!(figure.legend.len(), 3);
        let [counts, agreement, ap] = &figure.panels[..] else { panic!("three panels") };
        assert_eq!(counts.lines[0], (0, vec![(0.0, 2.0), (7.0, 2.0), (14.0, 2.0)]));
        assert_eq!(counts.lines[2], (2, vec![(0.0, 0.0), (7.0, 0.5), (14.0, 1.0)]));
        assert_eq!(agreement.lines[1], (2, vec![(7.0, 0.25), (14.0, 0.5)]));
        assert_eq!((ap.lines.len(), ap.y_range), (2, [0.6, 1.0]));
        let text = plot::svg(&figure).unwrap();
        assert!(text.contains("IoU of the harmful sets") && text.contains("zone over its boxes"));
        plot::svg(&sensor_errors(&sweeps())).unwrap();
        // Nothing swept is a picture too.
        plot::svg(&over_states(&Sweeps { curves: vec![], ..sweeps() }, Change::SteeringDeg)).unwrap();
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
        let figure = early(&early_figures);
        assert_eq!(figure.panels[0].lines[0], (0, vec![(1.0, 0.2), (2.0, 0.4)]));
        assert_eq!(figure.panels[0].lines[1].1.len(), 3);
        assert!(plot::svg(&figure).unwrap().contains("7 false-harmful boxes"));
    }
}
