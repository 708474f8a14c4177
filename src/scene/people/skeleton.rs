//! Where the joints of a body are in a pose. The frame is the person's: x forward, y left, z up, origin on the ground.

use nalgebra::{Rotation3, Unit};

use super::shell::Vec3;
use super::stature::Body;

/// Left, then right: the sign of y.
pub const SIDES: [f64; 2] = [1.0, -1.0];

/// A foot by its ankle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Foot {
    pub ankle: Vec3,
    /// Above zero the toes point upwards.
    pub pitch_rad: f64,
    pub yaw_rad: f64,
}

/// What an arm does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Arm {
    /// Forwards at the shoulder, away from the trunk, and bent at the elbow.
    Hangs { flexion_rad: f64, abduction_rad: f64, elbow_rad: f64 },
    /// The wrist is at a place.
    Reaches(Vec3),
}

/// All that a body may do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Middle between the hips' joints; its height is a wish that the legs may lower.
    pub pelvis: Vec3,
    /// To the left as seen from above.
    pub pelvis_yaw_rad: f64,
    pub chest_yaw_rad: f64,
    /// The trunk's lean forwards, and to the left.
    pub lean_rad: f64,
    pub tilt_rad: f64,
    /// Of the head against the trunk: downwards, and to the left.
    pub nod_rad: f64,
    pub look_rad: f64,
    pub feet: [Foot; 2],
    pub arms: [Arm; 2],
}

/// A body in a pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Skeleton {
    pub pelvis: Vec3,
    pub pelvis_left: Vec3,
    /// Middle of the trunk, and of the shoulders.
    pub waist: Vec3,
    pub chest: Vec3,
    pub chest_left: Vec3,
    pub chest_up: Vec3,
    /// Middle of the head, and its axes: forward, left, up.
    pub head: Vec3,
    pub head_axes: [Vec3; 3],
    pub hips: [Vec3; 2],
    pub knees: [Vec3; 2],
    pub ankles: [Vec3; 2],
    /// Forward and up of each foot.
    pub feet: [[Vec3; 2]; 2],
    pub shoulders: [Vec3; 2],
    pub elbows: [Vec3; 2],
    pub wrists: [Vec3; 2],
}

fn about(axis: Vec3, angle_rad: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Unit::new_normalize(axis), angle_rad)
}

/// The middle joint of two bones from one place to another, bent towards `pole`; what is too far is drawn nearer.
fn bend(from: Vec3, to: Vec3, [first_m, second_m]: [f64; 2], pole: Vec3) -> (Vec3, Vec3) {
    let way = to - from;
    let reach_m = way.norm().clamp((first_m - second_m).abs() + 0.02, 0.999 * (first_m + second_m));
    let along = way.try_normalize(1e-9).unwrap_or(-Vec3::z());
    let along_m = (first_m * first_m - second_m * second_m + reach_m * reach_m) / (2.0 * reach_m);
    let beside = (pole - along * pole.dot(&along)).try_normalize(1e-9).unwrap_or(Vec3::x());
    let middle = from + along * along_m + beside * (first_m * first_m - along_m * along_m).max(0.0).sqrt();
    (middle, from + along * reach_m)
}

impl Skeleton {
    pub fn new(body: &Body, pose: &Pose) -> Self {
        let pelvis_turn = about(Vec3::z(), pose.pelvis_yaw_rad);
        let pelvis_left = pelvis_turn * Vec3::y();
        let leg_m = body.leg_m();
        let hip_at = |pelvis: Vec3, side: f64| pelvis + pelvis_left * (side * body.half_hips_m);
        // The pelvis sinks until both legs reach.
        let mut pelvis = pose.pelvis;
        for (side, foot) in SIDES.iter().zip(&pose.feet) {
            let away_m = (hip_at(pelvis, *side) - foot.ankle).xy().norm().min(0.97 * leg_m);
            let most_m = ((0.992 * leg_m).powi(2) - away_m * away_m).sqrt();
            pelvis.z = pelvis.z.min(foot.ankle.z + most_m);
        }
        let turn_of = |share: f64| {
            let yaw_rad = pose.pelvis_yaw_rad + share * (pose.chest_yaw_rad - pose.pelvis_yaw_rad);
            about(Vec3::z(), yaw_rad)
                * about(Vec3::y(), share * pose.lean_rad)
                * about(Vec3::x(), -share * pose.tilt_rad)
        };
        let waist = pelvis + turn_of(0.6) * Vec3::z() * (0.42 * body.trunk_m);
        let chest_turn = turn_of(1.0);
        let chest = waist + chest_turn * Vec3::z() * (0.58 * body.trunk_m);
        let head_turn = chest_turn
            * about(Vec3::z(), pose.look_rad)
            * about(Vec3::y(), pose.nod_rad - 0.5 * pose.lean_rad);
        let neck_m = body.height_m - body.hip_m - body.trunk_m - body.head_m;
        let neck = chest + chest_turn * Vec3::new(0.1, 0.0, 1.0) * neck_m;
        let head = neck + head_turn * Vec3::new(0.012 * body.height_m, 0.0, 0.5 * body.head_m);

        let hips = SIDES.map(|side| hip_at(pelvis, side));
        let mut knees = hips;
        let mut ankles = hips;
        let mut feet = [[Vec3::x(), Vec3::z()]; 2];
        for i in 0..2 {
            let Foot { ankle, pitch_rad, yaw_rad } = pose.feet[i];
            let turn = about(Vec3::z(), yaw_rad) * about(Vec3::y(), -pitch_rad);
            feet[i] = [turn * Vec3::x(), turn * Vec3::z()];
            let pole = about(Vec3::z(), yaw_rad) * Vec3::new(1.0, 0.0, 0.35);
            (knees[i], ankles[i]) = bend(hips[i], ankle, [body.thigh_m, body.shank_m], pole);
        }
        let chest_left = chest_turn * Vec3::y();
        let shoulders = SIDES.map(|side| chest + chest_left * (side * body.half_shoulders_m));
        let mut elbows = shoulders;
        let mut wrists = shoulders;
        for i in 0..2 {
            let side = SIDES[i];
            match pose.arms[i] {
                Arm::Hangs { flexion_rad, abduction_rad, elbow_rad } => {
                    // An arm hangs down even where the trunk leans.
                    let trunk = about(Vec3::z(), pose.chest_yaw_rad) * about(Vec3::y(), 0.4 * pose.lean_rad);
                    let upper =
                        trunk * about(Vec3::y(), -flexion_rad) * about(Vec3::x(), side * abduction_rad);
                    elbows[i] = shoulders[i] - upper * Vec3::z() * body.upper_arm_m;
                    let lower =
                        upper * about(Vec3::x(), -side * 0.6 * abduction_rad) * about(Vec3::y(), -elbow_rad);
                    wrists[i] = elbows[i] - lower * Vec3::z() * body.forearm_m;
                }
                Arm::Reaches(target) => {
                    let pole = chest_turn * Vec3::new(-0.6, side * 0.5, -0.7);
                    let bones = [body.upper_arm_m, body.forearm_m];
                    (elbows[i], wrists[i]) = bend(shoulders[i], target, bones, pole);
                }
            }
        }
        Self {
            pelvis,
            pelvis_left,
            waist,
            chest,
            chest_left,
            chest_up: chest_turn * Vec3::z(),
            head,
            head_axes: [Vec3::x(), Vec3::y(), Vec3::z()].map(|axis| head_turn * axis),
            hips,
            knees,
            ankles,
            feet,
            shoulders,
            elbows,
            wrists,
        }
    }

    pub fn chest_forward(&self) -> Vec3 {
        self.chest_left.cross(&self.chest_up)
    }

    /// The way that a hand points.
    pub fn hand(&self, i: usize) -> Vec3 {
        (self.wrists[i] - self.elbows[i]).normalize()
    }

    /// A point of a leg, 0 at the hip, 1 at the ankle, and the way down along the leg there.
    pub fn leg_at(&self, i: usize, share: f64) -> (Vec3, Vec3) {
        let (hip, knee, ankle) = (self.hips[i], self.knees[i], self.ankles[i]);
        let (upper, lower) = ((knee - hip).normalize(), (ankle - knee).normalize());
        let at =
            if share < 0.5 { hip.lerp(&knee, 2.0 * share) } else { knee.lerp(&ankle, 2.0 * share - 1.0) };
        // The way turns around the knee, not in it.
        let turned = ((share - 0.44) / 0.12).clamp(0.0, 1.0);
        (at, upper.lerp(&lower, turned).normalize())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bones_keep_their_lengths_and_bend_towards_the_pole() {
        let from = Vec3::new(0.0, 0.0, 1.0);
        let (middle, end) = bend(from, Vec3::new(0.1, 0.0, 0.3), [0.4, 0.45], Vec3::x());
        assert!(((middle - from).norm() - 0.4).abs() < 1e-9 && ((end - middle).norm() - 0.45).abs() < 1e-9);
        assert!((end - Vec3::new(0.1, 0.0, 0.3)).norm() < 1e-9 && middle.x > 0.05);
        let (_, end) = bend(from, Vec3::new(3.0, 0.0, 1.0), [0.4, 0.45], Vec3::z());
        assert!((end.x - 0.849).abs() < 2e-3 && end.z == 1.0);
    }
}
