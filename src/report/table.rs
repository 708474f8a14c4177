//! A table as data: the terminal, the HTML page and RESULTS.md show the same one, each in its own way.

use std::fmt;

use serde::Serialize;

use crate::text_table::text_table;

/// Rows of cells; the first cell of a row is its name.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Table {
    pub head: Vec<String>,
    pub rows: Vec<Vec<Cell>>,
    /// A sentence or two below; empty if there is nothing to say.
    pub note: String,
}

/// A value, and smaller ones that belong to it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Cell {
    pub text: String,
    pub below: Vec<String>,
}

impl Table {
    #[must_use]
    pub fn new<Name: Into<String>>(head: impl IntoIterator<Item = Name>, rows: Vec<Vec<Cell>>) -> Self {
        Self { head: head.into_iter().map(Into::into).collect(), rows, note: String::new() }
    }

    #[must_use]
    pub fn with_note(self, note: impl Into<String>) -> Self {
        Self { note: note.into(), ..self }
    }
}

impl fmt::Display for Table {
    /// Columns of text, then the note.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rows = self.rows.iter().map(|row| row.iter().map(ToString::to_string).collect());
        f.write_str(&text_table(std::iter::once(self.head.clone()).chain(rows)))?;
        if self.note.is_empty() { Ok(()) } else { writeln!(f, "{}", self.note) }
    }
}

impl fmt::Display for Cell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)?;
        if self.below.is_empty() { Ok(()) } else { write!(f, " ({})", self.below.join(", ")) }
    }
}

impl<Text: Into<String>> From<Text> for Cell {
    fn from(text: Text) -> Self {
        Self { text: text.into(), below: Vec::new() }
    }
}

/// An AP with three digits, or that there was nothing to find.
#[must_use]
pub fn ap(value: impl Into<Option<f64>>) -> String {
    value.into().map_or_else(|| NO_TRUTH.to_owned(), |value| format!("{value:.3}"))
}

/// What stands in place of the score of a class without a truth.
pub const NO_TRUTH: &str = "no truth";

/// A share in percent, or a dash.
#[must_use]
pub fn percent(share: Option<f64>) -> String {
    number(share.map(|share| 100.0 * share), 1) + if share.is_some() { " %" } else { "" }
}

/// A number with this many decimals, or a dash.
#[must_use]
pub fn number(value: Option<f64>, n_decimals: usize) -> String {
    let Some(value) = value else { return "–".to_owned() };
    let text = format!("{value:.n_decimals$}");
    let is_zero = text.bytes().all(|byte| b"-0.".contains(&byte));
    if is_zero { text.trim_start_matches('-').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_as_text_has_the_smaller_values_in_brackets_and_the_note_below() {
        let cell = Cell { text: ap(0.5), below: vec!["paper 0.812".to_owned()] };
        let table = Table::new(["AP", "mean"], vec![vec!["ID".into(), cell]]).with_note("A note.");
        assert_eq!(table.to_string(), "AP                 mean\nID  0.500 (paper 0.812)\nA note.\n");
    }

    #[test]
    fn what_is_not_known_is_a_dash_and_nothing_is_called_minus_zero() {
        assert_eq!([percent(None), percent(Some(0.1234))], ["–", "12.3 %"]);
        assert_eq!([number(Some(-0.04), 1), number(Some(-0.06), 1)], ["0.0", "-0.1"]);
    }
}
