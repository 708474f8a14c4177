//! Changes of lane: when a neighbouring lane of the same direction is better and free.
//!
//! Reasons: someone slower ahead, or a lane that ends. The change itself is a new route along the
//! neighbour with the body beside it, which the driver then steers back to the middle of.

use super::driving::Obstacle;
use super::network::LaneGraph;
use super::path::Vec2;
use super::route::Route;
use crate::random::Rng;

/// No change begins closer than this to the end of a lane, as before a junction.
const LEAST_LEFT_M: f64 = 30.0;
/// If the route ends within this distance, the driver looks for a lane that leads on.
const END_M: f64 = 150.0;
/// How far ahead slower vehicles are seen.
const SIGHT_M: f64 = 45.0;
/// A vehicle slower than this share of the wished speed is worth passing.
const SLOW_SHARE: f64 = 0.75;
/// A neighbouring lane must be free this much farther than the present one.
const GAIN_M: f64 = 15.0;

/// A driver who might change.
#[derive(Debug, Clone, Copy)]
pub struct Mover<'a> {
    pub route: &'a Route,
    /// Station of the body's centre.
    pub station_m: f64,
    pub length_m: f64,
    pub speed_mps: f64,
    /// The speed it would drive alone.
    pub wish_mps: f64,
}

/// The new way, and where the body is on it.
#[derive(Debug, Clone)]
pub struct LaneChange {
    pub route: Route,
    pub station_m: f64,
    pub left_m: f64,
}

impl Mover<'_> {
    /// The change to make now, if any.
    pub fn change(&self, graph: &LaneGraph, others: &[Obstacle], rng: &mut Rng) -> Option<LaneChange> {
        let span = self.route.span_at(self.station_m);
        let lane = &graph.lanes[span.lane];
        if lane.junction.is_some() || (lane.left.is_none() && lane.right.is_none()) {
            return None;
        }
        if span.end_m - self.station_m < LEAST_LEFT_M + self.speed_mps {
            return None;
        }
        let ends = self.route.path.length_m() - self.station_m < END_M;
        let (free_m, lead_mps) = self.ahead(self.route, self.station_m, others);
        let is_held_up = lead_mps < SLOW_SHARE * self.wish_mps;
        if !ends && !is_held_up {
            return None;
        }
        // The faster lane is the one away from the kerb.
        let sides = if graph.keeps_left { [lane.right, lane.left] } else { [lane.left, lane.right] };
        sides.into_iter().flatten().find_map(|other| {
            let leads_on = graph.lanes[other].reach_m > lane.reach_m + END_M;
            let route = Route::random(graph, other, 400.0, rng);
            let length_m = graph.lanes[other].path.length_m();
            let at = self.route.path.at(self.station_m);
            let (station_m, left_m) = route.path.project(at, 0.0, length_m);
            let (there_m, there_mps) = self.ahead(&route, station_m, others);
            let is_better = there_m > free_m + GAIN_M || (there_m > free_m && there_mps > lead_mps + 2.0);
            let is_wanted = (ends && leads_on) || (is_held_up && !ends && is_better);
            (is_wanted && left_m.abs() < 6.0 && self.is_free(&route, station_m, others))
                .then_some(LaneChange { route, station_m, left_m })
        })
    }

    /// How far a way is free, and the speed of the vehicle that ends it.
    fn ahead(&self, route: &Route, station_m: f64, others: &[Obstacle]) -> (f64, f64) {
        let front_m = station_m + self.length_m / 2.0;
        self.on(route, station_m, others)
            .filter(|(s_m, _, half_m)| s_m + half_m > front_m)
            .map(|(s_m, along_mps, half_m)| ((s_m - half_m - front_m).max(0.0), along_mps))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or((SIGHT_M, f64::INFINITY))
    }

    /// Whether nobody is beside, close ahead, or comes from behind too fast.
    fn is_free(&self, route: &Route, station_m: f64, others: &[Obstacle]) -> bool {
        let half_own_m = self.length_m / 2.0;
        self.on(route, station_m, others).all(|(s_m, along_mps, half_m)| {
            let between_m = (s_m - station_m).abs() - half_m - half_own_m;
            let closing_mps =
                if s_m > station_m { self.speed_mps - along_mps } else { along_mps - self.speed_mps };
            between_m > 4.0 + 0.4 * self.speed_mps + 3.0 * closing_mps.max(0.0)
        })
    }

    /// The vehicles on a way near a station: their station, speed along it, and half their length.
    fn on<'b>(
        &self,
        route: &'b Route,
        station_m: f64,
        others: &'b [Obstacle],
    ) -> impl Iterator<Item = (f64, f64, f64)> + use<'b> {
        let (from_m, to_m) = (station_m - SIGHT_M, station_m + SIGHT_M + self.length_m);
        let at: Vec2 = route.path.at(station_m);
        others.iter().filter(move |other| (other.footprint.center - at).norm() < SIGHT_M + 12.0).filter_map(
            move |other| {
                let (s_m, left_m) = route.path.project(other.footprint.center, from_m, to_m);
                let is_on = left_m.abs() < 1.2 + other.footprint.width_m / 2.0;
                let along_mps = other.velocity_mps.dot(&route.path.direction(s_m));
                is_on.then_some((s_m, along_mps, other.footprint.length_m / 2.0))
            },
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::driving::Owner;
    use super::super::network::GraphLane;
    use super::super::occupancy::Footprint;
    use super::super::path::Path;
    use super::*;

    /// Two lanes to the east, the second on the left.
    fn street() -> LaneGraph {
        let lane = |y: f64| GraphLane::new(Path::new([Vec2::new(0.0, y), Vec2::new(300.0, y)]).unwrap());
        let lanes = vec![
            GraphLane { left: Some(1), reach_m: 300.0, ..lane(0.0) },
            GraphLane { right: Some(0), reach_m: 300.0, ..lane(3.5) },
        ];
        LaneGraph { lanes, ..LaneGraph::default() }
    }

    fn car(x_m: f64, y_m: f64, speed_mps: f64) -> Obstacle {
        Obstacle {
            owner: Owner::Placement(7),
            footprint: Footprint { center: Vec2::new(x_m, y_m), yaw_rad: 0.0, length_m: 4.0, width_m: 1.8 },
            velocity_mps: Vec2::new(speed_mps, 0.0),
            is_still: false,
            is_vehicle: true,
            backs_up: false,
        }
    }

    fn change(others: &[Obstacle]) -> Option<LaneChange> {
        let graph = street();
        let mut rng = crate::random::stream(0, "test", 0);
        let route = Route::random(&graph, 0, 100.0, &mut rng);
        let mover = Mover { route: &route, station_m: 50.0, length_m: 4.0, speed_mps: 8.0, wish_mps: 13.0 };
        mover.change(&graph, others, &mut rng)
    }

    #[test]
    fn a_slower_one_is_passed_on_the_free_lane() {
        let found = change(&[car(70.0, 0.0, 6.0)]).unwrap();
        assert_eq!(found.route.spans[0].lane, 1);
        assert!((found.station_m - 50.0).abs() < 1e-9 && (found.left_m + 3.5).abs() < 1e-9);
    }

    #[test]
    fn nobody_changes_without_reason_or_into_someone() {
        assert!(change(&[]).is_none(), "an empty road");
        assert!(change(&[car(70.0, 0.0, 13.0)]).is_none(), "as fast as the own wish");
        let slow = car(70.0, 0.0, 6.0);
        assert!(change(&[slow, car(49.0, 3.5, 8.0)]).is_none(), "someone beside");
        assert!(change(&[slow, car(30.0, 3.5, 14.0)]).is_none(), "someone fast from behind");
    }
}
