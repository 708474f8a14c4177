//! Movers of scenarios: they stand until the ego comes, go their way, and stand again. They wait for nobody.

use super::dash::Dash;
use super::driving::{Obstacle, Owner};
use super::following::Stride;
use super::models::Model;
use super::occupancy::Footprint;
use super::path::{Vec2, direction_of};
use crate::object::Kind;

/// How fast they set out and stop.
const ACCELERATION_MPS2: f64 = 4.0;
const BRAKING_MPS2: f64 = 6.0;

/// One of them.
#[derive(Debug, Clone)]
pub struct Dasher {
    pub placement: usize,
    pub position: Vec2,
    pub yaw_rad: f64,
    pub velocity_mps: Vec2,
    pub stride: Stride,
    pub dash: Dash,
    start: Vec2,
    /// 1 along its route, -1 against it.
    sense: f64,
    size_m: [f64; 2],
    is_vehicle: bool,
    is_off: bool,
    gone_m: f64,
    speed_mps: f64,
}

impl Dasher {
    /// `at`: the model's origin and its yaw.
    pub fn new(placement: usize, dash: Dash, model: &Model, (at, yaw_rad): (Vec2, f64)) -> Self {
        let along = direction_of(yaw_rad);
        let sense = match &dash.on_route {
            Some((route, station_m, _)) if route.path.direction(*station_m).dot(&along) < 0.0 => -1.0,
            _ => 1.0,
        };
        Self {
            placement,
            position: at,
            yaw_rad,
            velocity_mps: Vec2::zeros(),
            stride: Stride::new(placement, model),
            dash,
            start: at,
            sense,
            size_m: [model.length_m(), model.width_m()],
            is_vehicle: model.facts.kind == Kind::Vehicle,
            is_off: false,
            gone_m: 0.0,
            speed_mps: 0.0,
        }
    }

    /// Whether the ego has set it off.
    pub fn is_off(&self) -> bool {
        self.is_off
    }

    /// Whether it is off and has some way left.
    pub fn is_under_way(&self) -> bool {
        self.is_off && self.dash.speed_mps > 0.0 && self.gone_m < self.dash.way_m - 0.01
    }

    /// The ground it takes now.
    pub fn obstacle(&self) -> Obstacle {
        let [length_m, width_m] = self.size_m;
        Obstacle {
            owner: Owner::Placement(self.placement),
            footprint: Footprint { center: self.position, yaw_rad: self.yaw_rad, length_m, width_m },
            velocity_mps: self.velocity_mps,
            is_still: false,
            is_vehicle: self.is_vehicle,
            backs_up: false,
        }
    }

    /// Moves on by one step.
    pub fn step(&mut self, dt_s: f64, ego: Vec2) {
        self.is_off |= (ego - self.start).norm() < self.dash.trigger_m;
        let before = self.position;
        if self.is_off {
            let left_m = (self.dash.way_m - self.gone_m).max(0.0);
            let stopping_mps = (2.0 * BRAKING_MPS2 * left_m).sqrt();
            let faster_mps = self.speed_mps + ACCELERATION_MPS2 * dt_s;
            self.speed_mps = faster_mps.min(self.dash.speed_mps).min(stopping_mps);
            let step_m = (self.speed_mps * dt_s).min(left_m);
            self.gone_m += step_m;
            self.stride.advance(step_m);
            match &self.dash.on_route {
                None => self.position = self.start + direction_of(self.yaw_rad) * self.gone_m,
                Some((route, station_m, left_m)) => {
                    let station_m = station_m + self.sense * self.gone_m;
                    self.position = route.path.beside(station_m, *left_m);
                    let heading_rad = route.path.heading_rad(station_m);
                    self.yaw_rad =
                        if self.sense < 0.0 { heading_rad + std::f64::consts::PI } else { heading_rad };
                }
            }
        }
        self.velocity_mps = (self.position - before) / dt_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::models;

    #[test]
    fn it_stands_until_the_ego_comes_and_stops_after_its_way() {
        let library = models::load().unwrap();
        let dash = Dash { speed_mps: 3.0, way_m: 6.0, trigger_m: 20.0, on_route: None };
        let mut dasher = Dasher::new(0, dash, &library[0], (Vec2::zeros(), 0.0));
        for _ in 0..20 {
            dasher.step(0.05, Vec2::new(-21.0, 0.0));
        }
        assert_eq!(dasher.position, Vec2::zeros());
        let mut fastest_mps = 0.0_f64;
        for _ in 0..100 {
            dasher.step(0.05, Vec2::new(-19.0, 0.0));
            fastest_mps = fastest_mps.max(dasher.velocity_mps.norm());
        }
        assert!((dasher.position.x - 6.0).abs() < 0.01 && dasher.velocity_mps.norm() < 0.01, "{dasher:?}");
        assert!((fastest_mps - 3.0).abs() < 1e-9, "{fastest_mps}");
    }
}
