//! The course of a training as a picture: losses, learning rate and AP on the validation split over its steps.
//!
//! `curves.svg` and `curves.png` in the run's folder. Losses are means over a window of a hundredth of the steps, which
//! never reaches over the end of a stage. The same logs give the same bytes.

use std::path::{Path, PathBuf};

use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use thiserror::Error;

use super::plot::{self, Area, BLUE, DARK, Drawn, Figure, GREEN, GRID, PlotError, VERMILION};
use crate::files::write_atomic;
use crate::history::{History, HistoryError, ScoreRow, StepRow};

/// Names of the two files.
pub const FILES: [&str; 2] = ["curves.svg", "curves.png"];

const SIZE_PX: (u32, u32) = (960, 900);
/// Points of a line at most; more cannot be seen.
const MAX_POINTS: usize = 600;

/// Why the picture could not be made.
#[derive(Debug, Error)]
pub enum CurvesError {
    #[error(transparent)]
    History(#[from] HistoryError),
    #[error(transparent)]
    Plot(#[from] PlotError),
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

/// Draws a run, finished or under way, into its own folder; returns the files' paths.
///
/// # Errors
/// The folder holds no logs of a run, or cannot be written to.
pub fn run(folder: &Path) -> Result<[PathBuf; 2], CurvesError> {
    let history = History::read(folder)?;
    let paths = FILES.map(|name| folder.join(name));
    write_atomic(&paths[0], svg(&history)?.as_bytes())?;
    write_atomic(&paths[1], &png(&history)?)?;
    Ok(paths)
}

/// The picture as SVG.
///
/// # Errors
/// The plotting library refuses.
pub fn svg(history: &History) -> Result<String, PlotError> {
    plot::svg(&Course(history))
}

/// The picture as PNG.
///
/// # Errors
/// The plotting library refuses.
pub fn png(history: &History) -> Result<Vec<u8>, PlotError> {
    plot::png(&Course(history))
}

/// The course of a training.
struct Course<'a>(&'a History);

impl Figure for Course<'_> {
    fn size_px(&self) -> (u32, u32) {
        SIZE_PX
    }

    fn draw<DB: DrawingBackend>(&self, area: &Area<DB>, scale: u32) -> Drawn<DB> {
        Page { history: self.0, scale }.draw(area)
    }
}

/// One panel: what it shows.
struct Panel {
    title: &'static str,
    x_name: &'static str,
    y_name: String,
    y_range: [f64; 2],
    n_y_labels: usize,
    y_label: fn(f64) -> String,
    lines: Vec<Line>,
    /// Without one where there is one line.
    legend: Option<SeriesLabelPosition>,
}

/// A line in parts, one a stage; points are (step, value).
struct Line {
    name: String,
    color: RGBColor,
    parts: Vec<Vec<(f64, f64)>>,
    has_marks: bool,
}

/// A line's name, what it draws of a row, and its colour.
type Part<R> = (&'static str, fn(&R) -> f64, RGBColor);

fn losses(history: &History) -> Panel {
    let steps = &history.steps;
    let window = (steps.len() / 100).max(1);
    let parts: [Part<StepRow>; 4] = [
        ("all", |row| row.heatmap + row.harm + row.boxes, DARK),
        ("heatmap", |row| row.heatmap, BLUE),
        ("boxes", |row| row.boxes, GREEN),
        ("harm", |row| row.harm, VERMILION),
    ];
    let lines = parts.map(|(name, of, color)| {
        let parts = smoothed(steps, window, of);
        let last = parts.iter().flatten().last().map_or(0.0, |&(_, y)| y);
        Line { name: format!("{name} {last:.3}"), color, parts, has_marks: false }
    });
    let values = lines.iter().flat_map(|line| line.parts.iter().flatten().map(|&(_, y)| y));
    let ends = |(low, high): (f64, f64), y: f64| (low.min(y), high.max(y));
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), ends);
    let low = low.max(1e-5);
    Panel {
        title: "losses, learning rate and AP on the validation split",
        x_name: "",
        y_name: if window == 1 { "loss".to_owned() } else { format!("loss, mean of {window} steps") },
        y_range: [0.8 * low, 1.25 * high.max(low)],
        n_y_labels: 30,
        y_label: |y| if y < 0.1 { format!("{y:.2}") } else { format!("{y:.1}") },
        lines: lines.into(),
        legend: Some(SeriesLabelPosition::UpperRight),
    }
}

fn rates(history: &History) -> Panel {
    let parts = smoothed(&history.steps, 1, |row| row.learning_rate);
    let high = parts.iter().flatten().fold(f64::MIN_POSITIVE, |high, &(_, y)| high.max(y));
    Panel {
        title: "",
        x_name: "",
        y_name: "learning rate".to_owned(),
        y_range: [0.0, 1.1 * high],
        n_y_labels: 4,
        y_label: |y| if y == 0.0 { "0".to_owned() } else { format!("{y:.1e}") },
        lines: vec![Line { name: String::new(), color: DARK, parts, has_marks: false }],
        legend: None,
    }
}

fn scores(history: &History) -> Panel {
    let scores = &history.scores;
    let parts: [Part<ScoreRow>; 3] = [
        ("harmless", |row| row.harmless, BLUE),
        ("harmful", |row| row.harmful, VERMILION),
        ("mean", |row| row.mean, DARK),
    ];
    let lines = parts.into_iter().filter_map(|(name, of, color)| {
        let last = of(scores.last()?);
        let parts = vec![scores.iter().map(|row| (row.n_done as f64, of(row))).collect()];
        Some(Line { name: format!("{name} {last:.3}"), color, parts, has_marks: true })
    });
    Panel {
        title: "",
        x_name: "steps",
        y_name: if scores.is_empty() { "AP (not validated yet)" } else { "AP, 0 to 1" }.to_owned(),
        y_range: [0.0, 1.0],
        n_y_labels: 6,
        y_label: |y| format!("{y:.1}"),
        lines: lines.collect(),
        legend: (!scores.is_empty()).then_some(SeriesLabelPosition::LowerRight),
    }
}

/// Means over a window about each step, stage by stage, thinned to what can be seen.
fn smoothed(steps: &[StepRow], window: usize, of: fn(&StepRow) -> f64) -> Vec<Vec<(f64, f64)>> {
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

/// The three panels, one below the other; sizes are in pixels times `scale`.
struct Page<'a> {
    history: &'a History,
    scale: u32,
}

impl Page<'_> {
    fn draw<DB: DrawingBackend>(&self, area: &Area<DB>) -> Drawn<DB> {
        let (top, rest) = area.split_vertically(self.px(400));
        let (middle, bottom) = rest.split_vertically(self.px(170));
        let losses = losses(self.history);
        let [low, high] = losses.y_range;
        self.panel(&top, &losses, (low..high).log_scale())?;
        for (area, panel) in [(&middle, rates(self.history)), (&bottom, scores(self.history))] {
            let [low, high] = panel.y_range;
            self.panel(area, &panel, low..high)?;
        }
        Ok(())
    }

    fn panel<DB, Y>(&self, area: &Area<DB>, panel: &Panel, y: Y) -> Drawn<DB>
    where
        DB: DrawingBackend,
        Y: AsRangedCoord<Value = f64>,
        Y::CoordDescType: ValueFormatter<f64>,
    {
        let n_steps = self.history.steps.last().map_or(1, |row| row.n_done) as f64;
        let mut builder = ChartBuilder::on(area);
        builder
            .margin(self.px(8))
            .margin_right(self.px(24))
            .x_label_area_size(self.px(if panel.x_name.is_empty() { 24 } else { 46 }))
            .y_label_area_size(self.px(70));
        if !panel.title.is_empty() {
            builder.caption(panel.title, self.font(17));
        }
        let mut chart = builder.build_cartesian_2d(0.0..n_steps, y)?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(GRID.stroke_width(self.scale))
            .axis_style(DARK.stroke_width(self.scale))
            .set_all_tick_mark_size(self.px(4))
            .label_style(self.font(13))
            .axis_desc_style(self.font(15))
            .x_desc(panel.x_name)
            .y_desc(&panel.y_name)
            .x_labels(10)
            .x_label_formatter(&|x| format!("{x:.0}"))
            .y_labels(panel.n_y_labels)
            .y_label_formatter(&|y| (panel.y_label)(*y))
            .draw()?;
        let [low, high] = panel.y_range;
        for pair in self.history.steps.windows(2).filter(|pair| pair[0].stage != pair[1].stage) {
            // Where a stage ends and another begins.
            let ends = [(pair[0].n_done as f64, low), (pair[0].n_done as f64, high)];
            let pen = self.pen(DARK, 1);
            chart.draw_series(DashedLineSeries::new(ends, self.px(6), self.px(5), pen))?;
            if !panel.title.is_empty() {
                let text = format!(" {} stage ", pair[1].stage);
                let side = if ends[0].0 > 0.85 * n_steps { HPos::Right } else { HPos::Left };
                let anchored = self.font(14).pos(Pos::new(side, VPos::Bottom));
                chart.draw_series([Text::new(text, ends[0], anchored)])?;
            }
        }
        for line in &panel.lines {
            let pen = self.pen(line.color, 2);
            let marks = if line.has_marks { self.px(3) as u32 } else { 0 };
            for (i, part) in line.parts.iter().enumerate() {
                let series = LineSeries::new(part.iter().copied(), pen.filled()).point_size(marks);
                let drawn = chart.draw_series(series)?;
                if i == 0 && panel.legend.is_some() {
                    let length = self.px(24);
                    drawn
                        .label(&line.name)
                        .legend(move |(x, y)| PathElement::new([(x, y), (x + length, y)], pen));
                }
            }
        }
        if let Some(position) = panel.legend.clone() {
            chart
                .configure_series_labels()
                .position(position)
                .margin(self.px(12))
                .legend_area_size(self.px(34))
                .border_style(GRID.stroke_width(self.scale))
                .background_style(WHITE.mix(0.9))
                .label_font(self.font(14))
                .draw()?;
        }
        Ok(())
    }

    fn px(&self, px: u32) -> i32 {
        (px * self.scale) as i32
    }

    fn font(&self, px: u32) -> TextStyle<'static> {
        plot::font(px, self.scale)
    }

    fn pen(&self, color: RGBColor, width_px: u32) -> ShapeStyle {
        color.stroke_width(width_px * self.scale)
    }
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
            gradient_norm: 1.0,
        };
        let score = |epoch: usize| ScoreRow {
            n_done: 100 * (epoch + 1),
            stage: "lidar".into(),
            epoch,
            harmful: 0.1 * epoch as f64,
            harmless: 0.5,
            mean: 0.05 * epoch as f64 + 0.25,
        };
        History { steps: (0..1000).map(step).collect(), scores: (0..10).map(score).collect() }
    }

    #[test]
    fn means_smooth_within_a_stage_and_never_over_its_end() {
        let steps = history().steps;
        let heatmap = smoothed(&steps, 10, |row| row.heatmap);
        assert_eq!(heatmap.len(), 2);
        assert!(heatmap[0].iter().all(|&(_, y)| y == 2.0) && heatmap[1].iter().all(|&(_, y)| y == 1.0));
        let boxes = smoothed(&steps, 10, |row| row.boxes);
        assert!(boxes.iter().flatten().all(|&(_, y)| (y - 1.5).abs() < 0.11));
        assert_eq!(boxes[1].last().map(|&(x, _)| x), Some(1000.0));
        assert!(boxes.iter().flatten().count() < MAX_POINTS);
    }

    #[test]
    fn the_same_history_gives_the_same_bytes_and_all_that_is_named() {
        let history = history();
        let text = svg(&history).unwrap();
        for name in ["harmful 0.900", "mean 0.700", "fused stage", "learning rate", "steps", "heatmap 1.000"]
        {
            assert!(text.contains(name), "{name}");
        }
        assert_eq!(text, svg(&history).unwrap());
        let picture = png(&history).unwrap();
        assert!(picture == png(&history).unwrap());
        let picture = image::load_from_memory(&picture).unwrap().into_rgb8();
        assert_eq!(picture.dimensions(), SIZE_PX);
        assert_eq!(picture.get_pixel(2, 2).0, [255; 3], "the ground is white");
        assert!(picture.pixels().any(|pixel| pixel.0 == VERMILION_RGB), "a line is drawn in its own tone");
    }

    const VERMILION_RGB: [u8; 3] = [VERMILION.0, VERMILION.1, VERMILION.2];

    #[test]
    fn one_step_without_a_validation_is_drawn_too() {
        let History { mut steps, .. } = history();
        steps.truncate(1);
        let text = svg(&History { steps, scores: Vec::new() }).unwrap();
        assert!(text.contains("not validated yet"));
    }
}
