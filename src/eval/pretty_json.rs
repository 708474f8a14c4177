//! JSON with one line for each value, but lists of plain values in one line: curves stay readable.

use std::io::{self, Write};

use serde::Serialize;
use serde_json::ser::{Formatter, PrettyFormatter, Serializer};

/// The text of a value that holds only numbers, words, lists and structs; ends with a newline.
pub fn to_string(value: &impl Serialize) -> String {
    let mut text = Vec::new();
    let mut serializer = Serializer::with_formatter(&mut text, PlainListsInOneLine::default());
    value.serialize(&mut serializer).expect("figures hold only numbers, names and lists");
    text.push(b'\n');
    String::from_utf8(text).expect("JSON is UTF-8")
}

/// serde's indentation, but a list whose first value is plain takes one line.
#[derive(Default)]
struct PlainListsInOneLine {
    pretty: PrettyFormatter<'static>,
    /// For each open list, whether it stays in its line.
    is_plain: Vec<bool>,
    /// Whether the first value of a list begins.
    is_first: bool,
}

impl PlainListsInOneLine {
    /// A list or struct begins: the list that it is the first value of takes several lines.
    fn begin_nested<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        if !std::mem::take(&mut self.is_first) {
            return Ok(());
        }
        *self.is_plain.last_mut().expect("a value is within its list") = false;
        self.pretty.begin_array_value(writer, true)
    }

    fn stays_in_line(&self) -> bool {
        self.is_plain.last().copied().unwrap_or(false)
    }
}

impl Formatter for PlainListsInOneLine {
    fn begin_array<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.begin_nested(writer)?;
        self.is_plain.push(true);
        self.pretty.begin_array(writer)
    }

    fn end_array<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.is_plain.pop();
        self.pretty.end_array(writer)
    }

    fn begin_array_value<W: ?Sized + Write>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        self.is_first = first;
        match (first, self.stays_in_line()) {
            (true, _) => Ok(()),
            (false, true) => writer.write_all(b", "),
            (false, false) => self.pretty.begin_array_value(writer, false),
        }
    }

    fn end_array_value<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.is_first = false;
        if self.stays_in_line() { Ok(()) } else { self.pretty.end_array_value(writer) }
    }

    fn begin_object<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.begin_nested(writer)?;
        self.pretty.begin_object(writer)
    }

    fn end_object<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.pretty.end_object(writer)
    }

    fn begin_object_key<W: ?Sized + Write>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        self.pretty.begin_object_key(writer, first)
    }

    fn begin_object_value<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.pretty.begin_object_value(writer)
    }

    fn end_object_value<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.pretty.end_object_value(writer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn plain_lists_take_one_line_and_the_value_stays_the_same() {
        let value = json!({"a": [1, 2.5, null], "b": [[1, 2], [3]], "c": [{"d": ["x[", "]", "y],"]}], "e": [], "f": 1});
        let text = to_string(&value);
        assert!(
            text.contains("\"a\": [1, 2.5, null],\n") && text.contains("    [1, 2],\n    [3]\n"),
            "{text}"
        );
        assert!(text.contains("[\"x[\", \"]\", \"y],\"]"), "{text}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&text).unwrap(), value);
    }
}
