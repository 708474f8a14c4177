//! What is swept: changes of the ego's state, and their values.

use serde::{Deserialize, Serialize};

use crate::eval::judge::Judge;
use crate::sample::EgoState;

/// What is swept; `configs/sweep.toml` equals the default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SweepConfig {
    /// Speeds that the frames are given, m/s. Default 0 to 14 by 1, the paper's.
    pub speed_mps: Vec<f64>,
    /// Steering angles that the frames are given, degrees, positive to the left. Default -35 to 35 by 5, the paper's.
    pub steering_deg: Vec<f64>,
    /// Factors of a speed sensor that errs. Default 0.8 to 1.2 by 0.05.
    pub speed_factor: Vec<f64>,
    /// Offsets of a steering sensor that errs, degrees. Default -4 to 4 by 1.
    pub steering_offset_deg: Vec<f64>,
    /// Who decides on harm. Default all.
    pub judges: Vec<Judge>,
    /// Episodes that are looked at, the first ones; 0 for all. Default 0.
    pub n_episodes: usize,
    /// Speeds of the picture of one frame, m/s, one panel each. Default 2, 7, 14.
    pub picture_speed_mps: Vec<f64>,
    /// Steering angles of the picture of one frame, degrees, one panel each. Default -20, 0, 20.
    pub picture_steering_deg: Vec<f64>,
    /// Score from which boxes are drawn in pictures. Default 0.3.
    pub picture_min_score: f32,
}

impl Default for SweepConfig {
    fn default() -> Self {
        let steps = |range: std::ops::RangeInclusive<i32>, step: f64| range.map(move |i| f64::from(i) * step);
        Self {
            speed_mps: steps(0..=14, 1.0).collect(),
            steering_deg: steps(-7..=7, 5.0).collect(),
            speed_factor: (16..=24).map(|i| f64::from(i) / 20.0).collect(),
            steering_offset_deg: steps(-4..=4, 1.0).collect(),
            judges: Judge::ALL.to_vec(),
            n_episodes: 0,
            picture_speed_mps: vec![2.0, 7.0, 14.0],
            picture_steering_deg: vec![-20.0, 0.0, 20.0],
            picture_min_score: 0.3,
        }
    }
}

/// What is changed of the ego's state; values are in the unit of the name.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_config_is_the_default() {
        let shipped: SweepConfig = toml::from_str(include_str!("../../../configs/sweep.toml")).unwrap();
        assert_eq!(shipped, SweepConfig::default());
    }
}
