//! Those who go along with someone, and the strides of all who walk.

use super::driving::{Obstacle, Owner};
use super::models::Model;
use super::occupancy::Footprint;
use super::path::{Vec2, rotate, turn_between};
use super::world::{Beside, Motion, World};

/// Side of the square that a person takes.
const BODY_M: f64 = 0.6;
/// Fastest turn on foot.
const TURN_RATE_RPS: f64 = 4.0;
/// Nobody catches up faster than this.
const MOST_MPS: f64 = 3.5;
/// Steps shorter than this, in a control step, count as standing: 0.2 m/s.
const STANDS_M: f64 = 0.01;

/// Where someone is in the cycle of a gait: the phase follows the way, so that feet do not slide.
#[derive(Debug, Clone, PartialEq)]
pub struct Stride {
    cycle_m: f64,
    n_phases: usize,
    way_m: f64,
    walks: bool,
}

impl Stride {
    /// Those of a party begin out of step.
    pub fn new(placement: usize, model: &Model) -> Self {
        let way_m = (0.37 * placement as f64).fract() * model.stride_m;
        Self { cycle_m: model.stride_m, n_phases: model.shapes.len().saturating_sub(1), way_m, walks: false }
    }

    pub fn advance(&mut self, moved_m: f64) {
        self.walks = moved_m > STANDS_M;
        self.way_m += moved_m;
    }

    /// The look of the present phase, if there are any: 0 at rest.
    pub fn shape(&self) -> Option<usize> {
        let share = (self.way_m / self.cycle_m).rem_euclid(1.0);
        let phase = ((share * self.n_phases as f64).round() as usize) % self.n_phases.max(1);
        (self.n_phases > 0).then_some(if self.walks { 1 + phase } else { 0 })
    }
}

/// Someone or something that moves with a walker.
#[derive(Debug, Clone)]
pub struct Follower {
    pub placement: usize,
    pub beside: Beside,
    pub position: Vec2,
    pub yaw_rad: f64,
    pub velocity_mps: Vec2,
    pub stride: Stride,
}

/// The followers of a placement, each with its place ahead and to the left.
pub fn party_of(world: &World, leader: usize) -> Vec<(usize, Vec2)> {
    let place = |(i, motion): (usize, &Motion)| match motion {
        Motion::Follows(beside) if beside.leader == leader => {
            Some((i, Vec2::new(beside.forward_m, beside.left_m)))
        }
        _ => None,
    };
    world.placements.iter().map(|placement| &placement.motion).enumerate().filter_map(place).collect()
}

impl Follower {
    pub fn new(placement: usize, beside: Beside, position: Vec2, yaw_rad: f64, stride: Stride) -> Self {
        Self { placement, beside, position, yaw_rad, velocity_mps: Vec2::zeros(), stride }
    }

    /// The ground it takes now.
    pub fn obstacle(&self) -> Obstacle {
        Obstacle {
            owner: Owner::Placement(self.placement),
            footprint: Footprint {
                center: self.position,
                yaw_rad: self.yaw_rad,
                length_m: BODY_M,
                width_m: BODY_M,
            },
            velocity_mps: Vec2::zeros(),
            is_still: false,
            is_vehicle: false,
            backs_up: false,
        }
    }

    /// Moves on by one step, to its place beside the leader.
    pub fn step(&mut self, dt_s: f64, leader: Vec2, leader_yaw_rad: f64) {
        let Beside { forward_m, left_m, is_stiff, .. } = self.beside;
        let before = self.position;
        let place = leader + rotate(forward_m, left_m, leader_yaw_rad);
        if is_stiff {
            (self.position, self.yaw_rad) = (place, leader_yaw_rad);
            self.velocity_mps = (place - before) / dt_s;
            return;
        }
        let way = place - self.position;
        let step_m = way.norm().min(MOST_MPS * dt_s);
        if step_m > 1e-6 {
            self.position += way.normalize() * step_m;
        }
        self.velocity_mps = (self.position - before) / dt_s;
        self.stride.advance(step_m);
        let wanted_rad = if step_m > STANDS_M { way.y.atan2(way.x) } else { leader_yaw_rad };
        let turn_rad = turn_between(self.yaw_rad, wanted_rad);
        self.yaw_rad += turn_rad.clamp(-TURN_RATE_RPS * dt_s, TURN_RATE_RPS * dt_s);
    }
}
