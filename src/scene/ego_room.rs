//! Room round the ego's body: what it meets on the arc of its wheels, what touches it, what is behind it.

use super::car::{EGO_LENGTH_M, MAX_STEERING_RAD, WHEELBASE_M};
use super::driving::Obstacle;
use super::ego_pose::EgoPose;
use super::occupancy::Footprint;
use super::path::direction_of;

/// What is this near to the body touches it.
const TOUCH_M: f64 = 0.1;
/// A steering angle leads past what it does not meet within this way, and angles are tried in such steps.
const DODGED_M: f64 = 2.5;
const DODGE_STEP_RAD: f64 = 0.05;

/// What the body meets first on the arc of a steering angle, but for what drives on, and what it meets already.
pub(super) fn first_hit<'a>(
    pose: &EgoPose,
    steering_rad: f64,
    reach_m: f64,
    others: &'a [Obstacle],
) -> Option<&'a Obstacle> {
    let curvature = steering_rad.tan() / WHEELBASE_M;
    let body = pose.obstacle().footprint;
    let n = (reach_m / 0.5).ceil() as usize;
    let (mut position, mut yaw_rad) = (pose.position, pose.yaw_rad);
    (0..n).find_map(|_| {
        position += direction_of(yaw_rad) * 0.5;
        yaw_rad += curvature * 0.5;
        let ahead = EgoPose { position, yaw_rad, ..*pose }.obstacle().footprint.grow(0.08);
        others.iter().find(|other| {
            let moves = other.velocity_mps.norm() > 1.0;
            !moves && ahead.meets(&other.footprint) && !body.meets(&other.footprint)
        })
    })
}

/// The steering angle nearest to a wanted one whose arc leads past all that stands near; the wanted one if there is none.
pub(super) fn dodge(pose: &EgoPose, wanted_rad: f64, others: &[Obstacle]) -> f64 {
    // Full lock is all that the wheels can do.
    let wanted_rad = wanted_rad.clamp(-MAX_STEERING_RAD, MAX_STEERING_RAD);
    let is_near = |other: &&Obstacle| {
        let away_m = (other.footprint.center - pose.position).norm();
        other.is_still && away_m < EGO_LENGTH_M + DODGED_M + other.footprint.radius_m()
    };
    let near: Vec<Obstacle> = others.iter().filter(is_near).copied().collect();
    // From one lock to the other.
    let n_turns = (2.0 * MAX_STEERING_RAD / DODGE_STEP_RAD).round() as u32;
    let turns_rad = (0..=n_turns).flat_map(|i| [1.0, -1.0].map(|side| side * DODGE_STEP_RAD * f64::from(i)));
    let angles_rad = turns_rad.map(|turn_rad| wanted_rad + turn_rad);
    angles_rad
        .filter(|angle_rad| angle_rad.abs() <= MAX_STEERING_RAD + 1e-9)
        .find(|&angle_rad| first_hit(pose, angle_rad, DODGED_M, &near).is_none())
        .unwrap_or(wanted_rad)
}

/// Whether something that stands, other than a vehicle, touches the front.
pub(super) fn pushes(pose: &EgoPose, others: &[Obstacle]) -> bool {
    let body = pose.obstacle().footprint;
    let front = Footprint { center: body.at(body.length_m / 2.0, 0.0), length_m: 2.0 * TOUCH_M, ..body };
    others.iter().any(|other| other.is_still && !other.is_vehicle && other.footprint.meets(&front))
}

/// Whether something that stands touches the body.
pub(super) fn touches(pose: &EgoPose, others: &[Obstacle]) -> bool {
    let body = pose.obstacle().footprint.grow(TOUCH_M);
    others.iter().any(|other| other.is_still && other.footprint.meets(&body))
}

/// Whether nothing hinders backing up.
pub(super) fn is_free_behind(pose: &EgoPose, others: &[Obstacle]) -> bool {
    let body = pose.obstacle().footprint;
    let behind =
        Footprint { center: body.center - pose.direction() * 1.5, length_m: body.length_m + 2.0, ..body };
    // A thing that touches the front does not hinder backing up.
    let rear = |other: &&Obstacle| (other.footprint.center - body.center).dot(&pose.direction()) < 0.0;
    !others.iter().filter(rear).any(|other| other.footprint.meets(&behind))
}

#[cfg(test)]
mod tests {
    use super::super::driving::Owner;
    use super::super::path::Vec2;
    use super::*;

    const STANDS: EgoPose =
        EgoPose { position: Vec2::new(0.0, 0.0), yaw_rad: 0.0, speed_mps: 0.0, grade: 0.0 };

    fn thing(x_m: f64, y_m: f64) -> Obstacle {
        Obstacle {
            owner: Owner::Placement(0),
            footprint: Footprint::square(Vec2::new(x_m, y_m), 0.5),
            velocity_mps: Vec2::zeros(),
            is_still: true,
            is_vehicle: false,
            backs_up: false,
        }
    }

    #[test]
    fn the_wheels_turn_away_from_what_stands_before_a_corner_of_the_car() {
        assert!(dodge(&STANDS, 0.0, &[]).abs() < 1e-12);
        assert_eq!(dodge(&STANDS, 0.8, &[]), MAX_STEERING_RAD);
        let on_the_right = [thing(5.0, -0.9)];
        assert!(first_hit(&STANDS, 0.0, DODGED_M, &on_the_right).is_some());
        let angle_rad = dodge(&STANDS, 0.0, &on_the_right);
        assert!(angle_rad > 0.0 && first_hit(&STANDS, angle_rad, DODGED_M, &on_the_right).is_none());
        // A wall leaves no angle.
        let footprint = Footprint { width_m: 20.0, ..thing(4.5, 0.0).footprint };
        let beside_wall_rad = dodge(&STANDS, 0.1, &[Obstacle { footprint, ..thing(4.5, 0.0) }]);
        assert!((beside_wall_rad - 0.1).abs() < 1e-12, "{beside_wall_rad}");
    }

    #[test]
    fn what_the_bumper_touches_is_pushed_and_what_is_behind_hinders_backing_up() {
        assert!(pushes(&STANDS, &[thing(3.65, 0.3)]) && touches(&STANDS, &[thing(3.65, 0.3)]));
        assert!(!pushes(&STANDS, &[thing(1.5, 1.15)]) && touches(&STANDS, &[thing(1.5, 1.15)]));
        assert!(!touches(&STANDS, &[thing(4.0, 0.0)]));
        assert!(is_free_behind(&STANDS, &[thing(4.0, 0.0)]) && !is_free_behind(&STANDS, &[thing(-1.5, 0.0)]));
    }
}
