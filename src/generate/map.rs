//! The map that viewers draw under an episode: lane borders and drivable ground.

use crate::episode::MapDrawing;
use crate::geometry::{Point, World};
use crate::scene::{Ground, LaneGraph};

/// Lane borders are straight between points this far apart.
const STEP_M: f64 = 2.0;

/// The lanes within `reach_m` of the points.
pub(super) fn drawing(graph: &LaneGraph, ground: &Ground, near: &[[f64; 2]], reach_m: f64) -> MapDrawing {
    let mut map = MapDrawing::default();
    let is_near =
        |point: &Point<World>| near.iter().any(|[x, y]| (point.x() - x).hypot(point.y() - y) < reach_m);
    for lane in &graph.lanes {
        let n_steps = (lane.path.length_m() / STEP_M).ceil().max(1.0) as usize;
        let border = |left_m: f64| -> Vec<Point<World>> {
            let at = |i: usize| lane.path.beside(lane.path.length_m() * i as f64 / n_steps as f64, left_m);
            (0..=n_steps).map(at).map(|at| Point::new(at.x, at.y, ground.height_m(at))).collect()
        };
        let (left, right) = (border(lane.width_m / 2.0), border(-lane.width_m / 2.0));
        if !left.iter().any(is_near) {
            continue;
        }
        for i in 0..n_steps {
            map.drivable_area.push([right[i], right[i + 1], left[i + 1]]);
            map.drivable_area.push([right[i], left[i + 1], left[i]]);
        }
        map.lane_lines.extend([left, right]);
    }
    map
}
