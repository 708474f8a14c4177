//! The ego's driver: pure pursuit on its route, IDM for what is ahead, a way round what stands.
//!
//! Pure pursuit (Coulter, 1992): `steering = atan(2 wheelbase sin(alpha) / lookahead)` towards the
//! point on the path `lookahead` ahead of the rear axle.

mod ordered;

use std::collections::BTreeMap;

pub use ordered::EgoOrders;

use super::car::{
    DRIVE_RESPONSE_S, EGO_LENGTH_M, EGO_WIDTH_M, EgoCommand, FRONT_BUMPER_X_M, MAX_STEERING_RAD, WHEELBASE_M,
};
use super::driving::{self, Gap, Obstacle, Owner};
use super::ego_pose::EgoPose;
use super::ego_room::{dodge, first_hit, is_free_behind, pushes, touches};
use super::junctions::Answer;
use super::lane_change::Mover;
use super::network::LaneGraph;
use super::path::turn_between;
use super::route::Route;
use super::surface::Surface;
use super::swerve::Swerve;
use crate::random::Rng;

/// Fastest turn of the road wheels.
const STEERING_RATE_RPS: f64 = 0.9;
/// Standing this long without a junction as the reason is a jam.
const JAM_S: f64 = 5.0;
/// Nobody waits long for a thing this near to move: patience runs out so much faster.
const THING_M: f64 = 8.0;
const HASTE: f64 = 5.0;
/// After standing this long before a thing it drives on at a walk, if a way round is planned.
const CREEP_S: f64 = 0.4;
const CREEPING_S: f64 = 4.0;
const CREEP_MPS: f64 = 1.0;
/// It backs up for this long; time in which someone behind hinders it counts half.
const BACKING_S: f64 = 3.0;
/// Slower than this it looks for a steering angle that leads past what stands.
const DODGING_MPS: f64 = 2.0;
/// A planned offset from where it is now that counts as a way round, metres.
const ROUND_M: f64 = 0.2;
/// After waiting this long at a junction the driver turns elsewhere.
const PATIENCE_S: f64 = 9.0;
/// A driver who stands this close to the end of the route has arrived, and waits.
const END_M: f64 = 8.0;
/// What is noticed late is noticed at this distance beyond the way to a stop.
const NOTICED_M: f64 = 9.0;
const GRAVITY_MPS2: f64 = 9.81;
/// Drag is learnt over this time, up to a bound, while the demanded acceleration is small.
const DRAG_TIME_S: f64 = 2.0;
const MAX_DRAG_MPS2: f64 = 0.8;
const MAX_LEARNT_MPS2: f64 = 2.0;
/// Slower than this it stands.
const MOVES_MPS: f64 = 0.3;
/// Sideways speed of a change of lanes.
const SIDEWAYS_MPS: f64 = 1.3;
/// Time from one change of lanes to the next.
const CHANGED_S: f64 = 5.0;

/// The driver's memory.
#[derive(Debug, Clone)]
pub struct EgoDriver {
    pub route: Route,
    /// Station of the rear axle.
    pub station_m: f64,
    /// Offset to the left of the route that the driver steers to.
    left_m: f64,
    steering_rad: f64,
    jam_s: f64,
    held_s: f64,
    /// Seconds for which it still backs up.
    backing_s: f64,
    /// Seconds for which it still drives on at a walk, past what is too near for a planned way.
    creeping_s: f64,
    /// Whether the last check stopped it before something that stands, or something that stands touches it.
    is_stopped_short: bool,
    /// Seconds for which it still takes any way round.
    bold_s: f64,
    /// Whether it moves over to another lane, the offset that it steers at meanwhile, and the time
    /// until the next change.
    is_changing: bool,
    glide_m: f64,
    change_s: f64,
    /// The last demanded acceleration, the speed then, and the drag learnt from the outcome.
    asked_mps2: f64,
    speed_before_mps: f64,
    drag_mps2: f64,
    /// Braking that the driver under test asks of the wheels beyond what is ordered, so that the car does what is ordered.
    more_braking_mps2: f64,
    /// Placements that are not noticed yet, and the braking that stopping before them takes when they are, m/s².
    unnoticed: BTreeMap<usize, f64>,
    rng: Rng,
}

impl EgoDriver {
    pub fn new(route: Route, station_m: f64, unnoticed: BTreeMap<usize, f64>, rng: Rng) -> Self {
        Self {
            route,
            station_m,
            left_m: 0.0,
            steering_rad: 0.0,
            jam_s: 0.0,
            held_s: 0.0,
            backing_s: 0.0,
            creeping_s: 0.0,
            is_stopped_short: false,
            bold_s: 0.0,
            is_changing: false,
            glide_m: 0.0,
            change_s: 0.0,
            asked_mps2: 0.0,
            speed_before_mps: 0.0,
            drag_mps2: 0.0,
            more_braking_mps2: 0.0,
            unnoticed,
            rng,
        }
    }

    /// Follows the ego's pose along the route.
    pub fn locate(&mut self, pose: &EgoPose) {
        let window = (self.station_m - 8.0, self.station_m + 12.0);
        self.station_m = self.route.path.project(pose.position, window.0, window.1).0;
    }

    pub fn front_m(&self) -> f64 {
        self.station_m + FRONT_BUMPER_X_M
    }

    pub fn rear_m(&self) -> f64 {
        self.station_m - (EGO_LENGTH_M - FRONT_BUMPER_X_M)
    }

    /// Decides once. `answer` comes from the next junction and its lights.
    pub fn step(
        &mut self,
        dt_s: f64,
        pose: &EgoPose,
        answer: &Answer,
        (graph, surface): (&LaneGraph, &Surface),
        obstacles: &[Obstacle],
    ) -> EgoCommand {
        let line = answer.stop.map(|stop| stop.gap);
        if answer.is_granted {
            self.held_s = 0.0;
        }
        let is_bold = self.bold_s > 0.0 && line.is_none();
        self.notice(pose, obstacles);
        let others: Vec<Obstacle> = obstacles
            .iter()
            .filter(|other| other.owner != Owner::Ego && !self.is_unnoticed(other))
            .filter(|other| (other.footprint.center - pose.position).norm() < 60.0)
            // After a jam, standing cars are passed like things.
            .map(|other| {
                let stands = other.is_vehicle && other.velocity_mps.norm() < 0.1;
                Obstacle { is_still: other.is_still || (is_bold && stands), ..*other }
            })
            .collect();
        self.bold_s -= dt_s;
        self.consider_change(dt_s, pose, graph, &others);
        self.left_m = self.swerve(pose, graph).best_offset(self.left_m, &surface.road_grid, &others);
        let speed_mps = pose.speed_mps.max(0.0);
        let reach_m = 12.0 + 3.0 * speed_mps;
        let (gap, is_narrow) = self.swerve(pose, graph).gap_or_narrow(self.left_m, reach_m, &others);
        // Room to steer round what stands; less for vehicles that will drive on.
        let standstill_m = if gap.is_some_and(|gap| gap.is_still) { 4.5 } else { 1.5 };
        let limit_mps = graph.lanes[self.route.span_at(self.front_m()).lane].limit_mps;
        let mut desired_mps = driving::bend_speed_mps(&self.route.path, self.station_m, limit_mps);
        let swerve_m = (self.left_m - self.offset(pose)).abs();
        if !self.is_changing && (swerve_m > 0.7 || self.left_m.abs() > 1.2) {
            desired_mps = desired_mps.min(5.0);
        }
        let to_end_m = self.route.path.length_m() - self.front_m();
        let end = (to_end_m < 30.0).then(|| Gap::line(to_end_m.max(0.1)));
        let before_thing = gap.filter(|gap| gap.is_still && gap.distance_m < THING_M);
        self.consider_creeping(dt_s, speed_mps, swerve_m, before_thing);
        let creeping = driving::acceleration_mps2(speed_mps, CREEP_MPS, None, standstill_m);
        let mut acceleration = driving::acceleration_mps2(speed_mps, desired_mps, gap, standstill_m);
        if is_narrow {
            acceleration = acceleration.max(creeping);
        } else if self.creeping_s > 0.0 && before_thing.is_some() {
            acceleration = creeping;
        }
        for stop in [line, end].into_iter().flatten() {
            acceleration =
                acceleration.min(driving::acceleration_mps2(speed_mps, desired_mps, Some(stop), 1.0));
        }
        // Who is stuck at a thing does not wait for the junction behind it.
        let is_held = line.is_some_and(|line| line.distance_m < 4.0) && !self.is_stopped_short;
        let is_at_thing = before_thing.is_some() || self.is_stopped_short;
        // A queue before a light is not a jam, nor is a thing beyond a red light's line.
        if to_end_m > END_M && ((is_at_thing && !is_held) || !answer.is_queue) {
            let haste = if is_at_thing { HASTE } else { 1.0 };
            self.unjam(dt_s * haste, pose.speed_mps, is_held, graph);
        }
        if self.backing_s <= 0.0 && pushes(pose, &others) {
            self.backing_s = BACKING_S;
        }
        let hold_mps = self.hold_mps(dt_s, pose, acceleration);
        self.asked_mps2 = f64::INFINITY;
        if self.backing_s > 0.0 {
            let is_free = is_free_behind(pose, &others);
            self.backing_s -= if is_free { dt_s } else { dt_s / 2.0 };
            if is_free {
                self.steering_rad = 0.0;
                return EgoCommand { target_speed_mps: hold_mps - 1.2, steering_angle_rad: 0.0 };
            }
        }
        self.steer(dt_s, pose, &others);
        let hit = self.about_to_hit(pose, &others);
        self.is_stopped_short = hit.is_some_and(|other| other.is_still) || touches(pose, &others);
        if hit.is_some() {
            return EgoCommand { target_speed_mps: hold_mps, steering_angle_rad: self.steering_rad };
        }
        self.asked_mps2 = acceleration;
        EgoCommand {
            target_speed_mps: (speed_mps + acceleration * DRIVE_RESPONSE_S).max(0.0) + hold_mps,
            steering_angle_rad: self.steering_rad,
        }
    }

    /// Notices what has come near.
    fn notice(&mut self, pose: &EgoPose, obstacles: &[Obstacle]) {
        let speed_mps = pose.speed_mps.max(0.0);
        for other in obstacles {
            let Owner::Placement(placement) = other.owner else { continue };
            let Some(braking_mps2) = self.unnoticed.get(&placement) else { continue };
            let gap_m = (other.footprint.center - pose.position).norm()
                - FRONT_BUMPER_X_M
                - other.footprint.radius_m();
            if gap_m < speed_mps * speed_mps / (2.0 * braking_mps2) + NOTICED_M {
                self.unnoticed.remove(&placement);
            }
        }
    }

    fn is_unnoticed(&self, other: &Obstacle) -> bool {
        matches!(other.owner, Owner::Placement(placement) if self.unnoticed.contains_key(&placement))
    }

    /// What the wheels' target needs on top, so that the car does as demanded: against the slope, and
    /// against drag, which shows as the difference between demanded and measured acceleration.
    fn hold_mps(&mut self, dt_s: f64, pose: &EgoPose, asked_mps2: f64) -> f64 {
        let found_mps2 = (pose.speed_mps - self.speed_before_mps) / dt_s;
        self.speed_before_mps = pose.speed_mps;
        if pose.speed_mps > MOVES_MPS && self.asked_mps2.abs() < MAX_LEARNT_MPS2 {
            let change = (self.asked_mps2 - found_mps2) * dt_s / DRAG_TIME_S;
            self.drag_mps2 = (self.drag_mps2 + change).clamp(-MAX_DRAG_MPS2, MAX_DRAG_MPS2);
        }
        // One who stops or stands wants no push.
        let sets_off = pose.speed_mps > MOVES_MPS && asked_mps2 > 0.0;
        let drag_mps2 = if pose.speed_mps > 2.0 || sets_off { self.drag_mps2 } else { 0.0 };
        (GRAVITY_MPS2 * pose.grade + drag_mps2) * DRIVE_RESPONSE_S
    }

    /// Moves over gently to a neighbouring lane where that helps.
    fn consider_change(&mut self, dt_s: f64, pose: &EgoPose, graph: &LaneGraph, others: &[Obstacle]) {
        self.change_s -= dt_s;
        if self.is_changing {
            let step_m = SIDEWAYS_MPS * dt_s;
            self.glide_m += (self.left_m - self.glide_m).clamp(-step_m, step_m);
            if (self.glide_m - self.left_m).abs() < 0.05 {
                self.is_changing = false;
                self.change_s = CHANGED_S;
            }
            return;
        }
        if self.change_s > 0.0 || pose.speed_mps < 2.0 || self.left_m.abs() > 0.5 {
            return;
        }
        let lane = &graph.lanes[self.route.span_at(self.front_m()).lane];
        let mover = Mover {
            route: &self.route,
            station_m: self.station_m + FRONT_BUMPER_X_M - EGO_LENGTH_M / 2.0,
            length_m: EGO_LENGTH_M,
            speed_mps: pose.speed_mps,
            wish_mps: lane.limit_mps,
        };
        let Some(change) = mover.change(graph, others, &mut self.rng) else { return };
        let left_m = self.route.path.length_m() - self.station_m;
        self.route = change.route;
        self.route.extend(graph, change.station_m + left_m, &mut self.rng);
        self.station_m = self.route.path.project(pose.position, 0.0, change.station_m + 5.0).0;
        self.left_m = 0.0;
        self.glide_m = self.offset(pose);
        self.is_changing = true;
    }

    /// The time for which it has been standing.
    pub fn waited_s(&self) -> f64 {
        self.jam_s.max(self.held_s)
    }

    fn offset(&self, pose: &EgoPose) -> f64 {
        self.route.path.project(pose.position, self.station_m - 2.0, self.station_m + 2.0).1
    }

    fn swerve(&self, pose: &EgoPose, graph: &LaneGraph) -> Swerve<'_> {
        let path = &self.route.path;
        let turn_rad = turn_between(path.heading_rad(self.station_m), pose.yaw_rad);
        let ahead = graph.lanes[self.route.span_at(self.front_m() + 4.0).lane].junction;
        Swerve {
            path,
            front_m: self.front_m(),
            now_m: self.offset(pose) + turn_rad.sin() * FRONT_BUMPER_X_M,
            half_width_m: EGO_WIDTH_M / 2.0,
            length_m: EGO_LENGTH_M,
            speed_mps: pose.speed_mps.max(0.0),
            is_bold: self.bold_s > 0.0,
            mirror: -graph.kerb_sign(),
            is_near_junction: ahead.is_some(),
        }
    }

    /// A way planned too close may still be driven at a walk: the last check guards it.
    fn consider_creeping(&mut self, dt_s: f64, speed_mps: f64, swerve_m: f64, thing: Option<Gap>) {
        self.creeping_s -= dt_s;
        if speed_mps < MOVES_MPS && self.jam_s > HASTE * CREEP_S && swerve_m > ROUND_M && thing.is_some() {
            self.creeping_s = CREEPING_S;
        }
    }

    /// Whether it backs up, or would if it had room.
    pub fn backs_up(&self) -> bool {
        self.backing_s > 0.0
    }

    /// Ends a jam by another way: other turns ahead, a bolder way round, at last backing up.
    fn unjam(&mut self, dt_s: f64, speed_mps: f64, is_held: bool, graph: &LaneGraph) {
        if self.backing_s > 0.0 {
            return;
        }
        let before_s = self.jam_s;
        let stands = speed_mps.abs() <= MOVES_MPS;
        self.held_s = if stands && is_held { self.held_s + dt_s } else { 0.0 };
        self.jam_s = if stands && !is_held { self.jam_s + dt_s } else { 0.0 };
        if self.held_s > PATIENCE_S {
            self.held_s = 0.0;
            self.route.turn_elsewhere(graph, self.front_m(), &mut self.rng);
        }
        if before_s <= JAM_S && self.jam_s > JAM_S {
            self.bold_s = 12.0;
            self.route.turn_elsewhere(graph, self.front_m(), &mut self.rng);
        }
        if self.jam_s > JAM_S + 3.0 {
            self.jam_s = 0.0;
            self.backing_s = BACKING_S;
        }
    }

    /// The last check, whatever was planned: the arc that the wheels point along, up to a stop.
    fn about_to_hit<'a>(&self, pose: &EgoPose, others: &'a [Obstacle]) -> Option<&'a Obstacle> {
        let speed_mps = pose.speed_mps.max(0.0);
        let reach_m = 0.5 + 0.25 * speed_mps + speed_mps * speed_mps / 12.0;
        first_hit(pose, self.steering_rad, reach_m, others)
    }

    fn steer(&mut self, dt_s: f64, pose: &EgoPose, others: &[Obstacle]) {
        let speed_mps = pose.speed_mps.max(0.0);
        let lookahead_m = (0.6 * speed_mps + 2.6).clamp(3.8, 9.0);
        let left_m = if self.is_changing { self.glide_m } else { self.left_m };
        let target = self.route.path.beside(self.station_m + lookahead_m, left_m);
        let way = target - pose.position;
        let alpha = turn_between(pose.yaw_rad, way.y.atan2(way.x));
        let mut wanted = (2.0 * WHEELBASE_M * alpha.sin() / way.norm().max(1.0)).atan();
        if speed_mps < DODGING_MPS {
            wanted = dodge(pose, wanted, others);
        }
        let step = (wanted - self.steering_rad).clamp(-STEERING_RATE_RPS * dt_s, STEERING_RATE_RPS * dt_s);
        self.steering_rad = (self.steering_rad + step).clamp(-MAX_STEERING_RAD, MAX_STEERING_RAD);
    }
}
