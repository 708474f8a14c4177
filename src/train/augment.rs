//! Augmentation that keeps labels true: a mirror that turns the steering too, and speed and steering
//! drawn anew with the objects labelled again by the zone.

use rand::RngExt;

use super::config::AugmentConfig;
use crate::geometry::Point;
use crate::label::zone::{Zone, ZoneError};
use crate::object::LabelledObject;
use crate::random::Rng;
use crate::sample::EgoState;

/// How one sample is shown to the network this time.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Reflect the sensors' data.
    pub mirror: bool,
    /// The state before reflection.
    pub state: EgoState,
    /// The objects as labelled for that state, reflected with `mirror`.
    pub objects: Vec<LabelledObject>,
}

/// Draws a view of a sample.
///
/// # Errors
/// An object's box is not valid.
pub fn draw(
    state: &EgoState,
    objects: &[LabelledObject],
    zone: &Zone,
    config: &AugmentConfig,
    rng: &mut Rng,
) -> Result<View, ZoneError> {
    let mut state = *state;
    let mut objects = objects.to_vec();
    if rng.random::<f64>() < config.redraw_state_share {
        state.speed_mps = rng.random::<f64>() * config.max_speed_mps;
        // The cube of a uniform number: mostly nearly straight, as cars drive, with large angles among them.
        state.steering_angle_rad =
            (2.0 * rng.random::<f64>() - 1.0).powi(3) * config.max_steering_deg.to_radians();
        let area = zone.rect(&state)?;
        for object in &mut objects {
            object.harm = area.harm_of(&object.truth.box_in_ego)?.harm;
        }
    }
    let mirror = config.mirror && rng.random::<bool>();
    if mirror {
        for object in &mut objects {
            let truth = &mut object.truth;
            let center = truth.box_in_ego.center;
            truth.box_in_ego.center = Point::new(center.x(), -center.y(), center.z());
            truth.box_in_ego.yaw_rad = -truth.box_in_ego.yaw_rad;
            truth.velocity_in_ego_mps[1] = -truth.velocity_in_ego_mps[1];
        }
    }
    Ok(View { mirror, state, objects })
}
