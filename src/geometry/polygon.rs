//! Areas and overlaps of convex polygons on the ground plane.
//!
//! Overlap by clipping one polygon with the other's edges (Sutherland and Hodgman, 1974), which is
//! exact for convex shapes up to rounding.

/// A point on the ground plane, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point2 {
    pub x_m: f64,
    pub y_m: f64,
}

/// Area of a simple polygon in square metres; zero for fewer than three corners.
#[must_use]
pub fn polygon_area(corners: &[Point2]) -> f64 {
    signed_area(corners).abs()
}

/// Area shared by two convex polygons, in square metres, whatever their winding.
#[must_use]
pub fn convex_overlap_area(subject: &[Point2], clip: &[Point2]) -> f64 {
    let winding = if signed_area(clip) < 0.0 { -1.0 } else { 1.0 };
    let mut clipped = subject.to_vec();
    for (i, &edge_start) in clip.iter().enumerate() {
        let edge_end = clip[(i + 1) % clip.len()];
        let inside = |p: Point2| winding * cross(edge_start, edge_end, p);
        let corners = std::mem::take(&mut clipped);
        for (j, &current) in corners.iter().enumerate() {
            let next = corners[(j + 1) % corners.len()];
            let (side_current, side_next) = (inside(current), inside(next));
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
        }
    }
    polygon_area(&clipped)
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
        fn overlap_is_symmetric_and_bounded(x in -3.0..3.0, y in -3.0..3.0, side in 0.1..4.0) {
            let (a, b) = (square(0.0, 0.0, 2.0), square(x, y, side));
            let area = convex_overlap_area(&a, &b);
            prop_assert!((area - convex_overlap_area(&b, &a)).abs() < 1e-9);
            let expected = ((2.0f64.min(x + side) - x.max(0.0)).max(0.0)) * ((2.0f64.min(y + side) - y.max(0.0)).max(0.0));
            prop_assert!((area - expected).abs() < 1e-9);
        }
    }
}
