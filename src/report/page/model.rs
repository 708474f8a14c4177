//! What the page says, apart from how it looks: sections of text, tables, charts and cards. The template writes it.
//!
//! Every string is plain text and is escaped by the template, but for the two fields that say that they are markup.

use serde::Serialize;

use super::ReportError;
use super::gallery::Gallery;
use super::pictures::Picture;
use super::plot::{self, Chart, Look, Tone};

/// The whole page.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Page {
    pub title: String,
    pub subtitle: String,
    pub version: &'static str,
    pub sections: Vec<Section>,
}

/// A part with a heading that the page's bar leads to.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Section {
    pub id: &'static str,
    pub title: &'static str,
    pub blocks: Vec<Block>,
}

/// One thing in a section.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum Block {
    Heading {
        text: String,
    },
    Text {
        text: String,
    },
    Tiles {
        tiles: Vec<Tile>,
    },
    Table(Table),
    Figures {
        figures: Vec<Figure>,
    },
    Pictures {
        pictures: Vec<Picture>,
    },
    /// Hidden until it is opened.
    Fold {
        title: String,
        blocks: Vec<Block>,
    },
    /// What could be here, and the command that makes it.
    Absent {
        what: String,
        command: String,
    },
    Code {
        text: String,
    },
    /// Markup, made from Markdown.
    Markup {
        html: String,
    },
    Gallery(Gallery),
}

impl Block {
    pub fn heading(text: &str) -> Self {
        Self::Heading { text: text.to_owned() }
    }

    pub fn text(text: impl Into<String>) -> Self {
        Self::Text { text: text.into() }
    }

    pub fn absent(what: impl Into<String>, command: impl Into<String>) -> Self {
        Self::Absent { what: what.into(), command: command.into() }
    }

    pub fn fold(title: &str, blocks: Vec<Self>) -> Self {
        Self::Fold { title: title.to_owned(), blocks }
    }
}

/// One figure that matters most.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tile {
    pub name: String,
    pub value: String,
    pub note: String,
}

/// Rows of cells; the first cell of a row is its name.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Table {
    pub head: Vec<String>,
    pub rows: Vec<Vec<Cell>>,
    pub note: String,
}

impl Table {
    pub fn new(head: &[&str], rows: Vec<Vec<Cell>>) -> Self {
        Self { head: head.iter().map(|&name| name.to_owned()).collect(), rows, note: String::new() }
    }

    pub fn with_note(self, note: impl Into<String>) -> Self {
        Self { note: note.into(), ..self }
    }
}

/// A value, and smaller lines below it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Cell {
    pub text: String,
    pub below: Vec<String>,
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self { text, below: Vec::new() }
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        text.to_owned().into()
    }
}

/// A chart with its title and legend.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figure {
    pub title: String,
    /// Markup, drawn by the plotting library.
    pub svg: String,
    pub legend: Vec<Entry>,
    pub caption: String,
}

/// What a line or mark means.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Entry {
    pub name: String,
    pub tone: Tone,
    pub look: Look,
}

impl Figure {
    /// Draws a chart; series without a name stay out of the legend.
    ///
    /// # Errors
    /// The plotting library refuses.
    pub fn new(title: impl Into<String>, chart: &Chart) -> Result<Self, ReportError> {
        let named = chart.series.iter().filter(|series| !series.name.is_empty());
        let legend =
            named.map(|series| Entry { name: series.name.clone(), tone: series.tone, look: series.look });
        Ok(Self {
            title: title.into(),
            svg: plot::svg(chart)?,
            legend: legend.collect(),
            caption: String::new(),
        })
    }

    pub fn with_caption(self, caption: impl Into<String>) -> Self {
        Self { caption: caption.into(), ..self }
    }
}

/// An AP with three digits.
pub fn ap(value: f64) -> String {
    format!("{value:.3}")
}

/// A share in percent, or a dash.
pub fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "–".to_owned(), |share| format!("{:.1} %", 100.0 * share))
}

/// A number with so many decimals, or a dash.
pub fn number(value: Option<f64>, n_decimals: usize) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.n_decimals$}"))
}
