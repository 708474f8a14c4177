//! Charts as data: callers say what to show, this module draws it as SVG, as PNG, or as a drawing inside the HTML page.
//!
//! The same chart gives the same bytes.
//!
//! ```
//! use harmzone::report::chart::{Axis, Chart, ChartError, Look, Series, Sheet, Tone, svg};
//!
//! let line = Series::new("the network", Tone::Harmful, Look::Line, vec![(0.0, 0.2), (14.0, 0.9)]);
//! let (speed, ap) = (Axis::over("speed, m/s", 0.0, 14.0), Axis::share("mAP"));
//! let chart = Chart::new("mAP over the speed", speed, ap, vec![line], 340);
//! assert!(svg(&Sheet::column(vec![chart]))?.contains("speed, m/s"));
//! # Ok::<(), ChartError>(())
//! ```

mod axis;
mod draw;

pub use axis::{Axis, row};
pub use draw::{ChartError, inline_svg, png, svg};

use plotters::style::RGBColor;
use serde::Serialize;

/// The meaning of a colour; `page/report.css` gives each its value in light and in dark.
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
    /// For lines that must differ but have no meaning of their own.
    pub const ROW: [Self; 4] = [Self::Harmless, Self::Green, Self::Amber, Self::Harmful];

    /// The colour in the drawing (Okabe and Ito 2008, which colour-blind people tell apart).
    #[must_use]
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
    /// A stroke between each two points: the first and second, the third and fourth, ..
    Strokes,
    /// A filled rectangle between each two points, which are opposite corners.
    Bars,
}

/// Points of one meaning.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Stands in the legend; a series without a name does not.
    pub name: String,
    pub tone: Tone,
    pub look: Look,
    pub points: Vec<(f64, f64)>,
}

impl Series {
    #[must_use]
    pub fn new(name: impl Into<String>, tone: Tone, look: Look, points: Vec<(f64, f64)>) -> Self {
        Self { name: name.into(), tone, look, points }
    }
}

/// One plane with two axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    pub series: Vec<Series>,
    /// Words beside a point.
    pub texts: Vec<((f64, f64), String)>,
    pub height_px: u32,
}

impl Chart {
    /// A chart without words in the plane.
    #[must_use]
    pub fn new(title: impl Into<String>, x: Axis, y: Axis, series: Vec<Series>, height_px: u32) -> Self {
        Self { title: title.into(), x, y, series, texts: Vec::new(), height_px }
    }
}

/// Charts side by side and below one another, as one picture. A name that several charts share stands only in
/// the legend of the first.
#[derive(Debug, Clone, PartialEq)]
pub struct Sheet {
    pub title: String,
    /// Width of each column.
    pub column_px: u32,
    pub columns: Vec<Vec<Chart>>,
}

impl Sheet {
    /// Charts below one another.
    #[must_use]
    pub fn column(charts: Vec<Chart>) -> Self {
        Self { title: String::new(), column_px: 960, columns: vec![charts] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart() -> Chart {
        use Look::{Bars, Dashed, Diamonds, Dots, Line, LineAndDots, Strokes};
        let looks = [Line, Dashed, Dots, LineAndDots, Diamonds, Strokes, Bars];
        let points = vec![(0.1, 0.2), (0.5, 0.9)];
        let series = looks.map(|look| Series::new("the network", Tone::Harmful, look, points.clone()));
        let y = Axis::rows(&["<b>&\"".to_owned(), "below".to_owned()]);
        let texts = vec![((0.5, 0.5), "12 objects".to_owned())];
        Chart { texts, ..Chart::new("both classes", Axis::share("recall"), y, series.into(), 200) }
    }

    fn sheet() -> Sheet {
        Sheet {
            title: "a data set".into(),
            columns: vec![vec![chart(), chart()], vec![chart()]],
            ..Sheet::column(vec![])
        }
    }

    #[test]
    fn a_chart_of_the_page_is_drawn_in_its_tones_with_its_names_escaped_and_always_alike() {
        let text = inline_svg(&chart()).unwrap();
        for part in [
            "viewBox=\"0 0 1920 800\"",
            "#D55E00",
            "recall",
            "0.4",
            "&lt;b&gt;&amp;&quot;",
            "12 objects",
            "</svg>",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert!(!text.contains("http") && !text.contains("<b>") && !text.contains("both classes"));
        assert_eq!(text, inline_svg(&chart()).unwrap());
    }

    #[test]
    fn a_sheet_tells_each_name_of_its_legends_once() {
        let text = svg(&sheet()).unwrap();
        assert_eq!(text.matches("the network").count(), 7, "each look once, in the first chart");
        assert_eq!(text.matches("both classes").count(), 3);
        assert!(text.contains("a data set") && text.starts_with("<svg") && text.contains("xmlns"));
        assert_eq!(text, svg(&sheet()).unwrap());
    }

    #[test]
    fn a_picture_has_the_size_and_the_tones_of_its_sheet() {
        let bytes = png(&sheet()).unwrap();
        let picture = image::load_from_memory(&bytes).unwrap().into_rgb8();
        assert_eq!(picture.dimensions(), (2 * 960, 446));
        assert_eq!(picture.get_pixel(2, 2).0, [255; 3], "the ground is white");
        let RGBColor(r, g, b) = Tone::Harmful.rgb();
        assert!(picture.pixels().any(|pixel| pixel.0 == [r, g, b]));
        assert!(bytes == png(&sheet()).unwrap());
    }

    #[test]
    fn a_chart_without_points_or_rows_is_drawn_too() {
        let empty = Chart { y: Axis::rows(&[]), series: vec![], ..chart() };
        assert!(inline_svg(&empty).unwrap().ends_with("</svg>\n"));
        assert!(svg(&Sheet::column(vec![])).unwrap().ends_with("</svg>\n"));
    }
}
