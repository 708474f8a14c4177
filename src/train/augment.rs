//! Augmentation that keeps labels true: a mirror that turns the steering too, and other speeds and
//! steering angles for which the objects are labelled again by the zone.
//!
//! Speed and steering reach the network's last layers only, so one pass over a sample's sensors serves
//! several states: the recorded one and some drawn anew.

use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use super::config::AugmentConfig;
use crate::geometry::{Point, Point2};
use crate::object::LabelledObject;
use crate::random::Rng;
use crate::sample::EgoState;
use crate::zone::{Zone, ZoneError};

/// An aimed steering angle leads the zone to a point at most this many metres beside an object.
const AIM_SPREAD_M: f64 = 4.0;

/// The objects of one sample, labelled for each of its states.
pub type ObjectsByState = Vec<Vec<LabelledObject>>;

/// How one sample is shown to the network this time.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainView {
    /// Whether to reflect the sensors' data.
    pub mirror: bool,
    /// The states before reflection; the recorded one is the first.
    pub states: Vec<EgoState>,
    /// The objects with their labels for each state; reflected where `mirror` is set.
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
) -> Result<TrainView, ZoneError> {
    let mut states = vec![*recorded];
    let mut labelled = vec![objects.to_vec()];
    for _ in 0..config.n_redrawn_states {
        let state = redraw(recorded, objects, zone, config, rng);
        let area = zone.at(&state)?;
        let mut again = objects.to_vec();
        for object in &mut again {
            object.harm = area.harm_of_object(&object.truth)?.harm;
        }
        states.push(mismeasure(&state, config, rng));
        labelled.push(again);
    }
    let mirror = config.mirror && rng.random::<bool>();
    if mirror {
        labelled.iter_mut().flatten().for_each(reflect);
    }
    Ok(TrainView { mirror, states, objects: labelled })
}

/// Draws another speed and steering angle.
fn redraw(
    recorded: &EgoState,
    objects: &[LabelledObject],
    zone: &Zone,
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
        zone.steering_towards_rad(recorded, Point2 { x_m: center.x(), y_m: center.y() + spread_m })
    });
    let steering_angle_rad = aimed.filter(|angle| angle.abs() <= max_angle_rad).unwrap_or(straight);
    EgoState { speed_mps, steering_angle_rad, ..*recorded }
}

/// What a car's sensors might tell of a state.
fn mismeasure(state: &EgoState, config: &AugmentConfig, rng: &mut Rng) -> EgoState {
    if config.speed_error == 0.0 && config.steering_error_deg == 0.0 {
        return *state;
    }
    let mut normal = || -> f64 { StandardNormal.sample(rng) };
    EgoState {
        speed_mps: state.speed_mps * (1.0 + config.speed_error * normal()),
        steering_angle_rad: state.steering_angle_rad + config.steering_error_deg.to_radians() * normal(),
        ..*state
    }
}

/// Reflects an object in the ego's x-z plane.
fn reflect(object: &mut LabelledObject) {
    let truth = &mut object.truth;
    let center = truth.box_in_ego.center;
    truth.box_in_ego.center = Point::new(center.x(), -center.y(), center.z());
    truth.box_in_ego.yaw_rad = -truth.box_in_ego.yaw_rad;
    truth.velocity_in_ego_mps[1] = -truth.velocity_in_ego_mps[1];
    if let Some(solid) = &mut truth.solid {
        solid.across_m = -solid.across_m;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;
    use crate::object::Harm;
    use crate::random::stream;
    use crate::zone::ZoneKind;

    #[test]
    fn every_zone_labels_each_state_anew_before_the_mirror_and_alike_after() {
        for kind in ZoneKind::ALL {
            let dataset = test_data::dataset_of(6, kind);
            let (zone, config) = (dataset.zone(), AugmentConfig::default());
            let mut rng = stream(1, "augment-test", 0);
            let mut n_changed = 0;
            for sample in dataset.samples() {
                let recorded = &sample.measured.ego_state;
                let view = draw(recorded, &sample.objects, zone, &config, &mut rng).unwrap();
                assert_eq!(view.states.len(), 1 + config.n_redrawn_states);
                for (state, objects) in view.states.iter().zip(&view.objects) {
                    let sign = if view.mirror { -1.0 } else { 1.0 };
                    let seen = EgoState { steering_angle_rad: sign * state.steering_angle_rad, ..*state };
                    let here = zone.at(&seen).unwrap();
                    for (object, before) in objects.iter().zip(&sample.objects) {
                        let truth = &object.truth;
                        let harm = here.harm_of_object(truth).unwrap().harm;
                        assert_eq!(harm, object.harm, "{kind:?}");
                        n_changed += usize::from(object.harm != before.harm);
                    }
                }
            }
            assert!(n_changed > 5, "{kind:?}: {n_changed}");
        }
    }

    #[test]
    fn a_state_told_wrongly_keeps_the_labels_of_the_true_one() {
        let dataset = test_data::dataset(4);
        let exact = AugmentConfig { mirror: false, ..AugmentConfig::default() };
        let told = AugmentConfig { speed_error: 0.05, steering_error_deg: 1.0, ..exact };
        let sample = &dataset.samples()[0];
        let recorded = &sample.measured.ego_state;
        let view = |config, n| {
            let config = AugmentConfig { n_redrawn_states: n, ..config };
            draw(recorded, &sample.objects, dataset.zone(), &config, &mut stream(1, "augment-test", 2))
                .unwrap()
        };
        // One state: the draws before the error are the same.
        let (exact, told) = (view(exact, 1), view(told, 1));
        assert_eq!((told.states[0], &told.objects), (*recorded, &exact.objects));
        assert_ne!(told.states[1], exact.states[1]);
        let off = told.states[1].speed_mps / exact.states[1].speed_mps - 1.0;
        assert!(off.abs() < 0.25, "{off}");
    }

    #[test]
    fn aimed_angles_put_objects_into_the_zone_of_every_shape() {
        for kind in ZoneKind::ALL {
            let dataset = test_data::dataset_of(12, kind);
            let mut rng = stream(1, "augment-test", 1);
            let mut share_at = |aimed_share: f64| {
                let config = AugmentConfig { aimed_share, ..AugmentConfig::default() };
                let (mut n_harmful, mut n) = (0, 0);
                for sample in dataset.samples() {
                    let recorded = &sample.measured.ego_state;
                    let view = draw(recorded, &sample.objects, dataset.zone(), &config, &mut rng).unwrap();
                    for object in view.objects.iter().skip(1).flatten() {
                        n_harmful += usize::from(object.harm == Harm::Harmful);
                        n += 1;
                    }
                }
                f64::from(n_harmful as u32) / f64::from(n)
            };
            let (aimed, not_aimed) = (share_at(1.0), share_at(0.0));
            assert!(aimed > 1.2 * not_aimed, "{kind:?}: {aimed} {not_aimed}");
        }
    }
}
