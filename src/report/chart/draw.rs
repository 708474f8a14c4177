//! Draws charts with plotters, on any of its backends.

use std::io::Cursor;
use std::sync::Once;

use image::{ImageFormat, RgbImage, imageops};
use plotters::coord::Shift;
use plotters::element::{DashedPathElement, EmptyElement};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontStyle, register_font};
use thiserror::Error;

use super::axis::Ticked;
use super::{Chart, Look, Series, Sheet, Tone};

/// Coordinates are whole numbers; this many of them make a pixel.
const FINER: u32 = 4;
/// Width of a chart in the page where there is room, pixels.
const INLINE_WIDTH_PX: u32 = 480;
const SHEET_TITLE_PX: u32 = 46;
const TITLE_PX: u32 = 30;
const LEGEND_ROW_PX: u32 = 22;
/// Room for a character of a label, as the widest font of a page (DejaVu Sans) needs it.
const CHARACTER_PX: u32 = 9;
/// Points right of this share of the plane have their words on the left.
const TURN_SHARE: f64 = 0.8;
/// The page sets the font; the library needs one to measure text, and draws pictures with it.
const FONT: &str = "sans-serif";

/// Why a chart could not be drawn.
#[derive(Debug, Error)]
pub enum ChartError {
    #[error("the chart cannot be drawn: {message}")]
    Draw { message: String },
    #[error("the chart cannot be packed: {0}")]
    Png(#[from] image::ImageError),
}

type Area<DB> = DrawingArea<DB, Shift>;
type Drawn<DB> = Result<(), DrawingAreaErrorKind<<DB as DrawingBackend>::ErrorType>>;

/// The kind of drawing: a picture with all its words, or the plane of a chart that the page writes words
/// around.
enum Drawing<'a> {
    Sheet(&'a Sheet),
    Inline(&'a Chart),
}

/// A sheet as an SVG file.
///
/// # Errors
/// The plotting library refuses.
pub fn svg(sheet: &Sheet) -> Result<String, ChartError> {
    svg_of(&Drawing::Sheet(sheet), |[width, height]| {
        format!("width=\"{width}\" height=\"{height}\" xmlns=\"http://www.w3.org/2000/svg\"")
    })
}

/// A chart as an `svg` element of the page, which sets its size and colours and writes title and legend around it.
///
/// # Errors
/// The plotting library refuses.
pub fn inline_svg(chart: &Chart) -> Result<String, ChartError> {
    svg_of(&Drawing::Inline(chart), |_| "aria-hidden=\"true\"".to_owned())
}

fn svg_of(drawing: &Drawing<'_>, attributes: impl Fn([u32; 2]) -> String) -> Result<String, ChartError> {
    register_font_once();
    let size_px = drawing.size_px();
    let [width, height] = size_px.map(|px| px * FINER);
    let mut text = String::new();
    draw(drawing, SVGBackend::with_string(&mut text, (width, height)))?;
    let body = text.split_once('>').map_or("", |(_, body)| body);
    Ok(format!("<svg viewBox=\"0 0 {width} {height}\" {}>{body}", attributes(size_px)))
}

/// A sheet as a PNG file.
///
/// # Errors
/// The plotting library refuses.
pub fn png(sheet: &Sheet) -> Result<Vec<u8>, ChartError> {
    register_font_once();
    let drawing = Drawing::Sheet(sheet);
    let [width, height] = drawing.size_px().map(|px| px * FINER);
    let mut pixels = vec![0; (3 * width * height) as usize];
    draw(&drawing, BitMapBackend::with_buffer(&mut pixels, (width, height)))?;
    let fine = RgbImage::from_raw(width, height, pixels).expect("the buffer has three bytes a pixel");
    // Drawn larger and shrunk, edges are smooth.
    let picture = imageops::resize(&fine, width / FINER, height / FINER, imageops::FilterType::Triangle);
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

fn register_font_once() {
    static FONT_ONCE: Once = Once::new();
    FONT_ONCE.call_once(|| {
        // Fails only for bytes that are not a font; drawing text then reports it.
        let _ = register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT);
    });
}

fn draw<DB: DrawingBackend>(drawing: &Drawing<'_>, backend: DB) -> Result<(), ChartError> {
    let area = backend.into_drawing_area();
    let drawn = match drawing {
        Drawing::Sheet(sheet) => area.fill(&WHITE).and_then(|()| draw_sheet(&area, sheet)),
        Drawing::Inline(chart) => draw_plane(&area, chart, label_width(chart)),
    };
    drawn.and_then(|()| area.present()).map_err(|error| ChartError::Draw { message: error.to_string() })
}

impl Drawing<'_> {
    /// Width and height in pixels.
    fn size_px(&self) -> [u32; 2] {
        match self {
            Self::Inline(chart) => [INLINE_WIDTH_PX, chart.height_px],
            Self::Sheet(sheet) => {
                let heights = sheet.columns.iter().map(|column| {
                    let charts = column.iter().map(|chart| chart.height_px);
                    charts.sum::<u32>()
                });
                let height = sheet_title_px(sheet) + heights.max().unwrap_or(0);
                [sheet.column_px * sheet.columns.len() as u32, height.max(1)]
            }
        }
    }
}

fn sheet_title_px(sheet: &Sheet) -> u32 {
    if sheet.title.is_empty() { 0 } else { SHEET_TITLE_PX }
}

fn draw_sheet<DB: DrawingBackend>(area: &Area<DB>, sheet: &Sheet) -> Drawn<DB> {
    let (title, rest) = area.split_vertically(px(sheet_title_px(sheet)));
    if !sheet.title.is_empty() {
        draw_words(&title, &sheet.title, (16, 26), 22)?;
    }
    let mut told: Vec<(&str, Tone, Look)> = Vec::new();
    let columns = rest.split_evenly((1, sheet.columns.len().max(1)));
    for (mut area, charts) in columns.into_iter().zip(&sheet.columns) {
        for chart in charts {
            let (own, below) = area.split_vertically(px(chart.height_px));
            area = below;
            let mut new: Vec<&Series> = Vec::new();
            for series in chart.series.iter().filter(|series| !series.name.is_empty()) {
                let entry = (series.name.as_str(), series.tone, series.look);
                if !told.contains(&entry) {
                    told.push(entry);
                    new.push(series);
                }
            }
            let mut top_px = 8;
            if !chart.title.is_empty() {
                draw_words(&own, &chart.title, (16, top_px + 10), 17)?;
                top_px += TITLE_PX;
            }
            top_px += draw_legend(&own, &new, top_px, sheet.column_px)?;
            // Charts over the same values line up.
            let is_beside = |other: &&Chart| (other.x.low, other.x.high) == (chart.x.low, chart.x.high);
            let widest = charts.iter().filter(is_beside).map(label_width).max().unwrap_or(0);
            draw_plane(&own.margin(px(top_px), 0, 0, 0), chart, widest)?;
        }
    }
    Ok(())
}

/// Draws the legend in rows from `top_px` on; returns the height that it needed, pixels.
fn draw_legend<DB: DrawingBackend>(
    area: &Area<DB>,
    entries: &[&Series],
    top_px: u32,
    width_px: u32,
) -> Result<u32, DrawingAreaErrorKind<DB::ErrorType>> {
    let (left_px, swatch_px) = (16, 26);
    let (mut x_px, mut y_px) = (left_px, top_px + LEGEND_ROW_PX / 2);
    for series in entries {
        let entry_px = swatch_px + 28 + 8 * series.name.chars().count() as u32;
        if x_px > left_px && x_px + entry_px > width_px {
            (x_px, y_px) = (left_px, y_px + LEGEND_ROW_PX);
        }
        let (left, right, y) = (px(x_px), px(x_px + swatch_px), px(y_px));
        let middle = i32::midpoint(left, right);
        let (ends, line) = ([(left, y), (right, y)], pen(series.tone, 2));
        let color = series.tone.rgb().filled();
        match series.look {
            Look::Line | Look::LineAndDots => area.draw(&PathElement::new(ends, line))?,
            Look::Dashed => area.draw(&DashedPathElement::new(ends, px(6), px(4), line))?,
            Look::Strokes => area.draw(&PathElement::new(ends, pen(series.tone, 4)))?,
            Look::Bars => {
                area.draw(&Rectangle::new([(left + px(6), y - px(6)), (right - px(6), y + px(6))], color))?;
            }
            Look::Dots => {}
            Look::Diamonds => area.draw(&diamond((middle, y), line))?,
        }
        if matches!(series.look, Look::Dots | Look::LineAndDots) {
            area.draw(&Circle::new((middle, y), px(4), color))?;
        }
        draw_words(area, &series.name, (x_px + swatch_px + 6, y_px), 14)?;
        x_px += entry_px;
    }
    Ok(if entries.is_empty() { 0 } else { y_px + LEGEND_ROW_PX / 2 - top_px })
}

/// Draws words that begin at a point and are centred on its height.
fn draw_words<DB: DrawingBackend>(
    area: &Area<DB>,
    words: &str,
    (x_px, y_px): (u32, u32),
    size_px: u32,
) -> Drawn<DB> {
    let style = font(size_px, Tone::Ink).pos(Pos::new(HPos::Left, VPos::Center));
    area.draw(&Text::new(words.to_owned(), (px(x_px), px(y_px)), style))
}

/// Characters of the longest label along the y axis.
fn label_width(chart: &Chart) -> u32 {
    chart.y.ticks.iter().map(|tick| tick.1.chars().count()).max().unwrap_or(0) as u32
}

/// Draws axes, series and words in the plane, with room for `widest` characters on its left.
fn draw_plane<DB: DrawingBackend>(area: &Area<DB>, chart: &Chart, widest: u32) -> Drawn<DB> {
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
        .draw()?;
    for series in &chart.series {
        let (points, line) = (series.points.iter().copied(), pen(series.tone, 2));
        let color = series.tone.rgb().filled();
        match series.look {
            Look::Line | Look::LineAndDots => {
                plane.draw_series(LineSeries::new(points.clone(), line))?;
            }
            Look::Dashed => {
                plane.draw_series(DashedLineSeries::new(points.clone(), px(5), px(4), line))?;
            }
            Look::Diamonds => {
                plane.draw_series(points.clone().map(|at| EmptyElement::at(at) + diamond((0, 0), line)))?;
            }
            Look::Strokes => {
                let line = pen(series.tone, 3);
                plane.draw_series(
                    series.points.chunks_exact(2).map(|ends| PathElement::new(ends.to_vec(), line)),
                )?;
            }
            Look::Bars => {
                let corners = series.points.chunks_exact(2);
                plane.draw_series(corners.map(|at| Rectangle::new([at[0], at[1]], color)))?;
            }
            Look::Dots => {}
        }
        if matches!(series.look, Look::Dots | Look::LineAndDots) {
            let radius = px(if series.look == Look::Dots { 5 } else { 3 });
            plane.draw_series(points.map(|at| Circle::new(at, radius, color)))?;
        }
    }
    for (at, words) in &chart.texts {
        let is_right = chart.x.share_at(at.0) > TURN_SHARE;
        let side = if is_right { HPos::Right } else { HPos::Left };
        let style = font(14, Tone::Ink).pos(Pos::new(side, VPos::Center));
        let gap = if is_right { -px(6) } else { px(6) };
        plane.draw_series([EmptyElement::at(*at) + Text::new(words.clone(), (gap, 0), style)])?;
    }
    Ok(())
}

fn diamond((x, y): (i32, i32), line: ShapeStyle) -> PathElement<(i32, i32)> {
    let r = px(6);
    PathElement::new([(x - r, y), (x, y - r), (x + r, y), (x, y + r), (x - r, y)], line)
}

fn px(px: u32) -> i32 {
    (px * FINER) as i32
}

fn font(size_px: u32, tone: Tone) -> TextStyle<'static> {
    // The library draws a size of 1.24 as one of 1.
    (FONT, 1.24 * f64::from(size_px * FINER)).into_font().color(&tone.rgb())
}

fn pen(tone: Tone, width_px: u32) -> ShapeStyle {
    tone.rgb().stroke_width(width_px * FINER)
}
