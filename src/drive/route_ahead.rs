//! What stands on the ego's route where the zone's rectangle does not reach: that points where the wheels do, and so leaves a bend.
//!
//! A driver knows its route. What the rectangle reaches is judged by whoever tells of the box.

use nalgebra::Vector2;

use super::config::ReflexConfig;
use crate::geometry::{Box3, Ego, World};
use crate::object::Harm;
use crate::sample::EgoState;
use crate::scene::car::EGO_WIDTH_M;
use crate::zone::{Zone, ZoneAt, ZoneConfig, ZoneError};

/// The rule; without a horizon nothing that is not harmful is in the way.
#[derive(Debug, Clone)]
pub(super) struct RouteAhead {
    rectangle: Zone,
    config: ReflexConfig,
}

/// The rule at one state of the ego.
#[derive(Debug)]
pub(super) struct RouteAheadAt<'a> {
    rectangle: ZoneAt,
    max_clearance_m: f64,
    /// Points of the route over ground, from the bumper to as far as counts.
    points: &'a [Vector2<f64>],
}

/// From one point of a route to the next, metres.
pub(super) const STEP_M: f64 = 0.25;

impl RouteAhead {
    /// # Errors
    /// The config is not valid.
    pub fn new(config: &ReflexConfig) -> Result<Self, ZoneError> {
        Ok(Self { rectangle: Zone::try_from(ZoneConfig::default())?, config: config.clone() })
    }

    /// `points`: of the route over ground, from the bumper on, [`STEP_M`] apart.
    ///
    /// # Errors
    /// The state is not valid.
    pub fn at<'a>(
        &self,
        state: &EgoState,
        points: &'a [Vector2<f64>],
    ) -> Result<RouteAheadAt<'a>, ZoneError> {
        let horizon_s = self.config.route_foresight_s;
        let reach_m = if horizon_s > 0.0 { state.speed_mps * horizon_s + self.config.near_m } else { 0.0 };
        let n_points = (reach_m.max(0.0) / STEP_M) as usize;
        let max_clearance_m = ZoneConfig::default().max_clearance_m;
        let points = &points[..n_points.min(points.len())];
        Ok(RouteAheadAt { rectangle: self.rectangle.at(state)?, max_clearance_m, points })
    }
}

impl RouteAheadAt<'_> {
    /// Whether a box that stands and is not called harmful is where the ego's body will be.
    ///
    /// # Errors
    /// The box is not finite.
    pub fn is_blocked_by(&self, of: &Box3<World>, in_ego: &Box3<Ego>) -> Result<bool, ZoneError> {
        let is_met = |point: &Vector2<f64>| apart_m(of, point) < EGO_WIDTH_M / 2.0;
        if in_ego.bottom_m() > self.max_clearance_m || !self.points.iter().any(is_met) {
            return Ok(false);
        }
        Ok(self.rectangle.harm_of(in_ego, [0.0; 2])?.harm == Harm::Harmless)
    }
}

/// From a point on the ground to a footprint; 0 within it.
fn apart_m(of: &Box3<World>, point: &Vector2<f64>) -> f64 {
    let (sin, cos) = of.yaw_rad.sin_cos();
    let (x_m, y_m) = (point.x - of.center.x(), point.y - of.center.y());
    let along_m = (x_m * cos + y_m * sin).abs() - of.length_m / 2.0;
    let across_m = (y_m * cos - x_m * sin).abs() - of.width_m / 2.0;
    along_m.max(0.0).hypot(across_m.max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Point, Transform};

    const STATE: EgoState = EgoState {
        speed_mps: 8.0,
        steering_angle_rad: 0.0,
        yaw_rate_rps: 0.0,
        acceleration_mps2: 0.0,
        wheelbase_m: 2.6,
        front_bumper_x_m: 3.6,
    };

    #[test]
    fn a_point_is_as_far_from_a_turned_box_as_from_its_nearest_side() {
        let of = Box3 {
            center: Point::new(10.0, 2.0, 0.5),
            length_m: 4.0,
            width_m: 2.0,
            height_m: 1.0,
            yaw_rad: std::f64::consts::FRAC_PI_2,
        };
        assert!((apart_m(&of, &Vector2::new(10.0, 7.0)) - 3.0).abs() < 1e-12);
        assert!((apart_m(&of, &Vector2::new(14.0, 8.0)) - 5.0).abs() < 1e-12);
        assert!(apart_m(&of, &Vector2::new(10.5, 3.5)) < 1e-12);
    }

    #[test]
    fn what_stands_on_a_bend_of_the_route_is_in_the_way_and_what_stands_beside_it_or_aloft_is_not() {
        // To the left on a circle of 25 m.
        let bend: Vec<Vector2<f64>> = (0..200)
            .map(|i| {
                let turned_rad = f64::from(i) * STEP_M / 25.0;
                Vector2::new(3.6 + 25.0 * turned_rad.sin(), 25.0 * (1.0 - turned_rad.cos()))
            })
            .collect();
        let is_blocked = |(x_m, y_m, z_m): (f64, f64, f64), route_foresight_s: f64| {
            let config = ReflexConfig { route_foresight_s, ..ReflexConfig::default() };
            let ahead = RouteAhead::new(&config).unwrap();
            let center = Point::new(x_m, y_m, z_m);
            let of = Box3 { center, length_m: 0.6, width_m: 0.6, height_m: 1.0, yaw_rad: 0.0 };
            let here = Transform::<World, Ego>::from_xyz_yaw(0.0, 0.0, 0.0, 0.0);
            let in_ego = of.in_frame(&here.inverse());
            ahead.at(&STATE, &bend).unwrap().is_blocked_by(&of, &in_ego).unwrap()
        };
        // 12 m before the bumper the circle is 3.1 m to the left.
        assert!(is_blocked((15.6, 3.1, 0.5), 2.0));
        assert!(!is_blocked((15.6, 3.1, 0.5), 0.0) && !is_blocked((15.6, 3.1, 4.0), 2.0));
        assert!(!is_blocked((15.6, 6.0, 0.5), 2.0) && !is_blocked((26.0, 13.0, 0.5), 2.0));
        // The rectangle reaches it, and whoever calls it harmless is believed.
        assert!(!is_blocked((7.0, 0.3, 0.5), 2.0));
    }
}
