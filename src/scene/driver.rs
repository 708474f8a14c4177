//! One driver other than the ego: keeps to its route, follows, passes, waits, backs up.
//!
//! Kinematic: the body stays on the route's line, plus an offset to the left, and never enters ground
//! that is taken.

use super::driving::{self, Gap, Obstacle, Owner};
use super::lane_change::Mover;
use super::network::LaneGraph;
use super::occupancy::Footprint;
use super::path::direction_of;
use super::route::Route;
use super::swerve::Swerve;
use super::town::Town;
use crate::geometry::convex_overlap_area;
use crate::random::Rng;

/// Distance to the car ahead when standing.
const STANDSTILL_M: f64 = 0.9;
/// Standing this long before something still, a driver passes it at a walk, if it can, for so long.
const CREEP_S: f64 = 1.0;
const CREEPING_S: f64 = 5.0;
const CREEP_MPS: f64 = 1.0;
/// Who touches something may slide along it or away, but not onto it: more ground shared than this in one step.
const SLID_ALONG_M2: f64 = 1e-6;
/// Standing this long with no way on, a driver backs up.
const BACK_UP_S: f64 = 6.0;
/// The same right before something still, for which nobody waits; then it takes any way round for so long.
const STUCK_S: f64 = 2.0;
const BOLD_S: f64 = 8.0;
/// A driver backs up for this long when someone this near ahead wants to back up.
const ROOM_TO_BACK_M: f64 = 4.0;
const MAKES_ROOM_S: f64 = 0.5;
/// Time from the end of one change of lanes to the next.
const CHANGED_S: f64 = 5.0;

#[derive(Debug, Clone)]
pub struct Driver {
    pub placement: usize,
    pub route: Route,
    /// Station of the footprint's centre.
    pub station_m: f64,
    /// Offset of the centre to the left of the route, now and as planned.
    pub left_m: f64,
    left_wanted_m: f64,
    /// Change of the offset per metre of the way.
    slope: f64,
    pub speed_mps: f64,
    pub length_m: f64,
    pub width_m: f64,
    /// Share of the limit that this driver likes.
    eagerness: f64,
    pub waited_s: f64,
    /// Seconds for which it still backs up.
    backing_s: f64,
    /// Seconds for which it still drives on at a walk.
    creeping_s: f64,
    /// Seconds for which it still takes nearly any way round.
    bold_s: f64,
    /// Seconds until it may change lanes again; above [`CHANGED_S`] it is changing now.
    change_s: f64,
}

impl Driver {
    /// A driver at its start.
    pub fn new(placement: usize, route: Route, station_m: f64, body: &Footprint, eagerness: f64) -> Self {
        Self {
            placement,
            route,
            station_m,
            left_m: 0.0,
            left_wanted_m: 0.0,
            slope: 0.0,
            speed_mps: 3.0,
            length_m: body.length_m,
            width_m: body.width_m,
            eagerness,
            waited_s: 0.0,
            backing_s: 0.0,
            creeping_s: 0.0,
            bold_s: 0.0,
            change_s: 0.0,
        }
    }

    /// Continues elsewhere, in the middle of a lane.
    pub fn restart(&mut self, route: Route, station_m: f64) {
        (self.route, self.station_m) = (route, station_m);
        (self.left_m, self.left_wanted_m, self.slope) = (0.0, 0.0, 0.0);
        (self.waited_s, self.backing_s, self.change_s) = (0.0, 0.0, 0.0);
        (self.creeping_s, self.bold_s) = (0.0, 0.0);
    }

    /// Whether it stands at the end of its way.
    pub fn has_arrived(&self) -> bool {
        self.speed_mps < 0.3 && self.route.path.length_m() - self.front_m() < 6.0
    }

    pub fn front_m(&self) -> f64 {
        self.station_m + self.length_m / 2.0
    }

    pub fn rear_m(&self) -> f64 {
        self.station_m - self.length_m / 2.0
    }

    /// Heading of the chord between the axles.
    pub fn yaw_rad(&self) -> f64 {
        let half_m = 0.32 * self.length_m;
        let chord = self.route.path.at(self.station_m + half_m) - self.route.path.at(self.station_m - half_m);
        chord.y.atan2(chord.x) + self.slope.atan()
    }

    pub fn obstacle(&self) -> Obstacle {
        let yaw_rad = self.yaw_rad();
        Obstacle {
            owner: Owner::Placement(self.placement),
            footprint: Footprint {
                center: self.route.path.beside(self.station_m, self.left_m),
                yaw_rad,
                length_m: self.length_m,
                width_m: self.width_m,
            },
            velocity_mps: direction_of(yaw_rad) * self.speed_mps,
            is_still: false,
            is_vehicle: true,
            backs_up: self.backing_s > 0.0,
        }
    }

    /// Moves on by one step; `line` is where to stop for a junction or a light.
    pub fn step(&mut self, dt_s: f64, line: Option<Gap>, town: &Town, obstacles: &[Obstacle], rng: &mut Rng) {
        let graph = &town.graph;
        let driver = self;
        let before = driver.obstacle();
        let others: Vec<Obstacle> = obstacles
            .iter()
            .filter(|other| other.owner != before.owner)
            .filter(|other| (other.footprint.center - before.footprint.center).norm() < 60.0)
            .copied()
            .collect();
        if driver.left_m.abs() < 0.5 && driver.change_s > CHANGED_S {
            driver.change_s = CHANGED_S;
        }
        driver.change_s -= dt_s;
        driver.consider_change(graph, &others, rng);
        let is_changing = driver.change_s > CHANGED_S;
        let path = &driver.route.path;
        let front_m = driver.front_m();
        let limit_mps = graph.lanes[driver.route.span_at(front_m).lane].limit_mps * driver.eagerness;
        let mut desired_mps = driving::bend_speed_mps(path, driver.station_m, limit_mps);
        let swerve = Swerve {
            path,
            front_m,
            now_m: driver.left_m + driver.slope * driver.length_m / 2.0,
            half_width_m: driver.width_m / 2.0,
            length_m: driver.length_m,
            speed_mps: driver.speed_mps,
            is_bold: driver.waited_s > 6.0 || driver.bold_s > 0.0,
            mirror: -graph.kerb_sign(),
            is_near_junction: graph.lanes[driver.route.span_at(front_m + 4.0).lane].junction.is_some(),
        };
        let left_wanted_m = swerve.best_offset(driver.left_wanted_m, &town.surface.road_grid, &others);
        let reach_m = 10.0 + 2.5 * driver.speed_mps;
        let (gap, is_narrow) = swerve.gap_or_narrow(left_wanted_m, reach_m, &others);
        if !is_changing && (left_wanted_m.abs() > 0.7 || driver.left_m.abs() > 0.7) {
            desired_mps = desired_mps.min(5.0);
        }
        let to_end_m = path.length_m() - front_m;
        let end = (to_end_m < 25.0).then(|| Gap::line(to_end_m));
        let free = driving::acceleration_mps2(driver.speed_mps, desired_mps, None, STANDSTILL_M);
        let (mut acceleration, mut room_m) = (free, f64::INFINITY);
        driver.creeping_s -= dt_s;
        driver.bold_s -= dt_s;
        if driver.waited_s > CREEP_S && gap.is_some_and(|gap| gap.is_still) {
            driver.creeping_s = CREEPING_S;
        }
        let creeping = driving::acceleration_mps2(driver.speed_mps, CREEP_MPS, None, STANDSTILL_M);
        for stop in [gap, line, end].into_iter().flatten() {
            // Room to drive round what stands.
            let standstill_m = if stop.is_still { 4.5 } else { STANDSTILL_M };
            let asked = driving::acceleration_mps2(driver.speed_mps, desired_mps, Some(stop), standstill_m);
            if stop.is_still && (is_narrow || driver.creeping_s > 0.0) {
                // A way planned too close may still be driven at walking speed; the last check guards it.
                acceleration = acceleration.min(asked.max(creeping));
                continue;
            }
            acceleration = acceleration.min(asked);
            room_m = room_m.min(stop.distance_m - 0.1);
        }
        let moved_m = {
            let wanted_mps = (driver.speed_mps + acceleration * dt_s).max(0.0);
            driver.left_wanted_m = left_wanted_m;
            driver.speed_mps = wanted_mps.min((room_m / dt_s).max(0.0));
            driver.speed_mps * dt_s
        };
        // Who is before someone that backs up makes room.
        let backing = others.iter().filter(|other| other.backs_up);
        let way = (front_m, ROOM_TO_BACK_M);
        if driving::gap_ahead(path, way, driver.width_m / 2.0, |_| driver.left_m, backing).is_some() {
            driver.backing_s = driver.backing_s.max(MAKES_ROOM_S);
        }
        let saved = (driver.station_m, driver.left_m, driver.slope);
        // Sideways 1.5 m/s and 2.5 m/s2 at most.
        let speed_mps = driver.speed_mps.max(0.1);
        let steepest = (1.5 / speed_mps).min(0.4);
        let sharpest_per_m = (2.5 / (speed_mps * speed_mps)).min(0.12);
        let aim = ((left_wanted_m - driver.left_m) * 0.35).clamp(-steepest, steepest);
        let moved_m = if driver.backing_s > 0.0 { -CREEP_MPS * dt_s } else { moved_m };
        driver.backing_s -= dt_s;
        driver.slope +=
            (aim - driver.slope).clamp(-sharpest_per_m * moved_m.abs(), sharpest_per_m * moved_m.abs());
        driver.left_m += driver.slope * moved_m;
        driver.station_m += moved_m;
        // Whatever was planned: nobody moves onto taken ground, nor farther onto it.
        let [was, after] = [before.footprint, driver.obstacle().footprint].map(|body| body.grow(0.03));
        let hits = |other: &Obstacle| {
            let shared_m2 =
                |body: &Footprint| convex_overlap_area(&body.corners(), &other.footprint.corners());
            after.meets(&other.footprint) && shared_m2(&after) > shared_m2(&was) + SLID_ALONG_M2
        };
        if let Some(hit) = others.iter().find(|other| hits(other)) {
            (driver.station_m, driver.left_m, driver.slope) = saved;
            driver.speed_mps = 0.0;
            let patience_s = if hit.is_still { STUCK_S } else { BACK_UP_S };
            if driver.waited_s > patience_s && driver.backing_s < -BACK_UP_S {
                driver.backing_s = 2.5;
                driver.bold_s = if hit.is_still { BOLD_S } else { 0.0 };
            }
        }
        let stands = driver.speed_mps < 0.3 || (driver.station_m - saved.0).abs() < 1e-9;
        driver.waited_s = if stands || driver.backing_s > 0.0 { driver.waited_s + dt_s } else { 0.0 };
    }

    /// Moves over to a neighbouring lane where that helps: it takes a route there, and is then
    /// beside that route.
    fn consider_change(&mut self, graph: &LaneGraph, others: &[Obstacle], rng: &mut Rng) {
        if self.change_s > 0.0 || self.speed_mps < 1.0 || self.backing_s > 0.0 || self.left_m.abs() > 0.5 {
            return;
        }
        let mover = Mover {
            route: &self.route,
            station_m: self.station_m,
            length_m: self.length_m,
            speed_mps: self.speed_mps,
            wish_mps: graph.lanes[self.route.span_at(self.front_m()).lane].limit_mps * self.eagerness,
        };
        let Some(change) = mover.change(graph, others, rng) else { return };
        (self.route, self.station_m) = (change.route, change.station_m);
        self.left_m = change.left_m;
        self.left_wanted_m = 0.0;
        self.change_s = CHANGED_S + 12.0;
    }
}

#[cfg(test)]
mod tests {
    use super::super::path::Vec2;
    use super::*;
    use crate::random;

    /// A driver in the middle of a long lane of downtown, and a thing on the ground beside it.
    fn beside_thing(apart_m: f64) -> (Town, Driver, Obstacle) {
        let town = Town::load("downtown").unwrap();
        let mut rng = random::stream(1, "driver-test", 0);
        let is_long = |lane: &usize| {
            let lane = &town.graph.lanes[*lane];
            lane.junction.is_none() && lane.path.length_m() > 60.0
        };
        let lane = (0..town.graph.lanes.len()).find(is_long).unwrap();
        let route = Route::random(&town.graph, lane, 100.0, &mut rng);
        let body = Footprint { center: route.path.at(30.0), yaw_rad: 0.0, length_m: 4.5, width_m: 1.8 };
        let driver = Driver { speed_mps: 0.0, ..Driver::new(0, route, 30.0, &body, 1.0) };
        let body = driver.obstacle().footprint;
        let thing = Footprint { length_m: 0.6, width_m: 0.6, ..body };
        let footprint = Footprint { center: body.at(0.0, 0.9 + 0.3 + apart_m), ..thing };
        let thing = Obstacle {
            owner: Owner::Placement(1),
            footprint,
            velocity_mps: Vec2::zeros(),
            is_still: true,
            is_vehicle: false,
            backs_up: false,
        };
        (town, driver, thing)
    }

    #[test]
    fn who_stands_beside_a_thing_drives_off_whether_it_touches_or_nearly_does() {
        for apart_m in [-0.02, 0.0, 0.02, 0.2] {
            let (town, mut driver, thing) = beside_thing(apart_m);
            let mut rng = random::stream(2, "driver-test", 0);
            for _ in 0..100 {
                driver.step(0.05, None, &town, &[thing], &mut rng);
            }
            assert!(driver.station_m > 33.0, "{apart_m} m apart: {} m", driver.station_m - 30.0);
        }
    }

    #[test]
    fn a_driver_that_crept_does_not_stop_dead_before_the_next_thing() {
        let (town, driver, thing) = beside_thing(0.5);
        // Before it at driving speed, right in its lane.
        let mut driver = Driver { speed_mps: 4.5, creeping_s: 3.0, ..driver };
        let center = driver.route.path.at(driver.front_m() + 12.0);
        let footprint = Footprint { center, length_m: 1.0, width_m: 8.0, ..thing.footprint };
        let mut rng = random::stream(2, "driver-test", 0);
        let mut before_mps = driver.speed_mps;
        for _ in 0..20 {
            driver.step(0.05, None, &town, &[Obstacle { footprint, ..thing }], &mut rng);
            let braking_mps2 = (before_mps - driver.speed_mps) / 0.05;
            assert!(braking_mps2 < 8.0 + 1e-9, "{braking_mps2} m/s2 from {before_mps} m/s");
            before_mps = driver.speed_mps;
        }
        assert!(driver.speed_mps < 3.0, "{}", driver.speed_mps);
    }
}
