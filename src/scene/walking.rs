//! Pedestrians: up and down their pavement, and across the street when a gap allows.

use super::driving::{Obstacle, Owner};
use super::following::Stride;
use super::occupancy::Footprint;
use super::path::{Vec2, rotate, turn_between};
use super::world::Walk;

/// Side of the square that a standing person takes.
const BODY_M: f64 = 0.7;
/// Fastest turn on foot.
const TURN_RATE_RPS: f64 = 4.0;
/// Room that people keep from what stands or drives; one who stands nearer already keeps the next smaller.
const ROOMS_M: [f64; 3] = [0.35, 0.27, 0.1];
/// Turns that someone on the street tries, one after the other, to get round what stands there.
const ASIDE_RAD: [f64; 5] = [0.0, 0.7, -0.7, 1.4, -1.4];

#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    Along,
    /// At the kerb, looking for a gap.
    Waiting,
    Across {
        from: Vec2,
        to: Vec2,
    },
    /// On the far side, before going back.
    Resting {
        left_s: f64,
        back: Vec2,
    },
}

/// Someone on foot.
#[derive(Debug, Clone)]
pub struct Walker {
    pub placement: usize,
    pub position: Vec2,
    pub yaw_rad: f64,
    pub velocity_mps: Vec2,
    pub stride: Stride,
    /// Who goes along: placement, and the place ahead and to the left.
    pub party: Vec<(usize, Vec2)>,
    walk: Walk,
    phase: Phase,
    /// Time until it crosses or turns again.
    pause_s: f64,
}

impl Walker {
    pub fn new(placement: usize, walk: Walk, position: Vec2, yaw_rad: f64, stride: Stride) -> Self {
        let phase = Phase::Along;
        let (velocity_mps, party) = (Vec2::zeros(), Vec::new());
        Self { placement, position, yaw_rad, velocity_mps, stride, party, walk, phase, pause_s: 0.0 }
    }

    /// The ground it takes: on the street, also that of the next two seconds.
    pub fn obstacle(&self) -> Obstacle {
        let ahead =
            if matches!(self.phase, Phase::Across { .. }) { self.velocity_mps } else { Vec2::zeros() };
        let direction_rad = if ahead.norm() > 0.1 { ahead.y.atan2(ahead.x) } else { self.yaw_rad };
        Obstacle {
            owner: Owner::Placement(self.placement),
            footprint: Footprint {
                center: self.position + ahead,
                yaw_rad: direction_rad,
                length_m: BODY_M + 2.0 * ahead.norm(),
                width_m: BODY_M,
            },
            velocity_mps: Vec2::zeros(),
            is_still: false,
            is_vehicle: false,
            backs_up: false,
        }
    }

    /// Moves on by one step.
    pub fn step(&mut self, dt_s: f64, obstacles: &[Obstacle]) {
        self.pause_s -= dt_s;
        let before = self.position;
        match self.phase {
            Phase::Along => self.step_along(dt_s, obstacles),
            Phase::Waiting => {
                if let Some((_, to)) = self.walk.crossing
                    && self.is_clear(to, obstacles)
                {
                    self.phase = Phase::Across { from: self.position, to };
                }
            }
            Phase::Across { from, to } => {
                let way = to - self.position;
                let step_m = self.walk.speed_mps * dt_s;
                if way.norm() <= step_m {
                    self.position = to;
                    self.phase =
                        Phase::Resting { left_s: if self.walk.is_restless { 1.0 } else { 6.0 }, back: from };
                } else if let Some(direction) = self.way_round(way.normalize(), obstacles) {
                    self.position += direction * step_m;
                }
            }
            Phase::Resting { left_s, back } => {
                let is_home = self.walk.crossing.is_none_or(|(_, to)| (to - back).norm() < 0.5);
                if is_home {
                    self.phase = Phase::Along;
                    self.pause_s = 8.0;
                } else if left_s > 0.0 {
                    self.phase = Phase::Resting { left_s: left_s - dt_s, back };
                } else if self.is_clear(back, obstacles) {
                    self.phase = Phase::Across { from: self.position, to: back };
                }
            }
        }
        self.velocity_mps = (self.position - before) / dt_s;
        self.stride.advance((self.position - before).norm());
        if self.velocity_mps.norm() > 0.2 {
            let wanted_rad = self.velocity_mps.y.atan2(self.velocity_mps.x);
            let turn_rad = turn_between(self.yaw_rad, wanted_rad);
            self.yaw_rad += turn_rad.clamp(-TURN_RATE_RPS * dt_s, TURN_RATE_RPS * dt_s);
        }
    }

    fn step_along(&mut self, dt_s: f64, obstacles: &[Obstacle]) {
        let walk = &mut self.walk;
        let next_m = walk.station_m + walk.sense * walk.speed_mps * dt_s;
        if let Some((at_m, _)) = walk.crossing
            && self.pause_s < 0.0
            && (at_m - walk.station_m) * (at_m - next_m) <= 0.0
        {
            self.phase = Phase::Waiting;
            return;
        }
        let direction = walk.footway.direction(next_m) * walk.sense;
        if next_m < 0.5 || next_m > walk.footway.length_m() - 0.5 {
            walk.sense = -walk.sense;
            // A person who starts beyond an end walks inwards.
            walk.station_m = walk.station_m.clamp(0.5, (walk.footway.length_m() - 0.5).max(0.5));
            return;
        }
        if self.is_blocked(direction, obstacles) {
            self.walk.sense = -self.walk.sense;
            return;
        }
        self.walk.station_m = next_m;
        self.position = self.walk.footway.beside(next_m, self.walk.left_m);
    }

    /// The direction nearest to the wanted one that is free: nobody waits on the street for a post or someone who stands.
    fn way_round(&self, direction: Vec2, obstacles: &[Obstacle]) -> Option<Vec2> {
        ASIDE_RAD
            .into_iter()
            .map(|turn_rad| rotate(direction.x, direction.y, turn_rad))
            .find(|&way| !self.is_blocked(way, obstacles))
    }

    fn is_own(&self, other: &Obstacle) -> bool {
        let is = |placement: usize| other.owner == Owner::Placement(placement);
        is(self.placement) || self.party.iter().any(|&(placement, _)| is(placement))
    }

    fn is_blocked(&self, direction: Vec2, obstacles: &[Obstacle]) -> bool {
        let left = Vec2::new(-direction.y, direction.x);
        let beside = self.party.iter().map(|(_, at)| direction * at.x + left * at.y);
        let offsets: Vec<Vec2> = std::iter::once(Vec2::zeros()).chain(beside).collect();
        // On the street people slip past each other; on a pavement they turn round.
        let is_across = matches!(self.phase, Phase::Across { .. });
        let near = obstacles
            .iter()
            .filter(|other| !self.is_own(other) && (other.is_vehicle || other.is_still || !is_across));
        near.filter(|other| (other.footprint.center - self.position).norm() < 10.0).any(|other| {
            // A person who already stands too near may walk away, and not nearer.
            let grounds = ROOMS_M.map(|margin_m| other.footprint.grow(margin_m));
            offsets.iter().any(|offset| {
                let at = self.position + offset;
                grounds.iter().any(|ground| ground.contains(at + direction * 0.7) && !ground.contains(at))
            })
        })
    }

    /// Whether no vehicle is on the way or comes along it in time.
    fn is_clear(&self, to: Vec2, obstacles: &[Obstacle]) -> bool {
        let way = to - self.position;
        let needed_s = way.norm() / self.walk.speed_mps + 1.0;
        let horizon_s = if self.walk.is_reckless { 2.8 } else { needed_s };
        let corridor = Footprint {
            center: self.position + way / 2.0,
            yaw_rad: way.y.atan2(way.x),
            length_m: way.norm(),
            width_m: 2.6,
        };
        obstacles.iter().filter(|other| other.is_vehicle || other.is_still).all(|other| {
            let n = if other.velocity_mps.norm() > 0.3 { (horizon_s / 0.4).ceil() as usize } else { 0 };
            (0..=n).all(|i| {
                let center = other.footprint.center + other.velocity_mps * (0.4 * i as f64);
                let width_m = if other.is_still { 0.9 } else { corridor.width_m };
                !Footprint { center, ..other.footprint }.meets(&Footprint { width_m, ..corridor })
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::models;
    use crate::scene::path::Path;

    #[test]
    fn who_crosses_goes_round_what_stands_before_the_far_side() {
        let footway = Path::new([Vec2::new(0.0, 0.0), Vec2::new(40.0, 0.0)]).unwrap();
        let (from, to) = (Vec2::new(20.0, 0.0), Vec2::new(20.0, 10.0));
        let walk = Walk {
            footway,
            left_m: 0.0,
            station_m: 20.0,
            sense: 1.0,
            speed_mps: 1.3,
            crossing: Some((20.0, to)),
            is_reckless: false,
            is_restless: true,
        };
        let stride = Stride::new(0, &models::load().unwrap()[0]);
        let mut walker = Walker::new(0, walk, from, 0.0, stride);
        walker.phase = Phase::Across { from, to };
        let post = Obstacle {
            owner: Owner::Placement(1),
            footprint: Footprint::square(Vec2::new(20.0, 7.0), 0.6),
            velocity_mps: Vec2::zeros(),
            is_still: true,
            is_vehicle: false,
            backs_up: false,
        };
        let mut nearest_m = f64::INFINITY;
        for _ in 0..240 {
            walker.step(0.05, &[post]);
            nearest_m = nearest_m.min((walker.position - post.footprint.center).norm());
        }
        assert!(matches!(walker.phase, Phase::Resting { .. }), "{:?} at {}", walker.phase, walker.position);
        assert!(nearest_m > 0.4, "{nearest_m} m from the post's middle");
    }
}
