//! Where the ego was at any time, and how it moved, from a drive's odometry.
//!
//! Between two poses position and rotation run evenly. Speed, acceleration and yaw rate come from parabolas through the poses around a
//! time (least squares over plus and minus `smoothing_s`), so that they are smooth and not late at a drive's ends.

use nalgebra::{Isometry3, Matrix3, Vector3};

use super::Odometry;
use crate::geometry::{Ego, Transform, World};

/// Two neighbouring poses or values further apart than this are not joined: the log has a hole there. Poses of one a second come late at
/// times.
pub(super) const MAX_GAP_NS: u64 = 1_500_000_000;
/// Times at which poses enter a parabola.
const N_KNOTS: i64 = 21;

/// Poses and measurements at any time.
pub(super) struct Motion<'a> {
    pub(super) odometry: &'a Odometry,
    pub(super) tolerance_ns: u64,
    pub(super) smoothing_ns: u64,
}

/// A fit of the poses around a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Course {
    pub(super) speed_mps: f64,
    pub(super) acceleration_mps2: f64,
    pub(super) yaw_rate_rps: f64,
}

impl Motion<'_> {
    /// The ego's pose; `None` where the poses end further away than the tolerance, or have a hole.
    pub(super) fn pose_at(&self, time_ns: u64) -> Option<Transform<World, Ego>> {
        let poses = &self.odometry.poses;
        let (first_ns, last_ns) = (poses.first()?.0, poses.last()?.0);
        let is_covered = (first_ns.saturating_sub(self.tolerance_ns)
            ..=last_ns.saturating_add(self.tolerance_ns))
            .contains(&time_ns);
        let after = poses.partition_point(|(at_ns, _)| *at_ns < time_ns);
        if let Some((_, pose)) = poses.get(after).filter(|(at_ns, _)| *at_ns == time_ns) {
            return Some(*pose);
        }
        if after > 0 && after < poses.len() && poses[after].0 - poses[after - 1].0 > MAX_GAP_NS {
            let (before_ns, after_ns) = (poses[after - 1].0, poses[after].0);
            let near_ns = (time_ns - before_ns).min(after_ns - time_ns);
            return (near_ns <= self.tolerance_ns).then(|| self.pose_beyond(time_ns));
        }
        is_covered.then(|| self.pose_beyond(time_ns))
    }

    /// The length of the hole in the poses around a time, if there is one.
    pub(super) fn hole_ns(&self, time_ns: u64) -> Option<u64> {
        let poses = &self.odometry.poses;
        let after = poses.partition_point(|(at_ns, _)| *at_ns < time_ns);
        let hole_ns = poses.get(after)?.0 - poses.get(after.checked_sub(1)?)?.0;
        (hole_ns > MAX_GAP_NS).then_some(hole_ns)
    }

    /// As [`Self::pose_at`], carried on evenly from the nearest two poses wherever they end. There must be a pose.
    pub(super) fn pose_beyond(&self, time_ns: u64) -> Transform<World, Ego> {
        let poses = &self.odometry.poses;
        let [.., (last_ns, last)] = poses.as_slice() else {
            return Transform::from_xyz_yaw(0.0, 0.0, 0.0, 0.0);
        };
        if poses.len() == 1 || time_ns == *last_ns {
            return *last;
        }
        let after = poses.partition_point(|(at_ns, _)| *at_ns <= time_ns).clamp(1, poses.len() - 1);
        let ((from_ns, from), (to_ns, to)) = (&poses[after - 1], &poses[after]);
        let share = signed_s(*from_ns, time_ns) / signed_s(*from_ns, *to_ns);
        Transform::from_isometry(between(&from.isometry, &to.isometry, share))
    }

    /// Moves what is in the ego frame of one time into that of another, since the car goes on between a sample and a picture;
    /// the identity where either pose is not known.
    pub(super) fn ego_from_ego(&self, to_ns: u64, from_ns: u64) -> Transform<Ego, Ego> {
        match (self.pose_at(to_ns), self.pose_at(from_ns)) {
            (Some(to), Some(from)) if to_ns != from_ns => to.inverse() * from,
            _ => Transform::from_isometry(Isometry3::identity()),
        }
    }

    /// Whether there are poses at all.
    pub(super) fn has_poses(&self) -> bool {
        !self.odometry.poses.is_empty()
    }

    /// How the ego moved around a time; `None` where poses are too few or too far.
    pub(super) fn course_at(&self, time_ns: u64) -> Option<Course> {
        let here = self.pose_at(time_ns)?;
        let (from_ns, to_ns) =
            (time_ns.saturating_sub(self.smoothing_ns), time_ns.saturating_add(self.smoothing_ns));
        let (from_ns, to_ns) = self.without_hole(time_ns, from_ns, to_ns);
        // A parabola through less than a tenth of a second is noise.
        if to_ns <= from_ns || to_ns - from_ns < 100_000_000 {
            return None;
        }
        let mut knots = Vec::new();
        for i in 0..N_KNOTS {
            let at_ns = from_ns + (to_ns - from_ns) / (N_KNOTS as u64 - 1) * i as u64;
            let ego_here_from_ego = here.inverse() * self.pose_at(at_ns)?;
            let ahead_m = ego_here_from_ego.isometry.translation.vector.x;
            knots.push((signed_s(time_ns, at_ns), ahead_m, ego_here_from_ego.yaw_rad()));
        }
        let [_, speed_mps, half_acceleration] =
            parabola(knots.iter().map(|&(at_s, ahead_m, _)| (at_s, ahead_m)))?;
        let [_, yaw_rate_rps, _] = parabola(knots.iter().map(|&(at_s, _, yaw_rad)| (at_s, yaw_rad)))?;
        Some(Course { speed_mps, acceleration_mps2: 2.0 * half_acceleration, yaw_rate_rps })
    }

    /// The part of a span around a time that poses cover without a hole.
    fn without_hole(&self, time_ns: u64, from_ns: u64, to_ns: u64) -> (u64, u64) {
        let poses = &self.odometry.poses;
        let after = poses.partition_point(|(at_ns, _)| *at_ns < time_ns).min(poses.len() - 1);
        let is_before = after > 0 && time_ns.abs_diff(poses[after - 1].0) < poses[after].0.abs_diff(time_ns);
        let nearest = if is_before { after - 1 } else { after };
        let is_near = |one: usize, other: usize| poses[other].0 - poses[one].0 <= MAX_GAP_NS;
        let (mut first, mut last) = (nearest, nearest);
        while first > 0 && poses[first].0 > from_ns && is_near(first - 1, first) {
            first -= 1;
        }
        while last + 1 < poses.len() && poses[last].0 < to_ns && is_near(last, last + 1) {
            last += 1;
        }
        (from_ns.max(poses[first].0), to_ns.min(poses[last].0))
    }

    /// A measured value, evenly between its neighbours; `None` where the series ends further away than the tolerance.
    pub(super) fn value_at(&self, values: &[(u64, f64)], time_ns: u64) -> Option<f64> {
        let after = values.partition_point(|(at_ns, _)| *at_ns < time_ns);
        let neighbours = (after.checked_sub(1).and_then(|i| values.get(i)), values.get(after));
        let is_near = |at_ns: u64| at_ns.abs_diff(time_ns) <= self.tolerance_ns;
        match neighbours {
            (Some(&(before_ns, before)), Some(&(after_ns, after))) if after_ns - before_ns <= MAX_GAP_NS => {
                let share = (time_ns - before_ns) as f64 / (after_ns - before_ns) as f64;
                Some(before + share * (after - before))
            }
            (_, Some(&(after_ns, after))) if is_near(after_ns) => Some(after),
            (Some(&(before_ns, before)), _) if is_near(before_ns) => Some(before),
            _ => None,
        }
    }

    /// The pose's time that is nearest, for messages.
    pub(super) fn nearest_pose_ns(&self, time_ns: u64) -> Option<u64> {
        self.odometry.poses.iter().map(|(at_ns, _)| *at_ns).min_by_key(|at_ns| at_ns.abs_diff(time_ns))
    }
}

/// `to` after `from` in seconds, negative before it.
pub(super) fn signed_s(from_ns: u64, to_ns: u64) -> f64 {
    (i128::from(to_ns) - i128::from(from_ns)) as f64 * 1e-9
}

/// The time `offset_s` after another.
pub(super) fn shifted_ns(time_ns: u64, offset_s: f64) -> u64 {
    time_ns.saturating_add_signed((offset_s * 1e9).round() as i64)
}

/// The pose at a share of the way from one to another, also before 0 and beyond 1.
fn between(from: &Isometry3<f64>, to: &Isometry3<f64>, share: f64) -> Isometry3<f64> {
    let along = from.translation.vector.lerp(&to.translation.vector, share);
    let turn = (from.rotation.inverse() * to.rotation).powf(share);
    Isometry3::from_parts(along.into(), from.rotation * turn)
}

/// Least squares of `a + b t + c t^2`; `None` where the times do not determine it.
fn parabola(knots: impl Iterator<Item = (f64, f64)>) -> Option<[f64; 3]> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (t, value) in knots {
        let row = Vector3::new(1.0, t, t * t);
        normal += row * row.transpose();
        right += row * value;
    }
    Some((normal.try_inverse()? * right).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::Series;

    /// A circle of 20 m to the left at 5 m/s, with a pose each 0.1 s for 4 s.
    fn circle() -> Odometry {
        let pose = |i: u64| {
            let turned = 0.25 * i as f64 * 0.1;
            let (x, y) = (20.0 * turned.sin(), 20.0 - 20.0 * turned.cos());
            (i * 100_000_000, Transform::from_xyz_yaw(x, y, 0.0, turned))
        };
        Odometry { poses: (0..=40).map(pose).collect(), ..Odometry::default() }
    }

    fn motion(odometry: &Odometry) -> Motion<'_> {
        Motion { odometry, tolerance_ns: 50_000_000, smoothing_ns: 500_000_000 }
    }

    #[test]
    fn a_circle_has_its_speed_and_yaw_rate_in_the_middle_and_at_the_ends() {
        let odometry = circle();
        for time_ns in [0, 2_000_000_000, 4_000_000_000] {
            let course = motion(&odometry).course_at(time_ns).unwrap();
            assert!((course.speed_mps - 5.0).abs() < 0.03, "{course:?}");
            assert!((course.yaw_rate_rps - 0.25).abs() < 1e-6, "{course:?}");
        }
    }

    #[test]
    fn a_pose_between_two_lies_between_them_and_none_lies_beyond_the_tolerance() {
        let odometry = circle();
        let motion = motion(&odometry);
        let yaw_rad = motion.pose_at(1_950_000_000).unwrap().yaw_rad();
        assert!((yaw_rad - 0.4875).abs() < 1e-12);
        assert!(motion.pose_at(4_040_000_000).is_some() && motion.pose_at(4_060_000_000).is_none());
        assert!((motion.pose_beyond(4_100_000_000).yaw_rad() - 1.025).abs() < 1e-9);
    }

    #[test]
    fn a_hole_in_the_poses_is_not_bridged() {
        let mut odometry = circle();
        odometry.poses.drain(5..30);
        let motion = motion(&odometry);
        assert!(motion.pose_at(1_500_000_000).is_none() && motion.course_at(1_500_000_000).is_none());
        assert_eq!(motion.hole_ns(1_500_000_000), Some(2_600_000_000));
        assert_eq!((motion.hole_ns(200_000_000), motion.hole_ns(9_000_000_000)), (None, None));
        // At its edges, what is on this side of it tells the course.
        for time_ns in [200_000_000, 400_000_000, 440_000_000, 2_960_000_000, 3_000_000_000, 3_400_000_000] {
            let course = motion.course_at(time_ns).unwrap();
            assert!((course.speed_mps - 5.0).abs() < 0.1, "{time_ns}: {course:?}");
        }
    }

    #[test]
    fn poses_of_one_a_second_are_joined_though_one_comes_late() {
        let mut odometry = circle();
        let kept_ns = [0, 1_000_000_000, 2_400_000_000, 4_000_000_000];
        odometry.poses.retain(|(at_ns, _)| kept_ns.contains(at_ns));
        let motion = motion(&odometry);
        assert!(motion.pose_at(1_700_000_000).is_some() && motion.pose_at(3_200_000_000).is_none());
    }

    #[test]
    fn a_measured_value_is_read_between_its_neighbours() {
        let odometry = Odometry::default();
        let series = Series { source: String::new(), values: vec![(0, 1.0), (200_000_000, 3.0)] };
        let value = |time_ns| motion(&odometry).value_at(&series.values, time_ns);
        assert_eq!(value(100_000_000), Some(2.0));
        assert_eq!(value(240_000_000), Some(3.0));
        assert_eq!(value(260_000_000), None);
    }
}
