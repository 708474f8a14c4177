//! The course of a training as a picture: losses, learning rate and AP on the validation split over its steps.
//!
//! `curves.svg` and `curves.png` in the run's folder. Losses are means over a window of a hundredth of the steps, which
//! never crosses the end of a stage. The same logs give the same bytes.

use std::path::{Path, PathBuf};

use thiserror::Error;

use super::chart::{self, Axis, Chart, ChartError, Look, Series, Sheet, Tone};
use crate::files::{FolderLock, write_atomic};
use crate::history::{CURVE_FILES, History, HistoryError, ScoreRow, StepRow};

/// Names of the two files.
pub const FILES: [&str; 2] = CURVE_FILES;

/// Name of the lock, another than that of the run, which is drawn while its training writes there.
const LOCK_FILE: &str = "curves.partial";

/// Most points of a line; more cannot be seen.
const MAX_POINTS: usize = 600;

/// Why the picture could not be made.
#[derive(Debug, Error)]
pub enum CurvesError {
    #[error(transparent)]
    History(#[from] HistoryError),
    #[error(transparent)]
    Chart(#[from] ChartError),
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

/// Draws a run, finished or under way, into its own folder; returns the files' paths.
///
/// # Errors
/// The folder holds no logs of a run, or cannot be written to; another process draws it.
pub fn run(folder: &Path) -> Result<[PathBuf; 2], CurvesError> {
    let drawn = History::read(folder)?;
    let _lock = FolderLock::take_named(folder, LOCK_FILE)?;
    let sheet = sheet(&drawn);
    let paths = FILES.map(|name| folder.join(name));
    write_atomic(&paths[0], chart::svg(&sheet)?.as_bytes())?;
    write_atomic(&paths[1], &chart::png(&sheet)?)?;
    Ok(paths)
}

/// The charts of a training, one below the other.
#[must_use]
pub fn sheet(history: &History) -> Sheet {
    Sheet::column(vec![losses(history), rates(history), scores(history)])
}

/// A line's name, the value that it draws from a row, and its colour.
type Part<R, Value = f64> = (&'static str, fn(&R) -> Value, Tone);

fn losses(history: &History) -> Chart {
    let steps = &history.steps;
    let window = (steps.len() / 100).max(1);
    let parts: [Part<StepRow>; 5] = [
        ("all", |row| row.heatmap + row.harm + row.boxes + row.picture, Tone::Ink),
        ("heatmap", |row| row.heatmap, Tone::Harmless),
        ("boxes", |row| row.boxes, Tone::Green),
        ("harm", |row| row.harm, Tone::Harmful),
        ("picture", |row| row.picture, Tone::Amber),
    ];
    let mut series = Vec::new();
    for (name, of, tone) in parts {
        let mut stages = smooth(steps, window, of);
        // A part that a stage lacks, as `picture` without a camera and in older logs, has no place on a logarithmic axis.
        stages.retain(|points| points.iter().any(|&(_, y)| y != 0.0));
        let last = stages.iter().flatten().last().map_or(0.0, |&(_, y)| y);
        for (i, points) in stages.into_iter().enumerate() {
            let name = if i == 0 { format!("{name} {last:.3}") } else { String::new() };
            series.push(Series::new(name, tone, Look::Line, points));
        }
    }
    let values = series.iter().flat_map(|line| &line.points).map(|point| point.1);
    let ends = |(low, high): (f64, f64), y: f64| (low.min(y), high.max(y));
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), ends);
    let low = if series.is_empty() { 1e-5 } else { low.max(1e-5) };
    let y_name = if window == 1 { "loss".to_owned() } else { format!("loss, mean of {window} steps") };
    let y = Axis::log(&y_name, 0.8 * low, 1.25 * high.max(low));
    let title = "Losses, learning rate and AP on the validation split";
    let mut chart = over_steps(title, history, "", y, series, 400);
    let stage_name = |row: &StepRow| format!("{} stage", row.stage);
    let names = stage_ends(history).map(|[_, next]| ((next.n_done as f64, 0.9 * low), stage_name(next)));
    chart.texts = names.collect();
    chart
}

fn rates(history: &History) -> Chart {
    let stages = smooth(&history.steps, 1, |row| row.learning_rate);
    let high = stages.iter().flatten().fold(f64::MIN_POSITIVE, |high, &(_, y)| high.max(y));
    let series = stages.into_iter().map(|points| Series::new("", Tone::Ink, Look::Line, points));
    over_steps("", history, "", Axis::over("learning rate", 0.0, 1.1 * high), series.collect(), 190)
}

fn scores(history: &History) -> Chart {
    let scores = &history.scores;
    let parts: [Part<ScoreRow, Option<f64>>; 3] = [
        ("AP harmless", |row| row.harmless, Tone::Harmless),
        ("AP harmful", |row| row.harmful, Tone::Harmful),
        ("mAP", |row| row.mean, Tone::Ink),
    ];
    let series = parts.into_iter().filter_map(|(name, of, tone)| {
        let points: Vec<_> = scores.iter().filter_map(|row| Some((row.n_done as f64, of(row)?))).collect();
        let name = format!("{name} {:.3}", points.last()?.1);
        Some(Series::new(name, tone, Look::LineAndDots, points))
    });
    let y_name = if scores.is_empty() { "AP (not validated yet)" } else { "AP" };
    over_steps("", history, "steps", Axis::share(y_name), series.collect(), 330)
}

/// A chart over all steps, with a stroke where a stage ends and another begins.
fn over_steps(
    title: &str,
    history: &History,
    x_name: &str,
    y: Axis,
    mut series: Vec<Series>,
    height_px: u32,
) -> Chart {
    let n_steps = history.steps.last().map_or(1, |row| row.n_done) as f64;
    for [last, _] in stage_ends(history) {
        let ends = [y.low, y.high].map(|y| (last.n_done as f64, y));
        series.push(Series::new("", Tone::Soft, Look::Dashed, ends.into()));
    }
    Chart::new(title, Axis::over(x_name, 0.0, n_steps), y, series, height_px)
}

/// The last step of each stage and the first of the next.
fn stage_ends(history: &History) -> impl Iterator<Item = [&StepRow; 2]> {
    history.steps.windows(2).filter(|pair| pair[0].stage != pair[1].stage).map(|pair| [&pair[0], &pair[1]])
}

/// Means over a window about each step, stage by stage, thinned to as many points as can be seen.
fn smooth(steps: &[StepRow], window: usize, of: fn(&StepRow) -> f64) -> Vec<Vec<(f64, f64)>> {
    let every = steps.len().div_ceil(MAX_POINTS).max(1);
    let of_stage = |stage: &[StepRow]| {
        let mean = |i: usize| {
            let near = &stage[i.saturating_sub(window / 2)..(i + window.div_ceil(2)).min(stage.len())];
            near.iter().map(of).sum::<f64>() / near.len() as f64
        };
        let last = stage.len() - 1;
        (0..last).step_by(every).chain([last]).map(|i| (stage[i].n_done as f64, mean(i))).collect()
    };
    steps.chunk_by(|a, b| a.stage == b.stage).map(of_stage).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn history() -> History {
        let step = |n: usize| StepRow {
            n_done: n + 1,
            stage: if n < 700 { "lidar" } else { "fused" }.into(),
            epoch: n / 100,
            learning_rate: 1e-3,
            heatmap: if n < 700 { 2.0 } else { 1.0 },
            harm: 0.5,
            boxes: 1.0 + (n % 2) as f64,
            picture: if n < 700 { 0.0 } else { 0.25 },
            gradient_norm: 1.0,
        };
        let score = |epoch: usize| ScoreRow {
            n_done: 100 * (epoch + 1),
            stage: "lidar".into(),
            epoch,
            harmful: Some(0.1 * epoch as f64),
            harmless: Some(0.5),
            mean: Some(0.05 * epoch as f64 + 0.25),
        };
        History { steps: (0..1000).map(step).collect(), scores: (0..10).map(score).collect() }
    }

    #[test]
    fn means_smooth_within_a_stage_and_never_over_its_end() {
        let steps = history().steps;
        let heatmap = smooth(&steps, 10, |row| row.heatmap);
        assert_eq!(heatmap.len(), 2);
        assert!(heatmap[0].iter().all(|&(_, y)| y == 2.0) && heatmap[1].iter().all(|&(_, y)| y == 1.0));
        let boxes = smooth(&steps, 10, |row| row.boxes);
        assert!(boxes.iter().flatten().all(|&(_, y)| (y - 1.5).abs() < 0.11));
        assert_eq!(boxes[1].last().map(|&(x, _)| x), Some(1000.0));
        assert!(boxes.iter().flatten().count() < MAX_POINTS);
    }

    #[test]
    fn all_that_is_logged_is_named_with_its_last_value() {
        let text = chart::svg(&sheet(&history())).unwrap();
        for name in ["harmful 0.900", "mAP 0.700", "fused stage", "learning rate", "steps", "heatmap 1.000"] {
            assert!(text.contains(name), "{name}");
        }
        // The sum is that of all four parts: 1, 0.5, 1.5 and 0.25.
        for name in ["picture 0.250", "all 3.250"] {
            assert!(text.contains(name), "{name}");
        }
    }

    #[test]
    fn a_part_that_was_never_learnt_has_no_line_and_leaves_the_axis_alone() {
        let mut without = history();
        without.steps.iter_mut().for_each(|row| row.picture = 0.0);
        let chart = losses(&without);
        assert!(chart.series.iter().all(|line| !line.name.starts_with("picture")));
        assert!(chart.y.low > 0.1, "{}", chart.y.low);
    }

    #[test]
    fn a_run_is_drawn_while_its_training_writes_and_by_one_process_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        history().write(folder.path()).unwrap();
        let _training = FolderLock::take(folder.path()).unwrap();
        assert!(run(folder.path()).unwrap().iter().all(|path| path.is_file()));
        let _drawing = FolderLock::take_named(folder.path(), LOCK_FILE).unwrap();
        let told = run(folder.path()).unwrap_err().to_string();
        assert!(told.contains("another process writes here"), "{told}");
    }

    #[test]
    fn one_step_without_a_validation_is_drawn_too() {
        let History { mut steps, .. } = history();
        steps.truncate(1);
        let text = chart::svg(&sheet(&History { steps, scores: Vec::new() })).unwrap();
        assert!(text.contains("not validated yet"));
    }
}
