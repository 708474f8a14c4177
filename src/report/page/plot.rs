//! A chart as vector graphics in the page, drawn by plotters.
//!
//! Each tone is one fixed colour in the drawing; the page's style sheet gives every such colour its value in light and
//! dark. The drawing has no ground of its own, and no name: the page writes title and legend around it.

use std::ops::Range;
use std::sync::Once;

use plotters::coord::Shift;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::element::EmptyElement;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};
use serde::Serialize;

use super::ReportError;

/// Width of a chart in the page where there is room, pixels.
const WIDTH_PX: u32 = 480;
/// Coordinates are whole numbers; so many of them make a pixel.
const FINER: u32 = 4;

/// Room for a character of a label: the widest of the faces that a page may be shown in (DejaVu Sans) needs so much.
const CHARACTER_PX: u32 = 9;

/// The page sets the face; the library needs one to measure by.
const FONT: &str = "sans-serif";

type Drawn<DB> = Result<(), DrawingAreaErrorKind<<DB as DrawingBackend>::ErrorType>>;

/// What a colour stands for; `report.css` has its values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Tone {
    Ink,
    Soft,
    Grid,
    Harmful,
    Harmless,
    Green,
    Amber,
}

impl Tone {
    /// For lines that are told apart and have no meaning of their own.
    pub const ROW: [Self; 4] = [Self::Harmless, Self::Green, Self::Amber, Self::Harmful];

    /// The colour in the drawing (Okabe and Ito 2008, which colour-blind people tell apart).
    pub const fn rgb(self) -> RGBColor {
        match self {
            Self::Ink => RGBColor(40, 44, 52),
            Self::Soft => RGBColor(106, 115, 128),
            Self::Grid => RGBColor(222, 226, 230),
            Self::Harmful => RGBColor(213, 94, 0),
            Self::Harmless => RGBColor(0, 114, 178),
            Self::Green => RGBColor(0, 158, 115),
            Self::Amber => RGBColor(230, 159, 0),
        }
    }
}

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Look {
    Line,
    Dashed,
    Dots,
    LineAndDots,
    Diamonds,
    /// A stroke between each two points, the first and second, the third and fourth, ..
    Strokes,
}

/// Points of one meaning.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// In the legend; without a name it is not there.
    pub name: String,
    pub tone: Tone,
    pub look: Look,
    pub points: Vec<(f64, f64)>,
}

/// One direction of a chart.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    pub name: String,
    pub low: f64,
    pub high: f64,
    /// Where a line is drawn, and what is written there.
    pub ticks: Vec<(f64, String)>,
}

impl Axis {
    /// From 0 to 1.
    pub fn share(name: &str) -> Self {
        let ticks = (0..=5).map(|i| (f64::from(i) / 5.0, format!("{:.1}", f64::from(i) / 5.0)));
        Self { name: name.to_owned(), low: 0.0, high: 1.0, ticks: ticks.collect() }
    }

    /// Over all values, with ticks at round numbers; `low` and `high` must be finite.
    pub fn over(name: &str, low: f64, high: f64) -> Self {
        let high = if high > low { high } else { low + 1.0 };
        let rough = (high - low) / 7.0;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|n| n * power).into_iter().find(|&step| step >= rough);
        let step = step.unwrap_or(rough);
        let n_decimals = (-step.log10().floor()).max(0.0) as usize;
        let (first, last) = ((low / step - 1e-9).ceil() as i64, (high / step + 1e-9).floor() as i64);
        // Adding zero: no tick is called -0.
        let ticks = (first..=last).map(|i| i as f64 * step + 0.0);
        let ticks = ticks.map(|at| (at, format!("{at:.n_decimals$}"))).collect();
        Self { name: name.to_owned(), low, high, ticks }
    }

    /// Names one below the other; [`row`] says where each is.
    pub fn rows(names: &[String]) -> Self {
        let ticks = names.iter().enumerate().map(|(i, name)| (row(i, names.len()), name.clone())).collect();
        Self { name: String::new(), low: -0.6, high: names.len() as f64 - 0.4, ticks }
    }

    fn label(&self, at: f64) -> String {
        let nearest = self.ticks.iter().min_by(|a, b| (a.0 - at).abs().total_cmp(&(b.0 - at).abs()));
        nearest.map_or_else(String::new, |tick| tick.1.clone())
    }
}

/// An axis as the plotting library wants it: straight, with no ticks but its own.
struct Ticked(Axis);

impl Ranged for Ticked {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (start, end): (i32, i32)) -> i32 {
        let share = (value - self.0.low) / (self.0.high - self.0.low);
        start + (share * f64::from(end - start)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        let wants_light_ones = hint.weight().allow_light_points();
        self.0.ticks.iter().filter(|_| !wants_light_ones).map(|tick| tick.0).collect()
    }

    fn range(&self) -> Range<f64> {
        self.0.low..self.0.high
    }
}

impl ValueFormatter<f64> for Ticked {
    fn format_ext(&self, value: &f64) -> String {
        self.0.label(*value)
    }
}

/// Height of a row on [`Axis::rows`].
pub fn row(i: usize, n: usize) -> f64 {
    n as f64 - 1.0 - i as f64
}

/// What is drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    pub x: Axis,
    pub y: Axis,
    pub series: Vec<Series>,
    pub height_px: u32,
}

/// The chart as an `svg` element; the same chart gives the same bytes.
///
/// # Errors
/// The plotting library refuses.
pub fn svg(chart: &Chart) -> Result<String, ReportError> {
    static FONT_ONCE: Once = Once::new();
    FONT_ONCE.call_once(|| {
        // Fails only for bytes that are no font; drawing text would then say so.
        let _ = register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT);
    });
    let mut text = String::new();
    let size = (WIDTH_PX * FINER, chart.height_px * FINER);
    draw(chart, &SVGBackend::with_string(&mut text, size).into_drawing_area())
        .map_err(|error| ReportError::Plot { message: error.to_string() })?;
    // The page sets the size; inside HTML the name space goes without saying.
    let body = text.split_once('>').map_or("", |(_, body)| body);
    Ok(format!("<svg viewBox=\"0 0 {} {}\" aria-hidden=\"true\">{body}", size.0, size.1))
}

fn draw<DB: DrawingBackend>(chart: &Chart, area: &DrawingArea<DB, Shift>) -> Drawn<DB> {
    let widest = chart.y.ticks.iter().map(|tick| tick.1.chars().count()).max().unwrap_or(0) as u32;
    let name_px = if chart.y.name.is_empty() { 0 } else { 20 };
    let mut plane = ChartBuilder::on(area)
        .margin(px(6))
        // Half of the topmost label stands above the plane.
        .margin_top(px(12))
        .margin_right(px(18))
        .x_label_area_size(px(if chart.x.name.is_empty() { 24 } else { 44 }))
        .y_label_area_size(px(14 + CHARACTER_PX * widest + name_px))
        .build_cartesian_2d(Ticked(chart.x.clone()), Ticked(chart.y.clone()))?;
    plane
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(pen(Tone::Grid, 1))
        .axis_style(pen(Tone::Soft, 1))
        .set_all_tick_mark_size(px(4))
        .label_style(font(14, Tone::Soft))
        .axis_desc_style(font(15, Tone::Ink))
        .x_desc(chart.x.name.as_str())
        .y_desc(chart.y.name.as_str())
        .x_labels(chart.x.ticks.len())
        .y_labels(chart.y.ticks.len())
        .x_label_formatter(&|&at| chart.x.label(at))
        .y_label_formatter(&|&at| chart.y.label(at))
        .draw()?;
    for series in &chart.series {
        let (points, tone) = (series.points.as_slice(), series.tone);
        if matches!(series.look, Look::Line | Look::LineAndDots) {
            plane.draw_series(LineSeries::new(points.iter().copied(), pen(tone, 2)))?;
        }
        if matches!(series.look, Look::Dots | Look::LineAndDots) {
            let radius = px(if series.look == Look::Dots { 5 } else { 3 });
            plane.draw_series(points.iter().map(|&at| Circle::new(at, radius, tone.rgb().filled())))?;
        }
        match series.look {
            Look::Dashed => {
                let points = points.iter().copied();
                plane.draw_series(DashedLineSeries::new(points, px(5), px(4), pen(tone, 2)))?;
            }
            Look::Diamonds => {
                let r = px(6);
                let corners = [(-r, 0), (0, -r), (r, 0), (0, r), (-r, 0)];
                plane.draw_series(
                    points
                        .iter()
                        .map(|&at| EmptyElement::at(at) + PathElement::new(corners.to_vec(), pen(tone, 2))),
                )?;
            }
            Look::Strokes => {
                let ends = points.chunks_exact(2);
                plane.draw_series(ends.map(|ends| PathElement::new(ends.to_vec(), pen(tone, 3))))?;
            }
            Look::Line | Look::Dots | Look::LineAndDots => {}
        }
    }
    area.present()
}

fn px(px: u32) -> i32 {
    (px * FINER) as i32
}

fn font(size_px: u32, tone: Tone) -> TextStyle<'static> {
    // The library writes a size of 1.24 as one of 1.
    (FONT, 1.24 * f64::from(size_px * FINER)).into_font().color(&tone.rgb())
}

fn pen(tone: Tone, width_px: u32) -> ShapeStyle {
    tone.rgb().stroke_width(width_px * FINER)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart() -> Chart {
        let looks = [Look::Line, Look::Dashed, Look::Dots, Look::LineAndDots, Look::Diamonds, Look::Strokes];
        let points = vec![(0.1, 0.2), (0.5, 0.9)];
        let series =
            looks.map(|look| Series { name: "s".into(), tone: Tone::Harmful, look, points: points.clone() });
        let y = Axis::rows(&["<b>&\"".to_owned(), "below".to_owned()]);
        Chart { x: Axis::share("recall"), y, series: series.into(), height_px: 200 }
    }

    #[test]
    fn a_chart_is_drawn_in_its_tones_with_its_names_escaped_and_always_alike() {
        let text = svg(&chart()).unwrap();
        for part in ["viewBox=\"0 0 1920 800\"", "#D55E00", "recall", "0.4", "&lt;b&gt;&amp;&quot;", "</svg>"]
        {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert!(!text.contains("http") && !text.contains("<b>"));
        assert_eq!(text, svg(&chart()).unwrap());
    }

    #[test]
    fn ticks_are_round_numbers_within_the_axis() {
        let ticks =
            |low, high| Axis::over("", low, high).ticks.into_iter().map(|tick| tick.1).collect::<Vec<_>>();
        assert_eq!(ticks(0.0, 14.0), ["0", "2", "4", "6", "8", "10", "12", "14"]);
        assert_eq!(ticks(-35.0, 35.0), ["-30", "-20", "-10", "0", "10", "20", "30"]);
        assert_eq!(ticks(0.0, 0.3), ["0.00", "0.05", "0.10", "0.15", "0.20", "0.25", "0.30"]);
        assert_eq!(ticks(2.0, 2.0).first().map(String::as_str), Some("2.0"));
    }

    #[test]
    fn a_chart_without_points_or_rows_is_drawn_too() {
        let empty = Chart { y: Axis::rows(&[]), series: vec![], ..chart() };
        assert!(svg(&empty).unwrap().ends_with("</svg>\n"));
    }
}
