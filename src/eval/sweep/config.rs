//! What is swept: changes of the ego's state, and their values.

use serde::{Deserialize, Serialize};

use crate::config::{Check, Rule, SHARE, define_config, from_to, impl_checked};
use crate::eval::judge::Judge;
use crate::sample::EgoState;

define_config! {
    /// What to sweep; `configs/sweep.toml` equals the default.
    pub struct SweepConfig {
        /// Speeds that the frames are given, m/s. Default 0 to 14 by 1, the paper's.
        speed_mps: Vec<f64> = steps(0..=14, 1.0), in SPEED.list(0, 200);
        /// Steering angles that the frames are given, degrees, positive to the left. Default -35 to 35 by 5, the paper's.
        steering_deg: Vec<f64> = steps(-7..=7, 5.0), in STEERING.list(0, 200);
        /// Factors by which the speed sensor is wrong. Default 0.8 to 1.2 by 0.05.
        speed_factor: Vec<f64> =
            (16..=24).map(|i| f64::from(i) / 20.0).collect(), in from_to(0.0, 100.0).list(0, 200);
        /// Offsets by which the steering sensor is wrong, degrees. Default -4 to 4 by 1.
        steering_offset_deg: Vec<f64> = steps(-4..=4, 1.0), in STEERING.list(0, 200);
        /// What decides on harm. Default all.
        judges: Vec<Judge> = Judge::ALL.to_vec();
        /// How many of the first episodes are used; 0 for all. Default 0.
        n_episodes: usize = 0, in from_to(0.0, 1e9);
        /// Speeds of the picture of one frame, m/s, one panel each. Default 2, 7, 14.
        picture_speed_mps: Vec<f64> = vec![2.0, 7.0, 14.0], in SPEED.list(0, 12);
        /// Steering angles of the picture of one frame, degrees, one panel each. Default -20, 0, 20.
        picture_steering_deg: Vec<f64> = vec![-20.0, 0.0, 20.0], in STEERING.list(0, 12);
        /// Lowest score of the boxes drawn in pictures. Default 0.3.
        picture_min_score: f32 = 0.3, in SHARE;
    }
}

fn steps(range: std::ops::RangeInclusive<i32>, step: f64) -> Vec<f64> {
    range.map(|i| f64::from(i) * step).collect()
}

impl Check for SweepConfig {}

const SPEED: Rule = from_to(-100.0, 100.0);
/// Stays below a right angle, at which a car does not drive on.
const STEERING: Rule = from_to(-80.0, 80.0);

/// Which part of the ego's state is changed; values are in the unit of the name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Change {
    /// The speed becomes the value.
    SpeedMps,
    /// The steering angle becomes the value, positive to the left.
    SteeringDeg,
    /// The speed is multiplied by the value.
    SpeedFactor,
    /// The value is added to the steering angle.
    SteeringOffsetDeg,
}

impl Change {
    /// All of them, in the order of the output.
    pub const ALL: [Self; 4] =
        [Self::SpeedMps, Self::SteeringDeg, Self::SpeedFactor, Self::SteeringOffsetDeg];

    /// The name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::SpeedMps => "speed_mps",
            Self::SteeringDeg => "steering_deg",
            Self::SpeedFactor => "speed_factor",
            Self::SteeringOffsetDeg => "steering_offset_deg",
        }
    }

    /// The state with one value of the change.
    #[must_use]
    pub fn apply(self, state: &EgoState, value: f64) -> EgoState {
        let mut changed = *state;
        match self {
            Self::SpeedMps => changed.speed_mps = value,
            Self::SteeringDeg => changed.steering_angle_rad = value.to_radians(),
            Self::SpeedFactor => changed.speed_mps *= value,
            Self::SteeringOffsetDeg => changed.steering_angle_rad += value.to_radians(),
        }
        changed
    }

    /// Whether the truth follows the change; where it does not, a sensor errs and the labels stay.
    #[must_use]
    pub fn moves_truth(self) -> bool {
        matches!(self, Self::SpeedMps | Self::SteeringDeg)
    }

    /// The values that a config gives the change.
    #[must_use]
    pub fn values(self, config: &SweepConfig) -> &[f64] {
        match self {
            Self::SpeedMps => &config.speed_mps,
            Self::SteeringDeg => &config.steering_deg,
            Self::SpeedFactor => &config.speed_factor,
            Self::SteeringOffsetDeg => &config.steering_offset_deg,
        }
    }
}

impl_checked!(SweepConfig);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_config_is_the_default() {
        let shipped: SweepConfig = toml::from_str(include_str!("../../../configs/sweep.toml")).unwrap();
        assert_eq!(shipped, SweepConfig::default());
        crate::config::assert_every_number_is_checked(&shipped);
    }
}
