//! Maps that lie far from their origin, as in the coordinates of a whole country, are moved to it by whole metres.
//!
//! The crate `xodr` gives points as f32, whose steps are half a metre at 5e6 m. So the text is moved in f64 before the crate reads it.

use std::ops::Range;

use roxmltree::{Document, Node};

use super::road_limits::WIDEST_MAP_M;
use super::xml::{named, number};

/// What lies farther along x or y is moved, metres. Steps of f32 are 4 mm there.
const FARTHEST_M: f64 = 5e4;
/// No map of the Earth has larger coordinates, metres; f64 has steps of 15 nm there.
const LARGEST_M: f64 = 1e8;

/// What is to be taken from x and y of a map's roads, metres; `None` where they lie near enough.
///
/// # Errors
/// A road lies where no map does.
pub(super) fn offset_m(document: &Document<'_>) -> Result<Option<[f64; 2]>, String> {
    let (mut low_m, mut high_m) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for start in starts(document) {
        for (i, axis) in ["x", "y"].into_iter().enumerate() {
            let at_m = number(&start, axis);
            if at_m.abs() > LARGEST_M {
                return Err(format!(
                    "{}: `{axis}` is {at_m:.3e} m; at most {LARGEST_M:e} m from the origin are taken",
                    named(&start)
                ));
            }
            (low_m[i], high_m[i]) = (low_m[i].min(at_m), high_m[i].max(at_m));
        }
    }
    let is_far = [low_m, high_m].concat().iter().any(|at_m| at_m.abs() > FARTHEST_M);
    // One that is spread too widely is refused as it is.
    let is_one_map = (0..2).all(|i| high_m[i] - low_m[i] <= WIDEST_MAP_M);
    Ok((is_far && is_one_map).then(|| [0, 1].map(|i| f64::midpoint(low_m[i], high_m[i]).round())))
}

/// Where the parts of roads' lines begin.
fn starts<'a, 'input>(document: &'a Document<'input>) -> impl Iterator<Item = Node<'a, 'input>> {
    let inside = |of: Node<'a, 'input>, name: &'static str| {
        of.children().filter(move |child| child.has_tag_name(name))
    };
    inside(document.root_element(), "road")
        .flat_map(move |road| inside(road, "planView"))
        .flat_map(move |plan| inside(plan, "geometry"))
}

/// The text of a map of which all that stands at an x and a y is moved.
///
/// # Errors
/// An element whose x or y is written so that it cannot be replaced.
pub(super) fn moved(document: &Document<'_>, by_m: [f64; 2]) -> Result<String, String> {
    let text = document.input_text();
    let mut edits: Vec<(Range<usize>, f64)> = Vec::new();
    for node in document.descendants().filter(is_placed) {
        for (axis, by_m) in ["x", "y"].into_iter().zip(by_m) {
            let Some(attribute) = node.attribute_node(axis) else { continue };
            let Ok(at_m) = attribute.value().trim().parse::<f64>() else { continue };
            let range = attribute.range_value();
            let written = text.get(range.clone()).and_then(|text| text.trim().parse::<f64>().ok());
            if written != Some(at_m) {
                return Err(format!("{}: its `{axis}` must be a number of plain digits", named(&node)));
            }
            edits.push((range, at_m - by_m));
        }
    }
    edits.sort_by_key(|(range, _)| range.start);
    let (mut out, mut end) = (String::with_capacity(text.len()), 0);
    for (range, at_m) in edits {
        out += &text[end..range.start];
        out += &at_m.to_string();
        end = range.end;
    }
    out += &text[end..];
    Ok(out)
}

/// Whether an element's x and y are places in the map: parts of lines, and signs beside no road's line. All else is told along roads.
fn is_placed(node: &Node<'_, '_>) -> bool {
    let is_in_plan = node.parent().is_some_and(|above| above.has_tag_name("planView"));
    node.has_tag_name("geometry") && is_in_plan || node.has_tag_name("positionInertial")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A road that starts at these places, a sign, and numbers that are no places.
    fn map(x: &str, y: &str) -> String {
        format!(
            "<OpenDRIVE><!-- é --><road><planView><geometry s='7' x='{x}' y = \"{y}\"/></planView><signals><signal s='3'>\
             <positionInertial x='500010' y='5000001.5' z='2'/></signal></signals></road></OpenDRIVE>"
        )
    }

    #[test]
    fn starts_of_lines_and_places_of_signs_are_moved_and_nothing_else() {
        let far = map(" 500000.5 ", "5e6");
        let document = Document::parse(&far).unwrap();
        let by_m = offset_m(&document).unwrap().unwrap();
        assert_eq!(by_m, [500_001.0, 5e6]);
        let wanted = map("-0.5", "0").replace("500010", "9").replace("5000001.5", "1.5");
        assert_eq!(moved(&document, by_m).unwrap(), wanted);
    }

    #[test]
    fn a_map_near_its_origin_stays_and_one_beyond_the_earth_is_refused() {
        let offset = |text: &str| offset_m(&Document::parse(text).unwrap());
        assert_eq!(offset(&map("-49000", "50000")), Ok(None));
        assert_eq!(offset(&map("0", "50001")), Ok(Some([0.0, 50_001.0])));
        let told = offset(&map("0", "-1e300")).unwrap_err();
        assert!(told.contains("<geometry>, line 1: `y` is -1.000e300 m; at most 1e8 m"), "{told}");
    }

    #[test]
    fn a_number_that_cannot_be_replaced_is_told() {
        let odd = map("5&#48;0000", "5e6");
        let document = Document::parse(&odd).unwrap();
        let told = moved(&document, [5e5, 5e6]).unwrap_err();
        assert!(told.contains("<geometry>, line 1: its `x`"), "{told}");
    }
}
