//! The text table of a scoring, in the rows of the paper's Table III, with its figures beside ours.

use std::fmt::Write as _;

use crate::eval::{ClassScores, Column, Metrics, Mode};
use crate::object::Harm;

/// The paper's AP: harmful, harmless, mean.
struct PaperScores(f64, f64, f64);

/// ID run of the paper (Table II).
const PAPER_ID: PaperScores = PaperScores(0.7947, 0.8289, 0.8118);

/// The paper's AP, harmful, harmless and mean: of its ID run, or of a column of its OOD run.
#[must_use]
pub fn paper_scores(column: Option<Column>) -> [f64; 3] {
    let PaperScores(harmful, harmless, mean) = column.map_or(PAPER_ID, |column| described(column).1);
    [harmful, harmless, mean]
}

/// A column's name, and the paper's figures for an OOD run (Table III).
fn described(column: Column) -> (&'static str, PaperScores) {
    match column {
        Column::Total => ("mAP (total)", PaperScores(0.715, 0.723, 0.719)),
        Column::IdMatched => ("mAP_ID (matched FPs only)", PaperScores(0.74, 0.88, 0.81)),
        Column::OodAll => ("mAP_OOD (all FPs)", PaperScores(0.652, 0.345, 0.499)),
        Column::OodMatched => ("mAP_OOD (matched FPs only)", PaperScores(0.714, 0.725, 0.72)),
    }
}

/// The table; the same metrics give the same bytes.
#[must_use]
pub fn table(metrics: &Metrics) -> String {
    let mut text = String::new();
    write_table(&mut text, metrics).expect("writing to a string cannot fail");
    text
}

fn write_table(text: &mut String, metrics: &Metrics) -> std::fmt::Result {
    let (config, counts) = (&metrics.config, &metrics.counts);
    let thresholds: Vec<String> = config.dist_thresholds_m.iter().map(f64::to_string).collect();
    let what = match metrics.mode {
        Mode::Id => "in distribution",
        Mode::Ood => "in and out of distribution",
    };
    writeln!(text, "Detection {what}; samples: {}", counts.n_samples)?;
    writeln!(text, "AP, mean over centre distances {} m; (paper)\n", thresholds.join(", "))?;
    writeln!(text, "{:<28}{:>16}{:>16}{:>16}", "", "harmful", "harmless", "mean")?;
    match metrics.mode {
        Mode::Id => write_scores(text, "mAP", &metrics.columns.total, &PAPER_ID)?,
        Mode::Ood => {
            for column in Column::ALL {
                let (name, paper) = described(column);
                if let Some(scores) = metrics.columns.get(column) {
                    write_scores(text, name, scores, &paper)?;
                }
            }
        }
    }
    writeln!(
        text,
        "\n{:<12}{:>10}{:>10}{:>12}",
        format!("at {} m", config.tp_threshold_m),
        "ATE m",
        "ASE",
        "AOE rad"
    )?;
    for class in Harm::ALL {
        let errors = metrics.tp_errors.get(class);
        writeln!(text, "{:<12}{:>10.4}{:>10.4}{:>12.4}", class.name(), errors.ate, errors.ase, errors.aoe)?;
    }
    writeln!(
        text,
        "\n{:<12}{:>12}{:>10}{}",
        "scored",
        "detections",
        "truths",
        match metrics.mode {
            Mode::Id => "",
            Mode::Ood => "      (ID + OOD)",
        }
    )?;
    for class in Harm::ALL {
        let (truths, n_detections) = (counts.truths.get(class), counts.detections.get(class));
        write!(text, "{:<12}{n_detections:>12}{:>10}", class.name(), truths.all)?;
        if metrics.mode == Mode::Ood {
            write!(text, "{:>16}", format!("({} + {})", truths.id, truths.ood))?;
        }
        writeln!(text)?;
    }
    write_notes(text, metrics)
}

fn write_scores(text: &mut String, name: &str, ours: &ClassScores, paper: &PaperScores) -> std::fmt::Result {
    write!(text, "{name:<28}")?;
    for (our, their) in [(ours.harmful, paper.0), (ours.harmless, paper.1), (ours.mean, paper.2)] {
        write!(text, "{:>16}", format!("{our:.4} ({their:.4})"))?;
    }
    writeln!(text)
}

fn write_notes(text: &mut String, metrics: &Metrics) -> std::fmt::Result {
    let filters = &metrics.filters;
    write!(
        text,
        "\nDropped at {} m or more: {} truths, {} detections",
        filters.max_range_m, filters.truths_out_of_range, filters.detections_out_of_range
    )?;
    if filters.drop_truths_without_points {
        write!(text, "; without a LiDAR point: {} truths", filters.truths_without_points)?;
    }
    writeln!(text, ".")?;
    let is_missing = Harm::ALL.into_iter().any(|class| {
        let truths = metrics.counts.truths.get(class);
        truths.all == 0 || (metrics.mode == Mode::Ood && (truths.id == 0 || truths.ood == 0))
    });
    if is_missing {
        writeln!(text, "Where there is no truth, AP is 0 and counts in the mean, as in nuScenes.")?;
    }
    writeln!(text, "The paper's figures come from another simulator: a yardstick, not the same work.")
}
