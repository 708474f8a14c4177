//! Junctions by reservation: decides who may drive in, so that crossing paths are never driven at once.
//!
//! Lights come first, then right of way: a driver who yields waits for those of higher rank who arrive soon.
//! Among equals, the one who asks first drives first.

use super::driving::{self, Gap, Obstacle, Owner};
use super::lights::{Aspect, Clock, Lights};
use super::network::{LaneGraph, Rank};
use super::route::{Route, Span};

/// A driver who stands this long before a junction gives the reservation back.
const GIVE_WAY_S: f64 = 3.0;
/// Braking that a yellow light may ask for.
const YELLOW_BRAKING_MPS2: f64 = 3.0;
/// A driver who yields leaves this much time to those with priority.
const YIELD_S: f64 = 4.0;
/// Lights up to this far ahead explain a standing queue.
const QUEUE_M: f64 = 70.0;

/// Lanes of junctions that are taken, and by which driver.
#[derive(Debug, Clone, Default)]
pub struct Reservations {
    held: Vec<(usize, usize)>,
}

/// The next junction on a route.
#[derive(Debug, Clone)]
pub struct Crossing {
    pub lanes: Vec<usize>,
    pub entry_m: f64,
    pub exit_m: f64,
}

/// The first junction that a rear at `rear_m` has not left yet.
pub fn next_crossing(graph: &LaneGraph, route: &Route, rear_m: f64) -> Option<Crossing> {
    let junction_of = |span: &Span| graph.lanes[span.lane].junction;
    let mut spans = route.spans_from(rear_m).skip_while(|span| junction_of(span).is_none()).peekable();
    let first = *spans.peek()?;
    let run: Vec<&Span> = spans.take_while(|span| junction_of(span) == junction_of(first)).collect();
    Some(Crossing {
        lanes: run.iter().map(|span| span.lane).collect(),
        entry_m: first.start_m,
        exit_m: run[run.len() - 1].end_m,
    })
}

impl Reservations {
    /// Frees the lanes that a driver holds and no longer needs.
    pub fn keep_only(&mut self, driver: usize, lanes: &[usize]) {
        self.held.retain(|(holder, lane)| *holder != driver || lanes.contains(lane));
    }

    pub fn holds(&self, driver: usize, lanes: &[usize]) -> bool {
        lanes.iter().all(|lane| self.held.contains(&(driver, *lane)))
    }

    /// Takes the lanes if nobody else holds one that conflicts.
    pub fn try_take(&mut self, graph: &LaneGraph, driver: usize, lanes: &[usize]) -> bool {
        let is_blocked = self.held.iter().any(|(holder, held)| {
            *holder != driver && lanes.iter().any(|&lane| graph.lanes[lane].conflicts.contains(held))
        });
        if !is_blocked {
            self.take(driver, lanes);
        }
        !is_blocked
    }

    /// Takes the lanes for one who is already inside.
    pub fn take(&mut self, driver: usize, lanes: &[usize]) {
        for &lane in lanes {
            if !self.held.contains(&(driver, lane)) {
                self.held.push((driver, lane));
            }
        }
    }
}

/// What every driver at a junction takes into account.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    pub graph: &'a LaneGraph,
    pub lights: &'a Lights,
    pub clock: &'a Clock,
    pub moving: &'a [Obstacle],
    pub approaches: &'a [Approach],
}

/// A driver who comes to a junction and might have priority.
#[derive(Debug, Clone)]
pub struct Approach {
    driver: usize,
    lanes: Vec<usize>,
    rank: Rank,
    in_s: f64,
}

/// The distance at which a driver has to stop, and why.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stop {
    pub gap: Gap,
    pub is_light: bool,
}

/// A junction's answer.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Answer {
    pub stop: Option<Stop>,
    /// Whether the way through has just been granted.
    pub is_granted: bool,
    /// Whether a light that is not green lies ahead: then standing is not a jam.
    pub is_queue: bool,
}

/// A driver who comes to a junction.
#[derive(Debug, Clone, Copy)]
pub struct Asker<'a> {
    pub driver: usize,
    pub owner: Owner,
    pub route: &'a Route,
    pub rear_m: f64,
    pub front_m: f64,
    pub speed_mps: f64,
    pub length_m: f64,
    pub waited_s: f64,
    /// Whether it sees the vehicles before it and beyond the junction; a driver under test knows of none that no detector showed it.
    pub sees_vehicles: bool,
}

impl Asker<'_> {
    /// When and with what right this driver comes to its next junction; `None` if it will stop before.
    pub fn approach(&self, graph: &LaneGraph, lights: &Lights, clock: &Clock) -> Option<Approach> {
        let crossing = next_crossing(graph, self.route, self.rear_m)?;
        let to_entry_m = crossing.entry_m - self.front_m;
        let is_stopped = self.light(lights, clock, to_entry_m.max(0.0) + 1.0).is_some();
        if is_stopped || to_entry_m > 60.0 || (to_entry_m > 0.0 && self.speed_mps < 1.0) {
            return None;
        }
        let rank = crossing.lanes.iter().map(|&lane| graph.lanes[lane].rank).min().unwrap_or_default();
        let in_s = to_entry_m.max(0.0) / self.speed_mps.max(1.0);
        Some(Approach { driver: self.driver, lanes: crossing.lanes, rank, in_s })
    }

    /// Distance to the first light ahead that has to be stopped for.
    fn light(&self, lights: &Lights, clock: &Clock, reach_m: f64) -> Option<f64> {
        self.lights_ahead(lights, reach_m).find_map(|(to_line_m, light)| {
            let braking_m = self.speed_mps * self.speed_mps / (2.0 * YELLOW_BRAKING_MPS2);
            let must_stop = match clock.aspect(lights, light) {
                Aspect::Green => false,
                Aspect::Yellow => to_line_m > braking_m,
                // A driver who could not stop in time has driven on at yellow, and drives on.
                Aspect::Red => to_line_m > 0.5 * braking_m,
            };
            must_stop.then_some(to_line_m)
        })
    }

    /// Distance to stop lines ahead, with their lights.
    fn lights_ahead<'b>(
        &self,
        lights: &'b Lights,
        reach_m: f64,
    ) -> impl Iterator<Item = (f64, usize)> + use<'_, 'b> {
        let (front_m, until_m) = (self.front_m, self.front_m + reach_m);
        self.route.spans_from(front_m - 1.0).take_while(move |span| span.start_m < until_m).flat_map(
            move |span| {
                let lines = lights.on_lane(span.lane).iter();
                let to_line =
                    move |&(station_m, light): &(f64, usize)| (span.start_m + station_m - front_m, light);
                lines.map(to_line).filter(move |(to_line_m, _)| (-0.5..reach_m).contains(to_line_m))
            },
        )
    }

    /// Asks for the way through the next junction.
    pub fn ask(&self, view: &View<'_>, reservations: &mut Reservations) -> Answer {
        let braking_m = self.speed_mps * self.speed_mps / 5.0 + 10.0;
        let line = |to_line_m: f64| Gap::line((to_line_m - 0.3).max(0.05));
        let is_queue = self
            .lights_ahead(view.lights, QUEUE_M)
            .any(|(_, light)| view.clock.aspect(view.lights, light) != Aspect::Green);
        let red = self.light(view.lights, view.clock, braking_m + 10.0);
        let stop = red.map(|to_line_m| Stop { gap: line(to_line_m), is_light: true });
        let waits = Answer { stop, is_granted: false, is_queue };
        let Some(crossing) = next_crossing(view.graph, self.route, self.rear_m) else {
            reservations.keep_only(self.driver, &[]);
            return waits;
        };
        reservations.keep_only(self.driver, &crossing.lanes);
        let to_entry_m = crossing.entry_m - self.front_m;
        if to_entry_m < -0.5 {
            reservations.take(self.driver, &crossing.lanes);
        } else if red.is_some() {
            reservations.keep_only(self.driver, &[]);
            return waits;
        }
        let refused = Answer { stop: Some(Stop { gap: line(to_entry_m), is_light: false }), ..waits };
        // A driver who stands before the junction gives way, or all might wait for each other.
        let gives_way = to_entry_m > 0.0 && self.waited_s > GIVE_WAY_S;
        if reservations.holds(self.driver, &crossing.lanes) {
            if !gives_way {
                return waits;
            }
            reservations.keep_only(self.driver, &[]);
            // What a driver under test stands for is no line.
            return if self.sees_vehicles { refused } else { waits };
        }
        if to_entry_m > braking_m {
            return waits;
        }
        let has_room = !self.sees_vehicles || self.has_room(view, &crossing, to_entry_m);
        let may_go = has_room && !self.must_yield(view, &crossing.lanes);
        if may_go && reservations.try_take(view.graph, self.driver, &crossing.lanes) {
            return Answer { is_granted: true, ..waits };
        }
        refused
    }

    /// Whether it is the first in its lane and can leave the junction again.
    fn has_room(&self, view: &View<'_>, crossing: &Crossing, to_entry_m: f64) -> bool {
        let others = view.moving.iter().filter(|other| other.owner != self.owner && other.is_vehicle);
        // Only the first in the lane asks: a driver behind could not use the grant.
        let way = (self.front_m, to_entry_m.max(0.0));
        let is_first = driving::gap_ahead(&self.route.path, way, 0.8, |_| 0.0, others.clone()).is_none();
        // A driver who cannot leave a junction must not enter it.
        let standing = others.filter(|other| other.velocity_mps.norm() < 1.0);
        let room = (crossing.exit_m, self.length_m + 2.0);
        is_first && driving::gap_ahead(&self.route.path, room, 0.8, |_| 0.0, standing).is_none()
    }

    /// Whether someone of higher rank comes soon, on a way that crosses this one.
    fn must_yield(&self, view: &View<'_>, lanes: &[usize]) -> bool {
        let rank = lanes.iter().map(|&lane| view.graph.lanes[lane].rank).min().unwrap_or_default();
        if rank == Rank::Stops && self.speed_mps > 0.3 {
            return true;
        }
        view.approaches.iter().any(|other| {
            let crosses = || {
                let conflicts =
                    |lane: &usize| lanes.iter().any(|&own| view.graph.lanes[own].conflicts.contains(lane));
                other.lanes.iter().any(conflicts)
            };
            other.driver != self.driver && other.rank > rank && other.in_s < YIELD_S && crosses()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::network::GraphLane;
    use super::super::occupancy::Footprint;
    use super::super::path::{Path, Vec2};
    use super::*;

    /// A way from the west through a junction, crossed by one from the south.
    fn crossroads(rank: Rank) -> (LaneGraph, Route, Route) {
        let lane = |points: [(f64, f64); 2], successors: Vec<usize>, junction: Option<usize>| GraphLane {
            successors,
            junction,
            ..GraphLane::new(Path::new(points.map(|(x, y)| Vec2::new(x, y))).unwrap())
        };
        let mut lanes = vec![
            lane([(-50.0, 0.0), (-8.0, 0.0)], vec![1], None),
            lane([(-8.0, 0.0), (8.0, 0.0)], vec![2], Some(0)),
            lane([(8.0, 0.0), (50.0, 0.0)], vec![], None),
            lane([(0.0, -50.0), (0.0, -8.0)], vec![4], None),
            lane([(0.0, -8.0), (0.0, 8.0)], vec![5], Some(0)),
            lane([(0.0, 8.0), (0.0, 50.0)], vec![], None),
        ];
        lanes[1].rank = rank;
        lanes[4].rank = Rank::HasPriority;
        lanes[1].conflicts = vec![4];
        lanes[4].conflicts = vec![1];
        let graph = LaneGraph { lanes, ..LaneGraph::default() };
        let mut rng = crate::random::stream(0, "test", 0);
        let (west, south) =
            (Route::random(&graph, 0, 200.0, &mut rng), Route::random(&graph, 3, 200.0, &mut rng));
        (graph, west, south)
    }

    fn asker(route: &Route, driver: usize, front_m: f64, speed_mps: f64) -> Asker<'_> {
        let owner = Owner::Placement(driver);
        Asker {
            driver,
            owner,
            route,
            rear_m: front_m - 4.0,
            front_m,
            speed_mps,
            length_m: 4.0,
            waited_s: 0.0,
            sees_vehicles: true,
        }
    }

    fn answer(rank: Rank, speed_mps: f64, other_front_m: f64) -> Answer {
        let (graph, west, south) = crossroads(rank);
        let (lights, clock) = (Lights::default(), Clock::default());
        let approaches: Vec<Approach> =
            asker(&south, 1, other_front_m, 10.0).approach(&graph, &lights, &clock).into_iter().collect();
        let view =
            View { graph: &graph, lights: &lights, clock: &clock, moving: &[], approaches: &approaches };
        asker(&west, 0, 40.0, speed_mps).ask(&view, &mut Reservations::default())
    }

    #[test]
    fn who_yields_waits_for_priority_that_comes_soon_and_not_for_one_far_off() {
        assert!(answer(Rank::Yields, 3.0, 30.0).stop.is_some());
        assert!(answer(Rank::Yields, 3.0, -5.0).is_granted, "47 m away at 10 m/s");
        assert!(answer(Rank::HasPriority, 3.0, 30.0).is_granted, "equals: first come, first served");
    }

    #[test]
    fn who_sees_no_vehicles_is_not_held_by_one_before_it_nor_by_one_beyond_the_junction() {
        let (graph, west, _) = crossroads(Rank::HasPriority);
        let (lights, clock) = (Lights::default(), Clock::default());
        let stands_at = |x_m: f64| Obstacle {
            owner: Owner::Placement(7),
            footprint: Footprint { center: Vec2::new(x_m, 0.0), yaw_rad: 0.0, length_m: 4.0, width_m: 2.0 },
            velocity_mps: Vec2::zeros(),
            is_still: false,
            is_vehicle: true,
            backs_up: false,
        };
        // Its bumper is 2 m before the junction, which begins 8 m before the middle.
        for x_m in [-8.0, 10.5] {
            let moving = [stands_at(x_m)];
            let view =
                View { graph: &graph, lights: &lights, clock: &clock, moving: &moving, approaches: &[] };
            let answer = |sees_vehicles: bool| {
                let asker = Asker { sees_vehicles, ..asker(&west, 0, 40.0, 3.0) };
                asker.ask(&view, &mut Reservations::default())
            };
            assert!(answer(true).stop.is_some(), "{x_m}");
            assert!(answer(false).is_granted && answer(false).stop.is_none(), "{x_m}");
        }
    }

    #[test]
    fn who_stands_before_a_junction_for_what_it_sees_gives_its_reservation_back() {
        let (graph, west, _) = crossroads(Rank::HasPriority);
        let (lights, clock) = (Lights::default(), Clock::default());
        let view = View { graph: &graph, lights: &lights, clock: &clock, moving: &[], approaches: &[] };
        let mut reservations = Reservations::default();
        let mut ask = |waited_s: f64| {
            let asker = Asker { waited_s, sees_vehicles: false, ..asker(&west, 0, 40.0, 0.0) };
            let answer = asker.ask(&view, &mut reservations);
            (answer, reservations.holds(0, &[1]))
        };
        assert!(ask(0.0).1 && ask(GIVE_WAY_S - 0.1).1);
        // It is told of no line, for it stands at none.
        let (answer, holds) = ask(GIVE_WAY_S + 0.1);
        assert!(!holds && answer.stop.is_none() && !answer.is_granted);
        assert!(ask(0.0).0.is_granted, "nobody else has taken it");
    }

    #[test]
    fn at_a_stop_sign_one_stops_even_when_alone() {
        assert!(answer(Rank::Stops, 3.0, -100.0).stop.is_some());
        assert!(answer(Rank::Stops, 0.0, -100.0).is_granted);
    }
}
