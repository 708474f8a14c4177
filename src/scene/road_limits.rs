//! Sizes that no road has: a map with one is wrong, and drawing it would take hours and all memory.

use roxmltree::Node;

use super::xml::{named, number};

/// Metres of one road, or a part of its course.
const LONGEST_M: f64 = 1e5;
const WIDEST_LANE_M: f64 = 100.0;
/// Of a road's lanes from its reference line.
const LARGEST_OFFSET_M: f64 = 1000.0;
/// Above or below nought.
const HIGHEST_M: f64 = 1e4;
/// Of a map, along either axis.
pub(super) const WIDEST_MAP_M: f64 = 5e4;

/// A cubic polynomial of the way along a road, from its element on to the next one.
struct Cubic {
    from_m: f64,
    coefficients: [f64; 4],
}

impl Cubic {
    fn of(node: &Node<'_, '_>, start: &str) -> Self {
        Self {
            from_m: number(node, start),
            coefficients: ["a", "b", "c", "d"].map(|name| number(node, name)),
        }
    }

    fn at(&self, along_m: f64) -> f64 {
        self.coefficients.iter().rev().fold(0.0, |sum, coefficient| sum * along_m + coefficient)
    }

    /// The value farthest from nought on the way to `to_m`.
    fn farthest(&self, to_m: f64) -> f64 {
        let length_m = (to_m - self.from_m).max(0.0);
        let [_, b, c, d] = self.coefficients;
        // Where 3 d x^2 + 2 c x + b is nought, written so that nothing is divided by a small d.
        let root = (c * c - 3.0 * b * d).max(0.0).sqrt();
        let pivot = -(c + c.signum() * root);
        let turns = [pivot / (3.0 * d), b / pivot].into_iter().filter(|at| (0.0..length_m).contains(at));
        let values = turns.chain([0.0, length_m]).map(|at| self.at(at));
        values.fold(
            0.0,
            |farthest: f64, value| {
                if value.abs() > farthest.abs() || value.is_nan() { value } else { farthest }
            },
        )
    }
}

/// Refuses a road that is too long, wide, high, or far from its own line.
pub(super) fn check(road: &Node<'_, '_>) -> Result<(), String> {
    let length_m = number(road, "length");
    bounded(road, "its length is", length_m, LONGEST_M)?;
    for node in road.descendants().filter(|node| node.has_tag_name("geometry")) {
        bounded(&node, "its length is", number(&node, "length"), LONGEST_M)?;
    }
    for node in children(road, "elevationProfile") {
        bound_each(&node, "elevation", "s", length_m, ("the road's height becomes", HIGHEST_M))?;
    }
    for lanes in children(road, "lanes") {
        bound_each(&lanes, "laneOffset", "s", length_m, ("the lanes' offset becomes", LARGEST_OFFSET_M))?;
        let sections: Vec<Node<'_, '_>> = children(&lanes, "laneSection").collect();
        let starts_m = sections.iter().map(|section| number(section, "s")).chain([length_m]);
        for (section, (from_m, to_m)) in sections.iter().zip(starts_m.clone().zip(starts_m.skip(1))) {
            for lane in section.descendants().filter(|node| node.has_tag_name("lane")) {
                let told = ("the lane's width becomes", WIDEST_LANE_M);
                bound_each(&lane, "width", "sOffset", to_m - from_m, told)?;
            }
        }
    }
    Ok(())
}

/// Refuses a map with lanes so far from each other that no memory holds the land between them.
pub(super) fn check_spread(network: &xodr::RoadNetwork) -> Result<(), String> {
    let points = || network.lanes().iter().flat_map(|lane| lane.center.points());
    let sides: [fn(&xodr::Point) -> f32; 2] = [|point| point.x, |point| point.y];
    for (axis, side) in ["x", "y"].into_iter().zip(sides) {
        let range = |(low, high): (f64, f64), at: f64| (low.min(at), high.max(at));
        let (low_m, high_m) =
            points().map(|point| f64::from(side(point))).fold((f64::INFINITY, f64::NEG_INFINITY), range);
        if high_m - low_m > WIDEST_MAP_M {
            return Err(format!(
                "its lanes lie from {low_m:.3e} to {high_m:.3e} m along {axis}; at most {WIDEST_MAP_M} m are taken"
            ));
        }
    }
    Ok(())
}

/// Bounds what the children of one name tell, each valid from its start to the next one's, the last to `end_m`.
fn bound_each(
    node: &Node<'_, '_>,
    name: &'static str,
    start: &str,
    end_m: f64,
    (told, most_m): (&str, f64),
) -> Result<(), String> {
    let nodes: Vec<Node<'_, '_>> = children(node, name).collect();
    for (i, node) in nodes.iter().enumerate() {
        let to_m = nodes.get(i + 1).map_or(end_m, |next| number(next, start));
        bounded(node, told, Cubic::of(node, start).farthest(to_m), most_m)?;
    }
    Ok(())
}

fn bounded(node: &Node<'_, '_>, told: &str, found_m: f64, most_m: f64) -> Result<(), String> {
    if found_m.abs() <= most_m {
        return Ok(());
    }
    Err(format!("{}: {told} {found_m:.3e} m; at most {most_m} m are taken", named(node)))
}

fn children<'a, 'b>(node: &Node<'a, 'b>, name: &'static str) -> impl Iterator<Item = Node<'a, 'b>> {
    node.children().filter(move |child| child.has_tag_name(name))
}
