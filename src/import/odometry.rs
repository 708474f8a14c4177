//! Whether a drive's poses and its measurements fit each other: what does not is told, and imported as it is.

use super::motion::{Motion, signed_s};
use super::{Notes, Odometry, Series};

/// No road car drives faster, m/s: poses further apart hold a jump.
const MAX_SPEED_MPS: f64 = 80.0;
/// Below this the two sources of a speed are not compared, m/s.
const MOVING_MPS: f64 = 2.0;
/// Below this road-wheel angle the two sources of a steering angle are not compared.
const TURNING_RAD: f64 = 0.03;
/// Times at which sources are compared.
const N_TIMES: usize = 50;
/// Fewer than this say nothing.
const FEWEST: usize = 5;
/// Below this the two sources of a yaw rate are not compared, radians per second.
const TURNING_RPS: f64 = 0.05;
/// A car moves along its x axis, ahead or back, within this.
const MAX_HEADING_DEG: f64 = 30.0;
/// The time in which a car's way tells where it goes.
const STEP_NS: u64 = 200_000_000;
/// Sources whose middle ratio lies within these are taken as the same: tyres slip, wheels wear.
const SAME: std::ops::RangeInclusive<f64> = 0.8..=1.25;

/// Tells jumps of the poses, and measurements of which the poses say something else.
pub(super) fn check(motion: &Motion<'_>, times_ns: &[u64], wheelbase_m: f64, notes: &mut Notes) {
    tell_jumps(motion.odometry, notes);
    tell_heading(motion, times_ns, notes);
    let step = times_ns.len().div_ceil(N_TIMES).max(1);
    let times = || times_ns.iter().step_by(step).copied();
    let courses = || times().filter_map(|time_ns| Some((time_ns, motion.course_at(time_ns)?)));
    if let Some(speed) = &motion.odometry.speed_mps {
        let pair = |(time_ns, course): (u64, super::motion::Course)| {
            let measured_mps = motion.value_at(&speed.values, time_ns)?;
            (course.speed_mps.abs() > MOVING_MPS).then_some(measured_mps / course.speed_mps)
        };
        tell(speed, "speed", "is the unit m/s?", courses().filter_map(pair).collect(), notes);
    }
    if let Some(steering) = &motion.odometry.steering_angle_rad {
        let pair = |(time_ns, course): (u64, super::motion::Course)| {
            let measured_rad = motion.value_at(&steering.values, time_ns)?;
            let of_path_rad = (wheelbase_m * course.yaw_rate_rps / course.speed_mps).atan();
            let is_told = course.speed_mps.abs() > MOVING_MPS && of_path_rad.abs() > TURNING_RAD;
            is_told.then_some(measured_rad / of_path_rad)
        };
        let hint = "is it positive to the left, of the road wheels and not of the steering wheel, and the wheelbase right?";
        tell(steering, "steering angle", hint, courses().filter_map(pair).collect(), notes);
    }
    if let Some(yaw_rate) = &motion.odometry.yaw_rate_rps {
        let hint = "is it in rad/s, positive to the left, and does the sensor's z axis point up?";
        tell(yaw_rate, "yaw rate", hint, yaw_rate_ratios(motion, times_ns), notes);
    }
}

/// The measured yaw rate over that of the poses, in the middle; `None` where the car turns too seldom.
pub(super) fn yaw_rate_ratio(motion: &Motion<'_>, times_ns: &[u64]) -> Option<f64> {
    let mut ratios = yaw_rate_ratios(motion, times_ns);
    ratios.sort_by(f64::total_cmp);
    (ratios.len() >= FEWEST).then(|| ratios[ratios.len() / 2])
}

fn yaw_rate_ratios(motion: &Motion<'_>, times_ns: &[u64]) -> Vec<f64> {
    let Some(yaw_rate) = &motion.odometry.yaw_rate_rps else { return Vec::new() };
    let ratio = |time_ns: &u64| {
        let of_poses_rps = motion.course_at(*time_ns)?.yaw_rate_rps;
        let measured_rps = motion.value_at(&yaw_rate.values, *time_ns)?;
        (of_poses_rps.abs() > TURNING_RPS).then_some(measured_rps / of_poses_rps)
    };
    times_ns.iter().step_by(times_ns.len().div_ceil(N_TIMES).max(1)).filter_map(ratio).collect()
}

/// Tells poses whose x axis is not the direction in which the car moves.
fn tell_heading(motion: &Motion<'_>, times_ns: &[u64], notes: &mut Notes) {
    let aside_deg = |time_ns: &u64| {
        let (here, then) = (motion.pose_at(*time_ns)?, motion.pose_at(time_ns.saturating_add(STEP_NS))?);
        let way_m = (here.inverse() * then).isometry.translation.vector;
        let moves = way_m.x.hypot(way_m.y) > MOVING_MPS * STEP_NS as f64 * 1e-9;
        moves.then(|| way_m.y.atan2(way_m.x).abs().to_degrees())
    };
    let step = times_ns.len().div_ceil(N_TIMES).max(1);
    let mut angles_deg: Vec<f64> = times_ns.iter().step_by(step).filter_map(aside_deg).collect();
    if angles_deg.len() < FEWEST {
        return;
    }
    angles_deg.sort_by(f64::total_cmp);
    let middle_deg = angles_deg[angles_deg.len() / 2];
    if (MAX_HEADING_DEG..=180.0 - MAX_HEADING_DEG).contains(&middle_deg) {
        notes.tell(format!(
            "the car moves at {middle_deg:.0} degrees to the x axis of its poses; about 0 (or 180, backwards) would be right: is their \
             orientation the car's own?"
        ));
    }
}

fn tell(series: &Series, what: &str, hint: &str, mut ratios: Vec<f64>, notes: &mut Notes) {
    if ratios.len() < FEWEST {
        return;
    }
    ratios.sort_by(f64::total_cmp);
    let middle = ratios[ratios.len() / 2];
    if !SAME.contains(&middle) {
        notes.tell(format!(
            "the {what}, {}, is {middle:.2} times what the poses say; about 1 would be right: {hint}",
            series.source
        ));
    }
}

fn tell_jumps(odometry: &Odometry, notes: &mut Notes) {
    let mut n_jumps = 0;
    let mut largest = (0.0, 0.0, 0);
    for pair in odometry.poses.windows(2) {
        let [(before_ns, before), (after_ns, after)] = pair else { continue };
        let (span_s, moved_m) = (
            signed_s(*before_ns, *after_ns),
            (after.isometry.translation.vector - before.isometry.translation.vector).norm(),
        );
        if moved_m > MAX_SPEED_MPS * span_s {
            n_jumps += 1;
            if moved_m > largest.0 {
                largest = (moved_m, span_s, *after_ns);
            }
        }
    }
    if n_jumps > 0 {
        let (moved_m, span_s, at_ns) = largest;
        notes.tell(format!(
            "the poses jump {n_jumps} times, by up to {moved_m:.1} m in {span_s:.3} s at {at_ns} ns; less than {MAX_SPEED_MPS} m/s would be \
             right"
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Transform;

    /// What is told of 10 s straight on at 10 m/s, with the pose at `jump` moved aside and speeds scaled.
    fn told(jump: Option<usize>, scale: f64) -> Vec<String> {
        let time_ns = |i: usize| 1_000_000_000 + 100_000_000 * i as u64;
        let place = |i: usize| {
            let aside_m = if jump == Some(i) { 500.0 } else { 0.0 };
            (time_ns(i), Transform::from_xyz_yaw(i as f64, aside_m, 0.0, 0.0))
        };
        let speeds = (0..100).map(|i| (time_ns(i), 10.0 * scale)).collect();
        let odometry = Odometry {
            poses: (0..100).map(place).collect(),
            speed_mps: Some(Series { source: "measured".into(), values: speeds }),
            ..Odometry::default()
        };
        let motion = Motion { odometry: &odometry, tolerance_ns: 50_000_000, smoothing_ns: 500_000_000 };
        let mut notes = Notes::default();
        let times: Vec<u64> = (0..100).map(time_ns).collect();
        check(&motion, &times, 2.7, &mut notes);
        notes.sentences().collect()
    }

    /// What is told of a circle to the left at 10 m/s and 0.5 rad/s, with poses that are turned and another measured yaw rate.
    fn told_of_circle(turned_rad: f64, yaw_rate_rps: f64) -> Vec<String> {
        let times: Vec<u64> = (0..100).map(|i| 1_000_000_000 + 100_000_000 * i).collect();
        let place = |at_ns: &u64| {
            let angle = 0.5 * (*at_ns as f64 * 1e-9 - 1.0);
            let (x, y) = (20.0 * angle.sin(), 20.0 - 20.0 * angle.cos());
            (*at_ns, Transform::from_xyz_yaw(x, y, 0.0, angle + turned_rad))
        };
        let values = times.iter().map(|at_ns| (*at_ns, yaw_rate_rps)).collect();
        let odometry = Odometry {
            poses: times.iter().map(place).collect(),
            yaw_rate_rps: Some(Series { source: "measured".into(), values }),
            ..Odometry::default()
        };
        let motion = Motion { odometry: &odometry, tolerance_ns: 50_000_000, smoothing_ns: 500_000_000 };
        let mut notes = Notes::default();
        check(&motion, &times, 2.7, &mut notes);
        notes.sentences().collect()
    }

    #[test]
    fn a_yaw_rate_of_the_other_sign_and_a_heading_aside_are_told() {
        assert!(told_of_circle(0.0, 0.5).is_empty());
        // Backwards all the time.
        assert!(told_of_circle(std::f64::consts::PI, 0.5).is_empty());
        let turns = told_of_circle(0.0, -0.5);
        assert!(turns.len() == 1 && turns[0].contains("yaw rate, measured, is -1.00 times"), "{turns:?}");
        let aside = told_of_circle(1.5, 0.5);
        assert!(aside.len() == 1 && aside[0].contains("moves at 83 degrees to the x axis"), "{aside:?}");
    }

    #[test]
    fn jumps_and_wrong_units_are_told_and_a_good_drive_is_not() {
        assert!(told(None, 1.0).is_empty());
        let jumps = told(Some(40), 1.0);
        assert!(jumps[0].contains("jump 2 times, by up to 500.0 m"), "{jumps:?}");
        let speeds = told(None, 1.0 / 3.6);
        assert!(speeds[0].contains("speed, measured, is 0.28 times"), "{speeds:?}");
    }
}
