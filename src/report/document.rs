//! The content of a page or a text, apart from its looks: blocks of text, tables, charts and cards. Templates
//! write them.
//!
//! Every string is plain text, except the drawings and the pictures in base64.

use minijinja::syntax::SyntaxConfig;
use minijinja::value::Serde;
use minijinja::{Environment, UndefinedBehavior, Value, context};
use serde::Serialize;

use super::chart::{Chart, ChartError, Look, Tone, inline_svg};
use super::table::Table;

/// A part with a heading that the page's bar links to.
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
    /// What is missing here, and the command that makes it.
    Absent {
        what: String,
        command: String,
    },
    Code {
        text: String,
    },
    Gallery(Gallery),
}

impl Block {
    #[must_use]
    pub fn heading(text: &str) -> Self {
        Self::Heading { text: text.to_owned() }
    }

    #[must_use]
    pub fn text(text: impl Into<String>) -> Self {
        Self::Text { text: text.into() }
    }

    #[must_use]
    pub fn code(text: impl Into<String>) -> Self {
        Self::Code { text: text.into() }
    }

    #[must_use]
    pub fn absent(what: impl Into<String>, command: impl Into<String>) -> Self {
        Self::Absent { what: what.into(), command: command.into() }
    }

    #[must_use]
    pub fn fold(title: &str, blocks: Vec<Self>) -> Self {
        Self::Fold { title: title.to_owned(), blocks }
    }
}

/// One of the most important figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tile {
    pub name: String,
    pub value: String,
    pub note: String,
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

/// The meaning of a line or mark.
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
    pub fn new(chart: &Chart) -> Result<Self, ChartError> {
        let named = chart.series.iter().filter(|series| !series.name.is_empty());
        let legend =
            named.map(|series| Entry { name: series.name.clone(), tone: series.tone, look: series.look });
        Ok(Self {
            title: chart.title.clone(),
            svg: inline_svg(chart)?,
            legend: legend.collect(),
            caption: String::new(),
        })
    }

    #[must_use]
    pub fn with_caption(self, caption: impl Into<String>) -> Self {
        Self { caption: caption.into(), ..self }
    }
}

/// A picture with its caption.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Picture {
    pub title: String,
    /// JPEG in base64.
    pub data: String,
    pub width_px: u32,
    pub height_px: u32,
    /// What can be played below it.
    pub clip: Option<Clip>,
}

/// A clip in the page.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Clip {
    /// MP4 in base64.
    pub data: String,
    pub width_px: u32,
    pub height_px: u32,
}

/// Cards, and the choices by which they can be filtered.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Gallery {
    pub cards: Vec<Card>,
    pub filters: Vec<Filter>,
}

/// A choice; each card has one of its options under the filter's key.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Filter {
    pub key: &'static str,
    pub name: &'static str,
    pub options: Vec<String>,
}

/// One fault.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Card {
    pub title: String,
    pub kind: &'static str,
    pub is_miss: bool,
    pub sample: String,
    pub facts: Vec<String>,
    /// Values of the filters, in their order.
    pub choices: Vec<(&'static str, String)>,
    /// Place among the faults of its kind and side, from 1.
    pub rank: usize,
    /// Numbers to sort by; unknown ones sort last.
    pub score: Option<f64>,
    pub range_m: f64,
    pub margin_m: Option<f64>,
    pub speed_mps: Option<f64>,
    pub n_samples: usize,
    /// JPEG in base64: camera, then from above.
    pub pictures: Option<[String; 2]>,
}

/// Fills a template, by its name and text, with `content` under the name `of`. Values are escaped by the ending of the
/// template's name: in `.html` as HTML.
#[must_use]
pub fn render(template: (&str, &str), content: &impl Serialize) -> String {
    let mut environment = Environment::new();
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    let syntax = SyntaxConfig::builder().trim_blocks(true).lstrip_blocks(true).build();
    environment.set_syntax(syntax.expect("the usual delimiters are told apart"));
    environment.add_template(template.0, template.1).expect("the tests parse the template");
    let template = environment.get_template(template.0).expect("it was added just now");
    template
        .render(context! { of => Value::from(Serde(content)) })
        .expect("the template names only fields that the content has")
}

/// Blocks as Markdown, which takes no charts, pictures and cards.
///
/// # Panics
/// If a block is not a heading, text, table, code or fold of those, which is a mistake in this crate.
#[must_use]
pub fn markdown(blocks: &[Block]) -> String {
    render(("document.md", include_str!("document.md")), &blocks)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::table::Cell;

    #[test]
    fn blocks_become_markdown() {
        let cell = Cell { text: "0.900".into(), below: vec!["paper 0.812".into()] };
        let table = Table::new(["AP", "a|b"], vec![vec!["ID".into(), cell]]).with_note("A note.");
        let blocks = [
            Block::heading("Data & scores"),
            Block::text("One sentence."),
            Block::Table(table),
            Block::fold("Commands", vec![Block::code("harmzone gen")]),
        ];
        assert_eq!(
            markdown(&blocks),
            "## Data & scores\n\nOne sentence.\n\n| AP | a\\|b |\n|---|---|\n| ID | **0.900** (paper 0.812) |\n\nA note.\n\n\
             <details><summary>Commands</summary>\n\n```sh\nharmzone gen\n```\n\n</details>\n"
        );
    }
}
