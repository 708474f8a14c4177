//! The tables of a scoring, which text files, the terminal and the page share.

use super::missed;
use super::paper::{Line, PARTS, STRICT, YARDSTICK};
use super::standing::Standing;
use super::table::{Cell, NO_TRUTH, Table, number, percent};
use crate::eval::safety::{MetricTable, MetricValue};
use crate::eval::{
    Axis, Breakdown, Column, Evaluation, GroupScores, Metrics, MissingClass, Mode, NeutralCounts, TruthCounts,
};
use crate::object::Harm;

/// `table.txt`: missed harm, AP beside the paper's, errors and counts; the same scores give the same bytes.
#[must_use]
pub fn text(evaluation: &Evaluation) -> String {
    let metrics = &evaluation.metrics;
    let what = match metrics.mode {
        Mode::Id => "in distribution",
        Mode::Ood => "in and out of distribution",
    };
    let (headline, errors, counts) = (headline(&[evaluation]), errors(metrics), counts(metrics));
    let neutral = neutral(metrics).map_or_else(String::new, |table| format!("\n{table}"));
    let missed = evaluation.safety.alarms.as_ref().and_then(|alarms| missed::table(&[("", alarms)]));
    let missed = missed.map_or_else(String::new, |table| format!("{table}\n"));
    format!("Detection {what}\n\n{missed}{headline}\n{errors}\n{counts}{neutral}")
}

/// The same below what the figures may be used for, which is known where they are of a data set.
#[must_use]
pub fn with_standing(evaluation: &Evaluation, standing: Option<Standing>) -> String {
    let table = text(evaluation);
    standing.map_or_else(|| table.clone(), |standing| format!("{standing}\n\n{table}"))
}

/// Names the classes without a truth by column, and what became of them; nothing if there is none.
fn tell_missing(evaluation: &Evaluation) -> Option<String> {
    let metrics = &evaluation.metrics;
    let missing_in = |column: Column| {
        let truths = |class: Harm| {
            let TruthCounts { all, id, ood } = *metrics.counts.truths.get(class);
            match column {
                Column::Total => all,
                Column::IdMatched => id,
                Column::OodAll | Column::OodMatched => ood,
            }
        };
        let classes = Harm::ALL.into_iter().filter(|&class| truths(class) == 0).map(Harm::name);
        let classes = classes.collect::<Vec<_>>().join(" and ");
        let scores = metrics.columns.get(column)?;
        let of_column = (metrics.mode == Mode::Ood).then_some(column);
        (!classes.is_empty()).then(|| format!("{classes} ({})", Line::new(of_column, scores, None).short))
    };
    let missing = Column::ALL.into_iter().filter_map(missing_in).collect::<Vec<_>>().join(", ");
    let becomes = match metrics.config.missing_class {
        MissingClass::Absent => "these have no score and no part in a mean",
        MissingClass::Zero => "AP is 0 there and counts in the mean, as in nuScenes",
    };
    (!missing.is_empty()).then(|| format!("No truth of {missing}: {becomes}."))
}

/// `breakdown.txt`: one table per axis, then one per safety metric.
#[must_use]
pub fn breakdown(evaluation: &Evaluation) -> String {
    let axes = evaluation.breakdowns.iter().map(groups);
    let tables = axes.chain(safety(evaluation)).map(|table| format!("\n{table}"));
    format!("{}\n{}", terms(&evaluation.metrics), tables.collect::<String>())
}

/// The meaning of the words in [`groups`].
#[must_use]
pub fn terms(metrics: &Metrics) -> String {
    let config = &metrics.config;
    format!(
        "Found, called the other class and missed, in percent of the truths, at {} m with a score of {} or more.",
        config.tp_threshold_m, config.operating_score
    )
}

/// A table for each safety metric that is known.
#[must_use]
pub fn safety(evaluation: &Evaluation) -> Vec<Table> {
    let of_metric = |of: MetricTable| {
        let rows = of.rows.into_iter().map(|row| row.into_iter().map(cell).collect()).collect();
        Table::new(of.head, rows).with_note(of.note)
    };
    evaluation.safety.tables(&evaluation.metrics.config).into_iter().map(of_metric).collect()
}

fn cell(value: MetricValue) -> Cell {
    match value {
        MetricValue::Name(name) => name.into(),
        MetricValue::Count(n) => n.to_string().into(),
        MetricValue::Number { value, n_digits } => number(value, n_digits).into(),
        MetricValue::Share { value, of, interval } => {
            let interval =
                interval.map(|[low, high]| format!("{}–{}", percent(Some(low)), percent(Some(high))));
            Cell {
                text: percent(value),
                below: interval.into_iter().chain(of.map(|n| format!("of {n}"))).collect(),
            }
        }
    }
}

/// AP beside the paper's, for one scoring or for both.
#[must_use]
pub fn headline(evaluations: &[&Evaluation]) -> Table {
    let rows = evaluations.iter().flat_map(|of| Line::of_evaluation(of)).map(|line| line.cells()).collect();
    let mut note = String::new();
    if let Some(evaluation) = evaluations.first() {
        let thresholds = evaluation.metrics.config.dist_thresholds_m.iter().map(f64::to_string);
        note +=
            &format!("AP, mean over centre distances of {} m. ", thresholds.collect::<Vec<_>>().join(", "));
    }
    let confidences = evaluations.iter().filter_map(|of| of.confidence.as_ref());
    let n_episodes: Vec<String> = confidences.clone().map(|of| of.n_episodes.to_string()).collect();
    if let Some(of) = confidences.clone().next() {
        note += &format!(
            "With the {} % interval of a bootstrap over the episodes ({}) and the paper's figure. ",
            100.0 * of.level,
            n_episodes.join(" and ")
        );
    }
    if evaluations.iter().any(|of| of.metrics.strict.is_some()) {
        note += STRICT;
        note += " ";
    }
    note += YARDSTICK;
    for missing in evaluations.iter().filter_map(|of| tell_missing(of)) {
        note += "\n";
        note += &missing;
    }
    Table::new(["AP"].into_iter().chain(PARTS), rows).with_note(note)
}

/// Mean errors of the boxes that were found.
#[must_use]
pub fn errors(metrics: &Metrics) -> Table {
    let rows = Harm::ALL.map(|class| {
        let errors = metrics.tp_errors.get(class);
        let values = match errors {
            Some(of) => [of.ate, of.ase, of.aoe].map(|value| number(Some(value), 3)),
            None => [NO_TRUTH; 3].map(str::to_owned),
        };
        std::iter::once(class.name().into()).chain(values.map(Cell::from)).collect()
    });
    let note = format!("Mean errors of what was found at {} m.", metrics.config.tp_threshold_m);
    Table::new(["errors", "ATE m", "ASE", "AOE rad"], rows.into()).with_note(note)
}

/// The numbers of truths and detections, and the outcomes of the detections.
#[must_use]
pub fn counts(metrics: &Metrics) -> Table {
    let config = &metrics.config;
    let at = config.dist_thresholds_m.iter().position(|&threshold_m| threshold_m == config.tp_threshold_m);
    let rows = Harm::ALL.into_iter().filter_map(|class| {
        let outcomes = metrics.counts.outcomes.get(class).get(at?)?;
        let truths = metrics.counts.truths.get(class);
        let below = match metrics.mode {
            Mode::Id => vec![],
            Mode::Ood => vec![format!("{} ID, {} OOD", truths.id, truths.ood)],
        };
        let n_detections = *metrics.counts.detections.get(class);
        let cells = [n_detections, outcomes.matched, outcomes.misclassified, outcomes.unmatched];
        let start = [class.name().into(), Cell { text: truths.all.to_string(), below }];
        Some(start.into_iter().chain(cells.map(|n| n.to_string().into())).collect())
    });
    let head = ["counts", "truths", "detections", "matched", "other class", "unmatched"];
    let filters = &metrics.filters;
    let mut note = format!(
        "{} samples; detections of every score, matched at {} m. Dropped at {} m or more: {} truths, {} detections",
        metrics.counts.n_samples,
        config.tp_threshold_m,
        filters.max_range_m,
        filters.truths_out_of_range,
        filters.detections_out_of_range,
    );
    if filters.drop_truths_without_points {
        note += &format!("; without a LiDAR point: {} truths", filters.truths_without_points);
    }
    if filters.truths_beyond_labelled > 0 {
        note += &format!("; beyond the labelled range: {} truths", filters.truths_beyond_labelled);
    }
    if filters.samples_unlabelled > 0 {
        note += &format!("; without any truth: {} samples", filters.samples_unlabelled);
    }
    Table::new(head, rows.collect()).with_note(note + ".")
}

/// The numbers of detections that are neither right nor wrong, by reason; nothing where the truth leaves out nothing.
#[must_use]
pub fn neutral(metrics: &Metrics) -> Option<Table> {
    metrics.strict.as_ref()?;
    let config = &metrics.config;
    let at = config.dist_thresholds_m.iter().position(|&threshold_m| threshold_m == config.tp_threshold_m)?;
    let rows = Harm::ALL.into_iter().filter_map(|class| {
        let NeutralCounts { region, range, view, kind } = metrics.counts.outcomes.get(class).get(at)?.neutral;
        let cells = [region, range, view, kind].map(|n| n.to_string().into());
        Some(std::iter::once(class.name().into()).chain(cells).collect())
    });
    let head = ["neutral", "ignored region", "beyond the range", "beside the picture", "no labelled kind"];
    let note = format!(
        "Detections at {} m that are neither right nor wrong, since nobody labelled what may be there.",
        config.tp_threshold_m
    );
    Some(Table::new(head, rows.collect()).with_note(note))
}

/// The axis's name for readers.
#[must_use]
pub fn title(axis: Axis) -> &'static str {
    match axis {
        Axis::Distribution => "In and out of distribution",
        Axis::Kind => "Kind of object",
        Axis::IdCategory => "Family, in distribution",
        Axis::OodCategory => "Family, out of distribution",
        Axis::RangeM => "Range, m",
        Axis::VisibleFraction => "Visible share",
        Axis::NLidarPoints => "LiDAR points",
        Axis::Event => "Event",
        Axis::ZoneDistanceM => "Distance to the zone's edge, m",
        Axis::Town => "Town",
        Axis::Weather => "Weather",
        Axis::NLidarRings => "Rings of the LiDAR",
        Axis::SpeedMps => "Speed, m/s",
        Axis::SteeringDeg => "Steering, degrees",
    }
}

/// Scores of the groups of an axis.
#[must_use]
pub fn groups(breakdown: &Breakdown) -> Table {
    let rows = breakdown.groups.iter().map(|group| {
        let start = [to_words(&group.name).into(), group.n_samples.to_string().into()];
        let cells = Harm::ALL.into_iter().flat_map(|class| group_cells(group.classes.get(class)));
        start.into_iter().chain(cells).collect()
    });
    let of_class = |class: Harm| {
        ["truths", "AP", "found", "other", "missed", "false"].map(|what| format!("{}\n{what}", class.name()))
    };
    let head = [title(breakdown.axis).to_owned(), "samples".to_owned()].into_iter();
    let note = if breakdown.axis.is_of_samples() {
        "Scores of the samples of each group alone, all false positives included."
    } else {
        "Scores on the objects of each group; false positives on nothing count in none."
    };
    Table::new(head.chain(Harm::ALL.into_iter().flat_map(of_class)), rows.collect()).with_note(note)
}

fn group_cells(scores: &GroupScores) -> [Cell; 6] {
    let n_truths = scores.n_truths;
    let share = |n: usize| number((n_truths > 0).then(|| 100.0 * n as f64 / n_truths as f64), 1).into();
    [
        n_truths.to_string().into(),
        number(scores.ap, 3).into(),
        share(scores.n_found),
        share(scores.n_misclassified),
        share(scores.n_missed),
        scores.n_false.to_string().into(),
    ]
}

/// A name from the files as words.
#[must_use]
pub fn to_words(name: &str) -> String {
    name.replace('_', " ")
}
