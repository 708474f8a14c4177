//! The text of an evaluation's breakdowns: confidence intervals, then one table an axis.

use std::fmt::Write as _;

use crate::eval::{Column, Evaluation, Group, GroupScores, Intervals};

/// The tables; the same evaluation gives the same bytes.
#[must_use]
pub fn breakdown(evaluation: &Evaluation) -> String {
    let mut text = String::new();
    write_all(&mut text, evaluation).expect("writing to a string cannot fail");
    text
}

fn write_all(text: &mut String, evaluation: &Evaluation) -> std::fmt::Result {
    if let Some(confidence) = &evaluation.confidence {
        writeln!(
            text,
            "{} % confidence, bootstrap of {} episodes, {} resamples",
            100.0 * confidence.level,
            confidence.n_episodes,
            confidence.n_resamples
        )?;
        writeln!(text, "{:<16}{:>18}{:>18}{:>18}", "", "harmful", "harmless", "mean")?;
        let names = ["total", "id_matched", "ood_all", "ood_matched"];
        for (column, name) in Column::ALL.into_iter().zip(names) {
            if let Some(Intervals { harmful, harmless, mean }) = confidence.columns.get(column) {
                write!(text, "{name:<16}")?;
                for interval in [harmful, harmless, mean] {
                    let shown =
                        interval.map_or("-".to_owned(), |[low, high]| format!("{low:.3} to {high:.3}"));
                    write!(text, "{shown:>18}")?;
                }
                writeln!(text)?;
            }
        }
        writeln!(text)?;
    }
    let config = &evaluation.metrics.config;
    writeln!(
        text,
        "AP as above; found, called the other class and missed at {} m with a score of {} or more",
        config.tp_threshold_m, config.operating_score
    )?;
    for breakdown in &evaluation.breakdowns {
        let of = if breakdown.axis.is_of_samples() { "of the sample" } else { "of the object" };
        writeln!(
            text,
            "\n{:<30}{:^43}{:^43}",
            format!("{} ({of})", breakdown.axis.name()),
            "harmful",
            "harmless"
        )?;
        write!(text, "{:<20}{:>10}", "", "samples")?;
        for _ in 0..2 {
            write!(
                text,
                "{:>7}{:>9}{:>7}{:>7}{:>7}{:>6}",
                "truths", "AP", "found", "other", "missed", "false"
            )?;
        }
        writeln!(text)?;
        breakdown.groups.iter().try_for_each(|group| write_group(text, group))?;
    }
    Ok(())
}

fn write_group(text: &mut String, group: &Group) -> std::fmt::Result {
    write!(text, "{:<20}{:>10}", group.name, group.n_samples)?;
    for scores in [&group.classes.harmful, &group.classes.harmless] {
        write_scores(text, scores)?;
    }
    writeln!(text)
}

fn write_scores(text: &mut String, scores: &GroupScores) -> std::fmt::Result {
    let share = |n: usize| match scores.n_truths {
        0 => "-".to_owned(),
        n_truths => format!("{:.3}", n as f64 / n_truths as f64),
    };
    let ap = scores.ap.map_or("-".to_owned(), |ap| format!("{ap:.4}"));
    let shares = [scores.n_found, scores.n_misclassified, scores.n_missed].map(share);
    write!(
        text,
        "{:>7}{ap:>9}{:>7}{:>7}{:>7}{:>6}",
        scores.n_truths, shares[0], shares[1], shares[2], scores.n_false
    )
}
