//! Plots as SVG and PNG, by plotters: a figure is drawn once for both, and the same figure gives the same bytes.

use std::io::Cursor;
use std::sync::Once;

use image::{ImageFormat, RgbImage, imageops};
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontStyle, register_font};
use thiserror::Error;

/// The PNG is drawn so many times larger and shrunk, which smooths its edges.
const FINER: u32 = 3;
/// Tones that colour-blind people tell apart (Okabe and Ito 2008).
pub const BLUE: RGBColor = RGBColor(0, 114, 178);
pub const VERMILION: RGBColor = RGBColor(213, 94, 0);
pub const GREEN: RGBColor = RGBColor(0, 158, 115);
pub const DARK: RGBColor = RGBColor(40, 44, 52);
pub const GRID: RGBColor = RGBColor(222, 226, 230);
const FONT: &str = "sans-serif";

/// Why a plot could not be made.
#[derive(Debug, Error)]
pub enum PlotError {
    #[error("the plot cannot be drawn: {message}")]
    Draw { message: String },
    #[error("the plot cannot be packed: {0}")]
    Png(#[from] image::ImageError),
}

pub type Area<DB> = DrawingArea<DB, plotters::coord::Shift>;
pub type Drawn<DB> = Result<(), DrawingAreaErrorKind<<DB as DrawingBackend>::ErrorType>>;

/// What can be drawn on any backend.
pub trait Figure {
    /// Width and height, pixels.
    fn size_px(&self) -> (u32, u32);

    /// Draws, all sizes in pixels times `scale`.
    ///
    /// # Errors
    /// The plotting library refuses.
    fn draw<DB: DrawingBackend>(&self, area: &Area<DB>, scale: u32) -> Drawn<DB>;
}

/// A figure as SVG.
///
/// # Errors
/// The plotting library refuses.
pub fn svg(figure: &impl Figure) -> Result<String, PlotError> {
    let mut text = String::new();
    draw(figure, &SVGBackend::with_string(&mut text, figure.size_px()).into_drawing_area(), 1)?;
    Ok(text)
}

/// A figure as PNG.
///
/// # Errors
/// The plotting library refuses.
pub fn png(figure: &impl Figure) -> Result<Vec<u8>, PlotError> {
    let (width, height) = figure.size_px();
    let fine_px = (width * FINER, height * FINER);
    let mut pixels = vec![0; (3 * fine_px.0 * fine_px.1) as usize];
    draw(figure, &BitMapBackend::with_buffer(&mut pixels, fine_px).into_drawing_area(), FINER)?;
    let fine = RgbImage::from_raw(fine_px.0, fine_px.1, pixels).expect("the buffer has three bytes a pixel");
    let picture = imageops::resize(&fine, width, height, imageops::FilterType::Triangle);
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

fn draw<DB: DrawingBackend>(figure: &impl Figure, area: &Area<DB>, scale: u32) -> Result<(), PlotError> {
    static FONT_ONCE: Once = Once::new();
    FONT_ONCE.call_once(|| {
        // Fails only for bytes that are no font; drawing text would then say so.
        let _ = register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT);
    });
    let drawn = area.fill(&WHITE).and_then(|()| figure.draw(area, scale)).and_then(|()| area.present());
    drawn.map_err(|error| PlotError::Draw { message: error.to_string() })
}

/// The plots' face at a size in pixels times `scale`.
pub fn font(px: u32, scale: u32) -> TextStyle<'static> {
    (FONT, (px * scale) as i32).into_font().color(&DARK)
}

/// Panels of lines below one another under one legend.
pub struct Lines {
    /// What each line stands for; panels refer to it by place.
    pub legend: Vec<Entry>,
    pub panels: Vec<Panel>,
}

/// A line's name and look.
pub struct Entry {
    pub name: String,
    pub color: RGBColor,
    pub is_dashed: bool,
}

/// One panel.
pub struct Panel {
    pub x_name: String,
    pub y_name: String,
    /// Lower and upper end; the lower must be below the upper.
    pub y_range: [f64; 2],
    /// Place in the legend, and the points from left to right.
    pub lines: Vec<(usize, Vec<(f64, f64)>)>,
}

const WIDTH_PX: u32 = 960;
const PANEL_PX: u32 = 300;
const LEGEND_ROW_PX: u32 = 26;
const N_LEGEND_COLUMNS: usize = 3;

impl Lines {
    fn legend_px(&self) -> u32 {
        LEGEND_ROW_PX * self.legend.len().div_ceil(N_LEGEND_COLUMNS) as u32 + 14
    }
}

impl Figure for Lines {
    fn size_px(&self) -> (u32, u32) {
        (WIDTH_PX, self.legend_px() + PANEL_PX * self.panels.len() as u32)
    }

    fn draw<DB: DrawingBackend>(&self, area: &Area<DB>, scale: u32) -> Drawn<DB> {
        let px = |px: u32| (px * scale) as i32;
        let (top, rest) = area.split_vertically(px(self.legend_px()));
        for (i, entry) in self.legend.iter().enumerate() {
            let column = (i % N_LEGEND_COLUMNS) as u32 * (WIDTH_PX / N_LEGEND_COLUMNS as u32);
            let (x, y) = (px(column + 70), px(LEGEND_ROW_PX * (i / N_LEGEND_COLUMNS) as u32 + 20));
            let ends = [(x, y), (x + px(28), y)];
            let pen = entry.color.stroke_width(2 * scale);
            if entry.is_dashed {
                top.draw(&DashedPathElement::new(ends, px(6), px(4), pen))?;
            } else {
                top.draw(&PathElement::new(ends, pen))?;
            }
            let style = font(14, scale).pos(Pos::new(HPos::Left, VPos::Center));
            top.draw(&Text::new(entry.name.clone(), (x + px(36), y), style))?;
        }
        for (area, panel) in rest.split_evenly((self.panels.len().max(1), 1)).iter().zip(&self.panels) {
            self.panel(area, panel, scale)?;
        }
        Ok(())
    }
}

impl Lines {
    fn panel<DB: DrawingBackend>(&self, area: &Area<DB>, panel: &Panel, scale: u32) -> Drawn<DB> {
        let px = |px: u32| (px * scale) as i32;
        let xs = || panel.lines.iter().flat_map(|(_, points)| points.iter().map(|&(x, _)| x));
        let (low, high) = (xs().fold(f64::INFINITY, f64::min), xs().fold(f64::NEG_INFINITY, f64::max));
        let most_points = panel.lines.iter().map(|(_, points)| points.len()).max().unwrap_or(0);
        // A line of one point, or none, has a width too.
        let x_range = if low < high { low..high } else { 0.0..1.0 };
        let mut chart = ChartBuilder::on(area)
            .margin(px(8))
            .margin_right(px(24))
            .x_label_area_size(px(46))
            .y_label_area_size(px(70))
            .build_cartesian_2d(x_range, panel.y_range[0]..panel.y_range[1])?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(GRID.stroke_width(scale))
            .axis_style(DARK.stroke_width(scale))
            .set_all_tick_mark_size(px(4))
            .label_style(font(13, scale))
            .axis_desc_style(font(15, scale))
            .x_desc(&panel.x_name)
            .y_desc(&panel.y_name)
            .x_labels(most_points.clamp(2, 10))
            .x_label_formatter(&|x| short(*x))
            .y_labels(6)
            .y_label_formatter(&|y| short(*y))
            .draw()?;
        for (place, points) in &panel.lines {
            let entry = &self.legend[*place];
            let pen = entry.color.stroke_width(2 * scale);
            if entry.is_dashed {
                chart.draw_series(DashedLineSeries::new(points.iter().copied(), px(6), px(4), pen))?;
            } else {
                let marked = LineSeries::new(points.iter().copied(), pen.filled());
                chart.draw_series(marked.point_size(px(3) as u32))?;
            }
        }
        Ok(())
    }
}

/// A number with as many digits as it needs, at most three behind the point.
fn short(x: f64) -> String {
    let text = format!("{x:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_drawn_under_their_legend_and_the_same_way_again() {
        let entry = |name: &str, is_dashed| Entry { name: name.into(), color: VERMILION, is_dashed };
        let panel = |lines| Panel {
            x_name: "speed, m/s".into(),
            y_name: "agreement".into(),
            y_range: [0.0, 1.0],
            lines,
        };
        let figure = Lines {
            legend: vec![entry("network", false), entry("zone", true)],
            panels: vec![
                panel(vec![(0, vec![(0.0, 0.2), (14.0, 0.9)]), (1, vec![(0.0, 0.4), (14.0, 0.4)])]),
                panel(vec![(0, vec![(3.0, 0.5)])]),
            ],
        };
        let text = svg(&figure).unwrap();
        for name in ["network", "zone", "speed, m/s", "agreement"] {
            assert!(text.contains(name), "{name}");
        }
        assert_eq!(text, svg(&figure).unwrap());
        let picture = image::load_from_memory(&png(&figure).unwrap()).unwrap().into_rgb8();
        assert_eq!(picture.dimensions(), figure.size_px());
        assert!(picture.pixels().any(|pixel| pixel.0 == [VERMILION.0, VERMILION.1, VERMILION.2]));
        assert_eq!([short(-0.0001), short(12.0), short(0.25), short(-35.0)], ["0", "12", "0.25", "-35"]);
    }
}
