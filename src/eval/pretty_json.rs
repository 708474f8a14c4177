//! JSON with one line for each value, but lists of plain values in one line: curves stay readable.

use serde::Serialize;

/// The text of a value that holds only numbers, words, lists and structs; ends with a newline.
pub fn to_string(value: &impl Serialize) -> String {
    let text = serde_json::to_string_pretty(value).expect("figures hold only numbers, names and lists");
    let lines: Vec<&str> = text.lines().collect();
    let mut joined = String::with_capacity(text.len());
    let mut at = 0;
    while at < lines.len() {
        joined.push_str(lines[at]);
        if lines[at].ends_with('[')
            && let Some(end) = end_of_plain_list(&lines, at)
        {
            let items: Vec<&str> = lines[at + 1..=end].iter().map(|line| line.trim()).collect();
            joined.push_str(&items[..items.len() - 1].join(" "));
            joined.push_str(items[items.len() - 1]);
            at = end;
        }
        joined.push('\n');
        at += 1;
    }
    joined
}

/// Where the list that opens in a line closes, if it holds no list and no struct. A string never ends a line with a
/// bracket: its quote comes after.
fn end_of_plain_list(lines: &[&str], opening: usize) -> Option<usize> {
    let end = (opening + 1..lines.len())
        .find(|&i| lines[i].ends_with(['[', '{', ']', '}']) || lines[i].ends_with("],"))?;
    lines[end].trim_start().starts_with(']').then_some(end)
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
