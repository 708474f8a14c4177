//! Crosswalks: OpenDRIVE objects of that type, drawn as bars along the direction of travel.

use super::network::flat;
use super::path::Vec2;

/// Bars and the gaps between them: 0.5 m each, as on most roads of Europe.
const BAR_M: f64 = 0.5;

/// Painted quads of all crosswalks whose outline has four corners; others are left out.
#[must_use]
pub fn bars(network: &xodr::RoadNetwork) -> Vec<[Vec2; 4]> {
    let crosswalks = network.objects().iter().filter(|object| object.kind == xodr::ObjectType::Crosswalk);
    let outlines = crosswalks.filter_map(|object| match &object.shape {
        xodr::Shape::Outline { corners, .. } => Some(corners),
        _ => None,
    });
    outlines
        .filter_map(|corners| {
            let mut points: Vec<Vec2> = corners.iter().map(|corner| flat(corner.base)).collect();
            // Some maps close the ring by its first corner.
            if points.len() == 5 && (points[0] - points[4]).norm() < 0.01 {
                points.pop();
            }
            points.try_into().ok()
        })
        .flat_map(bars_of)
        .collect()
}

/// Bars within a rectangle; they run along its shorter side.
fn bars_of(corners: [Vec2; 4]) -> Vec<[Vec2; 4]> {
    let [a, b, c, d] = corners;
    // From `start` across the road to `end`; `along` is a bar.
    let (start, end, along) = if (b - a).norm() < (d - a).norm() { (a, d, b - a) } else { (b, a, c - b) };
    let across = end - start;
    let width_m = across.norm();
    if width_m < BAR_M {
        return Vec::new();
    }
    let n = ((width_m / BAR_M - 1.0) / 2.0).round().max(1.0);
    let step = across / (2.0 * n + 1.0);
    let is_left_turned = across.perp(&along) > 0.0;
    (0..n as usize)
        .map(|i| {
            let foot = start + step * (2 * i + 1) as f64;
            let quad = [foot, foot + step, foot + step + along, foot + along];
            // Counter-clockwise, so that it is seen from above.
            if is_left_turned { quad } else { [quad[0], quad[3], quad[2], quad[1]] }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_lie_within_the_crosswalk_and_face_up() {
        let corners = [(0.0, -3.5), (3.0, -3.5), (3.0, 3.5), (0.0, 3.5)].map(|(x, y)| Vec2::new(x, y));
        for corners in [corners, [corners[1], corners[2], corners[3], corners[0]]] {
            let bars = bars_of(corners);
            assert_eq!(bars.len(), 7);
            for [a, b, c, _] in bars {
                assert!((b - a).perp(&(c - a)) > 0.0);
                assert!(a.x > -1e-9 && a.x < 3.0 + 1e-9 && a.y.abs() < 3.5);
                assert!(((b - a).norm() - 7.0 / 15.0).abs() < 1e-9 || ((b - a).norm() - 3.0).abs() < 1e-9);
            }
        }
    }
}
