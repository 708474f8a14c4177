//! Walking and running as phases of a cycle. Feet that touch the ground stay where they are while the body moves on.
//!
//! Step lengths follow the walking ratio: step length over cadence is 0.0065 m a step per minute in adults (Sekiya and Nagasaki
//! 1998), scaled to other legs by the Froude number (Alexander 1976). Shares of stance, angles of the feet at heel strike and
//! toe-off and swings of the arms: Perry and Burnfield, Gait Analysis (2010), and Novacheck 1998 for running.

use std::f64::consts::TAU;

use super::shell::Vec3;
use super::skeleton::{Arm, Foot, Pose, SIDES};
use super::stature::Body;

/// Phases of a cycle.
pub const N_PHASES: usize = 8;
/// Faster than this people run, on legs of an adult; metres a second.
const RUN_MPS: f64 = 2.1;
/// Length of the leg that the figures hold for.
const LEG_M: f64 = 0.86;
const GRAVITY_MPS2: f64 = 9.81;

/// How a body walks or runs at a speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gait {
    runs: bool,
    /// Way of two steps.
    pub stride_m: f64,
    /// Share of the cycle that a foot is on the ground.
    stance: f64,
    /// Half of the distance between the feet.
    half_track_m: f64,
    lean_rad: f64,
    /// How far the arms swing, and how much they are bent.
    swing_rad: f64,
    elbow_rad: f64,
}

/// Smooth from 0 to 1.
fn ease(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

impl Gait {
    /// `swing` is the person's own liveliness, about 1.
    pub fn new(body: &Body, speed_mps: f64, swing: f64) -> Self {
        let leg_m = body.leg_m();
        let runs = speed_mps > RUN_MPS * (leg_m / LEG_M).sqrt();
        let speed = speed_mps / (GRAVITY_MPS2 * leg_m).sqrt();
        let step_m = if runs { (0.42 + 0.80 * speed) * leg_m } else { (1.43 * speed).sqrt() * leg_m };
        let stride_m = 2.0 * step_m.min(1.5 * leg_m);
        if runs {
            let (lean_rad, half_track_m) = (0.16, 0.03 * body.height_m);
            Self {
                runs,
                stride_m,
                stance: 0.34,
                half_track_m,
                lean_rad,
                swing_rad: 0.75 * swing,
                elbow_rad: 1.55,
            }
        } else {
            let (lean_rad, half_track_m) = (0.03 + 0.02 * swing, 0.036 * body.height_m);
            let swing_rad = 0.4 * swing * speed / 0.45;
            Self { runs, stride_m, stance: 0.62, half_track_m, lean_rad, swing_rad, elbow_rad: 0.3 }
        }
    }

    /// The pose at a share of the cycle, which begins as the left heel comes down.
    pub fn pose(&self, body: &Body, share: f64) -> Pose {
        let leg_m = body.leg_m();
        let shares = [share, share + 0.5].map(|share| share.rem_euclid(1.0));
        let mut feet = shares.map(|share| self.foot(body, share));
        for (foot, side) in feet.iter_mut().zip(SIDES) {
            foot.ankle.y = side * self.half_track_m;
            foot.yaw_rad = side * 0.09;
        }
        // Highest over the standing foot, twice a cycle; in running highest in flight.
        let stands = (2.0 * TAU * (share - self.stance / 2.0)).cos();
        let height_m =
            if self.runs { (0.955 - 0.03 * stands) * leg_m } else { (0.985 + 0.005 * stands) * leg_m };
        let turn_rad = 0.09 * (TAU * (share - 0.02)).cos() * (self.stride_m / (1.6 * leg_m)).min(1.2);
        let arms = [0, 1].map(|i| {
            let forward = -(TAU * shares[i]).cos();
            Arm::Hangs {
                flexion_rad: 0.04 + self.swing_rad * (forward - 0.12),
                abduction_rad: 0.12,
                elbow_rad: self.elbow_rad * (1.0 + 0.45 * forward) + 0.05,
            }
        });
        Pose {
            pelvis: Vec3::new(0.0, 0.012 * (TAU * (share - 0.31)).cos(), body.ankle_m + height_m),
            pelvis_yaw_rad: -turn_rad,
            chest_yaw_rad: 0.9 * turn_rad,
            lean_rad: self.lean_rad,
            tilt_rad: 0.0,
            nod_rad: self.lean_rad * 0.5,
            look_rad: -0.5 * turn_rad,
            feet,
            arms,
        }
    }

    /// Where a foot is that has come down `share` of a cycle ago.
    fn foot(&self, body: &Body, share: f64) -> Foot {
        if share <= self.stance {
            return self.foot_on_ground(body, share);
        }
        let (off, on) = (self.foot_on_ground(body, self.stance), self.foot_on_ground(body, 0.0));
        let t = (share - self.stance) / (1.0 - self.stance);
        let lift_m = if self.runs { 0.34 * body.leg_m() } else { 0.035 * body.leg_m() };
        let mut ankle = off.ankle.lerp(&on.ankle, ease(t));
        let rise = (std::f64::consts::PI * t.powf(0.75)).sin();
        ankle.z = off.ankle.z + (on.ankle.z - off.ankle.z) * t + lift_m * rise;
        let fall = if self.runs { 0.75 } else { 0.62 };
        let pitch_rad = off.pitch_rad + (on.pitch_rad - off.pitch_rad) * ease(t / fall);
        let mut foot = Foot { ankle, pitch_rad, yaw_rad: 0.0 };
        // Toes and heel clear the ground.
        let low_m = lowest_m(body, &foot);
        let clear_m = 0.012 * body.height_m * rise;
        foot.ankle.z += (clear_m - low_m).max(0.0);
        foot
    }

    fn foot_on_ground(&self, body: &Body, share: f64) -> Foot {
        let (strike_rad, off_rad) = if self.runs { (0.1, -1.05) } else { (0.33, -0.98) };
        let (flat_from, flat_to) = if self.runs { (0.06, 0.15) } else { (0.08, 0.36) };
        let strike_rad = strike_rad * (self.stride_m / (1.6 * body.leg_m())).min(1.0);
        let [heel_m, ball_m] = soles(body);
        // The flat foot's ankle: under the hip in the middle of the stance, a little behind it when the toes leave.
        let ankle_m = (0.47 * self.stance - share) * self.stride_m;
        let (pivot_m, pitch_rad) = if share < flat_from {
            (heel_m, strike_rad * (1.0 - ease(share / flat_from)))
        } else {
            (ball_m, off_rad * ((share - flat_to) / (self.stance - flat_to)).max(0.0).powf(1.4))
        };
        let pivot = Vec3::new(ankle_m + pivot_m, 0.0, 0.0);
        let (sin, cos) = pitch_rad.sin_cos();
        // The ankle from the pivot, turned about it.
        let (x, z) = (-pivot_m, body.ankle_m);
        let ankle = pivot + Vec3::new(x * cos - z * sin, 0.0, x * sin + z * cos);
        Foot { ankle, pitch_rad, yaw_rad: 0.0 }
    }
}

/// Where the heel and the ball touch the ground, along the foot from the ankle.
pub fn soles(body: &Body) -> [f64; 2] {
    [-0.24 * body.foot_m, 0.52 * body.foot_m]
}

/// Height of the lowest of heel, ball and toes.
pub fn lowest_m(body: &Body, foot: &Foot) -> f64 {
    let (sin, cos) = foot.pitch_rad.sin_cos();
    let [heel_m, ball_m] = soles(body);
    let height_m = |x: f64| foot.ankle.z + x * sin - body.ankle_m * cos;
    height_m(heel_m).min(height_m(ball_m))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random;

    fn bodies() -> Vec<Body> {
        let mut rng = random::stream(3, "gait", 0);
        [3.0, 7.0, 12.0, 30.0, 70.0].map(|age| Body::draw(age, age > 20.0, &mut rng)).into()
    }

    #[test]
    fn a_foot_on_the_ground_neither_slides_nor_leaves_it() {
        for body in bodies() {
            for speed_mps in [0.7, 1.3, 3.0] {
                let gait = Gait::new(&body, speed_mps, 1.0);
                for i in 0..200 {
                    let share = f64::from(i) / 200.0;
                    let (before, now) = (gait.foot(&body, share), gait.foot(&body, share + 0.005));
                    assert!(lowest_m(&body, &now) > -1e-9, "in the ground");
                    if share + 0.005 > gait.stance {
                        continue;
                    }
                    assert!(lowest_m(&body, &now).abs() < 1e-9, "off the ground");
                    // Over the ground the body has moved on by this much.
                    let way_m = 0.005 * gait.stride_m;
                    let ground = |foot: &Foot, along_m: f64| {
                        let (sin, cos) = foot.pitch_rad.sin_cos();
                        foot.ankle.x + along_m * cos + body.ankle_m * sin
                    };
                    let slides =
                        soles(&body).map(|at| (ground(&now, at) + way_m - ground(&before, at)).abs());
                    assert!(slides[0].min(slides[1]) < 0.002, "{slides:?} at {share}");
                }
            }
        }
    }

    #[test]
    fn steps_are_as_long_as_people_make_them() {
        let mut rng = random::stream(4, "gait", 0);
        let man = Body { height_m: 1.75, hip_m: 0.93, ..Body::draw(30.0, false, &mut rng) };
        let walk = Gait::new(&man, 1.3, 1.0);
        assert!((1.25..1.6).contains(&walk.stride_m) && !walk.runs, "{}", walk.stride_m);
        let run = Gait::new(&man, 3.0, 1.0);
        assert!((1.9..2.6).contains(&run.stride_m) && run.runs, "{}", run.stride_m);
    }
}
