//! Convex hulls in the plane.

use nalgebra::Vector2;

/// Convex hull, counter-clockwise (Andrew's monotone chain). Fewer than three different points come back sorted.
#[must_use]
pub fn convex_hull(mut points: Vec<Vector2<f64>>) -> Vec<Vector2<f64>> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let half = |ordered: &mut dyn Iterator<Item = Vector2<f64>>| {
        let mut hull: Vec<Vector2<f64>> = Vec::new();
        for point in ordered {
            while let [.., a, b] = hull[..] {
                if (b - a).perp(&(point - b)) > 0.0 {
                    break;
                }
                hull.pop();
            }
            hull.push(point);
        }
        hull.pop();
        hull
    };
    let mut hull = half(&mut points.iter().copied());
    hull.extend(half(&mut points.iter().rev().copied()));
    hull
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hull_of_a_square_leaves_out_its_middle() {
        let points = [(0.0, 0.0), (2.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (1.0, 1.0)];
        let hull = convex_hull(points.iter().map(|&(x, y)| Vector2::new(x, y)).collect());
        assert_eq!(hull.len(), 4);
        assert!(!hull.contains(&Vector2::new(1.0, 1.0)));
    }

    #[test]
    fn a_point_given_twice_is_one() {
        assert_eq!(convex_hull(vec![Vector2::new(1.0, 2.0); 3]), [Vector2::new(1.0, 2.0)]);
    }
}
