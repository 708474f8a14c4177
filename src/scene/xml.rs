//! Elements of an XML map, as its readers look at and name them.

use roxmltree::Node;

pub(super) fn line(node: &Node<'_, '_>) -> u32 {
    node.document().text_pos_at(node.range().start).row
}

/// The element with its id and line: `<lane id="-1">, line 12`.
pub(super) fn named(node: &Node<'_, '_>) -> String {
    let id = node.attribute("id").map_or_else(String::new, |id| format!(" id=\"{id}\""));
    format!("<{}{id}>, line {}", node.tag_name().name(), line(node))
}

/// An attribute's number; nought where there is none, as for all that may be missing.
pub(super) fn number(node: &Node<'_, '_>, attribute: &str) -> f64 {
    node.attribute(attribute).and_then(|text| text.trim().parse().ok()).unwrap_or(0.0)
}
