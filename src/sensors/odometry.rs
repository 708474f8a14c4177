//! The car's own sensors of speed and steering: a wheel of another size, a steering angle that is off, noise in both.

use rand_distr::{Distribution, StandardNormal};

use super::rig_config::OdometryConfig;
use crate::random;
use crate::sample::EgoState;

/// The state of sample `sample_idx` as the car measures it; `None` where its sensors tell the truth.
///
/// A wheel that stands tells so: speed noise comes in from 0.5 m/s on.
#[must_use]
pub fn measure(state: &EgoState, config: &OdometryConfig, seed: u64, sample_idx: u64) -> Option<EgoState> {
    if *config == OdometryConfig::default() {
        return None;
    }
    let mut rng = random::stream(seed, "odometry", sample_idx);
    let [speed_draw, steering_draw]: [f64; 2] = std::array::from_fn(|_| StandardNormal.sample(&mut rng));
    let moves = (state.speed_mps.abs() / FULL_NOISE_MPS).min(1.0);
    let steering_deg = config.steering_bias_deg + config.steering_noise_deg * steering_draw;
    Some(EgoState {
        speed_mps: state.speed_mps * config.speed_factor + moves * config.speed_noise_mps * speed_draw,
        steering_angle_rad: state.steering_angle_rad + steering_deg.to_radians(),
        ..*state
    })
}

/// From this speed on the noise is whole.
const FULL_NOISE_MPS: f64 = 0.5;

#[cfg(test)]
mod tests {
    use super::*;

    fn state(speed_mps: f64) -> EgoState {
        EgoState {
            speed_mps,
            steering_angle_rad: 0.1,
            yaw_rate_rps: 0.0,
            acceleration_mps2: 0.0,
            wheelbase_m: 2.7,
            front_bumper_x_m: 3.6,
        }
    }

    #[test]
    fn sensors_err_by_factor_bias_and_noise_and_a_standing_wheel_tells_zero() {
        let config = OdometryConfig {
            speed_factor: 1.02,
            speed_noise_mps: 0.1,
            steering_bias_deg: 0.5,
            steering_noise_deg: 0.2,
        };
        let told: Vec<EgoState> =
            (0..4000).map(|i| measure(&state(10.0), &config, 1, i).expect("it errs")).collect();
        let moments = |of: fn(&EgoState) -> f64| {
            let mean = told.iter().map(of).sum::<f64>() / told.len() as f64;
            let square = told.iter().map(|told| (of(told) - mean).powi(2)).sum::<f64>();
            (mean, (square / told.len() as f64).sqrt())
        };
        let (speed, spread) = moments(|told| told.speed_mps);
        assert!((speed - 10.2).abs() < 0.01 && (spread - 0.1).abs() < 0.01, "{speed} {spread}");
        let (angle, spread) = moments(|told| (told.steering_angle_rad - 0.1).to_degrees());
        assert!((angle - 0.5).abs() < 0.02 && (spread - 0.2).abs() < 0.02, "{angle} {spread}");
        assert_eq!(measure(&state(0.0), &config, 1, 0).map(|told| told.speed_mps), Some(0.0));
        assert_eq!(measure(&state(5.0), &OdometryConfig::default(), 1, 0), None);
    }
}
