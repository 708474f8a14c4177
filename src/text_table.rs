//! Tables as plain text, for the terminal and for files that people read.

use comfy_table::presets::NOTHING;
use comfy_table::{CellAlignment, Table};

/// Spaces between two columns.
const GAP: u16 = 2;

/// Rows as lines, each with its line break: the first column is aligned to the left, the others to the right. The heads
/// of the columns are a row like any other.
///
/// ```
/// let text = harmzone::text_table::text_table([["", "n"], ["cars", "12"]]);
/// assert_eq!(text, "       n\ncars  12\n");
/// ```
#[must_use]
pub fn text_table<Row, Cell>(rows: impl IntoIterator<Item = Row>) -> String
where
    Row: IntoIterator<Item = Cell>,
    Cell: ToString,
{
    let mut table = Table::new();
    table.load_style(NOTHING);
    for row in rows {
        table.add_row(row.into_iter().map(|cell| cell.to_string()));
    }
    for (i, column) in table.column_iter_mut().enumerate() {
        column.set_padding((if i == 0 { 0 } else { GAP }, 0));
        column.set_cell_alignment(if i == 0 { CellAlignment::Left } else { CellAlignment::Right });
    }
    table.trim_fmt() + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stand_left_and_numbers_right_and_no_line_ends_in_spaces() {
        let text = text_table([["", "n", "mean"], ["a long name", "7", "0.5"], ["b", "1234", ""]]);
        assert_eq!(text, "                n  mean\na long name     7   0.5\nb            1234\n");
    }
}
