//! Episodes whose rigs vary: metadata, calibration and points are those of the rig as drawn, and labels stay.

use std::path::Path;

use super::GenerateConfig;
use super::episode::tests::record_first;
use crate::episode::EpisodeReader;
use crate::sensors::{LidarVariationConfig, OdometryVariationConfig, Rig, RigConfig, RigVariationConfig};

fn record(rig_variation: RigVariationConfig, folder: &Path) -> EpisodeReader {
    let config = GenerateConfig {
        towns: vec!["suburb".into()],
        seed: 3,
        samples: 2,
        warm_up_s: [4.0, 4.0],
        rig_variation,
        ..GenerateConfig::default()
    };
    record_first(&config, folder)
}

#[test]
fn an_episode_is_that_of_the_rig_that_its_metadata_tells() {
    let folder = tempfile::tempdir().unwrap();
    let lidar = LidarVariationConfig {
        lost_beams_share: 1.0,
        lost_beams: [0.2, 0.3],
        intensity_share: 1.0,
        intensity_steps: [16.0, 40.0],
        place_share: 1.0,
        ..LidarVariationConfig::default()
    };
    let variation = RigVariationConfig { enabled: true, lidar, ..RigVariationConfig::default() };
    let episode = record(variation.clone(), folder.path());
    let told: RigConfig = toml::from_str(&episode.meta().rig_toml).unwrap();
    assert_eq!(told, variation.draw(&RigConfig::default(), episode.meta().seed));
    let rig = Rig::try_from(&told).unwrap();
    let (lost, steps) = (&rig.top().config.lost_beams, f64::from(rig.top().config.intensity.steps - 1));
    assert!(!lost.is_empty() && *rig.top() != *Rig::try_from(&RigConfig::default()).unwrap().top());
    for sample in episode.samples() {
        let measured = sample.unwrap().measured;
        assert_eq!(measured.ego_from_lidar, rig.top().ego_from_lidar);
        assert_eq!(measured.ego_from_camera, rig.front().ego_from_camera);
        assert_eq!(measured.intrinsics, rig.front().intrinsics);
        assert!(measured.points.len() > 300, "{}", measured.points.len());
        for point in &measured.points {
            assert!(!lost.contains(&point.ring), "beam {} is dead", point.ring);
            let step = f64::from(point.intensity) / 255.0 * steps;
            assert!((step - step.round()).abs() < 1e-3, "{} in {steps} steps", point.intensity);
        }
    }
}

#[test]
fn what_the_car_mismeasures_changes_no_truth() {
    let folder = tempfile::tempdir().unwrap();
    let odometry = OdometryVariationConfig {
        share: 1.0,
        speed_factor: [1.05, 1.05],
        speed_noise_mps: [0.0, 0.0],
        steering_bias_deg: [1.0, 1.0],
        steering_noise_deg: [0.0, 0.0],
    };
    let still = LidarVariationConfig {
        model_share: 0.0,
        place_share: 0.0,
        lost_beams_share: 0.0,
        azimuth_share: 0.0,
        noise_share: 0.0,
        intensity_share: 0.0,
        drop_share: 0.0,
        ..LidarVariationConfig::default()
    };
    let mut variation =
        RigVariationConfig { enabled: true, lidar: still, odometry, ..RigVariationConfig::default() };
    variation.camera.focal_share = 0.0;
    variation.camera.place_share = 0.0;
    variation.camera.exposure_share = 0.0;
    variation.camera.blur_share = 0.0;
    variation.camera.quality_share = 0.0;
    let errs = record(variation, &folder.path().join("errs"));
    let exact = record(RigVariationConfig::default(), &folder.path().join("exact"));
    for (told, known) in errs.samples().zip(exact.samples()) {
        let (told, known) = (told.unwrap(), known.unwrap());
        assert_eq!((told.objects(), told.true_state()), (known.objects(), known.true_state()));
        let (measured, state) = (&told.measured.ego_state, told.true_state());
        assert!((measured.speed_mps - 1.05 * state.speed_mps).abs() < 1e-12);
        let off_rad = measured.steering_angle_rad - state.steering_angle_rad;
        assert!((off_rad - 1_f64.to_radians()).abs() < 1e-12);
        assert!(known.truth.unwrap().ego_state.is_none());
        assert_eq!(told.measured.points, known.measured.points);
        assert_eq!(told.measured.image, known.measured.image);
    }
}
