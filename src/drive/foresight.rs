//! What is not in the zone yet but moves into the ego's way: where both would meet if both kept their motion.
//!
//! The rule is that of the zone `ttc` (`zone::ttc`) with a short horizon and a wider ego, asked about moving things alone, however
//! high they are: what flies comes down. A driver also asks it of what slows down on the way, as what rolls or tumbles does. What
//! stands is the zone's and the route's (`route_ahead`).

use super::config::ReflexConfig;
use crate::geometry::{Box3, Ego, Point};
use crate::sample::EgoState;
use crate::zone::{BodyConfig, TtcConfig, Zone, ZoneAt, ZoneConfig, ZoneError, ZoneKind};

/// The rule; without a horizon it foresees nothing.
#[derive(Debug, Clone)]
pub(super) struct Foresight {
    zone: Option<Zone>,
    moving_mps: f64,
    slows_to: f64,
}

/// The rule at one state of the ego.
#[derive(Debug)]
pub(super) struct ForesightAt {
    zone: Option<ZoneAt>,
    moving_mps: f64,
    slows_to: f64,
    front_bumper_x_m: f64,
}

impl Foresight {
    /// What is true does not depend on how a driver reacts: the horizon is given, the rest is the default's, and nothing slows down.
    ///
    /// # Errors
    /// The horizon is not valid.
    pub fn of_truth(horizon_s: f64) -> Result<Self, ZoneError> {
        Self::new(&ReflexConfig { foresight_s: horizon_s, slows_to: 1.0, ..ReflexConfig::default() })
    }

    /// # Errors
    /// The config is not valid.
    pub fn new(config: &ReflexConfig) -> Result<Self, ZoneError> {
        let zone = (config.foresight_s > 0.0).then(|| {
            let body = BodyConfig::default();
            let width_m = body.width_m + 2.0 * config.beside_m;
            Zone::try_from(ZoneConfig {
                kind: ZoneKind::Ttc,
                max_clearance_m: 0.0,
                body: BodyConfig { width_m, ..body },
                ttc: TtcConfig { horizon_s: config.foresight_s },
                ..ZoneConfig::default()
            })
        });
        Ok(Self { zone: zone.transpose()?, moving_mps: config.moving_mps, slows_to: config.slows_to })
    }

    /// # Errors
    /// The state is not valid, or its turn is too sharp to be foreseen.
    pub fn at(&self, state: &EgoState) -> Result<ForesightAt, ZoneError> {
        Ok(ForesightAt {
            zone: self.zone.as_ref().map(|zone| zone.at(state)).transpose()?,
            moving_mps: self.moving_mps,
            slows_to: self.slows_to,
            front_bumper_x_m: state.front_bumper_x_m,
        })
    }
}

impl ForesightAt {
    /// Where a box will be when the ego meets it, if it does within the horizon; `None` for what stands, and for what is not before
    /// the bumper now: braking does not help against what comes from behind.
    ///
    /// `velocity_mps` is over ground, in the ego's axes.
    ///
    /// # Errors
    /// The box or its velocity is not finite.
    pub fn meeting(&self, of: &Box3<Ego>, velocity_mps: [f64; 2]) -> Result<Option<Box3<Ego>>, ZoneError> {
        let [x_mps, y_mps] = velocity_mps;
        let is_ahead = of.footprint().iter().any(|corner| corner.x_m > self.front_bumper_x_m);
        let counts = is_ahead && x_mps.hypot(y_mps) >= self.moving_mps;
        let Some(zone) = self.zone.as_ref().filter(|_| counts) else {
            return Ok(None);
        };
        let shares: &[f64] = if self.slows_to < 1.0 { &[1.0, self.slows_to] } else { &[1.0] };
        let mut first: Option<(f64, Box3<Ego>)> = None;
        for share in shares {
            let velocity_mps = [x_mps * share, y_mps * share];
            let Some(after_s) = zone.harm_of(of, velocity_mps)?.time_to_collision_s else { continue };
            if first.is_none_or(|(first_s, _)| after_s < first_s) {
                let x_m = of.center.x() + velocity_mps[0] * after_s;
                let y_m = of.center.y() + velocity_mps[1] * after_s;
                first = Some((after_s, Box3 { center: Point::new(x_m, y_m, of.center.z()), ..*of }));
            }
        }
        Ok(first.map(|(_, met)| met))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATE: EgoState = EgoState {
        speed_mps: 8.0,
        steering_angle_rad: 0.0,
        yaw_rate_rps: 0.0,
        acceleration_mps2: 0.0,
        wheelbase_m: 2.6,
        front_bumper_x_m: 3.6,
    };

    fn crate_at(x_m: f64, y_m: f64) -> Box3<Ego> {
        Box3 { center: Point::new(x_m, y_m, 0.5), length_m: 1.0, width_m: 1.0, height_m: 1.0, yaw_rad: 0.0 }
    }

    fn foresight(foresight_s: f64) -> ForesightAt {
        let config = ReflexConfig {
            foresight_s,
            moving_mps: 1.0,
            beside_m: 0.5,
            slows_to: 1.0,
            ..ReflexConfig::default()
        };
        Foresight::new(&config).unwrap().at(&STATE).unwrap()
    }

    #[test]
    fn what_comes_from_behind_is_not_met() {
        let follower = crate_at(-8.0, 0.0);
        assert!(foresight(2.0).meeting(&follower, [14.0, 0.0]).unwrap().is_none());
        assert!(foresight(2.0).meeting(&crate_at(12.0, 0.0), [-1.5, 0.0]).unwrap().is_some());
    }

    #[test]
    fn the_truths_horizon_does_not_depend_on_the_drivers() {
        let truth = Foresight::of_truth(2.0).unwrap().at(&STATE).unwrap();
        assert!(truth.meeting(&crate_at(15.0, 5.0), [0.0, -3.0]).unwrap().is_some());
        let none = Foresight::of_truth(0.0).unwrap().at(&STATE).unwrap();
        assert!(none.meeting(&crate_at(15.0, 5.0), [0.0, -3.0]).unwrap().is_none());
    }

    #[test]
    fn what_rolls_into_the_way_is_met_where_both_will_be() {
        // In 1.5 s the bumper has come 12 m, and the crate 4.5 m to the right: before the car.
        let met = foresight(2.0).meeting(&crate_at(15.0, 5.0), [0.0, -3.0]).unwrap().unwrap();
        assert!((met.center.x() - 15.0).abs() < 1e-9, "{met:?}");
        assert!(met.center.y().abs() < 2.0, "{met:?}");
        // It comes too late, is gone before, stands, or no forecast is asked for.
        assert!(foresight(2.0).meeting(&crate_at(15.0, 9.0), [0.0, -3.0]).unwrap().is_none());
        assert!(foresight(2.0).meeting(&crate_at(19.0, 3.0), [0.0, -9.0]).unwrap().is_none());
        assert!(foresight(2.0).meeting(&crate_at(15.0, 0.0), [0.0, -0.5]).unwrap().is_none());
        assert!(foresight(0.0).meeting(&crate_at(15.0, 5.0), [0.0, -3.0]).unwrap().is_none());
    }

    #[test]
    fn what_flies_is_met_however_high_it_is_now() {
        let mut aloft = crate_at(22.0, 2.0);
        aloft.center = Point::new(22.0, 2.0, 5.5);
        assert!(foresight(2.0).meeting(&aloft, [-7.0, -1.5]).unwrap().is_some());
        assert!(foresight(2.0).meeting(&aloft, [0.0, 0.0]).unwrap().is_none());
    }

    #[test]
    fn what_would_be_across_in_time_is_met_if_it_may_slow_down() {
        // At 7 m/s it is across before the ego comes, at 3.5 m/s it is not.
        let met = |slows_to: f64| {
            let config = ReflexConfig { slows_to, ..ReflexConfig::default() };
            let foresight = Foresight::new(&config).unwrap().at(&STATE).unwrap();
            foresight.meeting(&crate_at(15.0, 4.5), [0.0, -7.0]).unwrap()
        };
        assert!(met(1.0).is_none());
        assert!(met(0.5).unwrap().center.y() > -2.0);
    }
}
