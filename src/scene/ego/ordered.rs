//! The ego's driver under test: drives its route at the route's speed, and brakes when perception orders it.
//!
//! It knows nothing of objects. The route gives the steering (pure pursuit on the lane's middle) and the target speed: limits,
//! bends, the lines of lights and of junctions whose way through is not granted.

use serde::{Deserialize, Serialize};

use super::{DRIVE_RESPONSE_S, EgoDriver, EgoPose, Gap, MOVES_MPS, driving};
use crate::scene::car::EgoCommand;
use crate::scene::junctions::Answer;
use crate::scene::network::LaneGraph;

/// A line nearer than this is what the driver stands for.
const AT_LINE_M: f64 = 4.0;
/// From a line to the bumper of one who stands.
const STANDSTILL_M: f64 = 1.0;
/// From here on the end of the route is a line to stop at.
const END_REACH_M: f64 = 30.0;

/// Braking that is missing is asked for over this time, up to a bound: wheels slip, and their speed follows late.
const BRAKING_TIME_S: f64 = 0.15;
const MOST_MORE_MPS2: f64 = 10.0;

/// What perception orders the driver under test.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct EgoOrders {
    /// Brake at least so hard; `None`: drive on.
    pub braking_mps2: Option<f64>,
}

impl EgoDriver {
    /// Decides once by route and orders alone; otherwise as [`EgoDriver::step`].
    pub fn step_ordered(
        &mut self,
        dt_s: f64,
        pose: &EgoPose,
        answer: &Answer,
        graph: &LaneGraph,
        orders: &EgoOrders,
    ) -> EgoCommand {
        let line = answer.stop.map(|stop| stop.gap);
        let speed_mps = pose.speed_mps.max(0.0);
        // Who has waited longest at a junction asks first.
        let is_held = line.is_some_and(|line| line.distance_m < AT_LINE_M);
        let waits = speed_mps <= MOVES_MPS && is_held && !answer.is_granted;
        self.held_s = if waits { self.held_s + dt_s } else { 0.0 };
        // Who stands for anything else before a junction gives its reservation back.
        let stands = speed_mps <= MOVES_MPS && !answer.is_granted;
        self.jam_s = if stands { self.jam_s + dt_s } else { 0.0 };
        let free = self.free_mps2(speed_mps, self.station_m, line, graph);
        let acceleration = orders.braking_mps2.map_or(free, |braking_mps2| free.min(-braking_mps2));
        let found_mps2 = (self.speed_before_mps - pose.speed_mps) / dt_s;
        self.more_braking_mps2 = if acceleration < 0.0 && speed_mps > MOVES_MPS {
            let change = (-acceleration - found_mps2) * dt_s / BRAKING_TIME_S;
            (self.more_braking_mps2 + change).clamp(0.0, MOST_MORE_MPS2)
        } else {
            0.0
        };
        let hold_mps = self.hold_mps(dt_s, pose, acceleration);
        self.left_m = 0.0;
        self.steer(dt_s, pose, &[]);
        self.asked_mps2 = acceleration;
        EgoCommand {
            target_speed_mps: (speed_mps + (acceleration - self.more_braking_mps2) * DRIVE_RESPONSE_S)
                .max(0.0)
                + hold_mps,
            steering_angle_rad: self.steering_rad,
        }
    }

    /// Whether it stands at the line of a light or a junction that does not let it through.
    pub fn waits_at_line(&self) -> bool {
        self.held_s > 0.0
    }

    /// How far a car has come after each of so many steps, from standing where it is, with nothing in its way.
    pub fn free_way_m(&self, n_steps: usize, dt_s: f64, graph: &LaneGraph) -> Vec<f64> {
        let (mut driven_m, mut speed_mps) = (0.0, 0.0_f64);
        let mut step = || {
            let acceleration = self.free_mps2(speed_mps, self.station_m + driven_m, None, graph);
            speed_mps = (speed_mps + acceleration * dt_s).max(0.0);
            driven_m += speed_mps * dt_s;
            driven_m
        };
        (0..n_steps).map(|_| step()).collect()
    }

    /// The acceleration that the route and a line ask for, with the rear axle at a station.
    fn free_mps2(&self, speed_mps: f64, station_m: f64, line: Option<Gap>, graph: &LaneGraph) -> f64 {
        let front_m = station_m + self.front_m() - self.station_m;
        let limit_mps = graph.lanes[self.route.span_at(front_m).lane].limit_mps;
        let desired_mps = driving::bend_speed_mps(&self.route.path, station_m, limit_mps);
        let to_end_m = self.route.path.length_m() - front_m;
        let end = (to_end_m < END_REACH_M).then(|| Gap::line(to_end_m.max(0.1)));
        let on_way = driving::acceleration_mps2(speed_mps, desired_mps, None, STANDSTILL_M);
        [line, end].into_iter().flatten().fold(on_way, |least, stop| {
            least.min(driving::acceleration_mps2(speed_mps, desired_mps, Some(stop), STANDSTILL_M))
        })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::random;
    use crate::scene::junctions::Stop;
    use crate::scene::{Route, Town};

    fn on_road() -> (Town, EgoDriver, EgoPose) {
        let town = Town::load("downtown").unwrap();
        let mut rng = random::stream(1, "ordered-test", 0);
        let is_long = |lane: &usize| {
            let lane = &town.graph.lanes[*lane];
            lane.junction.is_none() && lane.path.length_m() > 60.0
        };
        let lane = (0..town.graph.lanes.len()).find(is_long).unwrap();
        let route = Route::random(&town.graph, lane, 300.0, &mut rng);
        let (position, yaw_rad) = (route.path.at(5.0), route.path.heading_rad(5.0));
        let driver = EgoDriver::new(route, 5.0, BTreeMap::new(), rng);
        (town, driver, EgoPose { position, yaw_rad, speed_mps: 8.0, grade: 0.0 })
    }

    #[test]
    fn without_orders_it_drives_on_and_with_them_it_brakes_as_hard_as_told() {
        let (town, driver, pose) = on_road();
        let target_mps = |braking_mps2: Option<f64>| {
            let orders = EgoOrders { braking_mps2 };
            let mut driver = EgoDriver { speed_before_mps: 8.0, ..driver.clone() };
            driver.step_ordered(0.05, &pose, &Answer::default(), &town.graph, &orders).target_speed_mps
        };
        assert!(target_mps(None) > 8.0);
        // The car has not braked yet, so that a third of what is missing is asked for on top.
        let asked_mps2 = 4.0 * (1.0 + 0.05 / BRAKING_TIME_S);
        assert!((target_mps(Some(4.0)) - (8.0 - asked_mps2 * DRIVE_RESPONSE_S)).abs() < 1e-9);
    }

    #[test]
    fn it_waits_at_a_line_that_it_may_not_cross_and_nowhere_else() {
        let (town, driver, pose) = on_road();
        let standing = EgoPose { speed_mps: 0.0, ..pose };
        let waits = |pose: &EgoPose, stop: Option<f64>, is_granted: bool, braking_mps2: Option<f64>| {
            let mut driver = driver.clone();
            let stop = stop.map(|distance_m| Stop { gap: Gap::line(distance_m), is_light: true });
            let answer = Answer { stop, is_granted, ..Answer::default() };
            driver.step_ordered(0.05, pose, &answer, &town.graph, &EgoOrders { braking_mps2 });
            driver.waits_at_line()
        };
        for braking_mps2 in [None, Some(2.0)] {
            assert!(waits(&standing, Some(2.0), false, braking_mps2));
            assert!(!waits(&standing, Some(2.0), true, braking_mps2), "green");
            assert!(!waits(&standing, Some(9.0), false, braking_mps2), "before the line");
            assert!(!waits(&standing, None, false, braking_mps2));
            assert!(!waits(&pose, Some(2.0), false, braking_mps2), "it drives");
        }
    }

    #[test]
    fn a_free_drive_keeps_to_the_limit_and_ends_with_the_route() {
        let (town, driver, _) = on_road();
        let limit_mps = town.graph.lanes[driver.route.spans[0].lane].limit_mps;
        let way_m = driver.free_way_m(20_000, 0.05, &town.graph);
        let in_10_s = way_m[199];
        assert!(in_10_s > 30.0 && in_10_s < 10.0 * limit_mps, "{in_10_s}");
        assert!(way_m[19_999] < driver.route.path.length_m());
    }
}
