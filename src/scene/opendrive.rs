//! Reads OpenDRIVE: anything broken is an error with element, line and reason; whatever is valid but not
//! used here is reported in counts.
//!
//! The `xodr` crate skips what it cannot read, road by road. A file from elsewhere is better refused if
//! an element lacks what OpenDRIVE demands, so the text is checked first.

use std::collections::{BTreeMap, BTreeSet};

use roxmltree::{Document, Node};

use super::map_origin;
use super::network::flat;
use super::occupancy::Footprint;
use super::road_limits;
use super::xml::{line, named, number};

/// Attributes that must be there as numbers, by element (OpenDRIVE 1.4, sections 5.3 to 5.5).
const NUMBERS: [(&str, &[&str]); 14] = [
    ("road", &["length"]),
    ("geometry", &["s", "x", "y", "hdg", "length"]),
    ("arc", &["curvature"]),
    ("spiral", &["curvStart", "curvEnd"]),
    ("poly3", &["a", "b", "c", "d"]),
    ("paramPoly3", &["aU", "bU", "cU", "dU", "aV", "bV", "cV", "dV"]),
    ("elevation", &["s", "a"]),
    ("superelevation", &["s", "a"]),
    ("laneOffset", &["s", "a"]),
    ("laneSection", &["s"]),
    ("lane", &["id"]),
    ("width", &["a"]),
    ("signal", &["s", "t"]),
    ("object", &["s", "t"]),
];

/// Elements that must name something, and by which attribute.
const NAMES: [(&str, &str); 4] = [("road", "id"), ("junction", "id"), ("controller", "id"), ("signal", "id")];

/// Shapes that a geometry can have.
const SHAPES: [&str; 5] = ["line", "arc", "spiral", "poly3", "paramPoly3"];

/// A map that was read.
pub struct RoadMap {
    pub network: xodr::RoadNetwork,
    /// Reports on the parts that are skipped, and on its move.
    pub notes: Vec<String>,
    /// What was taken from all x and y: nought, but where the map lies far from its origin.
    pub offset_m: [f64; 2],
}

/// Reads a map.
///
/// # Errors
/// What is wrong, with its element and line; the caller adds the path.
pub fn read(text: &str) -> Result<RoadMap, String> {
    let document = Document::parse(text).map_err(|error| {
        // The parser's message ends in "at line:column".
        format!("broken XML, line {}: {error}", error.pos().row)
    })?;
    let mut notes = check(&document)?;
    let offset_m = map_origin::offset_m(&document)?;
    let moved = offset_m.map(|offset_m| map_origin::moved(&document, offset_m)).transpose()?;
    let (network, provenance) = xodr::load_str_with_provenance(moved.as_deref().unwrap_or(text))
        .map_err(|error| error.to_string())?;
    road_limits::check_spread(&network)?;
    notes.extend(summary(&provenance.warnings));
    notes.extend(undrawn(&network));
    notes.extend(offset_m.map(|[x_m, y_m]| {
        format!(
            "the map lies far from its origin: all of it is moved there, x by {} m and y by {} m",
            0.0 - x_m,
            0.0 - y_m
        )
    }));
    Ok(RoadMap { network, notes, offset_m: offset_m.unwrap_or_default() })
}

fn child<'a, 'b>(node: &Node<'a, 'b>, name: &str) -> Option<Node<'a, 'b>> {
    node.children().find(|child| child.tag_name().name() == name)
}

fn check(document: &Document<'_>) -> Result<Vec<String>, String> {
    let root = document.root_element();
    if root.tag_name().name() != "OpenDRIVE" {
        return Err(format!("{}: the root element must be <OpenDRIVE>", named(&root)));
    }
    let roads: Vec<Node<'_, '_>> = root.children().filter(|node| node.tag_name().name() == "road").collect();
    if roads.is_empty() {
        return Err(format!("{}: there is no <road> in it", named(&root)));
    }
    // User data is not checked.
    let is_own = |node: &Node<'_, '_>| !node.ancestors().any(|above| above.tag_name().name() == "userData");
    for node in root.descendants().filter(Node::is_element).filter(is_own) {
        check_attributes(&node)?;
    }
    let mut ids = BTreeMap::new();
    for road in &roads {
        if let Some(first) = ids.insert(road.attribute("id").unwrap_or_default(), line(road)) {
            return Err(format!("{}: the road of line {first} has the same id", named(road)));
        }
        check_road(road)?;
    }
    Ok(dangling(&root, &ids.into_keys().collect()))
}

fn check_attributes(node: &Node<'_, '_>) -> Result<(), String> {
    let name = node.tag_name().name();
    for attribute in NUMBERS.iter().filter(|(element, _)| *element == name).flat_map(|(_, needed)| *needed) {
        let found = node
            .attribute(*attribute)
            .ok_or_else(|| format!("{}: the attribute `{attribute}` is missing", named(node)))?;
        let is_number = found.trim().parse::<f64>().is_ok_and(f64::is_finite);
        let is_whole = name != "lane" || found.trim().parse::<i32>().is_ok();
        if !is_number || !is_whole {
            let wanted = if is_whole { "a number" } else { "a whole number" };
            return Err(format!("{}: `{attribute}` is \"{found}\", not {wanted}", named(node)));
        }
    }
    for (_, attribute) in NAMES.iter().filter(|(element, _)| *element == name) {
        if node.attribute(*attribute).is_none_or(str::is_empty) {
            return Err(format!("{}: the attribute `{attribute}` is missing", named(node)));
        }
    }
    Ok(())
}

fn check_road(road: &Node<'_, '_>) -> Result<(), String> {
    if number(road, "length") <= 0.0 {
        return Err(format!("{}: its length must be above 0", named(road)));
    }
    let plan = child(road, "planView").ok_or_else(|| format!("{}: it has no <planView>", named(road)))?;
    let mut geometries = plan.children().filter(|node| node.tag_name().name() == "geometry").peekable();
    if geometries.peek().is_none() {
        return Err(format!("{}: there is no <geometry> in it", named(&plan)));
    }
    for geometry in geometries {
        let shape = geometry.children().find(Node::is_element);
        if shape.is_none_or(|shape| !SHAPES.contains(&shape.tag_name().name())) {
            let found =
                shape.map_or_else(|| "nothing".into(), |shape| format!("<{}>", shape.tag_name().name()));
            return Err(format!("{}: it holds {found}, not one of {SHAPES:?}", named(&geometry)));
        }
    }
    let lanes = child(road, "lanes").ok_or_else(|| format!("{}: it has no <lanes>", named(road)))?;
    let sections = lanes.children().filter(|node| node.tag_name().name() == "laneSection");
    if sections.count() == 0 {
        return Err(format!("{}: there is no <laneSection> in it", named(&lanes)));
    }
    road_limits::check(road)
}

/// Links to roads that the file does not hold, as in maps cut out of larger ones.
fn dangling(root: &Node<'_, '_>, roads: &BTreeSet<&str>) -> Vec<String> {
    let named_road = |node: &Node<'_, '_>| {
        let road = match node.tag_name().name() {
            "predecessor" | "successor" if node.attribute("elementType") == Some("road") => {
                node.attribute("elementId")
            }
            "connection" => node.attribute("connectingRoad"),
            _ => None,
        };
        road.filter(|road| !roads.contains(road)).map(|road| (road.to_owned(), line(node)))
    };
    let lost: Vec<(String, u32)> = root.descendants().filter_map(|node| named_road(&node)).collect();
    let Some((road, line)) = lost.first() else { return Vec::new() };
    vec![format!(
        "{} links lead to roads that the map does not hold, the first to road {road} in line {line}",
        lost.len()
    )]
}

/// The importer's warnings by kind: how many, and the first.
fn summary(warnings: &[xodr::Warning]) -> Vec<String> {
    let mut kinds: BTreeMap<String, (usize, String)> = BTreeMap::new();
    for warning in warnings {
        let text = format!("{warning:?}");
        let kind = text.split([' ', '{', '(']).next().unwrap_or_default().to_owned();
        kinds.entry(kind).or_insert_with(|| (0, warning.to_string())).0 += 1;
    }
    let tell = |(n, first): (usize, String)| {
        if n == 1 { first } else { format!("{first} (and {} more such)", n - 1) }
    };
    kinds.into_values().map(tell).collect()
}

/// Crosswalks, whose length runs along the road they cross.
///
/// A plain box has its length along the road (OpenDRIVE: along `hdg`, relative to the road's); of an
/// outline, the shorter side is taken to be along the road, as crosswalks are wider than long.
pub fn crosswalks(network: &xodr::RoadNetwork) -> Vec<Footprint> {
    let is_crosswalk = |object: &&xodr::Object| object.kind == xodr::ObjectType::Crosswalk;
    network.objects().iter().filter(is_crosswalk).filter_map(|object| footprint(&object.shape)).collect()
}

fn footprint(shape: &xodr::Shape) -> Option<Footprint> {
    match shape {
        xodr::Shape::Solid {
            position,
            heading,
            extent: Some(xodr::Extent::Box { length, width, .. }),
            ..
        } => (*length > 0.5 && *width > 0.5).then(|| Footprint {
            center: flat(*position),
            yaw_rad: f64::from(*heading),
            length_m: f64::from(*length),
            width_m: f64::from(*width),
        }),
        xodr::Shape::Outline { corners, closed: true, .. } => {
            let [a, b, c, d] =
                corners.get(..4)?.iter().map(|corner| flat(corner.base)).collect::<Vec<_>>()[..]
            else {
                return None;
            };
            // Only a rectangle, perhaps closed by its first corner, is a zebra crossing.
            let is_four =
                corners.len() == 4 || (corners.len() == 5 && (flat(corners[4].base) - a).norm() < 0.1);
            let (one, other) = ((b - a + c - d) / 2.0, (d - a + c - b) / 2.0);
            let (along, across) = if one.norm() < other.norm() { (one, other) } else { (other, one) };
            let is_square = along.normalize().dot(&across.normalize()).abs() < 0.3;
            (is_four && is_square && along.norm() > 0.5).then(|| Footprint {
                center: (a + b + c + d) / 4.0,
                yaw_rad: along.y.atan2(along.x),
                length_m: along.norm(),
                width_m: across.norm(),
            })
        }
        _ => None,
    }
}

/// Counts the map's objects that are not drawn: the world has its own.
fn undrawn(network: &xodr::RoadNetwork) -> Option<String> {
    let mut kinds: BTreeMap<&str, usize> = BTreeMap::new();
    let is_drawn = |object: &xodr::Object| {
        object.kind == xodr::ObjectType::Crosswalk && footprint(&object.shape).is_some()
    };
    for object in network.objects().iter().filter(|object| !is_drawn(object)) {
        *kinds.entry(object.kind.as_str()).or_default() += 1;
    }
    let parts: Vec<String> = kinds.iter().map(|(kind, n)| format!("{n} {kind}")).collect();
    (!parts.is_empty()).then(|| format!("objects of the map are not drawn: {}", parts.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One straight road; `from` is replaced by `to`, which must occur.
    fn broken(from: &str, to: &str) -> String {
        let whole = r#"<OpenDRIVE>
  <header revMajor="1" revMinor="6"/>
  <road id="7" length="50" junction="-1">
    <planView>
      <geometry s="0" x="0" y="0" hdg="0" length="50">
        <line/>
      </geometry>
    </planView>
    <lanes>
      <laneSection s="0">
        <right>
          <lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>
        </right>
      </laneSection>
    </lanes>
  </road>
</OpenDRIVE>"#;
        assert!(whole.contains(from), "{from}");
        whole.replace(from, to)
    }

    #[test]
    fn a_whole_map_is_read() {
        let RoadMap { network, notes, offset_m } = read(&broken("driving", "driving")).unwrap();
        assert_eq!((network.lanes().len(), notes.len(), offset_m), (1, 0, [0.0; 2]), "{notes:?}");
    }

    #[test]
    fn a_map_in_the_coordinates_of_a_country_is_moved_and_keeps_its_shape() {
        let near = read(&broken("driving", "driving")).unwrap();
        let far = read(&broken("x=\"0\" y=\"0\"", "x=\"412345.25\" y=\"5412345.75\"")).unwrap();
        assert_eq!(far.offset_m, [412_345.0, 5_412_346.0]);
        assert!(far.notes[0].contains("x by -412345 m and y by -5412346 m"), "{:?}", far.notes);
        let points = |map: &RoadMap| map.network.lanes()[0].center.points().to_vec();
        for (near, far) in points(&near).iter().zip(points(&far)) {
            let is_same = (far.x - near.x - 0.25).abs() < 1e-4 && (far.y - near.y + 0.25).abs() < 1e-4;
            assert!(is_same, "{far:?}, near its origin {near:?}");
        }
    }

    #[test]
    fn what_is_broken_is_named_with_its_line() {
        for (from, to, wanted) in [
            ("</laneSection>", "", "broken XML, line 15"),
            ("OpenDRIVE>", "Map>", "<Map>, line 1: the root element must be <OpenDRIVE>"),
            (" hdg=\"0\"", "", "<geometry>, line 5: the attribute `hdg` is missing"),
            (
                "length=\"50\" junction",
                "length=\"long\" junction",
                "<road id=\"7\">, line 3: `length` is \"long\"",
            ),
            (
                "length=\"50\" junction",
                "length=\"0\" junction",
                "<road id=\"7\">, line 3: its length must be above 0",
            ),
            ("id=\"-1\"", "id=\"-1.5\"", "<lane id=\"-1.5\">, line 12: `id` is \"-1.5\", not a whole number"),
            ("<line/>", "<curve/>", "<geometry>, line 5: it holds <curve>"),
            ("a=\"3.5\"", "a=\"NaN\"", "<width>, line 12: `a` is \"NaN\""),
            (
                "d=\"0\"",
                "d=\"1\"",
                "<width>, line 12: the lane's width becomes 1.250e5 m; at most 100 m are taken",
            ),
            // Least at 37.5 m, not at either end.
            ("b=\"0\" c=\"0\"", "b=\"-9\" c=\"0.12\"", "the lane's width becomes -1.65"),
            (
                "hdg=\"0\" length=\"50\"",
                "hdg=\"0\" length=\"1e9\"",
                "<geometry>, line 5: its length is 1.000e9 m",
            ),
            (
                "<lanes>",
                "<lanes><laneOffset s=\"0\" a=\"0\" b=\"30\"/>",
                "<laneOffset>, line 9: the lanes' offset becomes 1.500e3 m",
            ),
            (
                "<lanes>",
                "<elevationProfile><elevation s=\"25\" a=\"2e4\"/></elevationProfile><lanes>",
                "<elevation>, line 9: the road's height becomes 2.000e4 m",
            ),
            (
                "<laneSection s=\"0\">",
                "<laneSection>",
                "<laneSection>, line 10: the attribute `s` is missing",
            ),
        ] {
            let message = read(&broken(from, to)).err().unwrap();
            assert!(message.contains(wanted), "{from} -> {to}: {message}");
        }
    }

    #[test]
    fn a_map_that_is_spread_over_a_continent_is_refused() {
        let one = broken("driving", "driving");
        let (_, rest) = one.split_once("<road").unwrap();
        let (road, _) = rest.split_once("</road>").unwrap();
        let far = road.replace("id=\"7\"", "id=\"8\"").replace("y=\"0\"", "y=\"-1e7\"");
        let both = one.replace("</OpenDRIVE>", &format!("<road{far}</road></OpenDRIVE>"));
        let message = read(&both).err().unwrap();
        assert!(message.contains("lanes lie from -1.000e7 to") && message.contains("along y"), "{message}");
    }

    #[test]
    fn a_link_to_a_road_outside_the_map_is_told_and_no_error() {
        let link = "<link><successor elementType=\"road\" elementId=\"99\" contactPoint=\"start\"/></link>\n    <planView>";
        let notes = read(&broken("<planView>", link)).unwrap().notes;
        assert!(notes[0].contains("road 99 in line 4"), "{notes:?}");
    }
}
