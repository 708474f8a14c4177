//! Poses of people who do not walk, and what arms do that hold something.

use rand::RngExt;

use super::shell::Vec3;
use super::skeleton::{Arm, Foot, Pose, SIDES};
use super::stature::Body;
use crate::random::Rng;

/// Height of a bench's seat, and of a wheelchair's, metres.
pub const BENCH_M: f64 = 0.47;
pub const WHEELCHAIR_M: f64 = 0.5;

/// What the hands are busy with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Holds {
    Nothing,
    /// In the hand of this side, 0 left, 1 right.
    Umbrella(usize),
    /// A bag hangs from the hand of this side.
    Bag(usize),
    /// A box before the chest, with both hands.
    Crate,
    /// A phone before the face.
    Phone(usize),
    /// A phone at the ear.
    Call(usize),
    /// A bar before the belly.
    Bar,
}

/// How someone stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stance {
    Easy,
    HandsInPockets,
    HandsOnHips,
    ArmsFolded,
    /// Speaks with the hands.
    Gestures,
}

fn hanging(rng: &mut Rng) -> [Arm; 2] {
    [0, 1].map(|_| Arm::Hangs {
        flexion_rad: -0.05 + 0.25 * rng.random::<f64>(),
        abduction_rad: 0.1 + 0.1 * rng.random::<f64>(),
        elbow_rad: 0.1 + 0.3 * rng.random::<f64>(),
    })
}

/// Upright, the weight more on one leg.
pub fn stand(body: &Body, stance: Stance, rng: &mut Rng) -> Pose {
    let h = body.height_m;
    let weight = rng.random::<f64>() * 2.0 - 1.0;
    let open_m = (0.045 + 0.035 * rng.random::<f64>()) * h;
    let feet = SIDES.map(|side| Foot {
        ankle: Vec3::new(0.04 * h * (rng.random::<f64>() - 0.5), side * open_m, body.ankle_m),
        pitch_rad: 0.0,
        yaw_rad: side * (0.1 + 0.3 * rng.random::<f64>()),
    });
    let shoulder_m = body.hip_m + body.trunk_m;
    let at = |x: f64, y: f64, z: f64| Arm::Reaches(Vec3::new(x * h, y * h, shoulder_m + z * h));
    let arms = match stance {
        Stance::Easy => hanging(rng),
        Stance::HandsInPockets => SIDES.map(|side| at(0.04, side * 0.115, -0.265)),
        Stance::HandsOnHips => SIDES.map(|side| at(0.02, side * 0.125, -0.2)),
        Stance::ArmsFolded => SIDES.map(|side| at(0.12, -side * 0.04, -0.11)),
        Stance::Gestures => SIDES.map(|side| {
            at(
                0.14 + 0.1 * rng.random::<f64>(),
                side * (0.06 + 0.1 * rng.random::<f64>()),
                -0.2 + 0.2 * rng.random::<f64>(),
            )
        }),
    };
    Pose {
        pelvis: Vec3::new(-0.01 * h, 0.02 * h * weight, body.ankle_m + 0.992 * body.leg_m()),
        pelvis_yaw_rad: 0.2 * (rng.random::<f64>() - 0.5),
        chest_yaw_rad: 0.3 * (rng.random::<f64>() - 0.5),
        lean_rad: 0.08 * rng.random::<f64>(),
        tilt_rad: -0.04 * weight,
        nod_rad: 0.2 * (rng.random::<f64>() - 0.4),
        look_rad: 1.0 * (rng.random::<f64>() - 0.5),
        feet,
        arms,
    }
}

/// On a seat whose front edge is behind the knees; the pelvis is over the origin.
pub fn sit(body: &Body, seat_m: f64, rng: &mut Rng) -> Pose {
    let h = body.height_m;
    let pelvis_m = seat_m + 0.062 * h * body.girth.max(0.8);
    // Small children's feet hang.
    let ankle_m = (pelvis_m - 0.98 * body.shank_m).max(body.ankle_m);
    let forward_m = body.thigh_m + body.shank_m * (0.25 * rng.random::<f64>() - 0.05);
    let open_m = (0.04 + 0.05 * rng.random::<f64>()) * h;
    let feet = SIDES.map(|side| Foot {
        ankle: Vec3::new(forward_m + 0.05 * h * (rng.random::<f64>() - 0.5), side * open_m, ankle_m),
        pitch_rad: 0.0,
        yaw_rad: side * 0.2 * rng.random::<f64>(),
    });
    let lean_rad = -0.22 + 0.5 * rng.random::<f64>().powi(2);
    let rests_m = 0.55 + 0.3 * rng.random::<f64>();
    let arms = SIDES
        .map(|side| Arm::Reaches(Vec3::new(rests_m * body.thigh_m, side * 0.05 * h, pelvis_m + 0.055 * h)));
    Pose {
        pelvis: Vec3::new(0.0, 0.0, pelvis_m),
        pelvis_yaw_rad: 0.0,
        chest_yaw_rad: 0.2 * (rng.random::<f64>() - 0.5),
        lean_rad,
        tilt_rad: 0.06 * (rng.random::<f64>() - 0.5),
        nod_rad: 0.15 + 0.3 * rng.random::<f64>(),
        look_rad: 1.2 * (rng.random::<f64>() - 0.5),
        feet,
        arms,
    }
}

/// Down to something on the ground before the feet: from the hips, or on bent knees.
pub fn stoop(body: &Body, rng: &mut Rng) -> Pose {
    let h = body.height_m;
    let knees = rng.random::<f64>();
    let feet = SIDES.map(|side| Foot {
        ankle: Vec3::new(0.06 * h * (rng.random::<f64>() - 0.5), side * 0.06 * h, body.ankle_m),
        pitch_rad: 0.0,
        yaw_rad: side * 0.2,
    });
    let leg_m = body.leg_m() * (0.95 - 0.4 * knees);
    let lean_rad = 1.5 - 0.65 * knees;
    let pelvis = Vec3::new(-0.1 * h - 0.05 * h * knees, 0.0, body.ankle_m + leg_m);
    let down_m = 0.22 * h + 0.05 * h * rng.random::<f64>();
    let arms = SIDES.map(|side| Arm::Reaches(Vec3::new(0.22 * h, side * 0.05 * h, down_m)));
    Pose {
        pelvis,
        pelvis_yaw_rad: 0.0,
        chest_yaw_rad: 0.1 * (rng.random::<f64>() - 0.5),
        lean_rad,
        tilt_rad: 0.0,
        nod_rad: 0.2,
        look_rad: 0.4 * (rng.random::<f64>() - 0.5),
        feet,
        arms,
    }
}

/// The arms as they hold something.
pub fn hold(pose: &mut Pose, body: &Body, holds: Holds) {
    let h = body.height_m;
    let pelvis_m = pose.pelvis.z;
    let shoulder =
        Vec3::new(body.trunk_m * pose.lean_rad.sin(), 0.0, pelvis_m + body.trunk_m * pose.lean_rad.cos());
    let at = |x: f64, y: f64, z: f64| Arm::Reaches(shoulder + Vec3::new(x * h, y * h, z * h));
    match holds {
        Holds::Nothing => {}
        Holds::Umbrella(i) => pose.arms[i] = at(0.13, SIDES[i] * 0.07, -0.06),
        Holds::Bag(i) => {
            pose.arms[i] = Arm::Hangs { flexion_rad: 0.03, abduction_rad: 0.14, elbow_rad: 0.08 };
        }
        Holds::Crate => pose.arms = SIDES.map(|side| at(0.19, side * 0.085, -0.19)),
        Holds::Phone(i) => {
            pose.arms[i] = at(0.15, SIDES[i] * 0.03, -0.08);
            pose.nod_rad = 0.45;
            pose.look_rad = 0.0;
        }
        Holds::Call(i) => pose.arms[i] = at(0.05, SIDES[i] * 0.08, 0.06),
        Holds::Bar => {
            pose.arms = SIDES.map(|side| at(0.2, side * 0.11, -0.17));
            pose.lean_rad += 0.06;
        }
    }
}
