//! Augmentation that keeps labels true: a mirror that turns the steering too, and other speeds and
//! steering angles for which the objects are labelled again by the zone.
//!
//! Speed and steering reach the network's last layers only, so one pass over a sample's sensors serves
//! several states: the recorded one and some drawn anew.

use rand::RngExt;

use super::config::AugmentConfig;
use crate::geometry::Point;
use crate::label::zone::{Zone, ZoneError};
use crate::object::LabelledObject;
use crate::random::Rng;
use crate::sample::EgoState;

/// An aimed steering angle points at an object, off by at most this many metres to a side.
const AIM_SPREAD_M: f64 = 4.0;

/// The objects of one sample as labelled for each of its states.
pub type ObjectsByState = Vec<Vec<LabelledObject>>;

/// How one sample is shown to the network this time.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Reflect the sensors' data.
    pub mirror: bool,
    /// The states before reflection; the recorded one is the first.
    pub states: Vec<EgoState>,
    /// The objects as labelled for each state, reflected with `mirror`.
    pub objects: ObjectsByState,
}

/// Draws a view of a sample, with `config.n_redrawn_states` states beside the recorded one.
///
/// # Errors
/// An object's box is not valid.
pub fn draw(
    recorded: &EgoState,
    objects: &[LabelledObject],
    zone: &Zone,
    config: &AugmentConfig,
    rng: &mut Rng,
) -> Result<View, ZoneError> {
    let mut states = vec![*recorded];
    let mut labelled = vec![objects.to_vec()];
    for _ in 0..config.n_redrawn_states {
        let state = redraw(recorded, objects, config, rng);
        let area = zone.rect(&state)?;
        let mut again = objects.to_vec();
        for object in &mut again {
            object.harm = area.harm_of(&object.truth.box_in_ego)?.harm;
        }
        states.push(state);
        labelled.push(again);
    }
    let mirror = config.mirror && rng.random::<bool>();
    if mirror {
        labelled.iter_mut().flatten().for_each(reflect);
    }
    Ok(View { mirror, states, objects: labelled })
}

/// A state with another speed and steering angle.
fn redraw(
    recorded: &EgoState,
    objects: &[LabelledObject],
    config: &AugmentConfig,
    rng: &mut Rng,
) -> EgoState {
    let max_angle_rad = config.max_steering_deg.to_radians();
    let speed_mps = rng.random::<f64>() * config.max_speed_mps;
    // The cube of a uniform number: mostly nearly straight, as cars drive, with large angles among them.
    let straight = (2.0 * rng.random::<f64>() - 1.0).powi(3) * max_angle_rad;
    let is_aimed = rng.random::<f64>() < config.aimed_share;
    let spread_m = (2.0 * rng.random::<f64>() - 1.0) * AIM_SPREAD_M;
    let aimed = (is_aimed && !objects.is_empty()).then(|| {
        let center = objects[rng.random_range(0..objects.len())].truth.box_in_ego.center;
        (center.y() + spread_m).atan2(center.x() - recorded.front_bumper_x_m)
    });
    let steering_angle_rad = aimed.filter(|angle| angle.abs() <= max_angle_rad).unwrap_or(straight);
    EgoState { speed_mps, steering_angle_rad, ..*recorded }
}

/// Reflects an object in the ego's x-z plane.
fn reflect(object: &mut LabelledObject) {
    let truth = &mut object.truth;
    let center = truth.box_in_ego.center;
    truth.box_in_ego.center = Point::new(center.x(), -center.y(), center.z());
    truth.box_in_ego.yaw_rad = -truth.box_in_ego.yaw_rad;
    truth.velocity_in_ego_mps[1] = -truth.velocity_in_ego_mps[1];
}
