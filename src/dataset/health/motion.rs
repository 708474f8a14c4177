//! What is odd about an episode's motion: gaps between samples, and a state that the poses contradict.

use super::check::{Aspect, Remark};
use crate::sample::Measured;

/// Speeds of state and poses may differ by this much, m/s, and by this share of the speed.
const MAX_SPEED_ERROR_MPS: f64 = 1.0;
const MAX_SPEED_ERROR: f64 = 0.2;
/// Samples farther apart than this many usual gaps have lost some between them.
const MAX_GAPS: f64 = 3.0;
/// Below this the wheels' angle cannot be told from the poses, m/s.
const MIN_SPEED_MPS: f64 = 3.0;
/// Steering angles of state and poses may differ by this much, radians.
const MAX_STEERING_ERROR_RAD: f64 = 0.1;

/// The states and poses of an episode.
#[derive(Default)]
pub(super) struct Motion {
    samples: Vec<Moment>,
}

struct Moment {
    time_s: f64,
    position_m: [f64; 2],
    yaw_rad: f64,
    speed_mps: f64,
    steering_angle_rad: f64,
    wheelbase_m: f64,
}

impl Motion {
    pub(super) fn add(&mut self, measured: &Measured) {
        let (pose, state) = (&measured.world_from_ego, &measured.ego_state);
        let at = pose.isometry.translation;
        self.samples.push(Moment {
            time_s: measured.time_ns as f64 * 1e-9,
            position_m: [at.x, at.y],
            yaw_rad: pose.yaw_rad(),
            speed_mps: state.speed_mps,
            steering_angle_rad: state.steering_angle_rad,
            wheelbase_m: state.wheelbase_m,
        });
    }

    /// Everything odd about the episode's motion.
    pub(super) fn judge(&self) -> Vec<Remark> {
        if self.samples.len() < 3 {
            return Vec::new();
        }
        [self.judge_gaps(), self.judge_speed(), self.judge_steering()].into_iter().flatten().collect()
    }

    fn steps(&self) -> impl Iterator<Item = (&Moment, &Moment)> {
        self.samples.iter().zip(&self.samples[1..])
    }

    fn judge_gaps(&self) -> Option<Remark> {
        let gaps_s: Vec<f64> = self.steps().map(|(one, next)| next.time_s - one.time_s).collect();
        let usual_s = median(gaps_s.clone());
        let widest_s = gaps_s.iter().copied().fold(0.0, f64::max);
        (widest_s > MAX_GAPS * usual_s).then(|| {
            let text = format!(
                "two samples are {widest_s:.2} s apart and most are {usual_s:.2} s apart; even gaps are needed to count \
                 events and distances"
            );
            Remark::warning(Aspect::Times, "gaps", text)
        })
    }

    fn judge_speed(&self) -> Option<Remark> {
        let by_pose: Vec<f64> =
            self.steps().map(|(one, next)| moved_m(one, next) / (next.time_s - one.time_s)).collect();
        let by_state: Vec<f64> =
            self.steps().map(|(one, next)| 0.5 * (one.speed_mps + next.speed_mps).abs()).collect();
        let error_mps = median(by_pose.iter().zip(&by_state).map(|(a, b)| (a - b).abs()).collect());
        let (pose_mps, state_mps) = (median(by_pose), median(by_state));
        (error_mps > MAX_SPEED_ERROR_MPS.max(MAX_SPEED_ERROR * pose_mps)).then(|| {
            let text = format!(
                "the state says {state_mps:.1} m/s and the poses {pose_mps:.1} m/s (medians); both should agree: the unit, \
                 the poses or the speed's topic may be wrong"
            );
            Remark::warning(Aspect::Motion, "speed", text)
        })
    }

    fn judge_steering(&self) -> Option<Remark> {
        let fast: Vec<(f64, f64)> = self
            .steps()
            .filter(|(one, next)| moved_m(one, next) > MIN_SPEED_MPS * (next.time_s - one.time_s))
            .map(|(one, next)| {
                let turned_rad = wrap(next.yaw_rad - one.yaw_rad);
                let by_pose = (one.wheelbase_m * turned_rad / moved_m(one, next)).atan();
                (by_pose, 0.5 * (one.steering_angle_rad + next.steering_angle_rad))
            })
            .collect();
        if fast.len() < 3 {
            return None;
        }
        let error_rad = median(fast.iter().map(|(a, b)| (a - b).abs()).collect());
        (error_rad > MAX_STEERING_ERROR_RAD).then(|| {
            let text = format!(
                "the steering angle differs from that of the poses by {:.1} degrees (median); both should agree: it must be \
                 the road wheels' angle in radians, positive to the left",
                error_rad.to_degrees()
            );
            Remark::warning(Aspect::Motion, "steering", text)
        })
    }
}

fn moved_m(one: &Moment, next: &Moment) -> f64 {
    (next.position_m[0] - one.position_m[0]).hypot(next.position_m[1] - one.position_m[1])
}

fn wrap(angle_rad: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    (angle_rad + PI).rem_euclid(TAU) - PI
}

/// The middle value; 0 of none.
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drive(speed_mps: f64, told_mps: f64, steering_angle_rad: f64, told_rad: f64) -> Vec<Remark> {
        let (wheelbase_m, gap_s) = (2.7, 0.3);
        let yaw_rate = speed_mps * steering_angle_rad.tan() / wheelbase_m;
        let (mut x_m, mut y_m) = (0.0, 0.0);
        let moments = (0..20).map(|i| {
            let time_s = f64::from(i) * gap_s;
            let yaw_rad = yaw_rate * time_s;
            let at = [x_m, y_m];
            x_m += speed_mps * gap_s * (yaw_rad + 0.5 * yaw_rate * gap_s).cos();
            y_m += speed_mps * gap_s * (yaw_rad + 0.5 * yaw_rate * gap_s).sin();
            Moment {
                time_s,
                position_m: at,
                yaw_rad,
                speed_mps: told_mps,
                steering_angle_rad: told_rad,
                wheelbase_m,
            }
        });
        Motion { samples: moments.collect() }.judge()
    }

    #[test]
    fn a_state_that_the_poses_bear_out_is_fine() {
        assert_eq!(drive(8.0, 8.0, 0.1, 0.1), []);
        assert_eq!(drive(8.0, -8.0, 0.0, 0.0), [], "backwards");
    }

    #[test]
    fn kilometres_an_hour_and_the_steering_wheels_angle_are_told() {
        let checks = |remarks: Vec<Remark>| remarks.iter().map(|remark| remark.kind).collect::<Vec<_>>();
        assert_eq!(checks(drive(8.0, 28.8, 0.1, 0.1)), ["speed"]);
        assert_eq!(checks(drive(8.0, 8.0, 0.1, 1.5)), ["steering"]);
    }
}
