//! Detectors side by side as tables: each one's figure with its interval, and what it is more than the first one's.

use crate::eval::versus::{Versus, VersusFigure, VersusLine};

use super::table::{Cell, Table, number};

/// How a figure is written.
type Show<'a> = &'a dyn Fn(f64) -> String;

/// All tables: missed harm first, then AP of the class harmful and of both.
#[must_use]
pub fn tables(versus: &Versus, names: &[String]) -> Vec<Table> {
    let share = |of: f64| number(Some(100.0 * of), 1);
    let ap = |of: f64| number(Some(of), 3);
    let of_lines: [(&str, &str, &[VersusLine], Show<'_>); 4] = [
        ("harmful events missed, %", "events", &versus.missed, &share),
        ("harmful events warned of in time, %", "events", &versus.warned, &share),
        ("AP, harmful", "truths", &versus.harmful, &ap),
        ("AP, mean of both", "truths", &versus.mean, &ap),
    ];
    let mut tables: Vec<Table> = of_lines
        .into_iter()
        .filter(|(_, _, lines, _)| !lines.is_empty())
        .map(|(title, counted, lines, show)| table([title, counted], lines, names, show))
        .collect();
    let how = "After the semicolon: the difference from the first. Of missed events less is better, of warned ones and AP more. In rows of \
               objects (near, small, few points) a detection counts only if it lies on such an object; false alarms on nothing count in no such row.";
    let mut lines = [&versus.missed, &versus.warned, &versus.harmful, &versus.mean].into_iter().flatten();
    let of_runs = if lines.any(|line| line.figures.iter().any(|figure| !figure.runs.is_empty())) {
        " Of a detector of several runs the mean, and below it each run's; with seeds: the difference's interval with what other seeds would change, too."
    } else {
        ""
    };
    let note = if versus.n_resamples == 0 {
        format!("No intervals: they are drawn from several episodes. {how}{of_runs}")
    } else {
        format!(
            "In brackets intervals of {} % by a bootstrap over the {} episodes, {} resamples, the same for all. {how}{of_runs}",
            100.0 * versus.level,
            versus.n_episodes,
            versus.n_resamples
        )
    };
    if let Some(last) = tables.pop() {
        tables.push(last.with_note(note));
    }
    tables
}

/// `head`: the table's title, and what its lines count.
fn table(head: [&str; 2], lines: &[VersusLine], names: &[String], show: Show<'_>) -> Table {
    let row = |line: &VersusLine| {
        let cells = line.figures.iter().enumerate().map(|(i, figure)| cell(figure, i > 0, show));
        [line.name.as_str().into(), line.n_truths.to_string().into()].into_iter().chain(cells).collect()
    };
    let head = head.into_iter().chain(names.iter().map(String::as_str));
    Table::new(head, lines.iter().map(row).collect())
}

fn cell(figure: &VersusFigure, has_gain: bool, show: Show<'_>) -> Cell {
    let Some(value) = figure.value else { return "–".into() };
    let range = |[low, high]: [f64; 2]| format!("{}–{}", show(low), show(high));
    let signed = |of: f64| if of < 0.0 { show(of) } else { format!("+{}", show(of)) };
    let mut below: Vec<String> = figure.interval.iter().map(|&of| range(of)).collect();
    if let Some(over) = figure.over_first.filter(|_| has_gain) {
        let interval = figure.over_first_interval.map(|[low, high]| [low, high].map(signed).join(" to "));
        let gain = interval.map_or_else(|| signed(over), |interval| format!("{}: {interval}", signed(over)));
        let by_seed = figure
            .over_first_seeds_interval
            .map(|ends| format!("; with seeds {}", ends.map(signed).join(" to ")));
        let gain = gain + &by_seed.unwrap_or_default();
        let before = below.pop().map_or_else(String::new, |of| format!("{of}; "));
        below.push(before + &gain);
    }
    if !figure.runs.is_empty() {
        let runs = figure.runs.iter().map(|of| of.map_or_else(|| "–".to_owned(), show));
        below.push(format!("runs {}", runs.collect::<Vec<_>>().join(", ")));
    }
    Cell { text: show(value), below }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_has_no_gain_and_the_others_have_theirs_with_its_sign() {
        let figure = |value, over: f64| VersusFigure {
            value: Some(value),
            interval: Some([value - 0.1, value + 0.1]),
            over_first: Some(over),
            over_first_interval: Some([over - 0.02, over + 0.02]),
            over_first_seeds_interval: None,
            runs: Vec::new(),
        };
        let unknown = || VersusFigure {
            value: None,
            interval: None,
            over_first: None,
            over_first_interval: None,
            over_first_seeds_interval: None,
            runs: Vec::new(),
        };
        let of_runs = VersusFigure { runs: vec![Some(0.84), Some(0.86)], ..figure(0.85, 0.05) };
        let line = |name: &str, figures| VersusLine { name: name.to_owned(), n_truths: 7, figures };
        let versus = Versus {
            level: 0.95,
            n_resamples: 1000,
            n_episodes: 12,
            n_samples: 70,
            missed: vec![line("at 10 false alarms/km", vec![figure(0.3, 0.0), figure(0.2, -0.1), unknown()])],
            warned: vec![line(
                "at 10 false alarms/km, 8 m/s²",
                vec![figure(0.5, 0.0), figure(0.6, 0.1), unknown()],
            )],
            harmful: Vec::new(),
            mean: vec![line("total", vec![figure(0.8, 0.0), of_runs, unknown()])],
        };
        let names = ["lidar", "both", "other"].map(str::to_owned);
        let text: String = tables(&versus, &names).iter().map(Table::to_string).collect();
        insta::assert_snapshot!(text);
    }
}
