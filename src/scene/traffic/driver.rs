//! A driver on a route: speed by the intelligent driver model (Treiber et al. 2000), junctions by
//! reservation, round what stands in the way within the road if there is room, else it waits.

use rand::RngExt;

use super::junction::Junctions;
use crate::random::Rng;
use crate::scene::network::LaneGraph;
use crate::scene::occupancy::Footprint;
use crate::scene::path::Vec2;
use crate::scene::route::Route;

/// Comfortable acceleration and braking, m/s².
const ACCELERATION: f64 = 1.8;
const BRAKING: f64 = 2.5;
const HARDEST_BRAKING: f64 = 7.0;
/// Gap kept at standstill, and the time gap on the move.
const STANDSTILL_GAP_M: f64 = 2.5;
const TIME_GAP_S: f64 = 1.2;
/// Sideways acceleration that a curve may cost, m/s².
const CURVE_ACCELERATION: f64 = 2.2;
/// Room kept to the side of what is passed, metres.
const SIDE_ROOM_M: f64 = 0.35;
/// Offsets tried, in order: the lane's middle first, then a little to either side, then the other lane.
const OFFSETS_M: [f64; 8] = [0.0, 0.4, -0.4, 0.8, -0.8, 1.3, 2.0, 2.8];
/// Sideways speed while the offset changes.
const SIDE_SPEED_MPS: f64 = 0.9;
/// A jam is over, by another route, after this.
const JAM_S: f64 = 5.0;

/// Something that is in the way, or may be.
#[derive(Debug, Clone, Copy)]
pub struct Obstacle {
    pub footprint: Footprint,
    /// Along its heading.
    pub speed_mps: f64,
    /// Moves by itself.
    pub can_move: bool,
    /// A pedestrian on the road.
    pub is_crossing: bool,
}

impl Obstacle {
    pub fn still(footprint: Footprint) -> Self {
        Self { footprint, speed_mps: 0.0, can_move: false, is_crossing: false }
    }

    pub fn moving(footprint: Footprint, speed_mps: f64) -> Self {
        Self { footprint, speed_mps, can_move: true, is_crossing: false }
    }

    pub fn velocity(&self) -> Vec2 {
        Vec2::new(self.footprint.yaw_rad.cos(), self.footprint.yaw_rad.sin()) * self.speed_mps
    }
}

/// A car's driver, human or the ego's.
#[derive(Debug, Clone)]
pub struct Driver {
    route: Route,
    /// Of the car's middle.
    station_m: f64,
    offset_m: f64,
    speed_mps: f64,
    length_m: f64,
    width_m: f64,
    /// Length of the current standstill behind something.
    waited_s: f64,
}

impl Driver {
    pub fn new(route: Route, station_m: f64, length_m: f64, width_m: f64) -> Self {
        Self { route, station_m, offset_m: 0.0, speed_mps: 0.0, length_m, width_m, waited_s: 0.0 }
    }

    pub fn speed_mps(&self) -> f64 {
        self.speed_mps
    }

    pub fn footprint(&self) -> Footprint {
        self.footprint_at(self.station_m, self.offset_m)
    }

    fn footprint_at(&self, station_m: f64, offset_m: f64) -> Footprint {
        Footprint {
            center: self.route.path.beside(station_m, offset_m),
            yaw_rad: self.route.path.heading_rad(station_m),
            length_m: self.length_m,
            width_m: self.width_m,
        }
    }

    /// Takes over where the car really is.
    pub fn observe(&mut self, center: Vec2, speed_mps: f64) {
        let (from_m, to_m) = (self.station_m - 3.0, self.station_m + 3.0 + speed_mps.max(0.0));
        self.station_m = self.route.path.project(center, from_m, to_m).0;
        self.speed_mps = speed_mps;
    }

    /// The point to steer for.
    pub fn point_ahead(&self, distance_m: f64) -> Vec2 {
        self.route.path.beside(self.station_m + distance_m, self.offset_m)
    }

    /// The acceleration that driver and situation agree on; sets the offset too.
    pub fn decide(
        &mut self,
        me: usize,
        obstacles: &[Obstacle],
        graph: &LaneGraph,
        junctions: &mut Junctions,
        dt_s: f64,
        rng: &mut Rng,
    ) -> f64 {
        let reach_m = 10.0 + 3.5 * self.speed_mps.max(0.0);
        let here = self.route.path.at(self.station_m);
        let near: Vec<(usize, &Obstacle)> = obstacles
            .iter()
            .enumerate()
            .filter(|&(i, other)| {
                i != me
                    && (other.footprint.center - here).norm()
                        < reach_m + self.length_m + other.footprint.radius_m() + 4.0
            })
            .collect();
        self.choose_offset(&near, reach_m, dt_s);
        let mut acceleration = self.free_acceleration(graph);
        if let Some((gap_m, leader_mps)) = self.gap_ahead(&near, self.offset_m, reach_m, true) {
            acceleration = acceleration.min(self.follow(gap_m, leader_mps));
        }
        if let Some(gap_m) = self.gap_to_junction(me, graph, junctions) {
            acceleration = acceleration.min(self.follow(gap_m + STANDSTILL_GAP_M - 0.5, 0.0));
        }
        self.waited_s = if self.speed_mps < 0.3 && acceleration < 0.3 { self.waited_s + dt_s } else { 0.0 };
        if self.waited_s > JAM_S {
            self.waited_s = 0.0;
            self.route.turn_elsewhere(graph, self.station_m + self.length_m, rng);
        }
        acceleration.clamp(-HARDEST_BRAKING, ACCELERATION)
    }

    /// Moves by itself (not the ego, whom physics moves).
    pub fn advance(&mut self, acceleration: f64, dt_s: f64) {
        self.speed_mps = (self.speed_mps + acceleration * dt_s).max(0.0);
        self.station_m += self.speed_mps * dt_s;
    }

    /// Lengthens the route before it ends.
    pub fn keep_going(&mut self, graph: &LaneGraph, rng: &mut Rng) {
        if self.route.path.length_m() - self.station_m < 150.0 {
            self.route.go_on(graph, 200.0, rng);
        }
    }

    /// Towards the speed that limit and curves allow.
    fn free_acceleration(&self, graph: &LaneGraph) -> f64 {
        let mut wanted_mps = graph.lanes[self.route.span_at(self.station_m).lane].limit_mps;
        let reach_m = self.speed_mps * self.speed_mps / (2.0 * BRAKING) + 4.0;
        let mut ahead_m = 0.0;
        while ahead_m < reach_m {
            let station_m = self.station_m + ahead_m;
            let limit_mps = graph.lanes[self.route.span_at(station_m).lane].limit_mps;
            let curvature = self.route.path.curvature_per_m(station_m).abs().max(1e-4);
            let there_mps = (CURVE_ACCELERATION / curvature).sqrt().min(limit_mps);
            wanted_mps = wanted_mps.min((there_mps * there_mps + 2.0 * BRAKING * 0.7 * ahead_m).sqrt());
            ahead_m += 2.0;
        }
        let ratio = self.speed_mps / wanted_mps.max(0.5);
        (ACCELERATION * (1.0 - ratio.powi(4))).max(-BRAKING * 1.5)
    }

    /// The model's answer to something ahead.
    fn follow(&self, gap_m: f64, leader_mps: f64) -> f64 {
        let v = self.speed_mps.max(0.0);
        let closing = v * (v - leader_mps) / (2.0 * (ACCELERATION * BRAKING).sqrt());
        let wanted_gap_m = STANDSTILL_GAP_M + (v * TIME_GAP_S + closing).max(0.0);
        ACCELERATION * (1.0 - (wanted_gap_m / gap_m.max(0.3)).powi(2))
    }

    /// Free way to the nearest obstacle in the corridor at an offset, and the speed at which it leads.
    fn gap_ahead(
        &self,
        near: &[(usize, &Obstacle)],
        offset_m: f64,
        reach_m: f64,
        with_moving: bool,
    ) -> Option<(f64, f64)> {
        let path = &self.route.path;
        near.iter()
            .filter(|(_, other)| with_moving || !other.can_move)
            .filter_map(|(_, other)| {
                let margin_m = if other.is_crossing { 1.2 } else { SIDE_ROOM_M };
                let grown = Footprint { width_m: other.footprint.width_m, ..other.footprint };
                let mut ahead_m = 0.0;
                while ahead_m < reach_m {
                    let station_m = self.station_m + ahead_m;
                    let slice = Footprint {
                        center: path.beside(station_m, offset_m),
                        yaw_rad: path.heading_rad(station_m),
                        length_m: self.length_m,
                        width_m: self.width_m + 2.0 * margin_m,
                    };
                    if slice.meets(&grown) {
                        // What one already overlaps sideways only, and is not ahead, is no obstacle.
                        let direction = path.direction(self.station_m);
                        let is_ahead = direction.dot(&(grown.center - path.at(self.station_m))) > 0.0;
                        if ahead_m == 0.0 && !is_ahead {
                            return None;
                        }
                        let leader_mps = other.velocity().dot(&path.direction(station_m));
                        return Some((ahead_m, leader_mps.max(0.0)));
                    }
                    ahead_m += 0.5;
                }
                None
            })
            .min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Moves towards the first offset at which nothing still stands in the way and nobody comes.
    fn choose_offset(&mut self, near: &[(usize, &Obstacle)], reach_m: f64, dt_s: f64) {
        let reach_m = reach_m.max(16.0);
        let is_free = |offset_m: f64| {
            self.gap_ahead(near, offset_m, reach_m, false).is_none()
                && (offset_m.abs() < 1.0 || self.gap_ahead(near, offset_m, reach_m * 1.8, true).is_none())
        };
        let in_junction_m = self.route.path.curvature_per_m(self.station_m + 4.0).abs();
        let wanted_m = if in_junction_m > 0.03 {
            0.0
        } else {
            OFFSETS_M.into_iter().find(|&offset_m| is_free(offset_m)).unwrap_or(self.offset_m)
        };
        // Sideways only on the move.
        let step_m = SIDE_SPEED_MPS.min(self.speed_mps * 0.3 + 0.15) * dt_s;
        self.offset_m += (wanted_m - self.offset_m).clamp(-step_m, step_m);
    }

    /// Free way to the line of the next junction that is not one's turn to cross.
    fn gap_to_junction(&self, me: usize, graph: &LaneGraph, junctions: &mut Junctions) -> Option<f64> {
        let (front_m, rear_m) = (self.station_m + self.length_m / 2.0, self.station_m - self.length_m / 2.0);
        let asking_m = front_m + 6.0 + self.speed_mps.powi(2) / (2.0 * BRAKING);
        let mut needed = Vec::new();
        let mut stop_at_m = None;
        for span in self.route.spans_from(rear_m) {
            if span.start_m > asking_m {
                break;
            }
            if graph.lanes[span.lane].junction.is_none() {
                continue;
            }
            let is_inside = front_m > span.start_m;
            if is_inside || junctions.take(graph, span.lane, me) {
                needed.push(span.lane);
            } else {
                stop_at_m = Some(span.start_m);
                break;
            }
        }
        junctions.keep_only(me, &needed);
        stop_at_m.map(|line_m| line_m - front_m)
    }
}

impl Route {
    /// Random turns from the end on, for at least `by_m` more.
    pub fn go_on(&mut self, graph: &LaneGraph, by_m: f64, rng: &mut Rng) {
        let wanted_m = self.path.length_m() + by_m;
        while self.path.length_m() < wanted_m {
            let last = self.spans[self.spans.len() - 1].lane;
            let successors = &graph.lanes[last].successors;
            if successors.is_empty() {
                return;
            }
            self.push(graph, successors[rng.random_range(0..successors.len())]);
        }
    }
}
