//! Pedestrians: to and fro along a pavement, now and then across the street and back.

use super::driver::Obstacle;
use crate::scene::occupancy::Footprint;
use crate::scene::path::{Path, Vec2};
use crate::scene::populate::Walk;

/// Time for which a car must not arrive where a careful pedestrian sets out.
const SAFE_GAP_S: f64 = 5.0;
/// Rest on the far side before walking back.
const REST_S: f64 = 6.0;
/// Closer than this ahead, somebody is waited for.
const PERSONAL_M: f64 = 1.0;

/// One walker.
#[derive(Debug)]
pub struct Pedestrian {
    footway: Path,
    left_m: f64,
    station_m: f64,
    sense: f64,
    speed_mps: f64,
    crossing: Option<(f64, Vec2)>,
    is_reckless: bool,
    phase: Phase,
    size: Footprint,
    is_moving: bool,
}

#[derive(Debug, Clone, Copy)]
enum Phase {
    Along,
    /// Share of the way from the near side to the far one.
    Across {
        share: f64,
        sense: f64,
    },
    Rest {
        left_s: f64,
    },
}

impl Pedestrian {
    pub fn new(walk: &Walk, size: Footprint) -> Self {
        Self {
            footway: walk.footway.clone(),
            left_m: walk.left_m,
            station_m: walk.station_m,
            sense: walk.sense,
            speed_mps: walk.speed_mps,
            crossing: walk.crossing,
            is_reckless: walk.is_reckless,
            phase: Phase::Along,
            size,
            is_moving: true,
        }
    }

    /// Position and heading.
    pub fn pose(&self) -> (Vec2, f64) {
        let along = self.footway.beside(self.station_m, self.left_m);
        match (self.phase, self.crossing) {
            (Phase::Across { share, sense }, Some((_, far))) => {
                let way = (far - along) * sense;
                (along + (far - along) * share, way.y.atan2(way.x))
            }
            (Phase::Rest { .. }, Some((_, far))) => {
                let way = along - far;
                (far, way.y.atan2(way.x))
            }
            _ => {
                let direction = self.footway.direction(self.station_m) * self.sense;
                (along, direction.y.atan2(direction.x))
            }
        }
    }

    pub fn obstacle(&self) -> Obstacle {
        let (center, yaw_rad) = self.pose();
        let speed_mps = if self.is_moving { self.speed_mps } else { 0.0 };
        let crosses = matches!(self.phase, Phase::Across { .. });
        Obstacle {
            is_crossing: crosses,
            ..Obstacle::moving(Footprint { center, yaw_rad, ..self.size }, speed_mps)
        }
    }

    pub fn step(&mut self, me: usize, obstacles: &[Obstacle], dt_s: f64) {
        let way_m = self.speed_mps * dt_s;
        match self.phase {
            Phase::Along => {
                let before = self.station_m;
                let is_blocked = self.is_blocked(me, obstacles);
                self.is_moving = !is_blocked;
                if is_blocked {
                    return;
                }
                let next = before + way_m * self.sense;
                if let Some((station, far)) = self.crossing
                    && (before - station) * (next - station) <= 0.0
                {
                    if self.is_reckless || self.may_cross(far, me, obstacles) {
                        self.station_m = station;
                        self.phase = Phase::Across { share: 0.0, sense: 1.0 };
                    } else {
                        self.is_moving = false;
                    }
                    return;
                }
                self.station_m = next.clamp(0.0, self.footway.length_m());
                if self.station_m != next {
                    self.sense = -self.sense;
                }
            }
            Phase::Across { share, sense } => {
                self.is_moving = !self.is_blocked(me, obstacles);
                let Some((station, far)) = self.crossing else { return };
                let width_m = (far - self.footway.beside(station, self.left_m)).norm().max(0.1);
                if !self.is_moving {
                    return;
                }
                let share = share + sense * way_m / width_m;
                self.phase = if share >= 1.0 {
                    Phase::Rest { left_s: REST_S }
                } else if share <= 0.0 {
                    // Past the place, so that the next step does not set out again.
                    self.station_m = station + 0.3 * self.sense;
                    Phase::Along
                } else {
                    Phase::Across { share, sense }
                };
            }
            Phase::Rest { left_s } => {
                self.is_moving = false;
                let near = self.footway.beside(self.station_m, self.left_m);
                self.phase = if left_s > dt_s {
                    Phase::Rest { left_s: left_s - dt_s }
                } else if self.is_reckless || self.may_cross(near, me, obstacles) {
                    Phase::Across { share: 0.999, sense: -1.0 }
                } else {
                    Phase::Rest { left_s: dt_s }
                };
            }
        }
    }

    /// Whether somebody or something is right ahead.
    fn is_blocked(&self, me: usize, obstacles: &[Obstacle]) -> bool {
        let (center, yaw_rad) = self.pose();
        let ahead = center + Vec2::new(yaw_rad.cos(), yaw_rad.sin()) * PERSONAL_M;
        let body = Footprint { center: ahead, yaw_rad, length_m: PERSONAL_M, width_m: 0.5 };
        let own = Footprint { center, yaw_rad, ..self.size };
        obstacles.iter().enumerate().any(|(i, other)| {
            // What one already stands in does not hold one back: better to walk out of it.
            i != me
                && other.footprint.meets(&body)
                && !other.footprint.meets(&own)
                && (other.speed_mps > 0.3 || other.footprint.length_m > 1.5 || i < me)
        })
    }

    /// Whether no car reaches the way across for a while.
    fn may_cross(&self, to: Vec2, me: usize, obstacles: &[Obstacle]) -> bool {
        let (from, _) = self.pose();
        let middle = (from + to) / 2.0;
        obstacles.iter().enumerate().all(|(i, other)| {
            let offset = middle - other.footprint.center;
            let velocity = other.velocity();
            let approach_mps = velocity.dot(&offset) / offset.norm().max(0.1);
            let is_car = i != me && other.footprint.length_m > 1.5 && other.speed_mps > 0.2;
            !is_car || offset.norm() > 8.0 + approach_mps.max(0.0) * SAFE_GAP_S || approach_mps < -0.5
        })
    }
}
