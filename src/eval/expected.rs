//! The zone's expected verdict: how likely a box is harmful, when box, speed and steering angle are known to some spread
//! alone.
//!
//! The mean of the zone's rule over draws from normal distributions about what was told: the same draws for every box,
//! each with its opposite. It knows any zone, since it asks only yes or no.

use std::f64::consts::PI;
use std::sync::LazyLock;

use rand_distr::{Distribution, StandardNormal};

use crate::geometry::{Box3, Ego, Point};
use crate::object::{BoxSpread, Detection, Harm};
use crate::random;
use crate::sample::EgoState;
use crate::zone::{Zone, ZoneAt, ZoneError};

/// Draws of box and state over which the expected rule takes its mean.
const N_DRAWS: usize = 64;
/// What the expected rule takes the measured speed to be off by: a share of it, and metres a second. A tyre's size and a
/// wheel's ticks, as the presets' rigs vary them.
const SPEED_SHARE: f64 = 0.016;
const SPEED_MPS: f64 = 0.05;
/// The same of the steering angle.
const STEERING_RAD: f64 = 0.45 * PI / 180.0;

/// The zone as it may lie at a measured state.
pub struct ExpectedVerdict {
    zones: Vec<ZoneAt>,
}

impl ExpectedVerdict {
    /// # Errors
    /// The state is not valid.
    pub fn at(measured: &EgoState, zone: &Zone) -> Result<Self, ZoneError> {
        let zones = DRAWS.iter().map(|draw| zone.at(&draw.state(measured))).collect::<Result<_, _>>()?;
        Ok(Self { zones })
    }

    /// The share of the draws in which the zone calls a box harmful.
    ///
    /// # Errors
    /// The box is not valid.
    pub fn of(&self, object: &Detection) -> Result<f64, ZoneError> {
        let mut n_harmful = 0;
        for (draw, zone) in DRAWS.iter().zip(&self.zones) {
            let drawn = draw.of_box(&object.box_in_ego, object.spread.as_ref());
            let verdict = zone.harm_of(&drawn, object.velocity_in_ego_mps)?;
            n_harmful += usize::from(verdict.harm == Harm::Harmful);
        }
        Ok(f64::from(n_harmful as u32) / N_DRAWS as f64)
    }
}

/// Standard normal numbers: how far a box's and a state's numbers are off, in their spreads.
struct Draw {
    center: [f64; 3],
    sizes: [f64; 3],
    yaw: f64,
    speed: f64,
    steering: f64,
}

/// The draws, the same for every box; each comes with its opposite, so that their mean is zero.
static DRAWS: LazyLock<Vec<Draw>> = LazyLock::new(|| {
    let mut rng = random::stream(0, "expected-verdict", 0);
    let mut draws = Vec::with_capacity(N_DRAWS);
    for _ in 0..N_DRAWS / 2 {
        let numbers: [f64; 9] = std::array::from_fn(|_| StandardNormal.sample(&mut rng));
        draws.extend([1.0, -1.0].map(|side| {
            let [x, y, z, length, width, height, yaw, speed, steering] = numbers.map(|number| side * number);
            Draw { center: [x, y, z], sizes: [length, width, height], yaw, speed, steering }
        }));
    }
    draws
});

impl Draw {
    fn state(&self, measured: &EgoState) -> EgoState {
        let speed_spread_mps = SPEED_SHARE * measured.speed_mps.abs() + SPEED_MPS;
        EgoState {
            speed_mps: measured.speed_mps + self.speed * speed_spread_mps,
            steering_angle_rad: measured.steering_angle_rad + self.steering * STEERING_RAD,
            ..*measured
        }
    }

    fn of_box(&self, told: &Box3<Ego>, spread: Option<&BoxSpread>) -> Box3<Ego> {
        let Some(of) = spread else { return *told };
        let ([x, y, z], [length, width, height]) = (self.center, self.sizes);
        let center = told.center;
        Box3 {
            center: Point::new(center.x() + x * of.x_m, center.y() + y * of.y_m, center.z() + z * of.z_m),
            length_m: told.length_m * (length * of.length).exp(),
            width_m: told.width_m * (width * of.width).exp(),
            height_m: told.height_m * (height * of.height).exp(),
            yaw_rad: told.yaw_rad + self.yaw * of.yaw_rad,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::zone::ZoneConfig;

    /// At 10 m/s the zone ends 28.6 m ahead.
    fn state() -> EgoState {
        EgoState {
            speed_mps: 10.0,
            steering_angle_rad: 0.0,
            yaw_rate_rps: 0.0,
            acceleration_mps2: 0.0,
            wheelbase_m: 2.7,
            front_bumper_x_m: 3.6,
        }
    }

    /// The verdict on a box of 1 m that is off along x by this much.
    fn verdict(x_m: f64, spread_m: Option<f64>) -> f64 {
        let center = Point::new(x_m, 0.0, 0.5);
        let spread = spread_m.map(|x_m| BoxSpread {
            x_m,
            y_m: 0.01,
            z_m: 0.01,
            length: 0.01,
            width: 0.01,
            height: 0.01,
            yaw_rad: 0.01,
        });
        let object = Detection {
            box_in_ego: Box3 { center, length_m: 1.0, width_m: 1.0, height_m: 1.0, yaw_rad: 0.0 },
            velocity_in_ego_mps: [0.0; 2],
            harm: Harm::Harmless,
            score: 1.0,
            spread,
        };
        let zone = Zone::try_from(ZoneConfig::default()).unwrap();
        ExpectedVerdict::at(&state(), &zone).unwrap().of(&object).unwrap()
    }

    #[test]
    fn it_is_as_sure_as_the_box() {
        assert_eq!((verdict(20.0, Some(0.1)), verdict(40.0, Some(0.1))), (1.0, 0.0));
        // A quarter of the box lies in the zone at 28.85 m: there the rule turns.
        let at_the_edge = verdict(28.85, Some(1.0));
        assert!((0.35..0.65).contains(&at_the_edge), "{at_the_edge}");
        assert!(verdict(32.0, Some(3.0)) > verdict(32.0, Some(0.3)));
        assert!(verdict(26.0, Some(3.0)) < verdict(26.0, Some(0.3)));
    }

    #[test]
    fn without_a_spread_the_state_alone_is_in_doubt() {
        assert_eq!((verdict(20.0, None), verdict(40.0, None)), (1.0, 0.0));
        let at_the_edge = verdict(28.85, None);
        assert!((0.2..0.8).contains(&at_the_edge), "{at_the_edge}");
    }

    #[test]
    fn draws_are_standard_and_their_mean_is_zero() {
        let of = |f: fn(&Draw) -> f64| {
            let mean = DRAWS.iter().map(f).sum::<f64>() / N_DRAWS as f64;
            (mean, DRAWS.iter().map(|draw| f(draw).powi(2)).sum::<f64>() / N_DRAWS as f64)
        };
        let parts: [fn(&Draw) -> f64; 3] = [|draw| draw.center[0], |draw| draw.yaw, |draw| draw.steering];
        for f in parts {
            let (mean, variance) = of(f);
            assert!(mean.abs() < 1e-12 && (0.5..1.6).contains(&variance), "{variance}");
        }
    }
}
