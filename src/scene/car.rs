//! The ego's car: its dimensions, what its driver commands, and its MJCF.
//!
//! The body `ego` has its origin at the rear-axle centre projected to the ground, x forward: its
//! pose is the ego frame. Dimensions are a Renault Zoe's, the car of nuScenes.

use nalgebra::Vector3;

use super::builder::quaternion_text;
use super::ground::Ground;
use super::path::{Vec2, direction_of};

/// Distance between the axles.
pub const WHEELBASE_M: f64 = 2.588;
/// Front bumper's x in the ego frame.
pub const FRONT_BUMPER_X_M: f64 = 3.35;
pub const EGO_LENGTH_M: f64 = 4.084;
pub const EGO_WIDTH_M: f64 = 1.730;
pub const EGO_HEIGHT_M: f64 = 1.562;
/// Distance between the wheels of an axle.
pub const TRACK_M: f64 = 1.51;
pub const WHEEL_RADIUS_M: f64 = 0.31;
/// Largest road-wheel angle.
pub const MAX_STEERING_RAD: f64 = 0.6;
/// Physics step.
pub const TIMESTEP_S: f64 = 0.005;
/// Time constant of the wheels' speed control: a target of `speed + a * this` yields about `a`.
pub const DRIVE_RESPONSE_S: f64 = 0.15;
const EGO_MASS_KG: f64 = 1500.0;

/// Two steered wheels, then the spin of four: the order of `ctrl`.
pub const N_ACTUATORS: usize = 6;

/// The driver's commands to the car.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EgoCommand {
    /// Speed that the wheels are driven towards; see [`DRIVE_RESPONSE_S`].
    pub target_speed_mps: f64,
    /// Ackermann mean of the road wheels, positive to the left.
    pub steering_angle_rad: f64,
}

impl EgoCommand {
    /// The actuators' inputs, in their order: front wheel angles by Ackermann, wheel spin rates.
    pub fn ctrl(&self) -> [f64; N_ACTUATORS] {
        let mean = self.steering_angle_rad.clamp(-MAX_STEERING_RAD, MAX_STEERING_RAD);
        let curvature = mean.tan() / WHEELBASE_M;
        let (narrow, wide) = (1.0 - curvature * TRACK_M / 2.0, 1.0 + curvature * TRACK_M / 2.0);
        let (left, right) =
            ((WHEELBASE_M * curvature / narrow).atan(), (WHEELBASE_M * curvature / wide).atan());
        let rate = self.target_speed_mps / WHEEL_RADIUS_M;
        [left, right, rate * narrow / left.cos(), rate * wide / right.cos(), rate * narrow, rate * wide]
    }
}

/// The `<actuator>` element, in the order of [`EgoCommand::ctrl`].
pub(super) const ACTUATORS: &str = "<actuator>
<position name=\"steer_left\" joint=\"steer_fl\" kp=\"4000\" kv=\"200\" ctrlrange=\"-0.8 0.8\" forcerange=\"-3000 3000\"/>
<position name=\"steer_right\" joint=\"steer_fr\" kp=\"4000\" kv=\"200\" ctrlrange=\"-0.8 0.8\" forcerange=\"-3000 3000\"/>
<velocity name=\"spin_fl\" joint=\"spin_fl\" kv=\"240\" forcerange=\"-930 930\"/>
<velocity name=\"spin_fr\" joint=\"spin_fr\" kv=\"240\" forcerange=\"-930 930\"/>
<velocity name=\"spin_rl\" joint=\"spin_rl\" kv=\"240\" forcerange=\"-930 930\"/>
<velocity name=\"spin_rr\" joint=\"spin_rr\" kv=\"240\" forcerange=\"-930 930\"/>
</actuator>
";

/// The car with a light over it, its rear axle at a place on the ground.
pub(super) fn body_xml((position, yaw_rad): (Vec2, f64), ground: &Ground, light: &str) -> String {
    let center = position + direction_of(yaw_rad) * (WHEELBASE_M / 2.0);
    let (middle_m, turn) = ground.stance(center, yaw_rad, WHEELBASE_M, TRACK_M);
    let z_m = middle_m - (turn * Vector3::x()).z * WHEELBASE_M / 2.0;
    let quaternion = if ground.is_flat() {
        let (sin, cos) = (yaw_rad / 2.0).sin_cos();
        format!("{cos:.6} 0 0 {sin:.6}")
    } else {
        quaternion_text(&turn)
    };
    let center_x_m = FRONT_BUMPER_X_M - EGO_LENGTH_M / 2.0;
    let chassis_low_m = 0.2;
    let half_height_m = (EGO_HEIGHT_M - chassis_low_m) / 2.0;
    let wheel_mass_kg = 20.0;
    let mass_kg = EGO_MASS_KG - 4.0 * wheel_mass_kg;
    // Inertia of a homogeneous box; the mass lies low, as in a car.
    let [ixx, iyy, izz] = [
        mass_kg / 12.0 * (EGO_WIDTH_M.powi(2) + 1.0),
        mass_kg / 12.0 * (EGO_LENGTH_M.powi(2) + 1.0),
        mass_kg / 12.0 * (EGO_LENGTH_M.powi(2) + EGO_WIDTH_M.powi(2)),
    ];
    let mut body = format!(
        "<body name=\"ego\" pos=\"{:.4} {:.4} {z_m}\" quat=\"{quaternion}\">\n<freejoint name=\"ego\"/>\n\
         <inertial pos=\"{:.4} 0 0.4\" mass=\"{mass_kg}\" diaginertia=\"{ixx:.1} {iyy:.1} {izz:.1}\"/>\n\
         {light}\n\
         <geom name=\"ego_chassis\" type=\"box\" size=\"{:.4} {:.4} {half_height_m:.4}\" pos=\"{center_x_m:.4} 0 {:.4}\" group=\"4\" rgba=\"0.8 0.8 0.85 1\"/>\n",
        position.x,
        position.y,
        WHEELBASE_M / 2.0,
        EGO_LENGTH_M / 2.0,
        EGO_WIDTH_M / 2.0,
        chassis_low_m + half_height_m,
    );
    for (name, x_m, side) in
        [("fl", WHEELBASE_M, 1.0), ("fr", WHEELBASE_M, -1.0), ("rl", 0.0, 1.0), ("rr", 0.0, -1.0)]
    {
        let steer = if x_m > 0.0 {
            format!(
                "<joint name=\"steer_{name}\" type=\"hinge\" axis=\"0 0 1\" range=\"-0.85 0.85\" damping=\"40\" armature=\"2\"/>\n"
            )
        } else {
            String::new()
        };
        // Wheels touch the ground plane only (bit 2), the chassis other things only.
        body += &format!(
            "<body name=\"wheel_{name}\" pos=\"{x_m:.4} {:.4} {WHEEL_RADIUS_M}\">\n{steer}\
             <joint name=\"spin_{name}\" type=\"hinge\" axis=\"0 1 0\" armature=\"0.5\" damping=\"0.05\"/>\n\
             <geom type=\"cylinder\" size=\"{WHEEL_RADIUS_M} 0.1\" quat=\"0.7071068 0.7071068 0 0\" mass=\"{wheel_mass_kg}\" group=\"4\" \
             friction=\"1.1 0.005 0.0001\" rgba=\"0.1 0.1 0.1 1\"/>\n</body>\n",
            side * TRACK_M / 2.0
        );
    }
    body + "</body>\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inner_wheel_turns_more_and_slower() {
        let [left_rad, right_rad, .., rear_left_rps, rear_right_rps] =
            EgoCommand { target_speed_mps: 5.0, steering_angle_rad: 0.3 }.ctrl();
        assert!(left_rad > 0.3 && right_rad < 0.3 && right_rad > 0.2);
        assert!(rear_left_rps < rear_right_rps);
        let mean = f64::midpoint(rear_left_rps, rear_right_rps);
        assert!((mean * WHEEL_RADIUS_M - 5.0).abs() < 1e-12);
    }
}
