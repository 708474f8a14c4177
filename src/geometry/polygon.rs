//! Areas and overlaps of convex polygons on the ground plane.
//!
//! Overlap by clipping one polygon with the other's edges (Sutherland and Hodgman, 1974), which is
//! exact for convex shapes up to rounding.

use serde::{Deserialize, Serialize};
use smallvec::SmallVec;

/// A point on the ground plane, metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Point2 {
    pub x_m: f64,
    pub y_m: f64,
}

/// Area of a simple polygon in square metres; zero for fewer than three corners.
#[must_use]
pub fn polygon_area(corners: &[Point2]) -> f64 {
    signed_area(corners).abs()
}

/// Corners for which no memory is asked: one rectangle clipped by another has at most 20, whatever rounding does.
const N_ON_STACK: usize = 24;

/// Area shared by two convex polygons, in square metres, whatever their winding.
#[must_use]
pub fn convex_overlap_area(subject: &[Point2], clip: &[Point2]) -> f64 {
    let winding = if signed_area(clip) < 0.0 { -1.0 } else { 1.0 };
    let mut clipped: SmallVec<[Point2; N_ON_STACK]> = SmallVec::from_slice(subject);
    let mut corners: SmallVec<[Point2; N_ON_STACK]> = SmallVec::new();
    for (i, &edge_start) in clip.iter().enumerate() {
        let edge_end = clip[(i + 1) % clip.len()];
        let inside = |p: Point2| winding * cross(edge_start, edge_end, p);
        std::mem::swap(&mut clipped, &mut corners);
        clipped.clear();
        let Some(&first) = corners.first() else { break };
        let (mut current, mut side_current) = (first, inside(first));
        for &next in corners[1..].iter().chain([&first]) {
            let side_next = inside(next);
            if side_current >= 0.0 {
                clipped.push(current);
            }
            if (side_current > 0.0 && side_next < 0.0) || (side_current < 0.0 && side_next > 0.0) {
                let t = side_current / (side_current - side_next);
                clipped.push(Point2 {
                    x_m: current.x_m + t * (next.x_m - current.x_m),
                    y_m: current.y_m + t * (next.y_m - current.y_m),
                });
            }
            (current, side_current) = (next, side_next);
        }
    }
    polygon_area(&clipped)
}

/// Signed distance of two convex polygons of three or more corners, metres, whatever their winding.
///
/// Positive: the gap between them. Negative: the shortest move of one after which they only touch, which runs along
/// the normal of an edge (separating axes; Gottschalk, Lin and Manocha 1996).
#[must_use]
pub fn convex_signed_distance_m(one: &[Point2], other: &[Point2]) -> f64 {
    let deepest_m = f64::max(separation_m(one, other), separation_m(other, one));
    if deepest_m <= 0.0 {
        return deepest_m;
    }
    // Apart, the nearest points are a corner of one and a point on an edge of the other.
    f64::min(gap_m(one, other), gap_m(other, one))
}

/// The largest gap between the projections of two polygons on the normals of `edges_of`.
fn separation_m(edges_of: &[Point2], other: &[Point2]) -> f64 {
    let winding = if signed_area(edges_of) < 0.0 { -1.0 } else { 1.0 };
    let edges = edges_of.iter().zip(edges_of.iter().cycle().skip(1));
    let along_normal_m = edges.filter_map(|(&start, &end)| {
        let length_m = (end.x_m - start.x_m).hypot(end.y_m - start.y_m);
        let outside = |&p: &Point2| -winding * cross(start, end, p);
        // A corner given twice has no normal.
        (length_m > 0.0).then(|| other.iter().map(outside).fold(f64::INFINITY, f64::min) / length_m)
    });
    along_normal_m.fold(f64::NEG_INFINITY, f64::max)
}

/// The smallest distance from a corner of one polygon to an edge of the other.
fn gap_m(corners_of: &[Point2], edges_of: &[Point2]) -> f64 {
    let (mut least_m, mut least_m2) = (f64::INFINITY, f64::INFINITY);
    for &corner in corners_of {
        for (&start, &end) in edges_of.iter().zip(edges_of.iter().cycle().skip(1)) {
            let [x, y] = offset_from_edge(corner, start, end);
            let squared = x * x + y * y;
            // `hypot` is slow; it is left out where rounding cannot make this distance the smaller one.
            if squared <= least_m2 * (1.0 + 1e-12) {
                least_m = least_m.min(x.hypot(y));
                least_m2 = least_m2.min(squared);
            }
        }
    }
    least_m
}

/// From the nearest point on the segment between two points to another point: x, y.
fn offset_from_edge(point: Point2, start: Point2, end: Point2) -> [f64; 2] {
    let (dx, dy) = (end.x_m - start.x_m, end.y_m - start.y_m);
    let squared = dx * dx + dy * dy;
    let along = (point.x_m - start.x_m) * dx + (point.y_m - start.y_m) * dy;
    let t = if squared > 0.0 { (along / squared).clamp(0.0, 1.0) } else { 0.0 };
    [point.x_m - start.x_m - t * dx, point.y_m - start.y_m - t * dy]
}

/// Distance of a point from a convex polygon, metres; zero inside.
#[must_use]
pub fn distance_to_convex_m(point: Point2, corners: &[Point2]) -> f64 {
    convex_signed_distance_of_point(point, corners).max(0.0)
}

/// Positive outside; inside, minus the distance to the nearest edge.
fn convex_signed_distance_of_point(point: Point2, corners: &[Point2]) -> f64 {
    let inside_m = separation_m(corners, &[point]);
    if inside_m <= 0.0 { inside_m } else { gap_m(&[point], corners) }
}

/// Twice the signed area of the triangle `a`, `b`, `c`; positive when `c` is left of `a -> b`.
fn cross(a: Point2, b: Point2, c: Point2) -> f64 {
    (b.x_m - a.x_m) * (c.y_m - a.y_m) - (b.y_m - a.y_m) * (c.x_m - a.x_m)
}

fn signed_area(corners: &[Point2]) -> f64 {
    let Some(&origin) = corners.first() else { return 0.0 };
    // Relative to the first corner, so that far from the origin no digits are lost.
    let fan = corners.windows(2).map(|pair| cross(origin, pair[0], pair[1])).sum::<f64>();
    fan / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn square(x: f64, y: f64, side: f64) -> [Point2; 4] {
        [(0.0, 0.0), (side, 0.0), (side, side), (0.0, side)]
            .map(|(dx, dy)| Point2 { x_m: x + dx, y_m: y + dy })
    }

    #[test]
    fn shifted_squares_share_a_quarter() {
        assert!((convex_overlap_area(&square(0.0, 0.0, 2.0), &square(1.0, 1.0, 2.0)) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn squares_apart_have_a_gap_and_squares_in_one_another_a_depth() {
        let at = |x, y| convex_signed_distance_m(&square(0.0, 0.0, 2.0), &square(x, y, 2.0));
        assert!((at(5.0, 0.5) - 3.0).abs() < 1e-12);
        assert!((at(5.0, 6.0) - 5.0).abs() < 1e-12, "3 and 4 apart, corner to corner");
        assert!((at(1.5, 0.25) + 0.5).abs() < 1e-12);
        assert!((at(0.0, 0.0) + 2.0).abs() < 1e-12);
        let inner = square(0.75, 0.75, 0.5);
        assert!((convex_signed_distance_m(&square(0.0, 0.0, 2.0), &inner) + 1.25).abs() < 1e-12);
        let point = |x_m, y_m| distance_to_convex_m(Point2 { x_m, y_m }, &square(0.0, 0.0, 2.0));
        assert!((point(1.0, 5.0) - 3.0).abs() < 1e-12 && point(1.0, 1.0) == 0.0);
    }

    #[test]
    fn touching_squares_share_nothing() {
        assert!(convex_overlap_area(&square(0.0, 0.0, 1.0), &square(1.0, 0.0, 1.0)) < 1e-15);
    }

    #[test]
    fn winding_does_not_matter() {
        let mut reversed = square(1.0, 1.0, 2.0);
        reversed.reverse();
        assert!((convex_overlap_area(&square(0.0, 0.0, 2.0), &reversed) - 1.0).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn the_signed_distance_is_negative_where_areas_overlap_and_alike_both_ways(
            x in -4.0..4.0_f64, y in -4.0..4.0_f64, turn in 0.0..6.3_f64, size in 0.2..3.0_f64,
        ) {
            let (one, turned) = (square(-1.0, -1.0, 2.0), square(-size, -size, 2.0 * size).map(|p: Point2| {
                let (sin, cos) = f64::sin_cos(turn);
                Point2 { x_m: x + p.x_m * cos - p.y_m * sin, y_m: y + p.x_m * sin + p.y_m * cos }
            }));
            let distance_m = convex_signed_distance_m(&one, &turned);
            prop_assert!((distance_m - convex_signed_distance_m(&turned, &one)).abs() < 1e-12);
            prop_assert_eq!(distance_m < -1e-9, convex_overlap_area(&one, &turned) > 1e-12);
        }

        #[test]
        fn overlap_is_symmetric_and_bounded(x in -3.0..3.0, y in -3.0..3.0, side in 0.1..4.0) {
            let (a, b) = (square(0.0, 0.0, 2.0), square(x, y, side));
            let area = convex_overlap_area(&a, &b);
            prop_assert!((area - convex_overlap_area(&b, &a)).abs() < 1e-9);
            let expected = ((2.0f64.min(x + side) - x.max(0.0)).max(0.0)) * ((2.0f64.min(y + side) - y.max(0.0)).max(0.0));
            prop_assert!((area - expected).abs() < 1e-9);
        }
    }
}
