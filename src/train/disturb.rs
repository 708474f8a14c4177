//! Augmentation of what the sensors measure: other LiDARs, other makes' intensities, a cloud thinned, in fog or gone, a picture
//! of another exposure or gone, and a car that is pitched or rolled. Labels stay true: objects move with a tilt, and
//! their points are counted again.
//!
//! A network that has seen one sensor alone takes its rings and intensities for the world's (docs/real_logs.md), and
//! one whose LiDAR never fails learns nothing from the picture.

use std::sync::LazyLock;

use nalgebra::{UnitQuaternion, Vector3};
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use super::config::AugmentConfig;
use super::cut_out::count_returns;
use crate::geometry::{Ego, Transform};
use crate::model::Recolour;
use crate::object::LabelledObject;
use crate::random::Rng;
use crate::sample::{LidarPoint, Measured};
use crate::sensors::lidar::AddedFog;

/// Thinned clouds keep one of 2 to this many rings.
const MOST_RINGS_PER_KEPT: u16 = 4;
/// Intensity's offset, in units of `intensity_spread`.
const OFFSET_OF_SPREAD: f64 = 20.0;
/// Fogs that a cloud may get, equally likely, by optical range in metres: from thick to thin.
const FOGS_MOR_M: [f64; 6] = [50.0, 75.0, 110.0, 170.0, 250.0, 400.0];

static FOGS: LazyLock<[AddedFog; 6]> = LazyLock::new(|| FOGS_MOR_M.map(AddedFog::new));

/// What the network gets of a sample in place of its measurements.
pub struct Disturbed {
    pub measured: Measured,
    pub objects: Vec<LabelledObject>,
    /// The picture's new colours, `None` where it stays.
    pub colours: Option<Recolour>,
}

/// Disturbs a sample; `None` where nothing was drawn. A picture shows what covers at least `min_visible_px`.
pub fn disturb(
    measured: &Measured,
    objects: &[LabelledObject],
    min_visible_px: u32,
    config: &AugmentConfig,
    rng: &mut Rng,
) -> Option<Disturbed> {
    // What decides is drawn first, whatever is used, so that one key of the config does not decide of another.
    let mut normal = || -> f64 { StandardNormal.sample(rng) };
    let tilt = [normal(), normal(), normal()];
    let intensity = [normal(), normal(), normal()];
    let light = [normal(), normal(), normal(), normal(), normal()];
    let [of_thinned, of_cloud, of_picture, of_tilt, of_intensity, of_light, of_noise, of_drops, of_fog] =
        std::array::from_fn(|_| rng.random::<f64>());
    let no_cloud = of_cloud < config.no_cloud_share;
    // One of the two sensors sees.
    let no_picture = !no_cloud && of_picture < config.no_picture_share;

    let (whole, all) = (measured, objects);
    let mut disturbed = Disturbed { measured: measured.clone(), objects: objects.to_vec(), colours: None };
    let Disturbed { measured, objects, colours } = &mut disturbed;
    let mut is_changed = false;
    if config.tilt_deg > 0.0 && of_tilt < config.disturbed_share {
        turn(measured, objects, &tilt.map(|part| part * config.tilt_deg.to_radians()));
        is_changed = true;
    }
    // Fog takes intensities for what came back, so they must be the LiDAR's own.
    if of_fog < config.fogged_share {
        let fog = &FOGS[rng.random_range(0..FOGS.len())];
        let points = std::mem::take(&mut measured.points);
        measured.points = points.iter().filter_map(|point| fog.on(point, rng)).collect();
        is_changed = true;
    }
    if config.intensity_spread > 0.0 && of_intensity < config.disturbed_share {
        let [scale, gamma, offset] = intensity.map(|part| part * config.intensity_spread);
        bend(&mut measured.points, scale.exp(), gamma.exp(), offset * OFFSET_OF_SPREAD);
        is_changed = true;
    }
    if config.range_noise_m > 0.0 && of_noise < config.disturbed_share {
        let most_m = config.range_noise_m * rng.random::<f64>();
        for point in &mut measured.points {
            shift(point, most_m * (2.0 * rng.random::<f64>() - 1.0));
        }
        is_changed = true;
    }
    if config.dropped_share > 0.0 && of_drops < config.disturbed_share {
        let share = config.dropped_share * rng.random::<f64>();
        measured.points.retain(|_| rng.random::<f64>() >= share);
        is_changed = true;
    }
    if of_thinned < config.thinned_share {
        let step = rng.random_range(2..=MOST_RINGS_PER_KEPT);
        let first = rng.random_range(0..step);
        measured.points.retain(|point| point.ring % step == first);
        is_changed = true;
    }
    if no_cloud {
        measured.points.clear();
        // What only the cloud showed is no longer seen.
        let is_shown =
            |object: &LabelledObject| object.truth.visible_px.is_none_or(|px| px >= min_visible_px);
        for object in objects.iter_mut().filter(|object| !is_shown(object)) {
            object.truth.n_lidar_points = Some(0);
        }
        is_changed = true;
    }
    if no_picture {
        *colours = Some(Recolour::black());
        objects.iter_mut().for_each(|object| object.truth.visible_px = Some(0));
    } else if config.picture_spread > 0.0 && of_light < config.disturbed_share {
        let [gain, gamma, red, green, blue] = light.map(|part| part * config.picture_spread);
        let tint = |of: f64| (gain + 0.3 * of).exp();
        *colours = Some(Recolour::new([red, green, blue].map(tint), (0.7 * gamma).exp()));
    }
    if is_changed && !no_cloud {
        let (before, after) = (count_returns(whole, all), count_returns(measured, objects));
        let share = measured.points.len() as f64 / whole.points.len().max(1) as f64;
        for (object, (before, after)) in objects.iter_mut().zip(before.into_iter().zip(after)) {
            let of = &mut object.truth.n_lidar_points;
            *of = of.map(|recorded| left_of(recorded, before, after, share));
        }
    }
    (is_changed || colours.is_some()).then_some(disturbed)
}

/// What is left of so many recorded points, where a box and its margin held some before and hold others now. With noise a
/// point of an object's surface leaves its box, so that a box's own count tells little. Where it held none before, the cloud's
/// share stands for the object's.
fn left_of(recorded: u32, before: u32, after: u32, share: f64) -> u32 {
    match (recorded, before, after) {
        (0, _, _) | (_, 1.., 0) => 0,
        (_, 0, _) => (f64::from(recorded) * share.min(1.0)).round() as u32,
        _ => ((f64::from(recorded) * f64::from(after) / f64::from(before)).round() as u32).clamp(1, recorded),
    }
}

/// Rolls and pitches the car by angles in radians, and lifts it by a metre a radian: all that it measures turns.
fn turn(measured: &mut Measured, objects: &mut [LabelledObject], &[roll, pitch, lift]: &[f64; 3]) {
    let rotation = UnitQuaternion::from_euler_angles(roll, pitch, 0.0);
    let turned = Transform::<Ego, Ego>::new(Vector3::new(0.0, 0.0, lift), rotation);
    measured.ego_from_lidar = turned * measured.ego_from_lidar;
    measured.ego_from_camera = turned * measured.ego_from_camera;
    for object in objects {
        let of = &mut object.truth.box_in_ego;
        of.center = turned * of.center;
    }
}

/// Bends intensities as another make would tell them.
fn bend(points: &mut [LidarPoint], scale: f64, gamma: f64, offset: f64) {
    for point in points {
        let share = (f64::from(point.intensity) / 255.0).clamp(0.0, 1.0);
        point.intensity = (255.0 * scale * share.powf(gamma) + offset).clamp(0.0, 255.0) as f32;
    }
}

/// Moves a point along its beam.
fn shift(point: &mut LidarPoint, by_m: f64) {
    let at = Vector3::new(point.x_m, point.y_m, point.z_m);
    let range_m = at.norm();
    if range_m > 1.0 {
        let at = at * (1.0 + by_m as f32 / range_m);
        (point.x_m, point.y_m, point.z_m) = (at.x, at.y, at.z);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::{LabelledSample, test_data};
    use crate::random::stream;

    fn sample() -> LabelledSample {
        test_data::dataset(1).samples()[0].clone()
    }

    fn disturbed(config: &AugmentConfig, seed: u64) -> Option<Disturbed> {
        let sample = sample();
        disturb(&sample.measured, &sample.objects, 40, config, &mut stream(seed, "disturb-test", 0))
    }

    /// Without any disturbance.
    fn undisturbed() -> AugmentConfig {
        AugmentConfig {
            tilt_deg: 0.0,
            intensity_spread: 0.0,
            range_noise_m: 0.0,
            dropped_share: 0.0,
            picture_spread: 0.0,
            thinned_share: 0.0,
            fogged_share: 0.0,
            no_cloud_share: 0.0,
            no_picture_share: 0.0,
            ..AugmentConfig::default()
        }
    }

    #[test]
    fn what_is_left_of_an_objects_points_is_their_share_and_never_nothing_while_some_are_there() {
        assert_eq!([left_of(0, 3, 3, 1.0), left_of(10, 8, 0, 0.5), left_of(10, 0, 0, 0.5)], [0, 0, 5]);
        let left = |recorded, before, after| left_of(recorded, before, after, 1.0);
        assert_eq!([left(10, 8, 4), left(2, 40, 3), left(10, 8, 12)], [5, 1, 10]);
    }

    #[test]
    fn nothing_asked_for_changes_nothing() {
        assert!((0..20).all(|seed| disturbed(&undisturbed(), seed).is_none()));
    }

    #[test]
    fn objects_keep_their_points_when_the_car_tilts() {
        let config = AugmentConfig { tilt_deg: 2.0, disturbed_share: 1.0, ..undisturbed() };
        let (before, mut most_m) = (sample(), 0f64);
        for seed in 0..20 {
            let found = disturbed(&config, seed).unwrap();
            assert_eq!(found.measured.points, before.measured.points, "the sensors turn with the car");
            for (old, new) in before.objects.iter().zip(&found.objects) {
                // As the LiDAR sees it, an object stays where it is.
                let in_lidar = |measured: &Measured, object: &LabelledObject| {
                    measured.ego_from_lidar.inverse() * object.truth.box_in_ego.center
                };
                let moved = in_lidar(&found.measured, new).coords.coords
                    - in_lidar(&before.measured, old).coords.coords;
                assert!(moved.norm() < 1e-9);
                most_m =
                    most_m.max((new.truth.box_in_ego.center.z() - old.truth.box_in_ego.center.z()).abs());
            }
        }
        assert!(most_m > 0.2, "{most_m}");
    }

    #[test]
    fn a_thinned_cloud_keeps_whole_rings_and_objects_lose_their_points() {
        let config = AugmentConfig { thinned_share: 1.0, ..undisturbed() };
        let rings = |points: &[LidarPoint]| -> std::collections::BTreeSet<u16> {
            points.iter().map(|point| point.ring).collect()
        };
        let before = sample();
        for seed in 0..10 {
            let found = disturbed(&config, seed).unwrap();
            let (kept, all) = (rings(&found.measured.points), rings(&before.measured.points));
            assert!(kept.is_subset(&all) && 2 * kept.len() <= all.len() + 2);
            let whole = before.measured.points.iter().filter(|point| kept.contains(&point.ring));
            assert_eq!(whole.count(), found.measured.points.len());
            let n = |objects: &[LabelledObject]| -> u32 {
                objects.iter().filter_map(|object| object.truth.n_lidar_points).sum()
            };
            assert!(n(&found.objects) <= n(&before.objects));
        }
    }

    #[test]
    fn fog_takes_far_points_and_what_is_left_of_an_object_is_counted() {
        let config = AugmentConfig { fogged_share: 1.0, ..undisturbed() };
        let before = sample();
        let n_far = |of: &Measured| of.points.iter().filter(|p| p.range_m() > 30.0).count();
        let mut n_left = 0;
        for seed in 0..10 {
            let found = disturbed(&config, seed).unwrap();
            n_left += n_far(&found.measured);
            assert!(n_far(&found.measured) <= n_far(&before.measured));
            for (old, new) in before.objects.iter().zip(&found.objects) {
                assert!(new.truth.n_lidar_points <= old.truth.n_lidar_points);
            }
        }
        assert!(n_left < 10 * n_far(&before.measured), "{n_left}");
    }

    #[test]
    fn what_only_a_lost_cloud_showed_is_no_object() {
        let mut of = sample();
        of.objects[0].truth.visible_px = Some(0);
        let config = AugmentConfig { no_cloud_share: 1.0, ..undisturbed() };
        let found =
            disturb(&of.measured, &of.objects, 40, &config, &mut stream(1, "disturb-test", 0)).unwrap();
        assert!(!found.objects[0].truth.is_hit() && found.objects[1..].iter().any(|of| of.truth.is_hit()));
    }

    #[test]
    fn never_are_both_sensors_gone() {
        let config = AugmentConfig { no_cloud_share: 0.5, no_picture_share: 0.9, ..undisturbed() };
        let (mut n_without_cloud, mut n_black) = (0, 0);
        for seed in 0..60 {
            let Some(found) = disturbed(&config, seed) else { continue };
            let (no_cloud, is_black) =
                (found.measured.points.is_empty(), found.colours == Some(Recolour::black()));
            assert!(!(no_cloud && is_black));
            if no_cloud {
                assert!(found.objects.iter().any(|object| object.truth.is_hit()), "they stay true objects");
            }
            assert!(!is_black || found.objects.iter().all(|object| object.truth.visible_px == Some(0)));
            n_without_cloud += u32::from(no_cloud);
            n_black += u32::from(is_black);
        }
        assert!((15..45).contains(&n_without_cloud) && (15..45).contains(&n_black));
    }

    #[test]
    fn another_makes_intensities_stay_in_range_and_order() {
        let config = AugmentConfig { intensity_spread: 0.5, disturbed_share: 1.0, ..undisturbed() };
        let before = sample();
        for seed in 0..10 {
            let found = disturbed(&config, seed).unwrap();
            let mut pairs: Vec<(f32, f32)> = before
                .measured
                .points
                .iter()
                .zip(&found.measured.points)
                .map(|(old, new)| (old.intensity, new.intensity))
                .collect();
            pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
            assert!(pairs.iter().all(|(_, new)| (0.0..=255.0).contains(new)));
            assert!(pairs.windows(2).all(|pair| pair[0].1 <= pair[1].1 + 1e-3));
        }
    }
}
